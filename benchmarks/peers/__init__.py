"""Our step on the 2RFR beside the ways that people take to the same tip: ``python -m benchmarks peers``.

All follow one closed path of inputs (`problem`), in one thread and in turn, each set up for its advantage; the
module of each says how and why. A new one is a module here and a line in `catalogue`.
"""
