import pytest

from tests.commands.calls import Shell


@pytest.fixture
def shell(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Shell:
    monkeypatch.delenv("PCM_GYM_TRACEBACK", raising=False)
    return Shell(capsys)
