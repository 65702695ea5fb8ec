"""The floors of the package: what may import what. The contracts stand in pyproject.toml."""

import ast
import importlib
import inspect
import json
import subprocess
import sys
import typing
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from numba.core.dispatcher import Dispatcher

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


def modules() -> Iterator[ModuleType]:
    """All modules of the package, and of what stands on it."""
    for folder in ("pcm_gym", "agents"):
        for path in sorted((ROOT / folder).rglob("*.py")):
            parts = path.relative_to(ROOT).with_suffix("").parts
            if parts[-1] not in ("__init__", "__main__"):
                yield importlib.import_module(".".join(parts))


def interpreted_code(module: ModuleType) -> Iterator[ast.AST]:
    """What Python itself runs of a module when functions are called: all but kernels."""
    for node in ast.parse(inspect.getsource(module)).body:
        name = getattr(node, "name", None)
        if name is None or not isinstance(getattr(module, name, None), Dispatcher):
            yield node


def named_in(node: ast.AST, module: ModuleType) -> Iterator[Any]:
    """What the names and attributes of a piece of code stand for, as far as they are the module's."""
    for part in ast.walk(node):
        if isinstance(part, ast.Name) and isinstance(part.ctx, ast.Load):
            yield getattr(module, part.id, None)
        elif isinstance(part, ast.Attribute) and isinstance(part.value, ast.Name):
            yield getattr(getattr(module, part.value.id, None), part.attr, None)


def kernels_called_from_python() -> dict[str, Callable[..., Any]]:
    found = {}
    for module in modules():
        for node in interpreted_code(module):
            for value in named_in(node, module):
                if isinstance(value, Dispatcher) and not is_compiled_again(module, node):
                    found[f"{value.py_func.__module__}.{value.py_func.__name__}"] = value.py_func
    return found


def is_compiled_again(module: ModuleType, node: ast.AST) -> bool:
    """Whether a plain function is also the source of a kernel, as ``new_workspace`` is that of ``make_workspace``."""
    function = getattr(module, getattr(node, "name", ""), None)
    return any(isinstance(value, Dispatcher) and value.py_func is function for value in vars(module).values())


def test_kernels_that_python_calls_return_numbers() -> None:
    """Numba runs Python code where it hands over arrays and named tuples; there a signal does harm.

    If it is an interruption, the exception is lost, or the interpreter with it.
    """
    called, numbers = kernels_called_from_python(), {int, float, bool, type(None)}
    assert len(called) > 40
    returned = {name: typing.get_type_hints(function)["return"] for name, function in called.items()}
    kinds = {
        name: typing.get_args(kind) if typing.get_origin(kind) is tuple else (kind,) for name, kind in returned.items()
    }
    assert {name: returned[name] for name, parts in kinds.items() if not numbers.issuperset(parts)} == {}
