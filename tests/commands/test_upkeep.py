"""The doctor names what is wrong; the cache is told of and cleared, and nothing else is touched."""

import shutil
import sys
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from pcm_gym.commands import doctor, upkeep
from pcm_gym.kernels.numerics.cache import cache_root
from tests.commands.calls import Shell


class Usage(NamedTuple):
    total: int
    used: int
    free: int


@pytest.fixture
def own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A cache with the kernels of two modules, as Numba writes them, and things that are not ours."""
    known = next(folder for folder in upkeep.kernel_folders() if any(folder.glob("*.nbc")))
    root = tmp_path / "cache"
    for name in ("rods.rod-0123456789abcdef", "statics.closure-0123456789abcdef"):
        shutil.copytree(known, root / name)
    (root / "others").mkdir()
    (root / "file-0123456789abcdef").write_text("not a folder")
    root.chmod(0o700)
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(root))
    return root


def wrong(shell: Shell) -> dict[str, str]:
    """What the doctor calls wrong, by what it is about; the exit code must agree."""
    ended = shell("doctor", "--json")
    found: list[dict[str, Any]] = ended.content["findings"]
    bad = {each["about"]: each["text"] for each in found if each["verdict"] == "wrong"}
    assert ended.content["is_well"] == (not bad) == (ended.code == 0)
    return bad


def test_doctor_finds_nothing_where_all_is_well(shell: Shell, own_cache: Path) -> None:
    assert wrong(shell) == {}
    ended = shell("doctor")
    assert ended.output.splitlines()[-1] == "all is well"
    assert "off by" in ended.output  # the solver was tried


def test_doctor_names_a_wrong_python(shell: Shell, own_cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "version_info", (3, 9, 18, "final", 0))
    assert "3.11 or newer" in wrong(shell)["Python"]


def test_doctor_names_missing_packages(shell: Shell, own_cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    requirements = ["contourpy>=1.2", "no-such-thing>=1", 'nor.this>=2; extra == "render"']
    monkeypatch.setattr("importlib.metadata.requires", lambda _: requirements)
    monkeypatch.setattr(doctor, "_version", lambda name: None if name in ("no-such-thing", "nor.this") else "1.0")
    assert "pip install no-such-thing" in wrong(shell)["packages"]
    assert "the extra render lacks nor.this: pip install 'pcm_gym[render]'" in shell("doctor").output


@pytest.mark.parametrize("damage", [b"", b"no pickle", None])
def test_doctor_names_a_broken_cache(shell: Shell, own_cache: Path, damage: bytes | None) -> None:
    for path in (next(own_cache.glob("*/*.nbi")), next(own_cache.glob("*/*.nbc"))):
        whole = path.read_bytes()
        path.write_bytes(whole[: len(whole) // 2] if damage is None else damage)
        assert str(path) in wrong(shell)["compiled kernels"]
        path.write_bytes(whole)
    assert wrong(shell) == {}


def test_doctor_names_a_cache_that_cannot_be_written(
    shell: Shell, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """A home that is read-only for the superuser, too: its place is taken by a file."""
    (tmp_path / "home").write_text("")
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "home" / "cache"))
    assert "cannot be written" in wrong(shell)["cache"]
    assert "NUMBA_CACHE_DIR" in wrong(shell)["cache"]


def test_doctor_names_a_full_disk(shell: Shell, own_cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shutil, "disk_usage", lambda _: Usage(10**9, 10**9, 10**6))
    assert "1 MB are free" in wrong(shell)["cache"]


def test_doctor_names_a_cache_that_others_may_write(shell: Shell, own_cache: Path) -> None:
    own_cache.chmod(0o777)
    assert "chmod go-w" in wrong(shell)["cache"]


def test_doctor_says_what_an_examination_died_of(
    shell: Shell, own_cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "numba", None)
    monkeypatch.delitem(sys.modules, "pcm_gym.kernels.numerics.cache")
    assert "numba" in wrong(shell)["cache"]


def test_doctor_does_not_compile(shell: Shell, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    class NotKept:
        is_kept = False

    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    tmp_path.chmod(0o700)
    monkeypatch.setattr("pcm_gym.kernels.enumeration.forward_search.find_starts", NotKept())
    ended = shell("doctor")
    assert ended.code == 0
    assert ended.output.count("warmup") == 2


def test_cache_is_told_of_and_cleared(shell: Shell, own_cache: Path) -> None:
    content = shell("cache", "--json").content
    assert (content["path"], content["folders"]) == (str(own_cache), 2)
    files = [path for folder in ("rods.rod", "statics.closure") for path in own_cache.glob(f"{folder}-*/*")]
    assert content["megabytes"] == sum(path.stat().st_size for path in files) / 1e6
    assert str(own_cache) in shell("cache").output
    assert shell("cache", "--clear").code == 0
    assert sorted(path.name for path in own_cache.iterdir()) == ["file-0123456789abcdef", "others"]
    assert shell("cache", "--json").content["folders"] == 0


def test_cache_that_is_not_there_is_empty(shell: Shell, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "none"))
    assert shell("cache", "--json").content["folders"] == 0
    assert shell("cache", "--clear").code == 0


@pytest.mark.slow
def test_after_the_warmup_nothing_is_compiled(shell: Shell) -> None:
    ended = shell("warmup", "--json")
    assert ended.code == 0
    assert ended.content["path"] == str(cache_root())
    before = {path: path.stat().st_mtime_ns for folder in upkeep.kernel_folders() for path in folder.iterdir()}
    for call in ("fk 3PFR --rho-max=4", "fk 2RFR --certify", "snap 2RFR", "track 2RFR --to=2.1,1.1 --certify"):
        assert shell(*call.split()).code == 0
    after = {path: path.stat().st_mtime_ns for folder in upkeep.kernel_folders() for path in folder.iterdir()}
    assert after.keys() == before.keys()
