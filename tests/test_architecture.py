"""The floors of the package: what may import what. The contracts stand in pyproject.toml."""

import ast
import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
TASK_FILES = sorted((ROOT / "pcm_gym" / "tasks").rglob("*.py"))
HEAVY_PACKAGES = {"agents", "matplotlib", "stable_baselines3", "tensorboard", "torch"}


def run_python(code: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False)


def gymnasium_names(source: str) -> Iterator[str]:
    """Dotted names that a file imports from Gymnasium."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            names = [f"{node.module}.{alias.name}" for alias in node.names]
        else:
            continue
        yield from (name for name in names if name.split(".")[0] == "gymnasium")


def test_import_contracts_are_kept() -> None:
    result = run_python("import sys; from importlinter.cli import lint_imports; sys.exit(lint_imports(no_cache=True))")
    assert result.returncode == 0, result.stdout + result.stderr


@pytest.mark.parametrize("path", TASK_FILES, ids=lambda path: path.name)
def test_tasks_know_gymnasium_only_by_its_spaces(path: Path) -> None:
    foreign = [name for name in gymnasium_names(path.read_text()) if not name.startswith("gymnasium.spaces")]
    assert foreign == []


def test_importing_the_package_loads_no_heavy_package() -> None:
    result = run_python("import json, sys, pcm_gym; print(json.dumps(sorted(sys.modules)))")
    assert result.returncode == 0, result.stderr
    loaded = {module.split(".")[0] for module in json.loads(result.stdout)}
    assert loaded.isdisjoint(HEAVY_PACKAGES), sorted(loaded & HEAVY_PACKAGES)


def test_package_is_marked_as_typed() -> None:
    assert (ROOT / "pcm_gym" / "py.typed").is_file()
