"""Where a training run keeps its files, and how snapshots of the learner get there.

::

    runs/<name>/config.yaml           the experiment, defaults included
                versions.json         packages it was trained with
                model.zip             the newest snapshot of the learner ...
                normalisation.pkl     ... and the statistics its observations are normalised with
                written_here.json         tells these files from those of others
                progress.csv          the learning curve
                tensorboard/
                checkpoints/<steps>/  every snapshot; the newest also holds the replay buffer, if there is one
                evaluation.json, episodes.csv, report.html
                policy.npz                the policy alone, as `agents.export` writes it
"""

import json
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from agents.experiments.files import PARTIAL, write_whole
from agents.experiments.machine import versions
from agents.learners.files import MODEL, NORMALISATION, REPLAY_BUFFER
from agents.learners.provenance import MARKS
from agents.learners.settings import UsageError

CONFIG = "config.yaml"
PROGRESS = "progress.csv"
EVALUATION = "evaluation.json"
POLICY = "policy.npz"

_LEVELS_ABOVE_A_MODEL = 3


class RunError(UsageError):
    """A run folder that cannot be used as asked; the message says what to do."""


@dataclass(frozen=True)
class RunFolder:
    """Paths inside one run's folder."""

    path: Path

    @property
    def config(self) -> Path:
        """The experiment."""
        return self.path / CONFIG

    @property
    def versions(self) -> Path:
        """Versions of the packages used."""
        return self.path / "versions.json"

    @property
    def progress(self) -> Path:
        """The learning curve."""
        return self.path / PROGRESS

    @property
    def tensorboard(self) -> Path:
        """Event files of TensorBoard."""
        return self.path / "tensorboard"

    def create(self, *, replace: bool) -> None:
        """Make the folder; what an earlier run left in it before its first snapshot is deleted.

        With `replace`, any earlier run is.

        Raises
        ------
        RunError
            If the folder holds a run with a model and `replace` is false, or holds something that is not a run.
        """
        if self.path.exists() and not self.path.is_dir():
            raise RunError(f"{self.path} is not a folder")
        if self.path.exists() and any(path.suffix != PARTIAL for path in self.path.iterdir()):
            if not self.config.exists():
                raise RunError(f"{self.path} is not a run ({CONFIG} is missing), so it is not deleted")
            if not replace and (self.snapshots() or (self.path / MODEL).exists()):
                raise RunError(f"{self.path} already holds a run: --resume continues it, --force starts it afresh")
            _delete(self.path)
        self.path.mkdir(parents=True, exist_ok=True)

    def snapshots(self) -> list[Path]:
        """Folders of the complete snapshots, oldest first."""
        return sorted(folder for folder in (self.path / "checkpoints").glob("[0-9]*") if folder.suffix == "")

    def add_snapshot(self, steps: int, write: Callable[[Path], None]) -> Path:
        """Keep a snapshot that `write` puts into an empty folder; make it the run's model.

        The folder gets its name only when it is complete. Only the newest snapshot keeps its replay buffer.

        Raises
        ------
        RunError
            If it cannot be written; the snapshots before it stay.
        """
        folder = self.path / "checkpoints" / f"{steps:010d}"
        partial = folder.with_suffix(PARTIAL)
        for leftover in (partial, folder):
            shutil.rmtree(leftover, ignore_errors=True)
        try:
            partial.mkdir(parents=True)
            write(partial)
            partial.rename(folder)
            self._publish(folder)
        except (OSError, RuntimeError) as error:  # on a full disk torch raises one of its own
            shutil.rmtree(partial, ignore_errors=True)
            raise RunError(f"{folder}: the snapshot cannot be written: {error}") from error
        return folder

    def _publish(self, newest: Path) -> None:
        for name in (MODEL, NORMALISATION, MARKS):
            if (newest / name).exists():
                shutil.copy2(newest / name, self.path / name)
        for snapshot in self.snapshots():
            if snapshot != newest:
                (snapshot / REPLAY_BUFFER).unlink(missing_ok=True)

    def write_versions(self) -> None:
        """Record the versions of Python and of the packages that decide the result."""
        write_whole(self.versions, json.dumps(versions(), indent=2) + "\n")


@dataclass(frozen=True)
class TrainedFiles:
    """A trained model and what belongs to it; `folder` is where its evaluation goes."""

    folder: Path
    model: Path
    normalisation: Path | None
    config: Path

    @property
    def pickles(self) -> list[Path]:
        """Those of the files that are pickles."""
        return [self.model] if self.normalisation is None else [self.model, self.normalisation]


def find_trained(path: Path) -> TrainedFiles:
    """Files of the model in a run's folder, in a snapshot's folder, or given by its own path.

    Raises
    ------
    RunError
        If there is no model, or no ``config.yaml`` beside it or above it.
    """
    model = path / MODEL if path.is_dir() else path
    if not model.is_file():
        raise RunError(f"{path}: no trained model found ({MODEL} is missing)")
    folder = model.parent
    normalisation = folder / NORMALISATION
    return TrainedFiles(folder, model, normalisation if normalisation.exists() else None, _config_above(folder))


def _config_above(folder: Path) -> Path:
    folders = [folder, *folder.absolute().parents][:_LEVELS_ABOVE_A_MODEL]
    found = next((place / CONFIG for place in folders if (place / CONFIG).is_file()), None)
    if found is None:
        raise RunError(f"{folder}: {CONFIG} is missing beside the model and above it")
    return found


def _delete(folder: Path) -> None:
    """Delete a folder so that no half of it bears its name, if it is killed meanwhile."""
    leaving = folder.with_name(f"{folder.name}{PARTIAL}")
    shutil.rmtree(leaving, ignore_errors=True)
    folder.rename(leaving)
    shutil.rmtree(leaving)
