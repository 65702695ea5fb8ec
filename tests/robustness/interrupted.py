"""A process that is interrupted in public calls: what `signals` starts.

Each line of standard input is the name of a call. It makes that call until it is interrupted, and then gives the call's
answer; after a name with ``?`` before it only the answer. It prints what becomes of that in lines of JSON.
"""

import hashlib
import importlib
import json
import signal
import sys
import time
from typing import Any

import numpy as np

from tests.robustness.calls import CALLS, Interruptible

# Others cannot be imported again where their import was interrupted, NumPy for one.
FOREIGN = ("numpy", "scipy.sparse.csgraph", "numba", "gymnasium")


def say(**values: Any) -> None:
    print(json.dumps(values), flush=True)


def tell_answer(made: Interruptible) -> None:
    """Say the digest of the answer, or what went wrong with it."""
    try:
        answer = made.answer()
    except BaseException as error:
        say(state="wrong", why=f"the next call: {type(error).__name__}: {error}")
        return
    digest = hashlib.sha256(str(len(answer)).encode())
    for array in answer:
        digest.update(np.ascontiguousarray(array).tobytes())
    say(state="answered", digest=digest.hexdigest())


def interrupt(made: Interruptible) -> None:
    """Make the call until the interruption comes."""
    try:
        say(state="running")
        while True:
            made.call()
    except KeyboardInterrupt:
        wall, processor = time.monotonic(), time.process_time()
    except BaseException as error:
        say(state="wrong", why=f"{type(error).__name__}: {error}")
        return
    say(state="interrupted", wall=wall, processor=processor)


def main() -> None:
    signal.signal(signal.SIGINT, signal.default_int_handler)  # whoever starts this in the background ignores it
    for module in FOREIGN:
        importlib.import_module(module)
    made: dict[str, Interruptible] = {}
    say(state="ready")
    for line in sys.stdin:
        name = line.strip().removeprefix("?")
        if name not in made:
            made[name] = CALLS[name]()
        if not line.startswith("?"):
            interrupt(made[name])
        else:
            started = time.monotonic()
            made[name].call()
            say(state="timed", seconds=time.monotonic() - started)
        tell_answer(made[name])


if __name__ == "__main__":
    main()
