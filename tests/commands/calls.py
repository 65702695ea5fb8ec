"""Calls of the command line as a shell makes them, in this process."""

import json
from typing import Any, NamedTuple

import pytest

from pcm_gym.commands.app import main


class Ended(NamedTuple):
    code: int
    output: str
    errors: str

    @property
    def content(self) -> Any:
        """What was printed as JSON, strictly read: nan and inf are none."""
        return json.loads(self.output, parse_constant=_refuse)


def _refuse(constant: str) -> None:
    raise ValueError(f"{constant} is no JSON")


class Shell:
    """Runs commands and keeps what they print."""

    def __init__(self, capsys: pytest.CaptureFixture[str]) -> None:
        self._capsys = capsys

    def __call__(self, *arguments: object) -> Ended:
        self._capsys.readouterr()
        with pytest.raises(SystemExit) as ended:
            main([str(argument) for argument in arguments])
        captured = self._capsys.readouterr()
        assert "Traceback" not in captured.out + captured.err
        return Ended(int(ended.value.code or 0), captured.out, captured.err)
