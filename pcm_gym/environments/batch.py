"""The native batch: many environments of one kind, stepped by one call of the kernels."""

import copy
from typing import Any, Unpack

import gymnasium
import numpy as np
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import ArrayLike, NDArray

from pcm_gym.arrays import Array, Mask
from pcm_gym.environments.arguments import EnvironmentArguments
from pcm_gym.environments.pictures import Pictures
from pcm_gym.environments.preview import Preview, checked_actions, preview
from pcm_gym.environments.rows import Outcome
from pcm_gym.environments.settings import Settings
from pcm_gym.environments.simulation import Simulation
from pcm_gym.environments.single import RENDER_FPS, Observation
from pcm_gym.kernels.numerics.threads import default_thread_count
from pcm_gym.mechanism import Mechanism
from pcm_gym.mechanism.validation import one_of, whole_number
from pcm_gym.solving import Equilibrium
from pcm_gym.tasks import Task


class MechanismVectorEnv(VectorEnv[Observation, NDArray[np.float32], NDArray[Any]]):
    """`num_envs` copies of `MechanismEnv`, equal to them row by row and bit for bit.

    Infos are arrays, one row per environment; for each key a mask, under the key with an underscore before it, says in
    which rows it counts. In the mode "SameStep" the last observations and infos of the episodes that have ended are in
    `final_obs` and `final_info`. `reset(options={"reset_mask": mask})` begins new episodes in some rows only.

    Parameters
    ----------
    num_envs : int
        Number of environments.
    max_episode_steps : int, optional
        Steps after which an episode is truncated; never by default, or with -1 as for `gymnasium.make`.
    autoreset_mode : AutoresetMode or str
        When an episode that has ended begins anew: in the next step (default), in the same step, or not by itself.
    threads : int, optional
        Threads that share the environments where there are many. By default as many as there are processors, or as
        ``OMP_NUM_THREADS`` or ``NUMBA_NUM_THREADS`` allow. No result depends on it.
    mechanism, **arguments
        As for `MechanismEnv`.
    """

    def __init__(
        self,
        num_envs: int = 1,
        *,
        max_episode_steps: int | None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        threads: int | None = None,
        mechanism: Mechanism | str = "2RFR",
        **arguments: Unpack[EnvironmentArguments],
    ) -> None:
        one_of("autoreset_mode", autoreset_mode, (*AutoresetMode, *(mode.value for mode in AutoresetMode)))
        settings = Settings.from_arguments(mechanism, **arguments)
        self.render_mode = settings.render_mode
        self.num_envs = num_envs = whole_number("num_envs", num_envs, least=1)
        self.autoreset_mode = AutoresetMode(autoreset_mode)
        self.metadata = {"render_modes": ["rgb_array"], "render_fps": RENDER_FPS, "autoreset_mode": self.autoreset_mode}
        threads = default_thread_count() if threads is None else whole_number("threads", threads, least=1)
        self._simulation = Simulation(settings, num_envs, threads)
        self.single_observation_space, self.single_action_space = self._simulation.spaces()
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        is_endless = max_episode_steps is None or max_episode_steps == -1
        self._max_episode_steps = (
            np.inf if is_endless else whole_number("max_episode_steps", max_episode_steps, least=1)
        )
        self._pictures = Pictures(settings)
        sources = [seeding.np_random(None) for _ in range(num_envs)]
        self._generators = [generator for generator, _ in sources]
        self._generator_seeds = [seed for _, seed in sources]
        self._ended = np.zeros(num_envs, dtype=np.bool_)
        self._is_reset = False
        self._kept: Observation = {}

    @property
    def mechanism(self) -> Mechanism:
        """The mechanism; where it is randomised, what its variants deviate from."""
        return self._simulation.settings.mechanism

    @property
    def task(self) -> Task:
        """Goals, rewards and what episodes are drawn."""
        return self._simulation.settings.task

    @property
    def max_action(self) -> Array:
        """Increment of each input for an action of 1, (legs,), rad or m."""
        return self._simulation.settings.max_action.copy()

    def equilibrium(self, row: int) -> Equilibrium:
        """Return the present equilibrium of one environment."""
        return self._simulation.equilibrium(row)

    def goal(self, row: int) -> Array:
        """Return the goal of one environment as a pose, (d,), in m and rad."""
        return self.task.goals.pose(self._simulation.goal(row))

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin new episodes: all of them, or those in ``options["reset_mask"]``, a bool array (num_envs,)."""
        options = dict(options or {})
        mask = self._checked_mask(options.pop("reset_mask", None))
        for row, own_seed in enumerate(self._seeds(seed)):
            if own_seed is not None and mask[row]:
                self._generators[row], self._generator_seeds[row] = seeding.np_random(own_seed)
        self._begin(mask, options)
        self._is_reset = True
        # the others must not draw any noise
        generators = [
            own if begun else np.random.default_rng(0) for own, begun in zip(self._generators, mask, strict=True)
        ]
        outcome = self._simulation.observe(np.arange(self.num_envs), generators)
        for key, array in self._kept.items():  # what stands still looks as it did, to the last bit
            outcome.observation[key][~mask] = array[~mask]
        self._keep(outcome.observation)
        return outcome.observation, _with_masks(outcome.infos(), mask)

    def step(self, actions: NDArray[np.float32]) -> tuple[Observation, NDArray[np.float64], Mask, Mask, dict[str, Any]]:
        """Step every environment; what happens to those that have ended is up to the autoreset mode."""
        if not self._is_reset:
            raise gymnasium.error.ResetNeeded("step() was called before the first reset()")
        values = self._checked_actions(actions)
        waiting = self._ended.copy()
        if self.autoreset_mode is AutoresetMode.NEXT_STEP and waiting.any():
            return self._step_and_begin(values, waiting)
        if waiting.any():
            raise gymnasium.error.ResetNeeded(
                f"environments {np.flatnonzero(waiting).tolist()} have ended: reset them with options['reset_mask']"
            )
        outcome = self._simulation.step(values, self._generators)
        truncated = self._is_truncated(outcome)
        self._ended = outcome.terminated | truncated
        infos = _with_masks(outcome.infos())
        self._keep(outcome.observation)
        if self.autoreset_mode is AutoresetMode.SAME_STEP and self._ended.any():
            self._begin_at_once(outcome.observation, infos, self._ended.copy())
        return outcome.observation, outcome.reward, outcome.terminated, truncated, infos

    def preview(self, actions: ArrayLike) -> Preview:
        """Return what `step` would do with each of several actions (n, k, legs), from here, without doing it.

        Nothing is moved and no random number is drawn; `step` of an action does what was told of it, to the last bit.
        Of an environment that waits for its reset it is told what an action would do in its last state.
        """
        if not self._is_reset:
            raise gymnasium.error.ResetNeeded("preview() was called before the first reset()")
        return preview(self._simulation, checked_actions(actions, (self.num_envs, "k", self.mechanism.leg_count)))

    def compute_reward(self, achieved_goal: ArrayLike, desired_goal: ArrayLike, info: Any) -> Any:
        """Return the reward of achieved for desired goals, (g,) or (n, g); `info` is not used."""
        return self._simulation.settings.task.compute_reward(achieved_goal, desired_goal)

    @property  # type: ignore[misc]  # as in SyncVectorEnv
    def np_random(self) -> tuple[np.random.Generator, ...]:  # type: ignore[override]
        """The environments' sources of chance."""
        return tuple(self._generators)

    @property
    def np_random_seed(self) -> tuple[int, ...]:  # type: ignore[override]  # as in SyncVectorEnv
        """The seeds of the environments' sources of chance."""
        return tuple(self._generator_seeds)

    def render(self) -> tuple[NDArray[np.uint8], ...] | None:
        """Return a picture of every environment, (height, width, 3) each; None without `render_mode`.

        About 3 ms each.
        """
        if self.render_mode is None:
            gymnasium.logger.warn("render() was called without a render_mode; pass render_mode='rgb_array'.")
            return None
        return tuple(self._pictures.draw(self._simulation, row) for row in range(self.num_envs))

    def save_state(self) -> dict[str, Any]:
        """Return everything that the rest of the episodes depends on; `restore_state` takes it back exactly."""
        return copy.deepcopy(
            {
                "rows": self._simulation.rows._asdict(),
                "generators": [generator.bit_generator.state for generator in self._generators],
                "generator_seeds": self._generator_seeds,
                "ended": self._ended,
                "is_reset": self._is_reset,
                "kept": self._kept,
            }
        )

    def restore_state(self, state: dict[str, Any]) -> None:
        """Go back to what `save_state` returned, here or in another batch made with the same arguments."""
        for name, array in self._simulation.rows._asdict().items():
            array[:] = state["rows"][name]
        for generator, bits in zip(self._generators, state["generators"], strict=True):
            generator.bit_generator.state = bits
        self._generator_seeds = list(state["generator_seeds"])
        self._ended, self._is_reset = state["ended"].copy(), state["is_reset"]
        self._kept = copy.deepcopy(state["kept"])

    def _is_truncated(self, outcome: Outcome) -> Mask:
        return (self._simulation.rows.elapsed >= self._max_episode_steps) | outcome.failed

    def _step_and_begin(
        self, actions: NDArray[np.float64], waiting: Mask
    ) -> tuple[Observation, NDArray[np.float64], Mask, Mask, dict[str, Any]]:
        """Begin the waiting environments, whose actions are ignored, and step the others."""
        outcome = self._simulation.step_and_reset(actions, waiting, self._generators)
        truncated = self._is_truncated(outcome)
        self._ended = outcome.terminated | truncated
        return outcome.observation, outcome.reward, outcome.terminated, truncated, _with_masks(outcome.infos())

    def _begin_at_once(self, observation: Observation, infos: dict[str, Any], ended: Mask) -> None:
        """Begin the episodes that have just ended; their last observations and infos go into the new infos."""
        rows = np.flatnonzero(ended)
        final_observations = np.full(self.num_envs, None, dtype=object)
        for row in rows:
            final_observations[row] = {key: array[row].copy() for key, array in observation.items()}
        final_infos = {key: values.copy() for key, values in infos.items() if not key.startswith("_")}
        self._begin(ended, {})
        begun = self._simulation.observe(rows, self._generators)
        for key, values in begun.infos().items():
            infos[key][rows] = values
        for key, array in begun.observation.items():
            observation[key][rows] = array
        infos["final_obs"], infos["_final_obs"] = final_observations, ended
        infos["final_info"], infos["_final_info"] = _with_masks(final_infos, ended), ended.copy()

    def _keep(self, observation: Observation) -> None:
        """Keep the observations where resets of some rows are up to the caller, for the others."""
        if self.autoreset_mode is AutoresetMode.DISABLED:
            self._kept = {key: array.copy() for key, array in observation.items()}

    def _begin(self, mask: Mask, options: dict[str, Any]) -> None:
        rows = np.flatnonzero(mask)
        self._simulation.reset_rows(rows, [self._generators[row] for row in rows.tolist()], options)
        self._ended[mask] = False

    def _seeds(self, seed: int | list[int | None] | None) -> list[int | None]:
        if seed is None:
            return [None] * self.num_envs
        if isinstance(seed, int | np.integer):
            return [int(seed) + row for row in range(self.num_envs)]
        if len(seed) != self.num_envs:
            raise ValueError(f"seed must be an int or {self.num_envs} of them, got {len(seed)}")
        return list(seed)

    def _checked_mask(self, mask: Any) -> Mask:
        if mask is None:
            return np.ones(self.num_envs, dtype=np.bool_)
        if not isinstance(mask, np.ndarray) or mask.dtype != np.bool_ or mask.shape != (self.num_envs,):
            raise ValueError(f"options['reset_mask'] must be a bool array of shape ({self.num_envs},), got {mask!r}")
        if not mask.any():
            raise ValueError("options['reset_mask'] must have at least one True value")
        return mask

    def _checked_actions(self, actions: ArrayLike) -> Array:
        return checked_actions(actions, (self.num_envs, self.mechanism.leg_count))


def _with_masks(infos: dict[str, Any], mask: Mask | None = None) -> dict[str, Any]:
    """Return the infos with their masks, and neutral values in the rows outside `mask`."""
    result: dict[str, Any] = {}
    masks = np.empty((len(infos), len(next(iter(infos.values())))), dtype=np.bool_)  # one array costs less than many
    masks[:] = True if mask is None else mask
    for (key, values), own in zip(infos.items(), masks, strict=True):
        if mask is not None and not mask.all():
            values[~mask] = None if values.dtype == object else 0
        result[key], result[f"_{key}"] = values, own
    return result
