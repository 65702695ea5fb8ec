"""What is said on standard error while kernels are compiled: what is at work, and how much is left.

The amount of work is known before: which kernels a kernel calls stands in its code. A kernel counts as one as a part of
others, and machine code as one and `_WHOLE` for each kernel in it. What is kept on disk, and what Numba brings along,
counts as nothing.
"""

import sys
import time
from collections.abc import Callable, Iterator
from typing import Any

from numba.core import event

from pcm_gym.kernels.numerics.cache import cache_root

# What machine code costs, for each kernel in it, in terms of what a kernel costs as a part of others.
_WHOLE = 0.25
# Seconds between two lines, and until the first one that says how much is left.
_PAUSE = 5.0

# A kernel, as a part of others or not.
_Piece = tuple[Callable[..., Any], bool]


class _Notice(event.Listener):
    """Counts what is compiled, and says so."""

    def __init__(self) -> None:
        self._left: dict[_Piece, float] = {}
        self._known: set[_Piece] = set()
        self._done, self._begun, self._said = 0.0, 0.0, 0.0

    def expect(self, kernel: Any) -> None:
        """Count a kernel that Python will call, with all it calls, among what is to be done."""
        whole = (kernel.py_func, False)
        if whole in self._known:
            return
        self._known.add(whole)
        if kernel.is_kept:
            return
        below = list(_kernels_below(kernel))
        self._left[whole] = 1.0 + _WHOLE * len(below)
        for called in below:
            part = (called.py_func, True)
            if called.is_shared:
                self.expect(called)
            elif part not in self._known and not called.part.is_kept:
                self._known.add(part)
                self._left[part] = 1.0

    def on_start(self, event: event.Event) -> None:
        """Say what begins."""
        dispatcher = event.data["dispatcher"]
        if not _is_ours(dispatcher):
            return
        if not dispatcher.is_part:
            self.expect(dispatcher)
        if self._begun == 0.0:
            self._begun = self._said = time.monotonic()
            _say(f"compiling the kernels, once for this version, into {cache_root()}")
        elif time.monotonic() - self._said > _PAUSE:
            self._said = time.monotonic()
            _say(f"compiling {dispatcher.py_func.__name__}, {self._progress(self._said - self._begun)}")

    def on_end(self, event: event.Event) -> None:
        """Count what is done."""
        dispatcher = event.data["dispatcher"]
        if _is_ours(dispatcher):
            self._done += self._left.pop((dispatcher.py_func, dispatcher.is_part), 0.0)

    def _progress(self, seconds: float) -> str:
        left = sum(self._left.values())
        share = self._done / (self._done + left) if self._done > 0.0 else 0.0
        remaining = f", about {seconds * left / self._done:.0f} s left" if share > 0.05 else ""
        return f"{100.0 * share:.0f} % done{remaining}"


def _is_ours(dispatcher: Any) -> bool:
    return hasattr(dispatcher, "is_part")


def _kernels_below(kernel: Any) -> Iterator[Any]:
    """Yield all that a kernel calls and takes over, and those that it shares with others.

    Formulas are left out, which are within their callers.
    """
    found, pending = {kernel}, [kernel]
    while pending:
        above = pending.pop()
        if above is not kernel and not above.is_formula:
            yield above
        if above is kernel or not above.is_shared:
            new = _named_in(above.py_func) - found
            found |= new
            pending.extend(new)


def _named_in(function: Any) -> set[Any]:
    """Return the kernels that stand in a function's code."""
    named = (function.__globals__.get(name) for name in function.__code__.co_names)
    return {called for called in named if _is_ours(called)}


def _say(text: str) -> None:
    print(f"pcm_gym: {text}", file=sys.stderr, flush=True)


_notice = _Notice()
event.register("numba:compile", _notice)


def expect(*functions: Callable[..., Any]) -> None:
    """Announce kernels that Python is about to call, so that how much is left to compile counts all of them.

    In place of a kernel there may be a plain function that calls some.
    """
    for function in functions:
        for kernel in [function] if _is_ours(function) else _named_in(function):
            _notice.expect(kernel)
