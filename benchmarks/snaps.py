"""Where mechanisms fall, against chains of links that fall by themselves: ``python -m benchmarks.snaps``.

Folds are met on random walks from stable equilibria, through the landings of earlier snaps. Through each of them the
chains of `tests.reference.dense_relaxation` are pushed a little, and left until they rest. The package's landing,
followed to the same inputs and load, must be there.
"""

from dataclasses import dataclass
from typing import Annotated

import numpy as np
import typer
from rich.console import Console
from rich.progress import Progress
from rich.table import Table

import pcm_gym
from pcm_gym import BranchTracker, Equilibrium, Event, Snap
from pcm_gym.arrays import Array
from tests.reference.dense_relaxation import Law, push_over

# Share of the folds per mechanism, and how far the inputs and the load of a walk may go.
_SHARES = {"2RFR": 0.35, "2PFR": 0.25, "3PFR": 0.4}
_LARGEST_LOAD = 30.0  # EI / L^2
_WITHIN_LIMITS = 0.9
# Chains and rods at the same equilibrium differ by less than this part of a length, two equilibria by more.
_SAME = 0.03


@dataclass(frozen=True)
class Fold:
    """A fold, the way on which it was met, and where the package says that the mechanism falls from it."""

    equilibrium: Equilibrium
    inputs_rate: Array  # both per unit of (inputs, load / _LARGEST_LOAD), dimensionless
    load_rate: Array
    snap: Snap


def find_folds(name: str, count: int, rng: np.random.Generator) -> list[Fold]:
    """Return folds met on random walks; every second walk changes the load too."""
    mechanism = pcm_gym.get_mechanism(name)
    units, pool = mechanism.units, [pcm_gym.home_equilibrium(mechanism)]
    folds: list[Fold] = []
    middle, reach = mechanism.lower_limits + mechanism.upper_limits, mechanism.upper_limits - mechanism.lower_limits
    walks = 0
    while len(folds) < count:
        walks += 1
        start = pool[rng.integers(len(pool))]
        inputs = 0.5 * (middle + _WITHIN_LIMITS * reach * rng.uniform(-1.0, 1.0, mechanism.leg_count))
        load = _LARGEST_LOAD * units.load * rng.uniform(-1.0, 1.0, mechanism.dof) * (walks % 2)
        step = BranchTracker(mechanism, start).step(inputs, load)
        if step.event != Event.FOLD:
            pool.append(step.equilibrium)
            continue
        snap = pcm_gym.snap(step.equilibrium)
        if snap.is_landed:
            pool.append(snap.equilibrium)
        way = np.concatenate([(inputs - start.inputs) / units.inputs, (load - start.load) / units.load / _LARGEST_LOAD])
        way /= np.linalg.norm(way)
        inputs_rate, load_rate = np.split(way, [mechanism.leg_count])
        folds.append(Fold(step.equilibrium, inputs_rate * units.inputs, load_rate * units.load * _LARGEST_LOAD, snap))
    return folds


def distance(fold: Fold, links: int, law: Law = "positions", push: float = 0.01) -> float:
    """Return how far, in mean lengths, the chains come to rest from the package's landing; nan where that is lost."""
    mechanism = fold.equilibrium.mechanism
    rest, inputs, load = push_over(fold.equilibrium, fold.inputs_rate, fold.load_rate, links, law, push)
    step = BranchTracker(mechanism, fold.snap.equilibrium).step(inputs, load)
    if not fold.snap.is_landed or step.event != Event.NONE:
        return float("nan")
    apart = np.linalg.norm(rest.joints - step.equilibrium.shape(links + 1), axis=2)
    return float(apart.max()) / mechanism.units.length


def main(
    count: Annotated[int, typer.Option(min=3, help="Folds in all.")] = 200,
    links: Annotated[int, typer.Option(min=8, help="Links of each chain.")] = 32,
    seed: Annotated[int, typer.Option(help="Of the walks.")] = 0,
) -> None:
    """Compare landings with chains of links, whose drag resists their motion, and with such as resist turning."""
    console = Console(width=None if Console().is_terminal else 150)
    rng = np.random.default_rng(seed)
    table = Table(
        "", "folds", "with load", "landed", "same", "same, turning resisted", "farthest same", "shortest fall"
    )
    with Progress(console=console, transient=True) as progress:
        for name, share in _SHARES.items():
            folds = find_folds(name, round(share * count), rng)
            task = progress.add_task(name, total=2 * len(folds))
            found: dict[Law, list[float]] = {"positions": [], "angles": []}
            for number, fold in enumerate(folds):
                for law, distances in found.items():
                    distances.append(distance(fold, links, law))
                    progress.advance(task)
                if not found["positions"][-1] < _SAME:
                    _explain(console, f"{name} {number}", fold, links)
            by_law = {law: np.array(distances) for law, distances in found.items()}
            same = by_law["positions"] < _SAME
            table.add_row(
                name,
                str(len(folds)),
                str(sum(bool(fold.equilibrium.load.any()) for fold in folds)),
                str(sum(fold.snap.is_landed for fold in folds)),
                str(same.sum()),
                str((by_law["angles"] < _SAME).sum()),
                f"{by_law['positions'][same].max():.1e}",
                f"{min(_fall(fold) for fold in folds):.1e}",
            )
    console.print(table)


def _fall(fold: Fold) -> float:
    """Return how far, in mean lengths, the landing is from the fold."""
    apart = np.linalg.norm(fold.equilibrium.shape() - fold.snap.equilibrium.shape(), axis=2)
    return float(apart.max()) / fold.equilibrium.mechanism.units.length


def _explain(console: Console, name: str, fold: Fold, links: int) -> None:
    """Print how far from the landing chains rest that are finer, that are pushed less, and that resist turning."""
    others = {
        "as it is": distance(fold, links),
        "twice the links": distance(fold, 2 * links),
        "half the push": distance(fold, links, push=0.005),
        "twice the push": distance(fold, links, push=0.02),
        "turning resisted": distance(fold, links, "angles"),
    }
    console.print(
        f"{name}: {fold.snap.status}, {fold.equilibrium!r};",
        ", ".join(f"{key} {value:.1e}" for key, value in others.items()),
        soft_wrap=True,
    )


if __name__ == "__main__":
    typer.run(main)
