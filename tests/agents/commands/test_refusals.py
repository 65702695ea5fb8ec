"""What a user can mend is said in a sentence, without a traceback, and a command that fails says so to the shell."""

import errno
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import yaml
from typer.testing import CliRunner, Result

from agents.commands.app import app
from agents.experiments.runs import RunFolder
from agents.learners import policy, progress, provenance
from agents.learners.files import PICKLES
from agents.learners.settings import ModelError
from agents.learners.vector_adapter import NativeVecEnv

EXPERIMENT: dict[str, Any] = {
    "name": "small",
    "environment": {"id": "PCM/2RFR-Reach-v0"},
    "hyperparameters": {"n_steps": 16, "batch_size": 32, "n_epochs": 1, "policy_kwargs": {"net_arch": [4]}},
    "num_envs": 2,
    "total_steps": 64,
    "evaluation": {"episodes": 2},
}


def command(*arguments: str | Path) -> Result:
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def train(folder: Path, *options: str, **changes: Any) -> Result:
    path = folder / "small.yaml"
    path.write_text(yaml.safe_dump(EXPERIMENT | changes))
    return command("train", path, "--runs-dir", folder, *options)


def assert_refused(result: Result, *words: str) -> None:
    assert result.exit_code == 1, result.output
    assert isinstance(result.exception, SystemExit)  # typer's own way to end, no error that escaped
    for word in words:
        assert word in result.output
    assert "Traceback" not in result.output


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"environment": {"id": "PCM/4RFR-Reach-v0"}}, ("PCM/4RFR-Reach-v0", "doesn't exist")),
        ({"environment": {"id": "nothing at all"}}, ("nothing at all",)),
        ({"environment": {"id": "no_such_file:PCM/2RFR-Reach-v0"}}, ("no_such_file",)),
        ({"environment": {"id": "CartPole-v1"}}, ("CartPole-v1", "autoreset_mode")),
        ({"environment": {"id": "PCM/2RFR-Reach-v0", "kwargs": {"sped": 3}}}, ("'sped' is no argument",)),
        ({"environment": {"id": "PCM/2RFR-Reach-v0", "kwargs": {"num_envs": 3}}}, ("num_envs",)),
        (
            {"environment": {"id": "PCM/2RFR-Reach-v0", "kwargs": {"max_action": 3.0}}},
            ("singular_margin", "max_action"),
        ),
        ({"hyperparameters": {"n_steps": "many"}}, ("hyperparameters of PPO",)),
        ({"hyperparameters": {"gama": 0.9}}, ("hyperparameters unknown to PPO: gama",)),
        ({"hyperparameters": {"learning_rate": {"start": 1}}}, ("hyperparameters.learning_rate: a schedule",)),
    ],
)
def test_what_cannot_be_made_is_said(tmp_path: Path, changes: dict[str, Any], words: tuple[str, ...]) -> None:
    assert_refused(train(tmp_path, **changes), "small.yaml: ", *words)
    assert not (tmp_path / "small").exists()


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("name: \xff".encode("latin-1"), ("not text in UTF-8",)),
        (b"name: [" * 50_000, ("nested too deeply",)),
        (b"name: 2020-99-99", ("not valid YAML", "month")),
        (b"name: {", ("not valid YAML",)),
        (b"total_steps: " + b"9" * 5000, ("not valid YAML", "4300")),
        (b"", ("the whole: Input should be",)),
        (b"\x00\x01", ("not valid YAML",)),
    ],
)
def test_a_file_that_describes_no_experiment_is_refused(tmp_path: Path, content: bytes, words: tuple[str, ...]) -> None:
    path = tmp_path / "broken.yaml"
    path.write_bytes(content)
    assert_refused(command("train", path, "--runs-dir", tmp_path), "broken.yaml", *words)
    assert_refused(command("train", tmp_path, "--runs-dir", tmp_path), "cannot be read")


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory) -> RunFolder:
    folder = tmp_path_factory.mktemp("run")
    result = train(folder)
    assert result.exit_code == 0, result.output
    return RunFolder(folder / "small")


@pytest.mark.parametrize("name", ["model.zip", "normalisation.pkl"])
@pytest.mark.parametrize("content", [b"", b"no model", b"PK\x05\x06" + bytes(18), b"\x80\x04N.", "cut", "changed"])
def test_a_broken_model_is_refused(trained: RunFolder, tmp_path: Path, name: str, content: Any) -> None:
    for part in ("model.zip", "normalisation.pkl", "config.yaml"):
        (tmp_path / part).write_bytes((trained.path / part).read_bytes())
    whole = bytearray((trained.path / name).read_bytes())
    if content == "changed":
        whole[len(whole) // 3 : len(whole) // 2] = bytes(len(whole) // 2 - len(whole) // 3)
    (tmp_path / name).write_bytes(
        content if isinstance(content, bytes) else whole[: None if content == "changed" else 99]
    )
    assert_refused(command("evaluate", tmp_path, "--no-report"), name, "cannot be read as a trained model")


def test_readers_of_models_have_one_family_of_errors(trained: RunFolder, tmp_path: Path) -> None:
    nothing = tmp_path / "nothing"
    with pytest.raises(ModelError):
        policy.load_policy("PPO", nothing, None)
    with pytest.raises(ModelError):
        policy.load_policy("PPO", trained.path / "model.zip", nothing)
    for content in (b"\xff\xfe", b"a,b\n1,x\n", b"a\n" + b"9" * 200_000, b"a\n1,2\n"):
        (tmp_path / "progress.csv").write_bytes(content)
        with pytest.raises(ModelError):
            progress.read_progress(tmp_path / "progress.csv")


def test_a_full_disk_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: Any) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("agents.experiments.training.save_learner", full)
    assert_refused(train(tmp_path), "snapshot cannot be written", "No space left on device")
    monkeypatch.setattr(RunFolder, "write_versions", full)
    assert_refused(train(tmp_path), "No space left on device")


def test_a_run_that_was_killed_before_its_first_checkpoint_is_started_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def die(*_: Any) -> None:
        raise MemoryError  # nothing is saved on the way out

    with monkeypatch.context() as patch:
        patch.setattr(NativeVecEnv, "step_wait", die)
        assert isinstance(train(tmp_path).exception, MemoryError)
    assert (tmp_path / "small" / "config.yaml").exists()
    assert_refused(train(tmp_path, "--resume"), "nothing to resume", "start it without --resume")
    assert train(tmp_path).exit_code == 0
    assert len(RunFolder(tmp_path / "small").snapshots()) == 1


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["PCM/2RFR-Reach-v0", "--learner", "bbo"], ("learner 'bbo'", "ppo, ppo_imitation")),
        (["PCM/4RFR-Reach-v0"], ("PCM/4RFR-Reach-v0: environment", "doesn't exist")),
        (["PCM/2RFR-Reach-v0", "--with", "difficulty=hard"], ("difficulty must be one of",)),
        (["PCM/2RFR-Reach-v0", "--with", "difficulty"], ("--with difficulty: an argument", "NAME=VALUE")),
        (["PCM/2RFR-Reach-v0", "--with", "load=[1"], ("--with load=[1: not valid YAML",)),
        (["small.yaml", "--learner", "ppo"], ("small.yaml: --learner and --with belong to an environment's id",)),
        (["small"], ("small: cannot be read",)),
    ],
)
def test_what_is_asked_for_by_id_and_cannot_be_is_said(arguments: list[str], words: tuple[str, ...]) -> None:
    assert_refused(command("train", *arguments), *words)


def test_files_that_were_not_written_here_are_warned_of(trained: RunFolder, tmp_path: Path) -> None:
    shutil.copytree(trained.path, tmp_path / "moved")
    whole = command("evaluate", tmp_path / "moved", "--no-report")
    assert whole.exit_code == 0, whole.output
    assert "Warning" not in whole.output
    (tmp_path / "moved" / "written_here.json").unlink()
    for name in ("evaluate", "export"):
        warned = command(name, tmp_path / "moved", *(["--no-report"] if name == "evaluate" else []))
        assert warned.exit_code == 0, warned.output
        for pickled in ("model.zip", "normalisation.pkl"):
            assert f"{pickled} was not written here" in warned.output
    snapshot = RunFolder(tmp_path / "moved").snapshots()[-1]
    (snapshot / "model.zip").write_bytes((snapshot / "model.zip").read_bytes() + b" ")
    assert provenance.foreign(snapshot / name for name in PICKLES) == [snapshot / "model.zip"]
    resumed = train(tmp_path, "--resume", name="moved", total_steps=128)
    assert "model.zip was not written here" in resumed.output


def test_without_a_place_for_a_key_all_files_are_foreign(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "taken").touch()
    monkeypatch.setattr(provenance, "user_data_path", lambda _: tmp_path / "taken")
    (tmp_path / "snapshot").mkdir()
    (tmp_path / "snapshot" / "model.zip").touch()
    provenance.mark(tmp_path / "snapshot")
    assert provenance.foreign((tmp_path / "snapshot").iterdir()) == [tmp_path / "snapshot" / "model.zip"]


def run_python(code: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)


def test_the_module_is_the_command() -> None:
    arguments = [sys.executable, "-m", "agents.cli", "train", "nowhere.yaml"]
    refused = subprocess.run(arguments, capture_output=True, text=True, check=False)
    assert refused.returncode == 1
    assert "nowhere.yaml: cannot be read: No such file or directory" in refused.stdout


def test_what_is_not_installed_is_named_with_the_extra_that_brings_it() -> None:
    without_typer = run_python("import sys; sys.modules['typer'] = None; from agents.cli import main; main()")
    assert (without_typer.returncode, without_typer.stderr) == (
        1,
        "pcm-gym needs typer, which is not installed: pip install 'pcm_gym[agents]'\n",
    )
    drawing = "import sys; sys.modules['PIL'] = None; import gymnasium, pcm_gym; "
    drawing += "env = gymnasium.make('PCM/2RFR-Reach-v0', render_mode='rgb_array'); env.reset(); env.render()"
    without_pillow = run_python(drawing)
    assert without_pillow.returncode == 1
    last = without_pillow.stderr.splitlines()[-1]
    assert last == "ImportError: pictures need Pillow, which is not installed: pip install 'pcm_gym[render]'"
