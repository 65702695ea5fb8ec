"""A run's folder never loses a complete snapshot and never deletes what is not a run."""

from pathlib import Path

import pytest

from agents.experiments.runs import CONFIG, RunError, RunFolder, find_trained
from agents.learners.files import MODEL, NORMALISATION, REPLAY_BUFFER


def write_all(folder: Path) -> None:
    for name in (MODEL, NORMALISATION, REPLAY_BUFFER):
        (folder / name).write_text(folder.name)


@pytest.fixture
def run(tmp_path: Path) -> RunFolder:
    run = RunFolder(tmp_path / "run")
    run.create(replace=False)
    run.config.touch()
    return run


def test_existing_run_is_kept_unless_replaced(run: RunFolder) -> None:
    run.add_snapshot(500, write_all)
    with pytest.raises(RunError, match=r"--resume .* --force"):
        run.create(replace=False)
    run.create(replace=True)
    assert list(run.path.iterdir()) == []


def test_what_a_run_left_before_its_first_snapshot_is_no_obstacle(run: RunFolder) -> None:
    run.progress.touch()
    (run.path / "checkpoints" / "0000000100.partial").mkdir(parents=True)
    run.create(replace=False)
    assert list(run.path.iterdir()) == []


def test_folder_that_is_not_a_run_is_never_deleted(tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").touch()
    with pytest.raises(RunError, match="is not a run"):
        RunFolder(tmp_path).create(replace=True)
    assert (tmp_path / "thesis.tex").exists()


def test_newest_snapshot_is_the_run_s_model_and_alone_keeps_its_buffer(run: RunFolder) -> None:
    run.add_snapshot(500, write_all)
    run.add_snapshot(1_000, write_all)
    assert [int(folder.name) for folder in run.snapshots()] == [500, 1_000]
    assert [(folder / REPLAY_BUFFER).exists() for folder in run.snapshots()] == [False, True]
    assert (run.path / MODEL).read_bytes() == (run.snapshots()[-1] / MODEL).read_bytes()


@pytest.mark.parametrize("error", [OSError(28, "No space left on device"), RuntimeError("unexpected pos 64 vs 0")])
def test_snapshot_that_fails_half_way_leaves_the_earlier_ones(run: RunFolder, error: Exception) -> None:
    """A full disk, as the system tells of it, and as torch does."""

    def fail(folder: Path) -> None:
        (folder / MODEL).touch()
        raise error

    kept = run.add_snapshot(500, write_all)
    with pytest.raises(RunError, match=r"0000001000: the snapshot cannot be written: .*(space|pos)"):
        run.add_snapshot(1_000, fail)
    assert run.snapshots() == [kept]
    assert run.add_snapshot(1_000, write_all) in run.snapshots()


def test_model_is_found_in_a_run_in_a_snapshot_and_by_its_path(run: RunFolder) -> None:
    snapshot = run.add_snapshot(500, write_all)
    for path, folder in ((run.path, run.path), (snapshot, snapshot), (snapshot / MODEL, snapshot)):
        files = find_trained(path)
        assert (files.folder, files.model, files.config) == (folder, folder / MODEL, run.path / CONFIG)
        assert files.normalisation == folder / NORMALISATION


def test_missing_model_or_configuration_is_named(tmp_path: Path) -> None:
    with pytest.raises(RunError, match="no trained model"):
        find_trained(tmp_path)
    (tmp_path / MODEL).touch()
    with pytest.raises(RunError, match=CONFIG):
        find_trained(tmp_path)
