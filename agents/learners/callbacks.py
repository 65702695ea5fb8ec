"""What happens beside the learning: episode statistics, snapshots, and the progress bar."""

from collections import deque
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from stable_baselines3.common.callbacks import BaseCallback

from agents.learners.infos import columns_of
from agents.learners.progress import COST_COLUMN, EPISODE_COST_COLUMN, SAFE_SUCCESS_COLUMN, VIOLATION_COLUMN


class EpisodeStatistics(BaseCallback):
    """Log the rates of safe success and of violation, and the cost, over the last finished episodes.

    A success is safe if the episode's whole cost is zero; a violation is a loss of stability. The cost of the whole
    training is logged too.

    Parameters
    ----------
    earlier_cost
        Cost of the training before the run was resumed.
    window
        Number of episodes that the rates are taken over.
    """

    def __init__(self, earlier_cost: float = 0.0, window: int = 200) -> None:
        super().__init__()
        self._costs: deque[float] = deque(maxlen=window)
        self._safe_successes: deque[bool] = deque(maxlen=window)
        self._violations: deque[bool] = deque(maxlen=window)
        self._total_cost = earlier_cost

    def _on_training_start(self) -> None:
        self._running_cost: NDArray[np.float64] = np.zeros(self.training_env.num_envs)
        self._was_unstable: NDArray[np.bool_] = np.zeros(self.training_env.num_envs, dtype=np.bool_)

    def _on_step(self) -> bool:
        told = columns_of(self.locals["infos"])
        self._total_cost += float(told["cost"].sum())
        self._running_cost += told["cost"]
        self._was_unstable |= told["cost_unstable"] > 0.0
        for index in np.flatnonzero(self.locals["dones"]).tolist():
            self._finish(index, is_success=bool(told["is_success"][index]))
        return True

    def _finish(self, index: int, *, is_success: bool) -> None:
        cost = float(self._running_cost[index])
        self._costs.append(cost)
        self._safe_successes.append(is_success and cost == 0.0)
        self._violations.append(bool(self._was_unstable[index]))
        self._running_cost[index] = 0.0
        self._was_unstable[index] = False

    def _on_rollout_end(self) -> None:
        self.logger.record(COST_COLUMN, self._total_cost)
        if self._costs:
            self.logger.record(EPISODE_COST_COLUMN, float(np.mean(self._costs)))
            self.logger.record(SAFE_SUCCESS_COLUMN, float(np.mean(self._safe_successes)))
            self.logger.record(VIOLATION_COLUMN, float(np.mean(self._violations)))


class Snapshots(BaseCallback):
    """Call `save` each time that another `every` steps are complete."""

    def __init__(self, every: int, save: Callable[[], None]) -> None:
        super().__init__()
        self._every = every
        self._save = save

    def _on_training_start(self) -> None:
        self._next = (self.num_timesteps // self._every + 1) * self._every

    def _on_step(self) -> bool:
        return True

    def _on_rollout_start(self) -> None:
        if self.num_timesteps >= self._next:
            self._save()
            self._next = (self.num_timesteps // self._every + 1) * self._every


class ProgressDisplay(BaseCallback):
    """A progress bar that also shows the rate of success and the mean cost of an episode."""

    def __init__(self) -> None:
        super().__init__()
        self._progress = Progress(
            TextColumn("training"),
            BarColumn(),
            MofNCompleteColumn(),
            TimeRemainingColumn(),
            TextColumn("{task.fields[outcome]}"),
            refresh_per_second=2,
        )

    def _on_training_start(self) -> None:
        total = self.locals["total_timesteps"]
        self._task = self._progress.add_task("training", total=total, completed=self.num_timesteps, outcome="")
        self._progress.start()

    def _on_step(self) -> bool:
        self._progress.update(self._task, completed=self.num_timesteps)
        return True

    def _on_rollout_end(self) -> None:
        logged = self.logger.name_to_value
        if SAFE_SUCCESS_COLUMN in logged:
            outcome = f"safe success {logged[SAFE_SUCCESS_COLUMN]:.0%}, cost {logged[EPISODE_COST_COLUMN]:.2f}"
            self._progress.update(self._task, outcome=outcome)

    def stop(self) -> None:
        """Leave the bar as it is and give the terminal back; harmless if it never started."""
        self._progress.stop()
