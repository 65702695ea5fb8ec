"""The page of the command line names what there is, and what it prints runs as printed."""

import re
from pathlib import Path

import pytest

import pcm_gym
from pcm_gym.commands.app import app, main
from pcm_gym.commands.errors import ExitCode

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "command_line.md").read_text(encoding="utf-8")
README = (ROOT / "README.md").read_text(encoding="utf-8")
PRINTED = re.findall(r"^pcm-gym (.*?)(?:  +#.*)?$", README, flags=re.MULTILINE)


def test_page_names_every_command_and_exit_code() -> None:
    named = re.findall(r"^\| `([a-z]+)[^`]*` \|", PAGE, flags=re.MULTILINE)
    assert sorted(named) == sorted(command.name or "" for command in app.registered_commands)
    codes = re.findall(r"^\| (\d+) \|", PAGE, flags=re.MULTILINE)
    assert [int(code) for code in codes] == [code.value for code in ExitCode]


def test_file_on_the_page_is_a_mechanism(tmp_path: Path) -> None:
    content = re.findall(r"```yaml\n(.*?)```", PAGE, flags=re.DOTALL)
    assert len(content) == 1
    (tmp_path / "narrow.yaml").write_text(content[0], encoding="utf-8")
    mechanism = pcm_gym.load_mechanism(tmp_path / "narrow.yaml")
    assert mechanism.name == "narrow"
    assert pcm_gym.home_equilibrium(mechanism).is_stable


@pytest.mark.parametrize("call", [call for call in PRINTED if call not in ("warmup", "doctor")])
def test_commands_of_the_readme_run_as_printed(
    call: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as ended:
        main(call.split())
    assert ended.value.code in (0, None), capsys.readouterr().err
    assert capsys.readouterr().out


def test_readme_prints_commands() -> None:
    assert len(PRINTED) >= 9
