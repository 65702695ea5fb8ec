"""The cells of a benchmark: what each comes to, and the folder with a small file for each.

::

    <folder>/results.csv          the table of all cells, made of their files
             cells/<cell>.json    what a cell came to ...
             cells/<cell>.failed  ... or, in its place, why it came to nothing
"""

import csv
import io
import json
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Self

from pydantic import Field, model_validator

from agents.benchmarking.tiers import Tier
from agents.experiments.config import validated
from agents.experiments.files import write_whole
from agents.learners.settings import ConfigError, Count, Section

_RESULT, _FAILURE = ".json", ".failed"

Rate = Annotated[float, Field(ge=0, le=1)]
Amount = Annotated[float, Field(ge=0, allow_inf_nan=False)]


@dataclass(frozen=True)
class Cell:
    """One controller in one tier, with one seed.

    Attributes
    ----------
    tier : Tier
    learner : str
        A reference, or one of configs/learners.
    seed : int
        Of its training.
    total_steps : int
        That it learns; 0 for a reference.
    """

    tier: Tier
    learner: str
    seed: int
    total_steps: int

    @property
    def name(self) -> str:
        """Name of its files and of its training run."""
        parts = (self.tier.id.rpartition("/")[2], self.tier.name, self.learner, str(self.seed))
        return re.sub(r"[^A-Za-z0-9._-]+", "_", "-".join(part for part in parts if part))


class CellResult(Section):
    """What a cell came to: what is handed in, too.

    Attributes
    ----------
    id, tier, learner, seed
        Which cell it is.
    steps
        Steps of training that it took.
    episodes, first_seed
        Episode `i` was ``reset(seed=first_seed + i)`` of the test split.
    success, safe_success
        Parts of the episodes that end in success, and do so without any cost.
    losses_per_1000_steps
        Episodes that lose stability, for 1,000 steps.
    final_error
        Median distance from the goal at the end, in m.
    smallest_margin
        Least stability margin of all steps; None if no step has one.
    seconds_per_decision
        Time of an action, many rows at once, the simulation left aside.
    steps_to_success
        Of each episode: after how many steps it is first a success; None if it does not end in one. None in place of
        all where the goal moves, so that steps tell nothing.
    machine, versions
        What it was made with.
    """

    id: str
    tier: str
    learner: str
    seed: int
    steps: Annotated[int, Field(ge=0)]
    episodes: Count
    first_seed: int
    success: Rate
    safe_success: Rate
    losses_per_1000_steps: Amount
    final_error: Amount
    smallest_margin: float | None
    seconds_per_decision: Amount
    steps_to_success: tuple[Count | None, ...] | None
    machine: str
    versions: dict[str, str]

    @model_validator(mode="after")
    def _check_episodes(self) -> Self:
        if self.steps_to_success is not None and len(self.steps_to_success) != self.episodes:
            raise ValueError(f"steps_to_success must have one entry for each of {self.episodes} episodes")
        return self


class ResultsFolder:
    """The folder of a benchmark's results.

    Parameters
    ----------
    path
        Need not exist yet.
    """

    def __init__(self, path: Path) -> None:
        self.table = path / "results.csv"
        self._cells = path / "cells"

    def create(self) -> None:
        """Make it, if it is not there."""
        self._cells.mkdir(parents=True, exist_ok=True)

    def is_done(self, cell: Cell, episodes: int) -> bool:
        """Whether a cell has its result: of as many steps as are asked for, or more, and of as many episodes.

        Raises
        ------
        ConfigError
            If its file cannot be read as a result.
        """
        path = self._path(cell, _RESULT)
        if not path.exists():
            return False
        found = _read(path)
        return found.steps >= cell.total_steps and found.episodes == episodes

    def succeed(self, cell: Cell, result: CellResult) -> None:
        """Keep what a cell came to."""
        write_whole(self._path(cell, _RESULT), result.model_dump_json(indent=1) + "\n")
        self._path(cell, _FAILURE).unlink(missing_ok=True)

    def fail(self, cell: Cell, reason: str) -> None:
        """Keep why a cell came to nothing."""
        write_whole(self._path(cell, _FAILURE), reason + "\n")

    def failure(self, cell: Cell) -> str | None:
        """Why a cell came to nothing, when it was last tried."""
        path = self._path(cell, _FAILURE)
        return path.read_text(encoding="utf-8").strip() if path.exists() else None

    def results(self) -> list[CellResult]:
        """All results there are, in the order of their names: those of other learners, that were handed in, too.

        Raises
        ------
        ConfigError
            If a file is none.
        """
        return [_read(path) for path in sorted(self._cells.glob(f"*{_RESULT}"))]

    def write_table(self, columns: Sequence[str], rows: Iterable[Mapping[str, Any]]) -> None:
        """Write the table of all cells."""
        text = io.StringIO()
        writer = csv.DictWriter(text, fieldnames=columns, lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
        write_whole(self.table, text.getvalue())

    def _path(self, cell: Cell, ending: str) -> Path:
        return self._cells / f"{cell.name}{ending}"


def _read(path: Path) -> CellResult:
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (UnicodeDecodeError, ValueError, RecursionError) as error:
        raise ConfigError(f"{path}: not valid JSON: {error}") from error
    return validated(CellResult, content, source=str(path))
