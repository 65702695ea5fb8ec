"""How the command starts: at once, in every way, without what it does not need."""

import importlib.metadata
import os
import runpy
import subprocess
import sys
from pathlib import Path

import pytest

import pcm_gym
from pcm_gym.commands.app import app
from tests.commands.calls import Shell

ROOT = Path(__file__).parents[2]
HEAVY = ("numba", "scipy", "matplotlib", "PIL", "torch", "agents")
NAMES = sorted(command.name or "" for command in app.registered_commands)


def python(*arguments: str, **environment: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, *arguments],
        cwd=ROOT,
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.mark.parametrize("arguments", [["--version"], ["--help"], ["fk", "--help"], ["no-such-command"]])
def test_what_needs_no_mechanics_loads_none(arguments: list[str]) -> None:
    code = (
        f"import sys; from pcm_gym.commands.app import main\ntry: main({arguments})\nexcept SystemExit: pass\n"
        f"print('loaded:', [name for name in {HEAVY} if name in sys.modules])"
    )
    ended = python("-c", code)
    assert ended.stdout.splitlines()[-1] == "loaded: []", ended.stderr


def test_completion_names_commands_mechanisms_and_environments() -> None:
    asked = {"_PCM_GYM_COMPLETE": "complete_bash"}
    ended = python("-m", "pcm_gym", COMP_WORDS="pcm-gym f", COMP_CWORD="1", **asked)
    assert set(ended.stdout.split()) == {name for name in NAMES if name.startswith("f")}
    ended = python("-m", "pcm_gym", COMP_WORDS="pcm-gym info PCM/2R", COMP_CWORD="2", **asked)
    assert "PCM/2RFR-Reach-v0" in ended.stdout


def test_module_runs_as_the_command() -> None:
    ended = python("-m", "pcm_gym", "--version")
    assert (ended.returncode, ended.stdout) == (0, f"{pcm_gym.__version__}\n")
    ended = python("-m", "pcm_gym", "fk", "4RFR")
    assert (ended.returncode, ended.stdout) == (1, "")
    assert ended.stderr.startswith("pcm-gym: there is no mechanism '4RFR'")
    assert "Traceback" not in ended.stderr


def test_entry_point_is_the_packages_own() -> None:
    for entry in importlib.metadata.entry_points(group="console_scripts", name="pcm-gym"):
        assert entry.value in ("pcm_gym.commands.app:main", "agents.cli:main")  # of an installation from before


OF_THE_CHECKOUT = ("train", "evaluate", "export", "benchmark", "figures")
# What is used by hand answers in no other way.
BY_HAND = ("explore", "play")


@pytest.mark.parametrize("name", [name for name in NAMES if name not in OF_THE_CHECKOUT])
def test_every_command_has_help_and_answers_in_json(shell: Shell, name: str) -> None:
    ended = shell(name, "--help")
    assert ended.code == 0
    assert "--json" in ended.output or name in ("schema", *BY_HAND)


def test_commands_of_the_checkout_have_help_of_their_own(shell: Shell) -> None:
    for name, option in (
        ("train", "--resume"),
        ("evaluate", "--episodes"),
        ("export", "--output"),
        ("benchmark", "--jobs"),
        ("figures", "--only"),
    ):
        ended = shell(name, "--help")
        assert ended.code == 0
        assert option in ended.output


def test_calls_without_a_command_show_help(shell: Shell) -> None:
    ended = shell()
    assert ended.code in (0, 2)
    assert all(name in ended.output + ended.errors for name in NAMES)


def test_old_pythons_are_told_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "version_info", (3, 10, 13, "final", 0))
    with pytest.raises(ImportError, match=r"needs Python 3\.11 or newer, this is Python 3\.10"):
        runpy.run_path(str(ROOT / "pcm_gym" / "__init__.py"))


def test_names_of_the_package_are_found_when_asked_for() -> None:
    ended = python(
        "-c", "import pcm_gym, sys; print('numba' in sys.modules); pcm_gym.Leg; print('numba' in sys.modules)"
    )
    assert ended.stdout.split() == ["False", "True"], ended.stderr
    for name in pcm_gym.__all__:
        assert hasattr(pcm_gym, name), name
    assert set(pcm_gym.__all__) <= set(dir(pcm_gym))
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        _ = pcm_gym.nothing  # type: ignore[attr-defined]
