"""A whole small experiment through the command line: train, resume, evaluate, report."""

import csv
import json
import re
import shutil
import signal
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest
import yaml
from typer.testing import CliRunner, Result

import pcm_gym
from agents.commands.app import app
from agents.experiments.config import load_config, parse_config
from agents.experiments.runs import RunFolder
from agents.learners.callbacks import Snapshots
from agents.learners.progress import COST_COLUMN, STEPS_COLUMN, read_progress

EPISODES = 6
EXPERIMENT: dict[str, Any] = {
    "name": "small",
    "environment": {"id": "PCM/2RFR-Reach-v0"},
    "hyperparameters": {"n_steps": 32, "batch_size": 64, "n_epochs": 1, "policy_kwargs": {"net_arch": [8]}},
    "num_envs": 4,
    "total_steps": 256,
    "checkpoint_every": 128,
    "evaluation": {"episodes": EPISODES},
}


def command(*arguments: str | Path) -> Result:
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def write_config(folder: Path, **changes: Any) -> Path:
    path = folder / "small.yaml"
    path.write_text(yaml.safe_dump(EXPERIMENT | changes))
    return path


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> RunFolder:
    """A run that was trained and evaluated; tests leave it as it is."""
    folder = tmp_path_factory.mktemp("experiment")
    trained = command("train", write_config(folder), "--runs-dir", folder)
    assert trained.exit_code == 0, trained.output
    evaluated = command("evaluate", folder / "small")
    assert evaluated.exit_code == 0, evaluated.output
    assert "points above random" in evaluated.output
    return RunFolder(folder / "small")


@pytest.fixture
def run(finished: RunFolder, tmp_path: Path) -> RunFolder:
    """A copy of the finished run, to be changed."""
    shutil.copytree(finished.path, tmp_path / "small")
    return RunFolder(tmp_path / "small")


def test_run_holds_everything_needed_to_use_and_to_repeat_it(finished: RunFolder) -> None:
    kept = {path.name for path in finished.path.iterdir()}
    assert kept == {
        "checkpoints",
        "config.yaml",
        "episodes.csv",
        "evaluation.json",
        "model.zip",
        "normalisation.pkl",
        "progress.csv",
        "report.html",
        "tensorboard",
        "versions.json",
        "written_here.json",
    }
    assert [int(folder.name) for folder in finished.snapshots()] == [128, 256]
    assert json.loads(finished.versions.read_text()).keys() >= {"python", "torch", "gymnasium", "stable-baselines3"}


def test_existing_run_is_refused_without_a_flag(run: RunFolder) -> None:
    refused = command("train", write_config(run.path.parent), "--runs-dir", run.path.parent)
    assert refused.exit_code == 1
    assert "--resume" in refused.output


def test_resumed_run_goes_on_where_it_stopped(run: RunFolder) -> None:
    before = read_progress(run.progress)
    resumed = command(
        "train", write_config(run.path.parent), "--runs-dir", run.path.parent, "--resume", "--total-steps", "512"
    )
    assert resumed.exit_code == 0, resumed.output
    after = read_progress(run.progress)
    assert after[: len(before)] == before
    assert [row[STEPS_COLUMN] for row in after] == [128.0, 256.0, 384.0, 512.0]
    assert after[-1][COST_COLUMN] >= before[-1][COST_COLUMN]
    assert int(run.snapshots()[-1].name) == 512


def test_complete_run_is_left_alone_when_resumed(run: RunFolder) -> None:
    model = (run.path / "model.zip").read_bytes()
    resumed = command("train", write_config(run.path.parent), "--runs-dir", run.path.parent, "--resume")
    assert resumed.exit_code == 0, resumed.output
    assert (run.path / "model.zip").read_bytes() == model


def test_another_experiment_is_not_resumed(run: RunFolder) -> None:
    other = write_config(run.path.parent, num_envs=8)
    refused = command("train", other, "--runs-dir", run.path.parent, "--resume")
    assert refused.exit_code == 1
    assert "differs in: num_envs" in refused.output


def test_nothing_to_resume_is_an_error(tmp_path: Path) -> None:
    refused = command("train", write_config(tmp_path), "--runs-dir", tmp_path, "--resume")
    assert refused.exit_code == 1
    assert "nothing to resume" in refused.output


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_interrupted_training_can_be_continued(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, number: signal.Signals
) -> None:
    def interrupt(callback: Snapshots) -> bool:
        if callback.num_timesteps >= 200:
            signal.raise_signal(number)
        return True

    if number == signal.SIGINT:  # whoever started the tests in the background had it ignored
        signal.signal(number, signal.default_int_handler)
    before = signal.getsignal(number)
    with monkeypatch.context() as patch:
        patch.setattr(Snapshots, "_on_step", interrupt)
        interrupted = command("train", write_config(tmp_path), "--runs-dir", tmp_path)
    assert interrupted.exit_code == 130
    assert signal.getsignal(number) == before
    assert int(RunFolder(tmp_path / "small").snapshots()[-1].name) == 200
    resumed = command("train", write_config(tmp_path), "--runs-dir", tmp_path, "--resume")
    assert resumed.exit_code == 0, resumed.output


def test_evaluation_publishes_every_episode_of_every_policy(finished: RunFolder) -> None:
    with (finished.path / "episodes.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    seeds = [row["seed"] for row in rows if row["policy"] == "trained"]
    assert seeds == [str(1_000_000 + episode) for episode in range(EPISODES)]
    for policy in ("random", "resolved rate"):
        assert [row["seed"] for row in rows if row["policy"] == policy] == seeds


def test_summary_agrees_with_the_episodes(finished: RunFolder) -> None:
    with (finished.path / "episodes.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    for summary in json.loads((finished.path / "evaluation.json").read_text())["summaries"]:
        own = [row for row in rows if row["policy"] == summary["policy"]]
        safe = [row["is_success"] == "True" and float(row["cost"]) == 0.0 for row in own]
        assert summary["safe_success_rate"]["estimate"] == sum(safe) / EPISODES
        assert summary["mean_cost"] == pytest.approx(sum(float(row["cost"]) for row in own) / EPISODES)


def test_evaluation_is_reproducible(run: RunFolder) -> None:
    first = {name: (run.path / name).read_bytes() for name in ("evaluation.json", "episodes.csv", "report.html")}
    assert command("evaluate", run.path / "model.zip").exit_code == 0
    assert {name: (run.path / name).read_bytes() for name in first} == first


def test_checkpoint_is_evaluated_in_its_own_folder(run: RunFolder) -> None:
    snapshot = run.snapshots()[0]
    evaluated = command("evaluate", snapshot, "--episodes", "2", "--seed", "2000000", "--no-report")
    assert evaluated.exit_code == 0, evaluated.output
    content = json.loads((snapshot / "evaluation.json").read_text())
    assert (content["training_steps"], content["seed"]) == (128, 2_000_000)
    assert not (snapshot / "report.html").exists()


def test_folder_without_a_model_is_an_error(tmp_path: Path) -> None:
    refused = command("evaluate", tmp_path)
    assert refused.exit_code == 1
    assert "no trained model" in refused.output


def test_controllers_are_those_of_the_configuration_and_the_first_is_judged(run: RunFolder) -> None:
    config = yaml.safe_load(run.config.read_text())
    config["evaluation"]["controllers"] = ["resolved rate", "trained"]
    run.config.write_text(yaml.safe_dump(config))
    evaluated = command("evaluate", run.path)
    assert evaluated.exit_code == 0, evaluated.output
    assert "Safe success of the resolved rate policy" in evaluated.output
    assert "points above trained." in evaluated.output
    summaries = json.loads((run.path / "evaluation.json").read_text())["summaries"]
    assert [summary["policy"] for summary in summaries] == ["resolved rate", "trained"]


def test_exported_policy_acts_as_the_model_and_says_where_it_comes_from(run: RunFolder) -> None:
    exported = command("export", run.path)
    assert exported.exit_code == 0, exported.output
    card = pcm_gym.load_policy(run.path / "policy.npz").card
    assert card["environment"] == {"id": "PCM/2RFR-Reach-v0", "kwargs": {}}
    assert (card["algorithm"], card["training_steps"], card["seed"]) == ("PPO", 256, 0)
    assert card["evaluation"] == json.loads((run.path / "evaluation.json").read_text())
    assert card["versions"]["torch"] == json.loads(run.versions.read_text())["torch"]
    assert parse_config(card["experiment"]) == load_config(run.config)
    again = command("evaluate", run.path / "policy.npz")
    assert again.exit_code == 0, again.output
    assert "is what the card says" in again.output
    snapshot = run.snapshots()[0]
    assert command("export", snapshot, "--output", run.path / "early.npz").exit_code == 0
    early = pcm_gym.load_policy(run.path / "early.npz").card
    assert (early["training_steps"], early["evaluation"]) == (128, None)
    refused = command("evaluate", run.path / "early.npz")
    assert refused.exit_code == 1
    assert "the card has no results" in refused.output
    assert command("evaluate", run.path / "nowhere.npz").exit_code == 1


def test_a_policy_that_does_not_come_to_what_its_card_says_is_told_of(run: RunFolder) -> None:
    content = json.loads((run.path / "evaluation.json").read_text())
    content["summaries"][0]["safe_success_rate"] = {"estimate": 2.0, "low": 1.9, "high": 2.1}
    (run.path / "evaluation.json").write_text(json.dumps(content))
    assert command("export", run.path).exit_code == 0
    failed = command("evaluate", run.path / "policy.npz")
    assert failed.exit_code == 1
    assert "is not what the card says: 200.0 % [190.0, 210.0]" in failed.output


class References(HTMLParser):
    """Everything that a page would fetch or link to, and the tags that are open at its end."""

    VOID = frozenset({"meta", "link", "input", "br"})

    def __init__(self, page: str) -> None:
        super().__init__()
        self.addresses: list[str] = []
        self.open: list[str] = []
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.addresses += [value or "" for name, value in attrs if name in {"src", "href", "xlink:href", "srcset"}]
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


def test_report_needs_nothing_from_elsewhere(finished: RunFolder) -> None:
    page = (finished.path / "report.html").read_text()
    references = References(page)
    assert references.open == []
    assert all(address.startswith(("#", "data:")) for address in references.addresses)
    assert not re.search(r"@import|fetch\(|XMLHttpRequest|url\((?!#)", page)
    assert set(re.findall(r"https?://[^\"' ]+", page)) <= {"http://www.w3.org/2000/svg", "http://www.w3.org/1999/xlink"}


def test_report_shows_every_rod_from_its_clamp_to_the_end_effector(finished: RunFolder) -> None:
    page = (finished.path / "report.html").read_text()
    found = re.search(r'<script type="application/json" id="recording">(.*?)</script>', page, re.DOTALL)
    assert found is not None
    recording = json.loads(found.group(1))
    assert sum(episode["policy"] == "trained" for episode in recording["episodes"]) == EPISODES
    bases = [actuator["base"] for actuator in recording["actuators"]]
    for episode in recording["episodes"]:
        for frame in episode["frames"]:
            assert [rod[:2] for rod in frame["rods"]] == bases
            for rod in frame["rods"]:
                assert rod[-2:] == pytest.approx(frame["tip"], abs=1)


def test_report_marks_every_lost_stability(finished: RunFolder) -> None:
    page = (finished.path / "report.html").read_text()
    recording = json.loads(page.split('id="recording">')[1].split("</script>")[0])
    for episode in recording["episodes"]:
        assert any(frame["unstable"] for frame in episode["frames"]) == (episode["outcome"] == "stability lost")


@pytest.mark.parametrize("module", ["agents.cli", "agents.train", "agents.evaluate"])
def test_modules_run_as_programs(module: str, tmp_path: Path) -> None:
    name = ["train"] if module == "agents.cli" else []
    code = [sys.executable, "-m", module, *name, str(tmp_path / "absent")]
    result = subprocess.run(code, capture_output=True, text=True, check=False)
    assert result.returncode == 1, result.stderr
    assert "absent" in result.stdout.replace("\n", "")


def test_help_loads_no_learning_library() -> None:
    heavy = ("torch", "stable_baselines3", "gymnasium", "matplotlib", "numba")
    code = f"import sys, agents.cli; print([name for name in {heavy} if name in sys.modules])"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert loaded.stdout.strip() == "[]"
    for name in ("train", "evaluate"):
        assert command(name, "--help").exit_code == 0
