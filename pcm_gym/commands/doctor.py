"""The command that looks for what is wrong with an installation, and says what would mend it."""

import os
import re
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from enum import StrEnum

import typer

from pcm_gym.commands.arguments import AsJson
from pcm_gym.commands.errors import EXTRAS, ExitCode
from pcm_gym.commands.output import print_json
from pcm_gym.commands.upkeep import damaged_files, kernel_folders

_LEAST_PYTHON = (3, 11)
_LEAST_FREE_BYTES = 300_000_000  # all kernels and as much again
_TEST_BYTES = 1 << 20
# The tip of the 2RFR at home, as public shooting code of the same mechanism finds it, m.
_KNOWN_TIP, _TOLERANCE = (0.0, 0.927501479), 1e-8


class Verdict(StrEnum):
    """What a finding means."""

    GOOD = "good"
    NOTE = "note"
    WRONG = "wrong"


@dataclass(frozen=True)
class Finding:
    """What an examination found."""

    about: str
    verdict: Verdict
    text: str


def doctor(as_json: AsJson = False) -> None:
    """Look for what is wrong: Python, packages, extras, cache, disk, and one known equilibrium."""
    findings = list(_examine())
    is_well = all(finding.verdict != Verdict.WRONG for finding in findings)
    if as_json:
        print_json({"is_well": is_well, "findings": [asdict(finding) for finding in findings]})
    else:
        for finding in findings:
            typer.echo(f"{finding.verdict.value:5}  {finding.about}: {finding.text}")
        typer.echo("all is well" if is_well else "something is wrong")
    raise typer.Exit(ExitCode.DONE if is_well else ExitCode.REFUSED)


def _examine() -> Iterator[Finding]:
    for about, examine in _EXAMINATIONS.items():
        try:
            for verdict, text in examine():
                yield Finding(about, verdict, text)
        except Exception as error:  # whatever a broken installation raises
            reason = str(error) or type(error).__name__
            yield Finding(about, Verdict.WRONG, f"{type(error).__name__}: {reason}")


def _python() -> Iterator[tuple[Verdict, str]]:
    version = ".".join(map(str, sys.version_info[:3]))
    if sys.version_info[:2] < _LEAST_PYTHON:
        yield Verdict.WRONG, f"{version}, and pcm_gym needs {'.'.join(map(str, _LEAST_PYTHON))} or newer"
    else:
        yield Verdict.GOOD, f"{version} at {sys.executable}"


def _requirements() -> tuple[list[str], dict[str, list[str]]]:
    """Return the distributions that the package needs, and those of each extra that is for its users."""
    from importlib import metadata

    always: list[str] = []
    extras: dict[str, list[str]] = {}
    for requirement in metadata.requires("pcm_gym") or []:
        name = re.split(r"[^\w.-]", requirement, maxsplit=1)[0]
        extra = re.search(r"extra == ['\"]([\w-]+)['\"]", requirement)
        (extras.setdefault(extra.group(1), []) if extra else always).append(name)
    return always, {extra: extras.get(extra, []) for extra in dict.fromkeys(EXTRAS.values())}


def _is_installed(distribution: str) -> bool:
    return _version(distribution) is not None


def _version(distribution: str) -> str | None:
    """Return the version of an installed distribution."""
    from importlib import metadata

    try:
        return metadata.version(distribution)
    except metadata.PackageNotFoundError:
        return None


def _packages() -> Iterator[tuple[Verdict, str]]:
    if not _is_installed("pcm_gym"):
        yield Verdict.NOTE, "pcm_gym is imported from a folder and not installed: what it needs is not known"
        return
    always, extras = _requirements()
    missing = [name for name in always if not _is_installed(name)]
    if missing:
        yield Verdict.WRONG, f"missing: pip install {' '.join(missing)}"
    else:
        yield Verdict.GOOD, ", ".join(f"{name} {_version(name)}" for name in always)
    for extra, names in extras.items():
        missing = [name for name in names if not _is_installed(name)]
        if missing:
            yield Verdict.NOTE, f"the extra {extra} lacks {', '.join(missing)}: pip install 'pcm_gym[{extra}]'"
        else:
            yield Verdict.GOOD, f"the extra {extra} is there"


def _cache() -> Iterator[tuple[Verdict, str]]:
    from pcm_gym.kernels.numerics.cache import cache_root

    root = cache_root()
    remedy = "each start compiles again, which takes a minute or more; NUMBA_CACHE_DIR names another folder"
    try:
        root.mkdir(mode=0o700, parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=root) as file:
            file.write(bytes(_TEST_BYTES))
            file.flush()
    except OSError as error:
        yield Verdict.WRONG, f"{root} cannot be written ({error.strerror or error}): {remedy}"
    else:
        yield Verdict.GOOD, f"{root} can be written"
    if root.is_dir():
        free = shutil.disk_usage(root).free
        if free < _LEAST_FREE_BYTES:
            yield Verdict.WRONG, f"the disk of {root} is full: {free / 1e6:.0f} MB are free; {remedy}"
        if os.name == "posix" and root.stat().st_mode & 0o022:
            yield Verdict.WRONG, f"others may write to {root}, which holds code that is run: chmod go-w '{root}'"


def _compiled() -> Iterator[tuple[Verdict, str]]:
    folders = kernel_folders()
    damaged = [path for folder in folders for path in damaged_files(folder)]
    if damaged:
        more = f" and {len(damaged) - 1} more" if len(damaged) > 1 else ""
        yield Verdict.WRONG, f"damaged: {damaged[0]}{more}; they are made again, `pcm-gym cache --clear` is rid of them"
    elif not folders:
        yield Verdict.NOTE, "nothing is compiled: the first start does it, or `pcm-gym warmup` does it all now"
    else:
        yield Verdict.GOOD, f"{len(folders)} modules are compiled and in order"


def _solver() -> Iterator[tuple[Verdict, str]]:
    from pcm_gym.kernels.enumeration.forward_search import find_starts

    if not find_starts.is_kept:  # type: ignore[attr-defined]  # a Kernel
        yield Verdict.NOTE, "not tried, because it is not compiled for these sources yet: `pcm-gym warmup`"
        return
    import pcm_gym

    tip = pcm_gym.home_equilibrium(pcm_gym.get_mechanism("2RFR")).pose.tolist()
    error = max(abs(own - known) for own, known in zip(tip, _KNOWN_TIP, strict=True))
    is_right = error < _TOLERANCE
    yield Verdict.GOOD if is_right else Verdict.WRONG, f"the home of the 2RFR is off by {error:.1e} m"


_EXAMINATIONS: dict[str, Callable[[], Iterator[tuple[Verdict, str]]]] = {
    "Python": _python,
    "packages": _packages,
    "cache": _cache,
    "compiled kernels": _compiled,
    "solver": _solver,
}
