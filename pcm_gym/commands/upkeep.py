"""Commands for what is kept of compiled kernels: compile all of them, and tell or clear the cache."""

import pickletools
import re
import shutil
import sys
from pathlib import Path
from typing import Annotated

import typer

from pcm_gym.commands.arguments import AsJson
from pcm_gym.commands.output import print_json, print_lines

_BYTES_OF_A_MEGABYTE = 1e6
# A folder of one module's kernels, by name and digest, and Numba's files in it.
_FOLDER, _SUFFIXES = re.compile(r"[a-z_.]+-[0-9a-f]{16}"), (".nbi", ".nbc")


def warmup(as_json: AsJson = False) -> None:
    """Compile every kernel now, with progress: what comes after starts at once."""
    import time

    from pcm_gym.commands.rehearsal import STAGES

    seconds: dict[str, float] = {}
    for number, (name, rehearse) in enumerate(STAGES.items()):
        print(f"{number + 1}/{len(STAGES)} {name} ...", file=sys.stderr, flush=True)
        begin = time.monotonic()
        rehearse()
        seconds[name] = time.monotonic() - begin
    folders = kernel_folders()
    if as_json:
        print_json({"seconds": seconds, "path": str(_root()), "megabytes": _megabytes(folders)})
    else:
        typer.echo(f"all kernels are compiled: {_megabytes(folders):.1f} MB in {_root()}")


def cache(
    clear: Annotated[bool, typer.Option("--clear", help="Delete all compiled kernels.")] = False,
    as_json: AsJson = False,
) -> None:
    """Tell where compiled kernels are kept and how large they are, or delete them."""
    folders = kernel_folders()
    content = {"path": str(_root()), "megabytes": _megabytes(folders), "folders": len(folders), "cleared": clear}
    if clear:
        for folder in folders:
            shutil.rmtree(folder)
    if as_json:
        print_json(content)
    elif clear:
        typer.echo(f"deleted {content['megabytes']:.1f} MB of compiled kernels in {content['path']}")
    else:
        print_lines({key: value for key, value in content.items() if key != "cleared"})


def kernel_folders() -> list[Path]:
    """Return the folders of compiled kernels, of all versions of their sources, and nothing else."""
    root = _root()
    return sorted(filter(_is_ours, root.iterdir())) if root.is_dir() else []


def damaged_files(folder: Path) -> list[Path]:
    """Return the files of a folder of compiled kernels that are cut off or no pickles; none is unpacked."""
    return [path for path in sorted(folder.iterdir()) if path.suffix in _SUFFIXES and not _is_whole(path)]


def _is_ours(path: Path) -> bool:
    return _FOLDER.fullmatch(path.name) is not None and path.is_dir() and not path.is_symlink()


def _is_whole(path: Path) -> bool:
    """Return whether a file is one pickle after the other up to its end."""
    try:
        with path.open("rb") as file:
            size, place = path.stat().st_size, 0
            while place < size or not size:
                for _ in pickletools.genops(file):
                    pass
                place = file.tell()
    except Exception:  # whatever the reader of pickles makes of bytes that are none
        return False
    return True


def _root() -> Path:
    from pcm_gym.kernels.numerics.cache import cache_root

    return cache_root()


def _megabytes(folders: list[Path]) -> float:
    files = (path for folder in folders for path in folder.iterdir())
    return sum(path.stat().st_size for path in files) / _BYTES_OF_A_MEGABYTE
