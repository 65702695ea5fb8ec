"""What a batch is and what a step of it comes to: one row per environment."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pcm_gym.arrays import Array, Integers, Mask
from pcm_gym.kernels.statics.states import States
from pcm_gym.kernels.stepping.goals import Pursuit
from pcm_gym.kernels.stepping.report import (
    EVENT,
    LIMIT,
    MORSE_INDEX,
    RESIDUAL,
    SINGULAR,
    SINGULARITY_MARGIN,
    SOLVER,
    STABILITY_MARGIN,
    UNSTABLE,
)
from pcm_gym.solving.tracking import EVENTS

_EVENT_NAMES = np.array([event.value for event in EVENTS], dtype=object)


class Rows(NamedTuple):
    """Everything that the future of a batch depends on, one row per environment, dimensionless as in the kernels."""

    x: Array  # (n, 2 legs + d)
    inputs: Array  # (n, legs)
    load: Array  # (n, d)
    scene: Integers  # (n,): which one the episode takes place in
    goals: Array  # (n, p, g): the goals of successive steps, over and over
    witness: Array  # (n, legs + 2 legs + d): inputs and state that meet the first goal, not a number if none is known
    elapsed: Integers  # (n,): steps since the reset
    held: Integers  # (n,): states in a row, the present one included, that are at their goal
    lost: Mask  # (n,): whether a loss of stability has ended the episode
    commands: Array  # (n, legs): what the actuators have been told
    drives: Array  # (n, legs): where their drives are

    @property
    def states(self) -> States:
        """The dynamic states."""
        return States(self.x, self.inputs, self.load)

    @property
    def pursuit(self) -> Pursuit:
        """The goals and how far their pursuit has come."""
        return Pursuit(self.goals, self.elapsed, self.held)


class Outcome(NamedTuple):
    """What one step, or a reset, of some rows came to; every array is new."""

    observation: dict[str, Array]
    reward: Array  # (n,)
    terminated: Mask  # (n,): stability was lost, and what comes of it is not followed
    failed: Mask  # (n,): the solver failed
    success: Mask  # (n,)
    costs: Array  # (4, n)
    verdicts: Array  # (7, n)

    def row_info(self, row: int) -> dict[str, Any]:
        """Return the info of one row, in Python's own types."""
        verdict, costs = self.verdicts[:, row].tolist(), self.costs[:, row].tolist()
        return {
            "is_success": bool(self.success[row]),
            "cost": sum(costs),
            "cost_unstable": costs[UNSTABLE],
            "cost_singular": costs[SINGULAR],
            "cost_limit": costs[LIMIT],
            "cost_solver": costs[SOLVER],
            "index": int(verdict[MORSE_INDEX]),
            "stability_margin": verdict[STABILITY_MARGIN],
            "singularity_margin": verdict[SINGULARITY_MARGIN],
            "residual": verdict[RESIDUAL],
            "event": _EVENT_NAMES[int(verdict[EVENT])],
        }

    def infos(self) -> dict[str, NDArray[Any]]:
        """Return the infos of all rows, one array per key; those of numbers are parts of this outcome."""
        verdicts, costs = self.verdicts, self.costs
        return {
            "is_success": self.success,
            "cost": costs.sum(axis=0),
            "cost_unstable": costs[UNSTABLE],
            "cost_singular": costs[SINGULAR],
            "cost_limit": costs[LIMIT],
            "cost_solver": costs[SOLVER],
            "index": verdicts[MORSE_INDEX].astype(np.int64),
            "stability_margin": verdicts[STABILITY_MARGIN],
            "singularity_margin": verdicts[SINGULARITY_MARGIN],
            "residual": verdicts[RESIDUAL],
            "event": _EVENT_NAMES[verdicts[EVENT].astype(np.int64)],
        }
