"""The results as a page in Markdown."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from agents.benchmarking.cells import Cell, ResultsFolder
from agents.benchmarking.config import BenchmarkConfig
from agents.benchmarking.scores import Row, Score, rows_of, scores
from agents.controllers.table import remarks
from agents.evaluation.estimates import Interval

_TEMPLATES = Path(__file__).parent / "templates"
_MM_PER_M, _MICROSECONDS_PER_SECOND = 1e3, 1e6
# How a measure is written, in the order of the columns: the factor to its unit there, and digits after the point.
_WRITTEN: Mapping[str, tuple[float, int]] = {
    "safe_success": (100.0, 1),
    "success": (100.0, 1),
    "losses_per_1000_steps": (1.0, 2),
    "spl": (1.0, 3),
    "final_error": (_MM_PER_M, 1),
    "seconds_per_decision": (_MICROSECONDS_PER_SECOND, 1),
}


@dataclass(frozen=True)
class _Section:
    """A tier and what everybody comes to in it."""

    id: str
    tier: str
    scores: Sequence[Score]


@dataclass(frozen=True)
class _Missing:
    """A tier and, for each controller of the benchmark, how many of its cells there are: "3/5"."""

    id: str
    tier: str
    counts: Sequence[str]


def page(config: BenchmarkConfig, source: Path, folder: ResultsFolder) -> str:
    """Page of all results in the folder, and of what is missing of those that the benchmark asks for.

    Parameters
    ----------
    config
        The benchmark.
    source
        Its file, as the page calls it.
    folder
        Where the results are.
    """
    rows, cells = rows_of(folder.results()), config.cells()
    missing = [cell for cell in cells if not folder.is_done(cell, config.episodes)]
    environment = Environment(
        loader=FileSystemLoader(_TEMPLATES), undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )  # of Markdown: nothing is escaped
    return environment.get_template("benchmark.md").render(
        config=config,
        source=source.as_posix(),
        cells=len(cells),
        missing_cells=len(missing),
        controllers=(*config.references, *config.learners),
        missing=_missing(config, cells, missing),
        failures=[(cell, reason) for cell in missing if (reason := folder.failure(cell))],
        remarks={name: remarks()[name] for name in config.references},
        together=scores(rows),
        sections=_sections(rows),
        machines=sorted({row["machine"] for row in rows}),
        versions=sorted({row["versions"] for row in rows}),
        written=_written,
    )


def _sections(rows: Sequence[Row]) -> list[_Section]:
    tiers = dict.fromkeys((row["id"], row["tier"]) for row in rows)
    return [_Section(*tier, scores=scores(row for row in rows if (row["id"], row["tier"]) == tier)) for tier in tiers]


def _missing(config: BenchmarkConfig, cells: Sequence[Cell], missing: Sequence[Cell]) -> list[_Missing]:
    """Tiers of which cells are missing."""
    found = []
    for tier in config.chosen_tiers():
        counts = []
        for name in (*config.references, *config.learners):
            asked, absent = (
                sum(1 for cell in of if (cell.tier, cell.learner) == (tier, name)) for of in (cells, missing)
            )
            counts.append(f"{asked - absent}/{asked}")
        if any(cell.tier == tier for cell in missing):
            found.append(_Missing(tier.id, tier.name, counts))
    return found


def _written(score: Score) -> list[str]:
    return [_write(score.measures[name], *how) for name, how in _WRITTEN.items()]


def _write(interval: Interval | None, unit: float, digits: int) -> str:
    if interval is None:
        return ""
    estimate, low, high = (f"{unit * own:.{digits}f}" for own in (interval.estimate, interval.low, interval.high))
    return estimate if low == "nan" else f"{estimate} [{low}, {high}]"
