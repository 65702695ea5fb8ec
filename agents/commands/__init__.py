"""How training and evaluation are asked for: one command in each file, put together in `app`.

They load what is heavy only when they run, so that ``--help`` is quick.
"""
