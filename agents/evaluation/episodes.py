"""What an episode comes to, and what is noted of it on the way."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from pcm_gym.arrays import Array, Integers, Mask

NOTED_INFOS = ("is_success", "cost", "cost_unstable", "cost_solver", "stability_margin", "singularity_margin")


@dataclass(frozen=True)
class EpisodeResult:
    """What one episode came to; a row of the published table.

    Attributes
    ----------
    policy, episode, seed
        Who acted, and from which start to which goal: episode `i` is the same for every policy.
    is_success
        Whether the goal was reached at the last step.
    is_safe_success
        Success, and not a single step of the episode had a cost.
    is_violation
        Whether stability was lost.
    is_solver_failure
        Whether the solver gave up in some step.
    final_error
        Distance of the end-effector from the goal at the last step, in the mechanism's unit of length.
    smallest_stability_margin, smallest_singularity_margin
        Smallest of the episode; nan if no step has one.
    cost
        Sum over the episode.
    longest_cost_run
        Greatest number of successive steps with a cost.
    total_reward
        Sum over the episode, not discounted.
    length
        Number of steps.
    """

    policy: str
    episode: int
    seed: int
    is_success: bool
    is_safe_success: bool
    is_violation: bool
    is_solver_failure: bool
    final_error: float
    smallest_stability_margin: float
    smallest_singularity_margin: float
    cost: float
    longest_cost_run: int
    total_reward: float
    length: int

    @classmethod
    def of(cls, policy: str, episode: int, seed: int, steps: Mapping[str, Array], final_error: float) -> Self:
        """Result of an episode, at least one step long, from what `StepLog` noted of it."""
        costs, is_success = steps["cost"], bool(steps["is_success"][-1])
        return cls(
            policy=policy,
            episode=episode,
            seed=seed,
            is_success=is_success,
            is_safe_success=is_success and not costs.any(),
            is_violation=bool(steps["cost_unstable"].any()),
            is_solver_failure=bool(steps["cost_solver"].any()),
            final_error=final_error,
            smallest_stability_margin=float(np.fmin.reduce(steps["stability_margin"])),
            smallest_singularity_margin=float(np.fmin.reduce(steps["singularity_margin"])),
            cost=float(costs.sum()),
            longest_cost_run=longest_run(costs > 0.0),
            total_reward=float(steps["reward"].sum()),
            length=len(costs),
        )


class StepLog:
    """What the steps of the episodes under way came to, one episode in each of `count` rows."""

    def __init__(self, count: int) -> None:
        self.lengths: Integers = np.zeros(count, dtype=np.int64)
        self._rows = np.arange(count)
        self._values = np.empty((count, 1 + len(NOTED_INFOS), 128))

    def begin(self, rows: Mask) -> None:
        """Forget the episodes in the rows of the mask (count,): others begin there."""
        self.lengths[rows] = 0

    def add(self, rewards: Array, infos: Mapping[str, Any]) -> None:
        """Note one step of every row: its rewards (count,) and infos."""
        if self.lengths.max() == self._values.shape[2]:
            self._values = np.concatenate([self._values, np.empty_like(self._values)], axis=2)
        noted = [rewards, *(infos[key] for key in NOTED_INFOS)]
        self._values[self._rows, :, self.lengths] = np.stack(noted, axis=1)
        self.lengths += 1

    def steps(self, row: int) -> dict[str, Array]:
        """What was noted of the episode in a row: for each key an array (steps,), valid until the row begins anew."""
        return dict(zip(("reward", *NOTED_INFOS), self._values[row, :, : self.lengths[row]], strict=True))


def longest_run(flags: Mask) -> int:
    """Greatest number of successive true values."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], flags, [False])).astype(np.int8)))
    return int((edges[1::2] - edges[::2]).max(initial=0))
