"""Compiling says what it does, once, and is done anew after every change of a kernel."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from pcm_gym.kernels import compilation

ROOT = Path(__file__).parents[2]
COMPILE_ONE = "from pcm_gym.kernels.elliptic import quarter_period; print(quarter_period(1.0))"


def run(cache: Path, folder: Path = ROOT, code: str = COMPILE_ONE, **variables: str) -> tuple[str, str]:
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(cache), **variables}
    result = subprocess.run(
        [sys.executable, "-c", code], cwd=folder, env=environment, capture_output=True, text=True, check=True
    )
    return result.stdout, result.stderr


def test_first_compilation_is_announced_on_standard_error_and_no_other(tmp_path: Path) -> None:
    first, second = run(tmp_path), run(tmp_path)
    assert first[0] == second[0] == "1.5707963267948966\n"
    assert first[1].startswith("pcm_gym: compiling the kernels")
    assert first[1].count("\n") == 1
    assert str(tmp_path) in first[1]
    assert second[1] == ""


def test_nothing_is_announced_without_compilation(tmp_path: Path) -> None:
    assert run(tmp_path, NUMBA_DISABLE_JIT="1") == ("1.5707963267948966\n", "")
    assert run(tmp_path, code="import pcm_gym") == ("", "")
    assert [path for path in tmp_path.rglob("*") if path.is_file()] == []


def test_change_of_a_called_kernel_is_never_missed(tmp_path: Path) -> None:
    """Numba's own cache looks at the file of the caller alone."""
    package = tmp_path / "pcm_gym" / "kernels"
    package.mkdir(parents=True)
    (tmp_path / "pcm_gym" / "__init__.py").touch()
    (package / "__init__.py").touch()
    shutil.copy(ROOT / "pcm_gym" / "kernels" / "compilation.py", package)
    header = "from pcm_gym.kernels.compilation import kernel\n"
    caller = "from pcm_gym.kernels.below import below\n\n\n@kernel\ndef above(x):\n    return 10.0 * below(x)\n"
    (package / "above.py").write_text(header + caller)
    for factor in (2.0, 3.0):
        (package / "below.py").write_text(f"{header}\n\n@kernel\ndef below(x):\n    return {factor} * x\n")
        printed, _ = run(tmp_path / "cache", tmp_path, "from pcm_gym.kernels.above import above; print(above(1.0))")
        assert float(printed) == 10.0 * factor


@pytest.fixture
def copied_kernels(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = tmp_path / "kernels"
    shutil.copytree(ROOT / "pcm_gym" / "kernels", folder, ignore=shutil.ignore_patterns("__pycache__"))
    monkeypatch.setattr(compilation, "_KERNEL_FOLDER", folder)
    return folder


def modules_below(name: str) -> set[str]:
    """Return the kernel modules that are loaded when a fresh interpreter imports one."""
    code = (
        "import sys, types, pathlib\n"
        "package = types.ModuleType('pcm_gym'); package.__path__ = ['pcm_gym']; sys.modules['pcm_gym'] = package\n"
        f"import pcm_gym.kernels.{name}\n"
        "print(*(m.rsplit('.', 1)[1] for m in sys.modules if m.startswith('pcm_gym.kernels.')))"
    )
    result = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    return set(result.stdout.split())


@pytest.mark.parametrize("name", ["rod", "linear", "continuation", "forward_search", "transition"])
def test_digest_depends_on_exactly_the_modules_that_an_import_loads(name: str, copied_kernels: Path) -> None:
    expected = modules_below(name)
    assert len(expected) > 1
    for path in sorted(copied_kernels.glob("[a-z]*.py")):
        before = compilation.source_digest(copied_kernels / f"{name}.py")
        path.write_text(path.read_text() + "# \n")
        changed = compilation.source_digest(copied_kernels / f"{name}.py") != before
        assert changed == (path.stem in expected), path.stem


def test_digest_depends_on_the_compiler(monkeypatch: pytest.MonkeyPatch) -> None:
    source = ROOT / "pcm_gym" / "kernels" / "elliptic.py"
    before = compilation.source_digest(source)
    monkeypatch.setattr(compilation.numba, "__version__", "0.0")
    assert compilation.source_digest(source) != before


def test_cache_is_where_the_environment_says_or_in_the_users_cache(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    assert compilation.cache_root() == tmp_path
    monkeypatch.delenv("NUMBA_CACHE_DIR")
    assert compilation.cache_root().name == "pcm_gym"
