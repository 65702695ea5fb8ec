"""What becomes of a kernel's code: a part of the machine code of others, or machine code of its own.

Numba turns every function into machine code, with all that it calls in it, before another one takes it over. What lies
deep is then optimised and translated once for each function above it, which takes most of the time. Here a kernel that
kernels call is only a part: code for LLVM, as it is written, with that of all it calls. A kernel that Python calls is a
whole: its parts are put together, optimised as one and translated, once. A whole may call another one, whose code is no
part of it: it knows it by its name.
"""

from collections.abc import Iterator
from importlib import import_module
from typing import Any, NamedTuple

from llvmlite.binding import Linkage, add_symbol, parse_assembly, parse_bitcode
from numba.core.codegen import CPUCodegen, JITCodeLibrary

# How names of compiled Python functions begin in LLVM.
_COMPILED = "_ZN"


class Part(JITCodeLibrary):
    """Code of a kernel and of all it calls, for wholes and other parts; it never becomes machine code itself."""

    @property
    def codegen(self) -> "Part":
        """The part itself, which Numba asks for nothing but `set_env`."""
        return self

    def set_env(self, name: str, environment: Any) -> None:
        """Do nothing: a whole says where its parts find their environments."""

    def finalize(self) -> None:
        """Take in what is called; nothing is optimised yet."""
        self._raise_if_finalized()
        for library in dict.fromkeys(self._linking_libraries):
            self._reload_init.update(library._reload_init)
            self._final_module.link_in(library._get_module_for_linking(), preserve=True)
        self._finalize_dynamic_globals()
        self._finalized = True

    def get_pointer_to_function(self, _name: str) -> int:
        """Return 0, the address of what does not exist."""
        self._ensure_finalized()
        return 0

    def serialize_using_object_code(self) -> tuple[str, type["Part"], bytes]:
        """Return what `restored` needs."""
        return self.name, type(self), self._get_module_for_linking().as_bitcode()

    @classmethod
    def restored(cls, codegen: CPUCodegen, name: str, bitcode: bytes) -> "Part":
        """Return a part that was kept."""
        part = cls(codegen, name)
        part._final_module = parse_bitcode(bitcode)
        part._finalize_dynamic_globals()
        part._finalized = True
        return part


class Whole(JITCodeLibrary):
    """Machine code of a kernel and of all it calls."""

    def _optimize_final_module(self) -> None:
        # Nobody else calls the parts: what is called once is inlined, what is inlined is dropped. What is left has no
        # symbol: other machine code in this process would take it for the function of that name as it was written.
        for function in self._functions():
            if function.linkage == Linkage.linkonce_odr and function.name.startswith(_COMPILED):
                function.linkage = Linkage.private
        super()._optimize_final_module()

    def _functions(self) -> Iterator[Any]:
        return (function for function in self._final_module.functions if not function.is_declaration)

    def _get_module_for_linking(self) -> Any:
        # who calls it takes nothing over
        return parse_assembly("")

    def serialize_using_object_code(self) -> tuple[str, type["Whole"], tuple[bytes, list[str]]]:
        """Return what `restored` needs: no code for others to take over, there are parts for that."""
        self._ensure_finalized()
        names = [function.name for function in self._functions() if function.linkage != Linkage.private]
        return self.name, type(self), (self._get_compiled_object(), names)

    @classmethod
    def restored(cls, codegen: CPUCodegen, name: str, kept: tuple[bytes, list[str]]) -> "Whole":
        """Return a whole that was kept."""
        whole = cls(codegen, name)
        whole.enable_object_caching()
        whole._set_compiled_object(kept[0])
        whole._finalize_final_module()
        codegen._engine._defined_symbols.update(kept[1])
        return whole


class Entry(NamedTuple):
    """A whole that other machine code calls. Numba calls it before it loads such code."""

    module: str
    kernel: str
    signature: tuple[Any, ...]
    symbol: str  # by which it is called, a name that changes from process to process

    def __call__(self) -> None:
        """Load the whole, or compile it, and tell the loader where it is."""
        kernel = getattr(import_module(self.module), self.kernel)
        add_symbol(self.symbol, kernel.address(self.signature))
