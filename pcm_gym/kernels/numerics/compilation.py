"""How every kernel is compiled: two decorators, one set of options, one cache."""

import sys
from collections.abc import Callable
from typing import Any, TypeVar

import numba
from numba.core import config, event

from pcm_gym.kernels.numerics.cache import KernelCache, cache_root

Function = TypeVar("Function", bound=Callable[..., Any])


def kernel(function: Function) -> Function:
    """Compile `function` to machine code on its first call and keep the result on disk.

    Division by zero follows IEEE 754 in every kernel (inf and nan, no exception), and fast-math is never used: it
    would make ``isnan`` constant. Kernels let go of Python's global lock, so that threads may run them side by side.
    With ``NUMBA_DISABLE_JIT=1`` the plain Python function is returned.
    """
    return _compiled(function, forceinline=False)


def formula(function: Function) -> Function:
    """Compile a formula, numbers in and numbers out, like a `kernel`, into the machine code of whoever calls it.

    A loop over the rows of a batch is turned into vector instructions only if all that it calls is part of it.
    """
    return _compiled(function, forceinline=True)


def _compiled(function: Function, *, forceinline: bool) -> Function:
    compiled = numba.njit(error_model="numpy", nogil=True, forceinline=forceinline)(function)
    if not config.DISABLE_JIT:
        compiled._cache = KernelCache(function)  # what Numba's own `cache=True` does, with its own class
    return compiled  # type: ignore[no-any-return]


class _CompilationNotice(event.Listener):
    """Says on standard error that kernels are being compiled, the first time that really happens."""

    def __init__(self) -> None:
        self._said = False

    def on_start(self, event: event.Event) -> None:
        dispatcher = event.data.get("dispatcher")
        module = getattr(getattr(dispatcher, "py_func", None), "__module__", "") or ""
        if not self._said and module.startswith("pcm_gym."):
            self._said = True
            print(
                f"pcm_gym: compiling the kernels, once for this version (about a minute), into {cache_root()}",
                file=sys.stderr,
                flush=True,
            )

    def on_end(self, event: event.Event) -> None:
        """Nothing to do: the notice is about the start."""


event.register("numba:compile", _CompilationNotice())
