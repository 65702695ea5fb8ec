"""Episodes on the exact solver, many side by side on one native batch."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode

from agents.evaluation.episodes import EpisodeResult, StepLog
from agents.learners.batches import make_batch
from agents.learners.settings import EnvironmentConfig
from pcm_gym.arrays import Array, Mask
from pcm_gym.environments.batch import MechanismVectorEnv
from pcm_gym.references import Controller, View

# Called with a row, its episode's seed and the infos of the batch: after a reset, with none, and after each step.
Watch = Callable[[int, int, Mapping[str, Any]], None]

_CONTROLLER_STREAM = 1


def make_evaluation_batch(environment: EnvironmentConfig, count: int, split: str = "test") -> MechanismVectorEnv:
    """Batch for `run_episodes`, of the test's episodes or of the training's, whose rows begin none by themselves."""
    held_out = environment.model_copy(update={"kwargs": environment.kwargs | {"split": split}})
    return make_batch(held_out, count, AutoresetMode.DISABLED)


def run_episodes(
    env: MechanismVectorEnv, name: str, controller: Controller, seeds: Sequence[int], watch: Watch | None = None
) -> Iterator[EpisodeResult]:
    """Run episode `i` from ``reset(seed=seeds[i])``, as many side by side as the batch has rows.

    Parameters
    ----------
    env
        A batch from `make_evaluation_batch`.
    name
        What the results call the controller.
    controller
        Chooses the actions.
    seeds
        One per episode.
    watch
        Told of every episode after its reset and after each of its steps.

    Yields
    ------
    EpisodeResult
        In the order in which the episodes end.
    """
    rows = _Rows(env, seeds, watch or _look_away)
    rows.begin(np.ones(env.num_envs, dtype=np.bool_))
    while rows.under_way.any():
        ended = rows.step(controller)
        yield from (rows.result(row, name) for row in np.flatnonzero(ended & rows.under_way).tolist())
        if ended.any():
            rows.begin(ended)


class _Rows:
    """The rows of a batch: each takes the next episode that waits when its own has ended.

    When none waits any more, a row repeats its last episode, without being watched, until the others have ended.
    """

    def __init__(self, env: MechanismVectorEnv, seeds: Sequence[int], watch: Watch) -> None:
        self.under_way: Mask = np.zeros(env.num_envs, dtype=np.bool_)
        self._env = env
        self._watch = watch
        self._log = StepLog(env.num_envs)
        self._waiting = iter(enumerate(seeds))
        self._episodes = [0] * env.num_envs
        self._seeds = [0] * env.num_envs
        self._generators = [np.random.default_rng()] * env.num_envs

    def begin(self, rows: Mask) -> None:
        """Begin the next episodes in the rows of the mask (n,)."""
        self.under_way[rows] = False
        for row, (episode, seed) in zip(np.flatnonzero(rows).tolist(), self._waiting, strict=False):
            self.under_way[row] = True
            self._episodes[row], self._seeds[row] = episode, seed
            self._generators[row] = np.random.default_rng([seed, _CONTROLLER_STREAM])
        self._log.begin(rows)
        self._observation, _ = self._env.reset(seed=list(self._seeds), options={"reset_mask": rows})
        for row in np.flatnonzero(rows & self.under_way).tolist():
            self._watch(row, self._seeds[row], {})

    def step(self, controller: Controller) -> Mask:
        """Take one step everywhere; return where it was an episode's last."""
        view = View.of(self._env, self._observation, self._generators, self.under_way.copy())
        actions = controller.act(view).astype(self._env.single_action_space.dtype)
        self._observation, rewards, terminated, truncated, infos = self._env.step(actions)
        self._log.add(rewards, infos)
        for row in view.rows:
            self._watch(row, self._seeds[row], infos)
        return terminated | truncated

    def result(self, row: int, policy: str) -> EpisodeResult:
        """What the episode in a row, which has ended, came to."""
        error = position_error(self._env.goal(row), self._env.equilibrium(row).pose)
        return EpisodeResult.of(policy, self._episodes[row], self._seeds[row], self._log.steps(row), error)


def position_error(goal: Array, pose: Array) -> float:
    """Distance of the end-effector from the goal, its orientation left aside."""
    return float(np.hypot(*(goal - pose)[:2]))


def _look_away(row: int, seed: int, infos: Mapping[str, Any]) -> None:
    """Watch nothing."""
