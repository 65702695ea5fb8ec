"""A Lagrange multiplier of the cost, turned by a PID controller while a learner learns."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import unwrap_vec_wrapper

from agents.learners.infos import columns_of
from agents.learners.settings import LagrangianConfig
from agents.learners.vector_adapter import CostPenalty


class Multiplier(NamedTuple):
    """A PID controller's state: its integral, and the cost at its last turn."""

    integral: float = 0.0
    cost: float = 0.0


def turned(multiplier: Multiplier, config: LagrangianConfig, cost: float) -> tuple[Multiplier, float]:
    """Multiplier after a mean cost of an episode has been seen, and the weight of the cost that follows.

    After A. Stooke, J. Achiam and P. Abbeel, 2020, "Responsive safety in reinforcement learning by PID Lagrangian
    methods", ICML: the integral and the derivative never reward a cost.
    """
    excess = cost - config.cost_limit
    integral = max(0.0, multiplier.integral + config.integral * excess)
    rise = max(0.0, cost - multiplier.cost)
    weight = max(0.0, config.proportional * excess + integral + config.derivative * rise)
    return Multiplier(integral, cost), weight


class CostController(BaseCallback):
    """Turns the weight that a `CostPenalty` takes costs with, after each rollout in which episodes have ended.

    The reward less the weighted cost is learnt by one critic (C. Tessler, D. Mankowitz and S. Mannor, 2019, "Reward
    constrained policy optimization", ICLR). The multiplier is kept in the learner, and so in its snapshots.

    Parameters
    ----------
    config
        Limit and gains.
    """

    def __init__(self, config: LagrangianConfig) -> None:
        super().__init__()
        self._config = config
        self._ended: list[float] = []

    def _on_training_start(self) -> None:
        self._running: NDArray[np.float64] = np.zeros(self.training_env.num_envs)
        penalty = unwrap_vec_wrapper(self.training_env, CostPenalty)
        if penalty is None:
            raise TypeError("the environments must take costs from rewards: there is no CostPenalty around them")
        self._penalty = penalty
        learner: Any = self.model
        integral, cost, self._penalty.weight = getattr(learner, "cost_multiplier", (0.0, 0.0, 0.0))
        self._multiplier = Multiplier(integral, cost)

    def _on_step(self) -> bool:
        self._running += columns_of(self.locals["infos"])["cost"]
        ended = self.locals["dones"]
        self._ended += self._running[ended].tolist()
        self._running[ended] = 0.0
        return True

    def _on_rollout_end(self) -> None:
        if self._ended:
            cost = float(np.mean(self._ended))
            self._multiplier, self._penalty.weight = turned(self._multiplier, self._config, cost)
            self._ended.clear()
        learner: Any = self.model
        learner.cost_multiplier = [*self._multiplier, self._penalty.weight]
        self.logger.record("rollout/cost_weight", self._penalty.weight)
