"""Episodes on the exact solver, many side by side, and what each one came to."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol, Self

import gymnasium
import numpy as np
from numpy.typing import NDArray

import pcm_gym  # noqa: F401 (registers the environments)
from agents.config import EnvironmentConfig
from pcm_gym.arrays import Array, Mask

Observation = dict[str, NDArray[Any]]
SingleEnv = gymnasium.Env[Any, Any]

_CONTROLLER_STREAM = 1


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


@dataclass
class RunningEpisode:
    """An episode under way: its environment, what is seen now, and what has happened so far."""

    env: SingleEnv
    index: int
    seed: int
    observation: Observation
    generator: np.random.Generator
    infos: list[dict[str, Any]] = field(default_factory=list)
    rewards: list[float] = field(default_factory=list)
    is_over: bool = False

    @classmethod
    def begin(cls, env: SingleEnv, index: int, seed: int) -> Self:
        """Reset the environment with the seed; the controller's generator is independent of the environment's."""
        observation, _ = env.reset(seed=seed)
        return cls(env, index, seed, observation, np.random.default_rng([seed, _CONTROLLER_STREAM]))

    @property
    def action_count(self) -> int:
        """Number of actuators."""
        return int(np.prod(self.env.action_space.shape or (1,)))

    def step(self, action: Array) -> None:
        """Take one step and remember what came of it."""
        self.observation, reward, terminated, truncated, info = self.env.step(
            action.astype(self.env.action_space.dtype)
        )
        self.infos.append(info)
        self.rewards.append(float(reward))
        self.is_over = terminated or truncated

    def position_error(self) -> float:
        """Distance of the end-effector from the goal, its orientation left aside."""
        env: Any = self.env.unwrapped
        return float(np.hypot(*(env.goal - env.equilibrium.pose)[:2]))

    def result(self, policy: str) -> EpisodeResult:
        """What the episode, at least one step long, came to."""
        costs = self._column("cost")
        is_success = bool(self.infos[-1]["is_success"])
        return EpisodeResult(
            policy=policy,
            episode=self.index,
            seed=self.seed,
            is_success=is_success,
            is_safe_success=is_success and not costs.any(),
            is_violation=bool(self._column("cost_unstable").any()),
            is_solver_failure=bool(self._column("cost_solver").any()),
            final_error=self.position_error(),
            smallest_stability_margin=float(np.fmin.reduce(self._column("stability_margin"))),
            smallest_singularity_margin=float(np.fmin.reduce(self._column("singularity_margin"))),
            cost=float(costs.sum()),
            longest_cost_run=longest_run(costs > 0.0),
            total_reward=float(np.sum(self.rewards)),
            length=len(self.infos),
        )

    def _column(self, name: str) -> Array:
        return np.array([info[name] for info in self.infos], dtype=np.float64)


class Controller(Protocol):
    """Whatever chooses actions for episodes that run side by side."""

    @property
    def name(self) -> str:
        """What tables and files call it."""

    def act(self, episodes: Sequence[RunningEpisode]) -> Array:
        """Array (episodes, actuators) in [-1, 1], one row per episode."""


def make_envs(environment: EnvironmentConfig, count: int) -> list[SingleEnv]:
    """Single environments of the same kind, for `run_episodes`."""
    return [
        gymnasium.make(environment.id, disable_env_checker=True, **environment.kwargs)  # made for speed: many steps
        for _ in range(count)
    ]


def run_episodes(
    envs: Sequence[SingleEnv],
    controller: Controller,
    seeds: Sequence[int],
    observe: Callable[[RunningEpisode], None] | None = None,
) -> Iterator[EpisodeResult]:
    """Run episode `i` from ``reset(seed=seeds[i])``, as many side by side as there are environments.

    Parameters
    ----------
    envs
        Environments; none of them keeps anything over a reset.
    controller
        Chooses the actions of all episodes under way at once.
    seeds
        One per episode.
    observe
        Called with each episode after its reset and after each of its steps.

    Yields
    ------
    EpisodeResult
        In the order of the seeds.
    """
    for first in range(0, len(seeds), len(envs)):
        together = zip(envs, seeds[first : first + len(envs)], strict=False)
        episodes = [RunningEpisode.begin(env, first + place, seed) for place, (env, seed) in enumerate(together)]
        _run_to_the_end(episodes, controller, observe or _ignore)
        yield from (episode.result(controller.name) for episode in episodes)


def _run_to_the_end(
    episodes: list[RunningEpisode], controller: Controller, observe: Callable[[RunningEpisode], None]
) -> None:
    for episode in episodes:
        observe(episode)
    while episodes:
        for episode, action in zip(episodes, controller.act(episodes), strict=True):
            episode.step(action)
            observe(episode)
        episodes = [episode for episode in episodes if not episode.is_over]


def longest_run(flags: Mask) -> int:
    """Greatest number of successive true values."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], flags, [False])).astype(np.int8)))
    return int((edges[1::2] - edges[::2]).max(initial=0))


def _ignore(_: RunningEpisode) -> None:
    """Observe nothing."""
