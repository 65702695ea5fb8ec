"""Compiling says what it does, once, and is done anew after every change of a kernel."""

import ast
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numba
import pytest

from pcm_gym.kernels.numerics import cache

ROOT = Path(__file__).parents[3]
COMPILE_ONE = "from pcm_gym.kernels.rods.elliptic import quarter_period; print(quarter_period(1.0))"


def run(folder_of_cache: Path, folder: Path = ROOT, code: str = COMPILE_ONE, **variables: str) -> tuple[str, str]:
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(folder_of_cache), **variables}
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


def test_a_long_compilation_says_what_is_at_work_and_how_much_is_left(tmp_path: Path) -> None:
    """It begins near nothing, never goes back, and names kernels that there are."""
    code = "from pcm_gym.kernels.numerics import notice; notice._PAUSE = 0.0\n"
    code += "from pcm_gym.kernels.rods import rod; rod.rod(1.0, 2.0)"
    said = run(tmp_path, code=code)[1].splitlines()[1:]
    found = [re.fullmatch(r"pcm_gym: compiling (\w+), (\d+) % done(, about \d+ s left)?", line) for line in said]
    assert len(said) > 5
    assert all(found)
    shares = [int(match[2]) for match in found if match]
    assert shares == sorted(shares)
    assert shares[0] < 10 < 50 < shares[-1] < 100  # the last line is of when the last kernel begins
    assert {"_rod_series", "_jacobi"} <= {match[1] for match in found if match}
    assert not [match for match in found if match and int(match[2]) > 50 and match[3] is None]


def test_machine_code_is_made_for_what_python_calls_alone(tmp_path: Path) -> None:
    """What kernels call is kept as code for LLVM, and serves the next kernel that is built on it."""
    first, second = "from pcm_gym.kernels.rods.rod import rod; rod(1.0, 2.0)", "; rod_shape(1.0, 2.0, np.zeros((2, 2)))"
    run(tmp_path, code=first)
    assert wholes(tmp_path) == {"rod"}
    kept = parts(tmp_path)
    assert {"_rod_series", "jacobi", "_jacobi"} <= kept
    assert "tip_half_angle" not in kept  # a formula is within its callers
    times = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*.nbc")}
    run(tmp_path, code="import numpy as np; from pcm_gym.kernels.rods.rod import rod_shape" + second)
    assert wholes(tmp_path) == {"rod", "rod_shape"}
    assert {path: path.stat().st_mtime_ns for path in times} == times


def test_machine_code_that_kernels_share_is_made_once_and_found_by_each_in_every_process(tmp_path: Path) -> None:
    """Its name in LLVM differs from process to process; and if it is not kept, it is made again."""
    code = (
        "import sys, numpy as np\n"
        "from pcm_gym.kernels.numerics.compilation import kernel, shared_kernel\n"
        "@kernel\n"
        "def other(x): return x + 1.0\n"
        "@shared_kernel\n"
        "def common(values, is_double):\n"
        "    values[:] = other(values[0]) * (2.0 if is_double else 3.0)\n"
        "    return len(values)\n"
        "@kernel\n"
        "def between(values): return common(values, False)\n"
        "@kernel\n"
        "def first(values): return common(values, True) + between(values)\n"
        "@kernel\n"
        "def second(values): return between(values) - values[1]\n"
        "@kernel\n"
        "def third(values): return 10.0 * between(values) + values[0]\n"
        "for name in sys.argv[1].split(): print(globals()[name](np.ones(2)), end=' ')\n"
    )
    (tmp_path / "script.py").write_text(code)

    def printed(names: str, disabled: str = "0") -> str:
        command = f"import sys; sys.path.insert(0, {str(tmp_path)!r}); sys.argv = ['', {names!r}]; import script"
        return run(tmp_path / "cache", code=command, NUMBA_DISABLE_JIT=disabled)[0]

    for names in ("first second", "second", "other second first", "third second", "first third"):
        assert printed(names) == printed(names, "1")
    kept = sorted(path.name for path in (tmp_path / "cache").rglob("*.nbc") if "common" in path.name)
    assert len(kept) == 1  # for both constants
    for path in (tmp_path / "cache").rglob("*common*"):
        path.unlink()
    assert printed("third first") == printed("third first", "1")


def kernels_kept(folder: Path) -> list[str]:
    """Return the files of the kernels in a cache, by name and line, without their module and version of Python."""
    return [path.name.partition(".")[2].rpartition(".py")[0] for path in folder.rglob("*.nbi")]


def wholes(folder: Path) -> set[str]:
    return {name.partition("-")[0] for name in kernels_kept(folder) if not name.endswith("-part")}


def parts(folder: Path) -> set[str]:
    return {name.partition("-")[0] for name in kernels_kept(folder) if name.endswith("-part")}


def test_a_kernel_can_be_called_by_kernels_by_python_and_by_itself(tmp_path: Path) -> None:
    """The values are those of the interpreter."""
    code = (
        "import numpy as np\n"
        "from pcm_gym.kernels.numerics.compilation import formula, kernel\n"
        "@formula\n"
        "def half(x): return 0.5 * x\n"
        "@kernel\n"
        "def halved(x, times): return x if times == 0 else halved(half(x), times - 1)\n"
        "@kernel\n"
        "def total(values, times): return halved(values.sum(), times) + values[0]\n"
        "print(halved(8.0, 2), total(np.array([6.0, 2.0]), 3), half(3.0), halved(1.0, 0))\n"
    )
    (tmp_path / "script.py").write_text(code)
    for disabled in ("0", "1"):
        command = f"import sys; sys.path.insert(0, {str(tmp_path)!r}); import script"
        assert run(tmp_path / "cache", code=command, NUMBA_DISABLE_JIT=disabled)[0] == "2.0 7.0 1.5 1.0\n"


def test_a_plain_numba_function_may_call_a_kernel_that_is_inside_other_machine_code(tmp_path: Path) -> None:
    """The loader knows functions by name, and those inside are specialised: taken for each other they crash."""
    code = (
        "import numba, numpy as np, pcm_gym\n"
        "from pcm_gym.kernels.lockstep.lanes import step_block\n"
        "from pcm_gym.kernels.lockstep.layout import make_block\n"
        "from pcm_gym.kernels.numerics.compilation import kernel\n"
        "def step(legs, g, inputs):\n"
        "    block = make_block(2)\n"
        "    block.common[0].pose[:], block.common[0].load[:] = 0.0, 0.0\n"
        "    for lane in range(16):\n"
        "        for i in range(2):\n"
        "            leg = block.legs[i]\n"
        "            leg.g[0, lane], leg.g[1, lane] = g[2 * i], g[2 * i + 1]\n"
        "            leg.input[lane], leg.target[lane] = inputs[i], inputs[i] + 0.01\n"
        "    step_block(legs, block, 16, 2)\n"
        "    return block.legs[0].g[0, 3]\n"
        "given = pcm_gym.get_mechanism('2RFR-paper').leg_table, np.array([1.0, 0.1, 1.0, 0.2]), np.array([1.0, 2.0])\n"
        "print(kernel(step)(*given) == numba.njit(error_model='numpy')(step)(*given))\n"
    )
    (tmp_path / "script.py").write_text(code)
    command = f"import sys; sys.path.insert(0, {str(tmp_path)!r}); import script"
    assert run(tmp_path / "cache", code=command)[0] == "True\n"


def test_nothing_is_announced_without_compilation(tmp_path: Path) -> None:
    assert run(tmp_path, NUMBA_DISABLE_JIT="1") == ("1.5707963267948966\n", "")
    assert run(tmp_path, code="import pcm_gym") == ("", "")
    assert [path for path in tmp_path.rglob("*") if path.is_file()] == []


def test_change_of_a_called_kernel_is_never_missed(tmp_path: Path) -> None:
    """Numba's own cache looks at the file of the caller alone."""
    package = tmp_path / "pcm_gym" / "kernels"
    for folder in (package.parent, package, package / "numerics", package / "room"):
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "__init__.py").touch()
    for name in ("cache", "compilation", "libraries", "notice"):
        shutil.copy(ROOT / "pcm_gym" / "kernels" / "numerics" / f"{name}.py", package / "numerics")
    header = "from pcm_gym.kernels.numerics.compilation import kernel\n"
    caller = "from pcm_gym.kernels.room.below import below\n\n\n@kernel\ndef above(x):\n    return 10.0 * below(x)\n"
    (package / "above.py").write_text(header + caller)
    for factor in (2.0, 3.0):
        (package / "room" / "below.py").write_text(f"{header}\n\n@kernel\ndef below(x):\n    return {factor} * x\n")
        printed, _ = run(tmp_path / "cache", tmp_path, "from pcm_gym.kernels.above import above; print(above(1.0))")
        assert float(printed) == 10.0 * factor


@pytest.fixture
def copied_kernels(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = tmp_path / "kernels"
    shutil.copytree(ROOT / "pcm_gym" / "kernels", folder, ignore=shutil.ignore_patterns("__pycache__"))
    monkeypatch.setattr(cache, "_KERNEL_FOLDER", folder)
    return folder


def modules_below(name: str) -> set[str]:
    """Return the kernel modules that are loaded when a fresh interpreter imports one."""
    code = (
        "import sys, types, pathlib\n"
        "package = types.ModuleType('pcm_gym'); package.__path__ = ['pcm_gym']; sys.modules['pcm_gym'] = package\n"
        f"import pcm_gym.kernels.{name}\n"
        "kernels = (m.removeprefix('pcm_gym.kernels.') for m in sys.modules if m.startswith('pcm_gym.kernels.'))\n"
        "print(*(name for name in kernels if '.' in name))"
    )
    result = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    return set(result.stdout.split())


@pytest.mark.parametrize(
    "name",
    ["rods.rod", "numerics.linear", "branches.continuation", "enumeration.forward_search", "stepping.transition"],
)
def test_digest_depends_on_exactly_the_modules_that_an_import_loads(name: str, copied_kernels: Path) -> None:
    expected = modules_below(name)
    assert len(expected) > 1
    source = copied_kernels.joinpath(*name.split(".")).with_suffix(".py")
    for path in sorted(copied_kernels.glob("*/[a-z]*.py")):
        before = cache.source_digest(source)
        cache._read.cache_clear()
        path.write_text(path.read_text() + "# \n")
        module = f"{path.parent.name}.{path.stem}"
        assert (cache.source_digest(source) != before) == (module in expected), module


def imported(path: Path) -> set[Path]:
    """Return the kernel modules that a file imports, as Python reads it."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_bytes())):
        if isinstance(node, ast.Import):
            names.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module is not None:
            names.update([node.module], (f"{node.module}.{alias.name}" for alias in node.names))
    kernels = ROOT / "pcm_gym" / "kernels"
    files = (ROOT.joinpath(*name.split(".")).with_suffix(".py") for name in names)
    return {file for file in files if file.exists() and file.is_relative_to(kernels)}


@pytest.mark.parametrize("path", sorted((ROOT / "pcm_gym" / "kernels").rglob("*.py")), ids=lambda path: path.stem)
def test_imports_are_found_without_parsing_as_python_finds_them(path: Path) -> None:
    assert cache._read(path).imported == imported(path)


@pytest.mark.parametrize(
    "text",
    [
        "import pcm_gym.kernels.rods.rod",
        "import pcm_gym.kernels.rods.rod as other",
        "def inside():\n    from pcm_gym.kernels.rods.rod import rod\n",
        "from pcm_gym.kernels.rods import rod",
        "from pcm_gym.kernels.rods import rod as other  # why",
        "from pcm_gym.kernels.rods import (\n    curvature,  # one\n    rod,\n)",
        "from pcm_gym.kernels.rods import curvature, \\\n    rod",
    ],
)
def test_no_form_of_an_import_is_overlooked(text: str, tmp_path: Path) -> None:
    path = tmp_path / "module.py"
    path.write_text(text + "\n")
    wanted = ROOT / "pcm_gym" / "kernels" / "rods" / "rod.py"
    assert wanted in imported(path)
    assert wanted in cache._read(path).imported


def test_digest_depends_on_the_compiler(monkeypatch: pytest.MonkeyPatch) -> None:
    source = ROOT / "pcm_gym" / "kernels" / "rods" / "elliptic.py"
    before = cache.source_digest(source)
    monkeypatch.setattr(numba, "__version__", "0.0")
    assert cache.source_digest(source) != before


def test_cache_is_where_the_environment_says_or_in_the_users_cache(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    assert cache.cache_root() == tmp_path
    monkeypatch.delenv("NUMBA_CACHE_DIR")
    assert cache.cache_root().name == "pcm_gym"


def test_equal_sources_elsewhere_are_not_compiled_again(tmp_path: Path) -> None:
    for place in ("one", "another"):
        shutil.copytree(ROOT / "pcm_gym", tmp_path / place / "pcm_gym", ignore=shutil.ignore_patterns("__pycache__"))
    first, second = (run(tmp_path / "cache", tmp_path / place) for place in ("one", "another"))
    assert first[0] == second[0]
    assert "compiling" in first[1]
    assert second[1] == ""


def test_damaged_cache_is_made_again(tmp_path: Path) -> None:
    run(tmp_path)
    files = [path for path in tmp_path.rglob("*") if path.is_file()]
    assert {path.suffix for path in files} == {".nbi", ".nbc"}
    for path in files:
        path.write_bytes(path.read_bytes()[:40])
    printed, said = run(tmp_path)
    assert printed == "1.5707963267948966\n"
    assert said.count("\n") == 1
    assert run(tmp_path) == (printed, "")


def test_cache_that_cannot_be_written_is_done_without_and_that_is_said_once(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    printed, said = run(tmp_path / "file")
    assert printed == "1.5707963267948966\n"
    assert said.count("cannot be kept") == 1


def test_nobody_else_may_write_into_the_cache(tmp_path: Path) -> None:
    run(tmp_path / "cache", code="import os; os.umask(0)\n" + COMPILE_ONE)
    assert [oct(path.stat().st_mode & 0o077) for path in (tmp_path / "cache").iterdir()] == ["0o0"]
