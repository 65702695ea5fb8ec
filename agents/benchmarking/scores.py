"""All cells in one table: what each came to, and its steps against those of the planner."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from agents.benchmarking.cells import CellResult
from agents.evaluation.estimates import Interval, interquartile_mean

# Whose steps are counted against, as the shortest that are known.
PLANNER = "planner"
COLUMNS = (
    *("id", "tier", "learner", "seed", "steps", "episodes", "success", "safe_success", "losses_per_1000_steps", "spl"),
    *("final_error", "smallest_margin", "seconds_per_decision", "machine", "versions"),
)
MEASURES = ("success", "safe_success", "losses_per_1000_steps", "spl", "final_error", "seconds_per_decision")

Row = Mapping[str, Any]


@dataclass(frozen=True)
class Score:
    """What a learner comes to, with all of its seeds, in one tier or in several.

    Attributes
    ----------
    learner : str
    tiers, cells : int
        How many there are of it.
    measures : dict
        Interquartile means over the cells, by the names of `MEASURES`; None where no cell has such a number.
    """

    learner: str
    tiers: int
    cells: int
    measures: Mapping[str, Interval | None]


def rows_of(results: Sequence[CellResult]) -> list[Row]:
    """Row of the table for each cell, with the entries of `COLUMNS`."""
    planned = {_episodes(own): own.steps_to_success for own in results if own.learner == PLANNER}
    return [_row(own, success_by_path_length(own.steps_to_success, planned.get(_episodes(own)))) for own in results]


def success_by_path_length(steps: Sequence[int | None] | None, shortest: Sequence[int | None] | None) -> float | None:
    """Success weighted by path length (P. Anderson et al., 2018, arXiv:1807.06757), from 0 to 1.

    An episode counts with the planner's steps over its own, and at most with one; as nothing if it fails. Episodes in
    which the planner itself fails are left out.

    Parameters
    ----------
    steps, shortest
        Steps to success of the same episodes, of a controller and of the planner; None for an episode that fails.

    Returns
    -------
    float or None
        None where one of both is not known, or the planner never succeeds.
    """
    if steps is None or shortest is None:
        return None
    weights = [_weight(own, best) for own, best in zip(steps, shortest, strict=True) if best is not None]
    return float(np.mean(weights)) if weights else None


def scores(rows: Iterable[Row]) -> list[Score]:
    """What each learner comes to in all of the rows together, the best by safe success first."""
    by_learner: dict[str, list[Row]] = {}
    for row in rows:
        by_learner.setdefault(row["learner"], []).append(row)
    found = [_score(learner, own) for learner, own in by_learner.items()]
    return sorted(found, key=lambda own: -_estimate(own.measures["safe_success"]))


def _score(learner: str, rows: Sequence[Row]) -> Score:
    tiers = list(dict.fromkeys((row["id"], row["tier"]) for row in rows))
    return Score(learner, len(tiers), len(rows), {name: _measure(name, rows, tiers) for name in MEASURES})


def _measure(name: str, rows: Sequence[Row], tiers: Sequence[tuple[str, str]]) -> Interval | None:
    strata = [
        [row[name] for row in rows if (row["id"], row["tier"]) == tier and row[name] is not None] for tier in tiers
    ]
    strata = [values for values in strata if values]
    return interquartile_mean(strata) if strata else None


def _estimate(interval: Interval | None) -> float:
    return 0.0 if interval is None else interval.estimate


def _weight(own: int | None, best: int) -> float:
    return 0.0 if own is None else best / max(best, own)


def _episodes(own: CellResult) -> tuple[str, str, int, int]:
    return own.id, own.tier, own.episodes, own.first_seed


def _row(own: CellResult, spl: float | None) -> Row:
    versions = " ".join(f"{name}={version}" for name, version in own.versions.items())
    content = own.model_dump(include=set(COLUMNS)) | {"spl": spl, "versions": versions}
    return {name: content[name] for name in COLUMNS}
