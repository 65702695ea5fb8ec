"""What stands in several places about the package says the same; ``python -m tests.packages`` tries what is built."""

import ast
import importlib
import pkgutil
import re
import tomllib
from pathlib import Path
from typing import Any

import pytest
import yaml

import pcm_gym

ROOT = Path(__file__).parents[2]
PROJECT: dict[str, Any] = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
PYTHONS = re.findall(r"Python :: (3\.\d+)", "\n".join(PROJECT["project"]["classifiers"]))


def read(name: str) -> Any:
    return yaml.safe_load((ROOT / name).read_text(encoding="utf-8"))


def test_citation_is_of_this_version_and_licence() -> None:
    citation = read("CITATION.cff")
    assert citation["cff-version"] == "1.2.0"
    assert citation["version"] == pcm_gym.__version__
    assert citation["license"] == PROJECT["project"]["license"]
    assert all(citation[key] for key in ("title", "message", "authors"))


def test_public_checks_are_the_own_ones_on_every_python_that_is_named() -> None:
    jobs = read(".github/workflows/ci.yml")["jobs"]
    for job in jobs.values():
        assert job["strategy"]["matrix"]["python"] == PYTHONS
    commands = [step.get("run", "") for job in jobs.values() for step in job["steps"]]
    assert ".ci/run" in commands
    assert any(command.startswith("python -m tests.packages") for command in commands)
    least = PROJECT["project"]["requires-python"].removeprefix(">=")
    assert PYTHONS[0] == least


@pytest.mark.parametrize("form", sorted(path.name for path in (ROOT / ".github" / "ISSUE_TEMPLATE").glob("*.yml")))
def test_forms_ask_for_something(form: str) -> None:
    content = read(f".github/ISSUE_TEMPLATE/{form}")
    if form == "config.yml":
        return
    assert content["name"]
    assert content["description"]
    ids = [field["id"] for field in content["body"]]
    assert len(ids) == len(set(ids)) > 0
    assert all(field["attributes"]["label"] for field in content["body"])


def test_the_wheel_holds_the_package_alone_and_the_sdist_all_folders() -> None:
    targets = PROJECT["tool"]["hatch"]["build"]["targets"]
    assert targets["wheel"]["packages"] == ["pcm_gym"]
    held = {name.strip("/") for name in targets["sdist"]["include"]}
    folders = {path.parts[0] for path in (found.relative_to(ROOT) for found in ROOT.glob("*/*.py"))}
    assert {name for name in folders if not name.startswith(".")} <= held
    assert {"tests", "configs", "docs", "README.md", "CITATION.cff"} <= held


def test_the_description_of_an_index_page_has_no_links_into_the_repository() -> None:
    hook = PROJECT["tool"]["hatch"]["metadata"]["hooks"]["fancy-pypi-readme"]
    text = (ROOT / hook["fragments"][0]["path"]).read_text(encoding="utf-8")
    for rule in hook["substitutions"]:
        text = re.sub(rule["pattern"], rule["replacement"], text)
    assert re.findall(r"\]\((?!https?://|#)[^)]*\)", text) == []
    assert "docs/command_line.md" in text


def test_links_of_the_readme_lead_somewhere() -> None:
    links = re.findall(r"\]\((?!https?://|#)([^)#]*)", (ROOT / "README.md").read_text(encoding="utf-8"))
    assert links
    for link in links:
        assert (ROOT / link).exists(), link


def test_type_checkers_know_the_names_that_are_given_out() -> None:
    """They see imports that Python itself does when a name is first asked for."""
    tree = ast.parse((ROOT / "pcm_gym" / "__init__.py").read_text(encoding="utf-8"))
    imported = {
        alias.asname or alias.name
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("pcm_gym")
        for alias in node.names
    }
    assert set(pcm_gym.__all__) - imported == {"__version__"}
    assert imported - set(pcm_gym.__all__) == {"attribute_loader", "register_environments"}


@pytest.mark.parametrize("package", ["pcm_gym", "pcm_gym.environments", "pcm_gym.solving"])
def test_names_that_are_looked_for_when_asked_for_are_those_that_type_checkers_see(package: str) -> None:
    """Whatever rooms call what they import themselves, and in whatever order they are imported."""
    own = importlib.import_module(package)
    path = Path(str(own.__file__))
    for room in pkgutil.iter_modules([str(path.parent)]):
        if room.name != "__main__":
            importlib.import_module(f"{package}.{room.name}")
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith(package) and node.col_offset:
            for alias in node.names:
                wanted = getattr(importlib.import_module(str(node.module)), alias.name)
                assert getattr(own, alias.name) is wanted, alias.name
