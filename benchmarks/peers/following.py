"""What a peer is, and how its steps along the path are measured."""

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.peers.problem import STEPS, exact_path
from benchmarks.timing import Measure
from pcm_gym.arrays import Array

Places = NDArray[np.intp]
Step = Callable[[Array], Array]


@dataclass(frozen=True)
class Peer:
    """A way to follow the path.

    Attributes
    ----------
    prepare : callable
        Takes the place on the path where to begin, or one for each row, (rows,). Returns the step: from the next
        inputs, (2,) or (rows, 2), to the tips there, of the same shape. Raises ImportError without its package.
    setup : str
        How it was set up, in a line; the reasons stand in its module.
    tells : str
        What a step says beside the tip: of stability, of the branch.
    rows : int
        Mechanisms that step together, each elsewhere on the path.
    """

    prepare: Callable[[Places], Step]
    setup: str
    tells: str
    rows: int = 1


def follow(peer: Peer, seconds: float) -> Measure:
    """Return a measure of steps per second around the path, and of the largest distance from the exact tips, in L.

    A measurement lasts `seconds` and at least one step, and goes on where the last one ended. Slow peers see a part of
    the path.
    """
    path = exact_path()
    places = (np.arange(STEPS)[:, None] + np.arange(peer.rows)) % STEPS
    if peer.rows == 1:
        places = places[:, 0]
    targets, exact = path.inputs[places], path.tips[places]
    tips = np.full(exact.shape, np.nan)
    step, clock = peer.prepare(places[0]), time.perf_counter
    place = 0

    def measure() -> dict[str, float]:
        nonlocal place
        count, tips[:] = 0, np.nan
        start = now = clock()
        while now - start < seconds or count == 0:
            place = (place + 1) % STEPS
            tips[place] = step(targets[place])
            count += 1
            now = clock()
        seen = [(place - back) % STEPS for back in range(min(count, STEPS))]
        error = np.linalg.norm(tips[seen] - exact[seen], axis=-1).max()
        return {"steps_per_second": peer.rows * count / (now - start), "tip_error": float(error)}

    return measure
