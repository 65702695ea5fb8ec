"""The page "What is proved" names tests and commands that there are, and quotes what is said, for every claim."""

import ast
import importlib.util
import re
from functools import cache
from pathlib import Path

import pytest
import typer.main

from benchmarks.__main__ import app as benchmark_app
from pcm_gym.commands.app import app

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "what_is_proved.md").read_text(encoding="utf-8")
TESTS = sorted(set(re.findall(r"`(tests/[\w/]+\.py(?:::\w+)+)`", PAGE)))
COMMANDS = [line for block in re.findall(r"```sh\n(.*?)```", PAGE, flags=re.DOTALL) for line in block.splitlines()]
CLAIMS = {part.partition("\n")[0]: part for part in PAGE.split("\n### ")[1:]}
QUOTES = re.findall(r"^> (\S+\.md): (.*)$", PAGE, flags=re.MULTILINE)


@cache
def defined_in(path: str) -> set[str]:
    """Names of the tests of a file, as pytest knows them."""
    found: set[str] = set()
    for node in ast.parse((ROOT / path).read_text(encoding="utf-8")).body:
        if isinstance(node, ast.FunctionDef):
            found.add(node.name)
        elif isinstance(node, ast.ClassDef):
            found.update(f"{node.name}::{own.name}" for own in node.body if isinstance(own, ast.FunctionDef))
    return found


@pytest.mark.parametrize("test", TESTS)
def test_named_test_exists(test: str) -> None:
    path, _, name = test.partition("::")
    assert name in defined_in(path)


@pytest.mark.parametrize("command", COMMANDS)
def test_command_exists(command: str) -> None:
    first, *rest = command.split()
    if first == "pcm-gym":
        assert rest[0] in {own.name for own in app.registered_commands}
        return
    assert (first, rest[0]) == ("python", "-m")
    module = rest[1]
    if module == "pytest":
        assert (ROOT / rest[2]).exists()
    elif module == "benchmarks":
        assert rest[2] in typer.main.get_command(benchmark_app).commands  # type: ignore[attr-defined]
    else:
        found = ROOT.joinpath(*module.split("."))
        assert found.with_suffix(".py").is_file() or (found / "__main__.py").is_file()
        assert importlib.util.find_spec(module) is not None


def plain(text: str) -> str:
    """Return a text without its line breaks, marks of code and comments."""
    return " ".join(text.split())


@pytest.mark.parametrize(("page", "quote"), QUOTES)
def test_quote_is_what_is_said(page: str, quote: str) -> None:
    assert plain(quote) in plain((ROOT / page).read_text(encoding="utf-8"))


@pytest.mark.parametrize("claim", CLAIMS)
def test_claim_has_its_evidence_its_limits_and_a_command(claim: str) -> None:
    text = CLAIMS[claim].partition("\n## ")[0]
    assert re.search(r"^> \S+\.md: ", text, flags=re.MULTILINE)
    assert re.search(r"^- Evidence: ", text, flags=re.MULTILINE)
    assert re.search(r"`tests/[\w/]+\.py(?:::\w+)+`", text)
    assert re.search(r"^- Limits: ", text, flags=re.MULTILINE)
    assert "```sh\n" in text


def test_every_kind_is_there() -> None:
    assert len(CLAIMS) >= 20
    assert len(TESTS) >= 50
