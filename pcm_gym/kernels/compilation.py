"""How every kernel is compiled: one decorator, one cache that can never serve stale code.

Numba's on-disk cache looks only at the file of the compiled function itself, so a change in a function that it
calls goes unnoticed. Here the cache folder of a module carries a hash of its source and of the sources of all kernel
modules that it imports, directly or not: an edit recompiles what depends on it, and nothing else.
"""

import ast
import hashlib
import os
import sys
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import Any, TypeVar

import numba
import platformdirs
from numba.core import config, event

Function = TypeVar("Function", bound=Callable[..., Any])

_PACKAGE = "pcm_gym.kernels"
_KERNEL_FOLDER = Path(__file__).parent
_DIGEST_LENGTH = 16


@lru_cache(maxsize=256)
def _imported(path: Path) -> frozenset[Path]:
    """Return the kernel modules that a source file names in its imports."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_bytes())):
        if isinstance(node, ast.Import):
            names.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module is not None:
            names.update([node.module], (f"{node.module}.{alias.name}" for alias in node.names))
    files = (_KERNEL_FOLDER / f"{name.removeprefix(_PACKAGE + '.')}.py" for name in names)
    return frozenset(file for file in files if file.exists())


def source_digest(source: Path) -> str:
    """Hexadecimal digest of a source file, of all kernel modules that it is built on, and of Numba's version."""
    found, pending = {source}, [source]
    while pending:
        new = _imported(pending.pop()) - found
        found |= new
        pending.extend(new)
    digest = hashlib.sha256(numba.__version__.encode())
    for path in sorted(found):
        digest.update(path.name.encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()[:_DIGEST_LENGTH]


def cache_root() -> Path:
    """Folder of all compiled kernels: ``NUMBA_CACHE_DIR`` if that is set, else in the user's cache."""
    return Path(os.environ.get("NUMBA_CACHE_DIR") or platformdirs.user_cache_dir("pcm_gym"))


@lru_cache(maxsize=256)
def _cache_folder(source: Path) -> str:
    return str(cache_root() / f"{source.stem}-{source_digest(source)}")


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
    previous = config.CACHE_DIR
    config.CACHE_DIR = _cache_folder(Path(function.__code__.co_filename))
    try:
        compiled = numba.njit(cache=True, error_model="numpy", nogil=True, forceinline=forceinline)(function)
    finally:
        config.CACHE_DIR = previous
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
