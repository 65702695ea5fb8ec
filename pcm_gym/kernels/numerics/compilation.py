"""How every kernel is compiled: two decorators, one set of options, one cache."""

import gc
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cached_property
from typing import Any, TypeVar

from numba.core import config
from numba.core.compiler import CompileResult, Flags, compile_extra
from numba.core.compiler_lock import global_compiler_lock
from numba.core.dispatcher import _FunctionCompiler  # type: ignore[attr-defined]
from numba.core.registry import CPUDispatcher
from numba.core.types import unliteral  # type: ignore[attr-defined]

from pcm_gym.kernels.numerics.cache import KernelCache, PartCache
from pcm_gym.kernels.numerics.libraries import Entry, Part, Whole
from pcm_gym.kernels.numerics.notice import expect as expect

Function = TypeVar("Function", bound=Callable[..., Any])

_OPTIONS = {"nopython": True, "boundscheck": None, "error_model": "numpy", "nogil": True, "no_cfunc_wrapper": True}


def kernel(function: Function) -> Function:
    """Compile `function` to machine code on its first call and keep the result on disk.

    Division by zero follows IEEE 754 in every kernel (inf and nan, no exception), and fast-math is never used: it
    would make ``isnan`` constant. Kernels let go of Python's global lock, so that threads may run them side by side.
    With ``NUMBA_DISABLE_JIT=1`` the plain Python function is returned.
    """
    return _compiled(function)


def shared_kernel(function: Function) -> Function:
    """Compile a large `kernel` once: its machine code is no part of those that call it, they share it.

    For what several kernels call that Python calls, and calls of which take long beside the call itself.
    """
    return _compiled(function, is_shared=True)


def formula(function: Function) -> Function:
    """Compile a formula, numbers in and numbers out, like a `kernel`, into the machine code of whoever calls it.

    A loop over the rows of a batch is turned into vector instructions only if all that it calls is part of it.
    """
    return _compiled(function, is_formula=True)


def _compiled(function: Function, *, is_formula: bool = False, is_shared: bool = False) -> Function:
    return function if config.DISABLE_JIT else Kernel(function, is_formula, is_shared)


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
            del self._cache  # Numba's, which is none

    @cached_property
    def _cache(self) -> PartCache:
        return PartCache(self.py_func)

    @property
    def is_kept(self) -> bool:
        """Whether there is something of it on disk."""
        return self._cache.is_kept


class Kernel(CPUDispatcher):
    """A kernel as Python calls it; for kernels that call it there is a part."""

    is_part = False

    def __init__(self, function: Callable[..., Any], is_formula: bool, is_shared: bool) -> None:
        super().__init__(function, targetoptions=_OPTIONS)
        self._compiler = _CompilerInto(self, Whole)
        del self._cache  # Numba's, which is none
        self.is_formula, self.is_shared = is_formula, is_shared
        self._own_part: _PartOfOthers | None = None

    @cached_property
    def _cache(self) -> KernelCache:
        # there are hundreds of kernels, of which a process calls a few
        return KernelCache(self.py_func)

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
        if not self.is_formula:  # one machine code for all constants
            args, kws = tuple(map(unliteral, args)), {name: unliteral(own) for name, own in kws.items()}
        return super().get_call_template(args, kws) if self.is_shared else self.part.get_call_template(args, kws)

    def get_overload(self, sig: Any) -> Any:
        """Return what Numba knows the function by that a kernel calls."""
        return super().get_overload(sig) if self.is_shared else self.part.get_overload(sig)

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
                if self.is_shared:
                    function = self.py_func
                    own = Entry(function.__module__, function.__name__, result.signature.args, _symbol(result))
                    result.library._reload_init.add(own)  # which Numba hands on to all that is built on it
            return entry

    def address(self, signature: tuple[Any, ...]) -> int:
        """Return where the machine code for a signature is, compiled or loaded if need be."""
        self.compile(signature)
        result = self.overloads[signature]
        found: int = result.library.get_pointer_to_function(_symbol(result))
        return found


def _symbol(result: CompileResult) -> str:
    name: str = result.fndesc.llvm_func_name
    return name


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
