"""Model-predictive control by sampling: what the next steps would come to is asked of the exact model."""

import numpy as np

from pcm_gym.arrays import Array, Integers
from pcm_gym.environments.preview import foreseen_rewards
from pcm_gym.environments.rows import total_cost
from pcm_gym.environments.shield import arrives_stable
from pcm_gym.kernels.stepping.transition import GIVE_UP
from pcm_gym.references.resolved_rate import ResolvedRateController
from pcm_gym.references.view import View

# Rows whose candidates are foreseen at a time; bounds the memory.
_ROWS_AT_ONCE = 512


class PredictiveController:
    """Goes on as the best of some dozens of short plans would begin, which it tries on copies of the environment.

    A plan holds one action for the first half of the horizon and another for the rest. Candidates are drawn anew for
    each step; among them are standing still, a resolved-rate step, and what was best before. Their worth is the sum of
    the rewards less `caution` times the costs, with actuators, limits, load and mechanism as they are.

    Parameters
    ----------
    candidates : int
        Plans that are tried, at least 4.
    horizon : int
        Steps of a plan.
    caution : float
        Reward that a cost of one takes away.
    """

    def __init__(self, candidates: int = 24, horizon: int = 6, caution: float = 2.0) -> None:
        self._count, self._horizon, self._caution = candidates, horizon, caution
        self._towards = ResolvedRateController()
        self._best = np.empty((0, 2, 0))

    def act(self, view: View) -> Array:
        """Actions (n, actuators): each the first of the plan that came out best."""
        count, legs = view.action_shape
        if self._best.shape != (count, 2, legs):
            self._best = np.zeros((count, 2, legs))
        self._best[view.elapsed == 0] = 0.0
        actions, towards, rows = np.zeros(view.action_shape), self._towards.act(view), np.flatnonzero(view.under_way)
        for first in range(0, len(rows), _ROWS_AT_ONCE):
            some = rows[first : first + _ROWS_AT_ONCE]
            plans = self._plans(view, some, towards)
            values = self._values(view, some, plans)
            self._best[some] = plans[np.arange(len(some)), values.argmax(axis=1)]
            actions[some] = self._best[some, 0]
        return actions

    def _plans(self, view: View, rows: Integers, towards: Array) -> Array:
        """Return candidates (m, k, 2, legs): a first and a second action each."""
        legs = towards.shape[1]
        drawn = np.stack([view.generators[row].uniform(-1.0, 1.0, (self._count - 3, 2, legs)) for row in rows.tolist()])
        # half of them around what was best before
        near = self._best[rows, None] + 0.3 * drawn[:, : (self._count - 3) // 2]
        drawn[:, : near.shape[1]] = np.clip(near, -1.0, 1.0)
        straight = np.repeat(towards[rows, None, None], 2, axis=2)
        fixed = np.concatenate([np.zeros_like(straight), straight, self._best[rows, None]], axis=1)
        plans: Array = np.concatenate([fixed, drawn], axis=1).astype(np.float32).astype(np.float64)
        return plans

    def _values(self, view: View, rows: Integers, plans: Array) -> Array:
        """Return what candidates come to, (m, k)."""
        simulation, (count, each) = view.simulation, plans.shape[:2]
        rules = simulation.settings.rules._replace(behaviour=GIVE_UP)  # what is hard to follow need not be followed
        origin, chosen = np.repeat(rows, each), plans.reshape(count * each, *plans.shape[2:])
        values, going, motion = np.zeros(len(origin)), np.arange(len(origin)), simulation.motion.copied(origin)
        for step in range(self._horizon):
            actions = chosen[going, 2 * step // self._horizon]
            report = simulation.foresee(motion, actions, rules)
            rewards = foreseen_rewards(simulation, motion.inputs, report.features, origin[going], step + 1)
            arrives = arrives_stable(report)
            # what does not arrive earns nothing any more, and costs as often as there are steps left
            costs = np.where(arrives, total_cost(report.verdicts, simulation.settings.limits), self._horizon - step)
            values[going] += np.where(arrives, rewards, 0.0) - self._caution * costs
            going, motion = going[arrives], motion.copied(arrives)
        return values.reshape(count, each)
