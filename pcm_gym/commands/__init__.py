"""The command ``pcm-gym``: one file for each kind of command, put together in `app`.

Read `app` (what there is), then `arguments` and `output`, which all commands share, and `errors` (what is said where
something fails, and the exit codes). Commands import the mechanics, NumPy and all else that is heavy only when they
run, so that ``--help``, ``--version`` and completion are quick. `checkout` hands over to what a checkout has beside the
package: training, evaluation and the paper's figures.
"""
