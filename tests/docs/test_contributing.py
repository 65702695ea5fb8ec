"""The walkthroughs of CONTRIBUTING.md, followed to the letter from outside the package."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

import pcm_gym

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
FILES = dict(re.findall(r"```python\n# (\w+)\.py\n(.*?)```", PAGE, flags=re.DOTALL))
ENVIRONMENTS = re.findall(r"PCM_ENVIRONMENTS=(\S+)", PAGE)


@pytest.mark.slow
def test_every_check_passes_on_what_the_walkthroughs_make(tmp_path: Path) -> None:
    """Another mechanism, and a task with its own argument, reward and success."""
    assert set(FILES) == {"three_rfr", "lift"}
    for name, content in FILES.items():
        (tmp_path / f"{name}.py").write_text(content, encoding="utf-8")
    command = [
        sys.executable,
        "-m",
        "pytest",
        "-q",
        "-p",
        "no:cacheprovider",
        "tests/environments/test_every_environment.py",
    ]
    folders = os.pathsep.join([str(tmp_path), str(ROOT), os.environ.get("PYTHONPATH", "")])
    environment = {**os.environ, "PCM_ENVIRONMENTS": ENVIRONMENTS[0], "PYTHONPATH": folders}
    result = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stdout[-5000:]
    passed = int(re.findall(r"(\d+) passed", result.stdout)[-1])
    assert passed >= 90
    assert "failed" not in result.stdout


def test_page_names_the_version() -> None:
    assert re.fullmatch(r"\d+\.\d+\.\d+", pcm_gym.__version__)
    assert f"## {pcm_gym.__version__}" in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
