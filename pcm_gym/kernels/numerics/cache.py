"""Where machine code is kept between runs: one cache for every copy of the same sources, never a stale one.

Numba's own cache asks for the path and the time of change of the function's own file. So every copy of the package is
compiled again, and a change in a function that is called goes unnoticed. Here the folder of a module carries a hash of
its source and of the sources of all kernel modules that it imports, directly or not: an edit recompiles what depends on
it and nothing else, and equal sources share their machine code wherever they are installed. Versions of Numba and
Python and the kind of processor are told apart too. A cache that cannot be read is made again; one that cannot be
written is done without, which is said once.
"""

import hashlib
import os
import re
import sys
from collections.abc import Callable
from contextlib import suppress
from functools import cache, lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numba
import platformdirs
from numba.core.caching import CompileResultCacheImpl, FunctionCache, _CacheLocator
from numba.core.compiler import compile_result

_PACKAGE = "pcm_gym.kernels"
_KERNEL_FOLDER = Path(__file__).parents[1]
_DIGEST_LENGTH = 16
# A module that is named anywhere, and what is imported from it: every import statement is one, and it costs a hundredth
# of parsing the file. What else it takes for one only lets a folder's name depend on more.
_NAMED = re.compile(re.escape(_PACKAGE) + r"((?:\.\w+)*)(?:\s+import\s+(\([^)]*\)|(?:\\\n|.)*))?")


def cache_root() -> Path:
    """Folder of all compiled kernels: ``NUMBA_CACHE_DIR`` if that is set, else in the user's cache."""
    return Path(os.environ.get("NUMBA_CACHE_DIR") or platformdirs.user_cache_dir("pcm_gym"))


def source_digest(source: Path) -> str:
    """Hexadecimal digest of a source file, of all kernel modules that it is built on, and of Numba's version."""
    found, pending = {source}, [source]
    while pending:
        new = _read(pending.pop()).imported - found
        found |= new
        pending.extend(new)
    digest = hashlib.sha256(numba.__version__.encode())
    for name, path in sorted((_module_name(path), path) for path in found):
        digest.update(name.encode())
        digest.update(_read(path).digest)
    return digest.hexdigest()[:_DIGEST_LENGTH]


class _Source(NamedTuple):
    digest: bytes
    imported: frozenset[Path]


@lru_cache(maxsize=256)
def _read(path: Path) -> _Source:
    """Return the digest of a source file, and the kernel modules that it imports."""
    content = path.read_bytes()
    modules: set[str] = set()
    for module, names in _NAMED.findall(content.decode()):
        modules.update([module], (f"{module}.{name}" for name in re.findall(r"\w+", names)))
    files = (_KERNEL_FOLDER.joinpath(*module.split(".")).with_suffix(".py") for module in modules if module)
    return _Source(hashlib.sha256(content).digest(), frozenset(file for file in files if file.exists()))


def _module_name(source: Path) -> str:
    """Return the name of a kernel module below the kernels' package; of any other file its own name."""
    if not source.is_relative_to(_KERNEL_FOLDER):
        return source.stem
    return ".".join(source.relative_to(_KERNEL_FOLDER).with_suffix("").parts)


@lru_cache(maxsize=256)
def _cache_folder(source: Path) -> str:
    return str(cache_root() / f"{_module_name(source)}-{source_digest(source)}")


class _Locator(_CacheLocator):
    """Tells Numba where the machine code of one function is kept."""

    def __init__(self, function: Callable[..., Any]) -> None:
        self._code = function.__code__
        self._py_file = self._code.co_filename  # Numba names it where it warns

    @classmethod
    def from_function(cls, function: Callable[..., Any], _file: str) -> "_Locator":
        return cls(function)

    def ensure_cache_path(self) -> None:
        # it holds pickles, which run what is in them: nobody else may write there
        Path(self.get_cache_path()).mkdir(mode=0o700, parents=True, exist_ok=True)

    def get_cache_path(self) -> str:
        return _cache_folder(Path(self._code.co_filename))

    def get_source_stamp(self) -> str:
        return ""  # the folder's name is one already

    def get_disambiguator(self) -> str:
        return str(self._code.co_firstlineno)


class _PartLocator(_Locator):
    """Tells Numba where one function is kept as a part of others."""

    def get_disambiguator(self) -> str:
        return f"{super().get_disambiguator()}-part"


class _Implementation(CompileResultCacheImpl):
    _locator_classes = (_Locator,)

    def rebuild(self, target_context: Any, payload: Any) -> Any:
        """Return a result from what its library and Numba have kept of it."""
        (name, kind, kept), fndesc, environment, signature, objectmode, lifted, annotation, reload, others = payload
        for prepare in reload:
            prepare()
        library = kind.restored(target_context.codegen(), name, kept)
        library._reload_init.update(reload)
        entry_point = target_context.get_executable(library, fndesc, environment)
        for other in others:
            library.codegen.set_env(other.env_name, other)
        return compile_result(
            typing_context=target_context.typing_context,
            target_context=target_context,
            entry_point=entry_point,
            library=library,
            fndesc=fndesc,
            environment=environment,
            signature=signature,
            objectmode=objectmode,
            lifted=lifted,
            type_annotation=annotation,
            reload_init=reload,
            referenced_envs=others,
        )


class _PartImplementation(_Implementation):
    _locator_classes = (_PartLocator,)


class KernelCache(FunctionCache):
    """Numba's cache of one function, kept where this module says, whose failures are never an error."""

    _impl_class = _Implementation

    @property
    def is_kept(self) -> bool:
        """Whether there is something of the function on disk, for whatever types."""
        return Path(self._cache_file._index_path).exists()

    def load_overload(self, signature: Any, target_context: Any) -> Any:
        """Return the machine code for a signature; None if there is none, or none that can be read."""
        try:
            return super().load_overload(signature, target_context)
        except Exception:  # a damaged file may raise whatever its bytes happen to mean
            with suppress(OSError):  # if nothing can be written here, saving will say so
                self.flush()
            return None

    def save_overload(self, signature: Any, data: Any) -> None:
        """Keep the machine code for a signature, if that is possible."""
        try:
            super().save_overload(signature, data)
        except OSError as error:
            self.disable()
            _say_unwritable(error)


class PartCache(KernelCache):
    """The same for a function as a part of others."""

    _impl_class = _PartImplementation


@cache
def _say_once(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


def _say_unwritable(error: OSError) -> None:
    reason = error.strerror or str(error)
    _say_once(f"pcm_gym: compiled kernels cannot be kept in {cache_root()} ({reason}): each start compiles again")
