"""Interleaved repeated measurements and their summary."""

import statistics
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from typing import Any

Measure = Callable[[], dict[str, float]]


@dataclass(frozen=True)
class Summary:
    """Median and range of repeated measurements."""

    median: float
    least: float
    most: float

    @classmethod
    def of(cls, values: list[float]) -> "Summary":
        return cls(statistics.median(values), min(values), max(values))

    def as_dict(self) -> dict[str, float]:
        return asdict(self)


def interleave(
    measures: Mapping[str, Measure], repeats: int, progress: Callable[[], Any]
) -> dict[str, dict[str, Summary]]:
    """Measure A B C A B C ..., so that whatever else the machine does falls on all alike.

    Returns
    -------
    dict
        Per name and per number that the measure returns, the summary over the repeats.
    """
    found: dict[str, list[dict[str, float]]] = {name: [] for name in measures}
    for _ in range(repeats):
        for name, measure in measures.items():
            found[name].append(measure())
            progress()
    return {
        name: {key: Summary.of([result[key] for result in results]) for key in results[0]}
        for name, results in found.items()
    }
