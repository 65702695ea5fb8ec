"""How every kernel is compiled: two decorators, one set of options, one cache."""

import gc
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, TypeVar

from numba.core import config
from numba.core.compiler import CompileResult, Flags, compile_extra
from numba.core.compiler_lock import global_compiler_lock
from numba.core.dispatcher import _FunctionCompiler  # type: ignore[attr-defined]
from numba.core.registry import CPUDispatcher

from pcm_gym.kernels.numerics.cache import KernelCache, PartCache
from pcm_gym.kernels.numerics.libraries import Part, Whole
from pcm_gym.kernels.numerics.notice import expect as expect

Function = TypeVar("Function", bound=Callable[..., Any])

_OPTIONS = {"nopython": True, "boundscheck": None, "error_model": "numpy", "nogil": True, "no_cfunc_wrapper": True}


def kernel(function: Function) -> Function:
    """Compile `function` to machine code on its first call and keep the result on disk.

    Division by zero follows IEEE 754 in every kernel (inf and nan, no exception), and fast-math is never used: it
    would make ``isnan`` constant. Kernels let go of Python's global lock, so that threads may run them side by side.
    With ``NUMBA_DISABLE_JIT=1`` the plain Python function is returned.
    """
    return _compiled(function, is_formula=False)


def formula(function: Function) -> Function:
    """Compile a formula, numbers in and numbers out, like a `kernel`, into the machine code of whoever calls it.

    A loop over the rows of a batch is turned into vector instructions only if all that it calls is part of it.
    """
    return _compiled(function, is_formula=True)


def _compiled(function: Function, *, is_formula: bool) -> Function:
    return function if config.DISABLE_JIT else Kernel(function, is_formula)


class _CompilerInto(_FunctionCompiler):
    """Compiles a function into a library of some kind."""

    def __init__(self, dispatcher: CPUDispatcher, library: type[Part] | type[Whole]) -> None:
        own = dispatcher._compiler
        super().__init__(own.py_func, own.targetdescr, own.targetoptions, own.locals, own.pipeline_class)
        self._library = library

    def _compile_core(self, args: Any, return_type: Any) -> CompileResult:
        flags, target = Flags(), self.targetdescr
        target.options.parse_as_flags(flags, self.targetoptions)
        library = self._library(target.target_context.codegen(), self.py_func.__qualname__)
        library.enable_object_caching()
        return compile_extra(
            target.typing_context,
            target.target_context,
            self.py_func,
            args=args,
            return_type=return_type,
            flags=flags,
            locals=self.locals,
            library=library,
            pipeline_class=self.pipeline_class,
        )


class _PartOfOthers(CPUDispatcher):
    """A kernel as kernels call it."""

    is_part = True

    def __init__(self, function: Callable[..., Any], is_formula: bool) -> None:
        super().__init__(function, targetoptions={**_OPTIONS, "no_cpython_wrapper": True, "forceinline": is_formula})
        self._compiler = _CompilerInto(self, Part)
        if not is_formula:  # a formula is within the kernels that are kept
            self._cache = PartCache(function)

    @property
    def is_kept(self) -> bool:
        """Whether there is something of it on disk."""
        return self._cache.is_kept


class Kernel(CPUDispatcher):
    """A kernel as Python calls it; for kernels that call it there is a part."""

    is_part = False

    def __init__(self, function: Callable[..., Any], is_formula: bool) -> None:
        super().__init__(function, targetoptions=_OPTIONS)
        self._compiler = _CompilerInto(self, Whole)
        self._cache = KernelCache(function)
        self.is_formula = is_formula
        self._own_part: _PartOfOthers | None = None

    @property
    def is_kept(self) -> bool:
        """Whether there is machine code of it on disk."""
        return self._cache.is_kept

    @property
    def part(self) -> _PartOfOthers:
        """The kernel as kernels call it."""
        if self._own_part is None:
            self._own_part = _PartOfOthers(self.py_func, self.is_formula)
        return self._own_part

    def get_call_template(self, args: Any, kws: Any) -> Any:
        """Return how Numba is to type a call from a kernel."""
        return self.part.get_call_template(args, kws)

    def get_overload(self, sig: Any) -> Any:
        """Return what Numba knows the function by that a kernel calls."""
        return self.part.get_overload(sig)

    @property
    def is_compiling(self) -> Any:
        """Whether it is being compiled, in which case a call to it is a recursion."""
        return self._compiling_counter or (self._own_part is not None and self._own_part.is_compiling)

    def compile(self, sig: Any) -> Any:
        """Compile the kernel for a signature, or load it; return what Python can call."""
        with global_compiler_lock, _no_collection():
            known = len(self.overloads)
            entry = super().compile(sig)
            if len(self.overloads) > known:
                result = next(reversed(self.overloads.values()))
                for environment in result._find_referenced_environments():  # those of its parts too
                    result.library.codegen.set_env(environment.env_name, environment)
            return entry


@contextmanager
def _no_collection() -> Iterator[None]:
    """Let no garbage be collected, which takes a seventh of the time: the compiler makes millions of objects."""
    was_on = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_on:
            gc.enable()
