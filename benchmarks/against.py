"""Two checkouts of the project, timed in turn: has a change made anything slower?"""

import json
import os
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from benchmarks.timing import Summary

_WORKER = Path(__file__).with_name("checkout_worker.py")
HERE = Path(__file__).parents[1]


class Checkout:
    """A process that times what one checkout does."""

    def __init__(self, folder: Path) -> None:
        if not (folder / "pcm_gym" / "__init__.py").is_file():
            raise ValueError(f"must be the root of a checkout of this project, got {folder}")
        self._process = subprocess.Popen(
            [sys.executable, str(_WORKER)],
            cwd=folder,
            env={**os.environ, "PYTHONPATH": str(folder)},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        greeting = self._answer()
        self.measures: list[str] = greeting["measures"]
        if not Path(greeting["package"]).is_relative_to(folder):
            raise ValueError(f"the checkout in {folder} is hidden by the package in {greeting['package']}")

    def seconds(self, measure: str) -> float:
        """Return the seconds of a measure."""
        assert self._process.stdin is not None
        self._process.stdin.write(measure + "\n")
        self._process.stdin.flush()
        return float(self._answer()["seconds"])

    def close(self) -> None:
        """End the process."""
        self._process.terminate()
        self._process.wait()

    def _answer(self) -> dict[str, Any]:
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        if not line:
            raise RuntimeError(f"the process of a checkout ended with status {self._process.wait()}")
        answer: dict[str, Any] = json.loads(line)
        return answer


def paired_ratios(
    measure: str, mine: Checkout, other: Checkout, pairs: int, advance: Callable[[], None]
) -> list[float]:
    """Return how many times faster `mine` is than `other`, pair by pair, each pair in both orders in turn."""
    mine.seconds(measure), other.seconds(measure)  # makes both ready
    ratios = []
    for n in range(pairs):
        first, second = (mine, other) if n % 2 == 0 else (other, mine)
        times = {id(checkout): checkout.seconds(measure) for checkout in (first, second)}
        ratios.append(times[id(other)] / times[id(mine)])
        advance()
    return ratios


def print_ratios(console: Console, ratios: Mapping[str, Sequence[float]]) -> None:
    """Print a row per measure: above 1 this checkout is the faster one."""
    table = Table(title="How many times faster this checkout is than the other, pair by pair", title_justify="left")
    for heading in ("", "median", "min - max"):
        table.add_column(heading, justify="right" if heading else "left", no_wrap=True)
    for name, own in ratios.items():
        summary = Summary.of(list(own))
        table.add_row(name, f"{summary.median:.3f}", f"{summary.least:.2f} - {summary.most:.2f}")
    console.print(table)
