"""What the pages written by hand print runs as printed."""

import re
from pathlib import Path

import pytest

import pcm_gym
from agents.experiments.config import load_config
from pcm_gym.commands.app import main

DOCS = Path(__file__).parents[2] / "docs"
PAGES = ["start", "controllers", "designs", "differentiable", "extend", "workers"]
PAGES += [*(f"ideas/{path.stem}" for path in (DOCS / "ideas").glob("*.md"))]


def blocks(page: str, language: str) -> list[str]:
    """The blocks of code of a page."""
    text = (DOCS / f"{page}.md").read_text(encoding="utf-8")
    return re.findall(rf"^```{language}\n(.*?)^```$", text, flags=re.DOTALL | re.MULTILINE)


@pytest.mark.parametrize("page", [page for page in PAGES if blocks(page, "python")])
def test_lines_of_python_run_one_after_the_other(
    page: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    if page == "differentiable":
        pytest.importorskip("torch")
    exec(compile("\n".join(blocks(page, "python")), page, "exec"), {"__name__": "page"})
    assert "Traceback" not in capsys.readouterr().err


def test_first_picture_is_drawn_as_printed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (call,) = [
        line for block in blocks("start", "sh") for line in block.splitlines() if line.startswith("pcm-gym render")
    ]
    with pytest.raises(SystemExit) as ended:
        main(call.split()[1:])
    assert ended.value.code in (0, None), capsys.readouterr().err
    assert (tmp_path / call.split()[-1]).read_text(encoding="utf-8").startswith("<")


def test_learner_of_the_page_is_an_experiment(tmp_path: Path) -> None:
    (content,) = blocks("extend", "yaml")
    path = tmp_path / "small.yaml"
    path.write_text(content, encoding="utf-8")
    config = load_config(path)
    assert config.name == path.stem
    assert config.environment.id in pcm_gym.environment_ids()
