"""How every kernel is compiled: one decorator, one cache that can never serve stale code.

Numba's on-disk cache looks only at the file of the compiled function itself, so a change in a function that it
calls goes unnoticed. Here the cache folder carries a hash of all kernel sources instead.
"""

import hashlib
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import numba
import platformdirs
from numba.core import config, event

Function = TypeVar("Function", bound=Callable[..., Any])

_KERNEL_FOLDER = Path(__file__).parent
_DIGEST_LENGTH = 16


def source_digest() -> str:
    """Hexadecimal digest of the sources of all kernels and of the version of Numba."""
    digest = hashlib.sha256(numba.__version__.encode())
    for path in sorted(_KERNEL_FOLDER.glob("*.py")):
        digest.update(path.name.encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()[:_DIGEST_LENGTH]


def cache_folder() -> Path:
    """Folder of the compiled kernels: below ``NUMBA_CACHE_DIR`` if that is set, else in the user's cache."""
    root = os.environ.get("NUMBA_CACHE_DIR") or platformdirs.user_cache_dir("pcm_gym")
    return Path(root) / f"kernels-{source_digest()}"


_CACHE_FOLDER = str(cache_folder())


def kernel(function: Function) -> Function:
    """Compile `function` to machine code on its first call and keep the result on disk.

    Division by zero follows IEEE 754 in every kernel (inf and nan, no exception), and fast-math is never used: it
    would make ``isnan`` constant. With ``NUMBA_DISABLE_JIT=1`` the plain Python function is returned.
    """
    previous, config.CACHE_DIR = config.CACHE_DIR, _CACHE_FOLDER
    try:
        return numba.njit(cache=True, error_model="numpy")(function)  # type: ignore[no-any-return]
    finally:
        config.CACHE_DIR = previous


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
                f"pcm_gym: compiling the kernels, once for this version (about a minute), into {_CACHE_FOLDER}",
                file=sys.stderr,
                flush=True,
            )

    def on_end(self, event: event.Event) -> None:
        """Nothing to do: the notice is about the start."""


event.register("numba:compile", _CompilationNotice())
