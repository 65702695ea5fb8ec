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
from pcm_gym.environments.preview import Preview, preview
from pcm_gym.environments.rows import Outcome, generator_of, saved_parts
from pcm_gym.environments.settings import Settings
from pcm_gym.environments.simulation import Simulation
from pcm_gym.environments.single import RENDER_FPS, Observation
from pcm_gym.kernels.numerics.threads import MOST_THREADS, default_thread_count
from pcm_gym.mechanism import Mechanism
from pcm_gym.mechanism.validation import (
    finite_array,
    mapping,
    one_of,
    sequence_of,
    shown,
    truth_array,
    whole_number,
)
from pcm_gym.solving import Equilibrium
from pcm_gym.tasks import Task

# Beyond this number there is a mistake, and no memory.
_MOST_ENVIRONMENTS = 1_000_000


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
        settings = Settings.from_arguments(mechanism, arguments)
        self.render_mode = settings.render_mode
        self.num_envs = num_envs = whole_number("num_envs", num_envs, least=1, most=_MOST_ENVIRONMENTS)
        self.autoreset_mode = AutoresetMode(autoreset_mode)
        self.metadata = {"render_modes": ["rgb_array"], "render_fps": RENDER_FPS, "autoreset_mode": self.autoreset_mode}
        if threads is None:
            threads = default_thread_count()
        threads = whole_number("threads", threads, least=1, most=MOST_THREADS)
        self._simulation = Simulation(settings, num_envs, threads)
        self.single_observation_space, self.single_action_space = self._simulation.spaces()
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        most = -1 if max_episode_steps is None else whole_number("max_episode_steps", max_episode_steps, least=-1)
        if most == 0:
            raise ValueError("max_episode_steps must be at least 1, or -1 for no limit, got 0")
        self._max_episode_steps = np.inf if most == -1 else most
        self._pictures = Pictures(settings)
        sources = [seeding.np_random(None) for _ in range(num_envs)]
        self._generators = [generator for generator, _ in sources]
        self._generator_seeds = [seed for _, seed in sources]
        self._ended = np.zeros(num_envs, dtype=np.bool_)
        self._begun = np.zeros(num_envs, dtype=np.bool_)
        # whether what was observed is kept for those that stand still while others are reset: noise is not drawn again
        self._keeps = self.autoreset_mode is AutoresetMode.DISABLED or settings.observation_noise > 0.0
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
        return self._simulation.equilibrium(self._checked_row(row))

    def true_mechanism(self, row: int) -> Mechanism:
        """Return the mechanism of one episode, of which the agent is not told where mechanisms are drawn."""
        return self.equilibrium(row).mechanism

    def goal(self, row: int) -> Array:
        """Return the goal of one environment as a pose, (d,), in m and rad."""
        return self.task.goals.pose(self._simulation.goal(self._checked_row(row)))

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin new episodes: all of them, or those in ``options["reset_mask"]``, a bool array (num_envs,)."""
        options = dict(mapping("options", options))
        mask = self._checked_mask(options.pop("reset_mask", None))
        for row, own_seed in enumerate(self._seeds(seed)):
            if own_seed is not None and mask[row]:
                self._generators[row], self._generator_seeds[row] = seeding.np_random(own_seed)
        self._begin(mask, options)
        # the others must not draw any noise
        generators = [
            own if begun else np.random.default_rng(0) for own, begun in zip(self._generators, mask, strict=True)
        ]
        outcome = self._simulation.observe(np.arange(self.num_envs), generators)
        for key, array in self._kept.items():  # what stands still looks as it did, to the last bit
            outcome.observation[key][~mask] = array[~mask]
        self._keep(outcome.observation)
        return outcome.observation, _with_masks(outcome.infos(), mask)

    def step(self, actions: ArrayLike) -> tuple[Observation, NDArray[np.float64], Mask, Mask, dict[str, Any]]:
        """Step every environment; what happens to those that have ended is up to the autoreset mode."""
        values = self._checked_actions(actions)
        self._check_begun("step")
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
        if self.autoreset_mode is AutoresetMode.SAME_STEP and self._ended.any():
            self._begin_at_once(outcome.observation, infos, self._ended.copy())
        self._keep(outcome.observation)
        return outcome.observation, outcome.reward, outcome.terminated, truncated, infos

    def preview(self, actions: ArrayLike) -> Preview:
        """Return what `step` would do with each of several actions (n, k, legs), from here, without doing it.

        Nothing is moved and no random number is drawn; `step` of an action does what was told of it, to the last bit.
        Of an environment that waits for its reset it is told what an action would do in its last state.
        """
        self._check_begun("preview")
        shape = (self.num_envs, "k", self.mechanism.leg_count)
        return preview(self._simulation, finite_array("actions", actions, shape))

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
                "begun": self._begun,
                "kept": self._kept,
            }
        )

    def restore_state(self, state: dict[str, Any]) -> None:
        """Go back to what `save_state` returned, here or in another batch made with the same arguments.

        Raises
        ------
        TypeError, ValueError
            If it is none, or one of a batch of another kind; nothing is changed then.
        """
        parts = saved_parts("state", state, ("rows", "generators", "generator_seeds", "ended", "begun", "kept"))
        rows, count = self._simulation.checked_rows(parts["rows"]), self.num_envs
        saved = sequence_of("state['generators']", parts["generators"], dict)
        generators = [generator_of("state['generators']", own) for own in saved]
        seeds = sequence_of("state['generator_seeds']", parts["generator_seeds"], int)
        if (len(generators), len(seeds)) != (count, count):
            raise ValueError(f"state must be of {count} environments, got {len(generators)} generators")
        ended, begun = (truth_array(f"state['{name}']", parts[name], (count,)) for name in ("ended", "begun"))
        spaces: Any = self.observation_space
        kept = {
            key: finite_array(f"state['kept'][{key!r}]", array, spaces[key].shape)
            for key, array in mapping("state['kept']", parts["kept"]).items()
        }
        self._simulation.restore_rows(rows)
        for generator, own in zip(self._generators, generators, strict=True):
            generator.bit_generator.state = own.bit_generator.state
        self._generator_seeds, self._ended, self._begun, self._kept = list(seeds), ended, begun, kept

    def _is_truncated(self, outcome: Outcome) -> Mask:
        return (self._simulation.rows.elapsed >= self._max_episode_steps) | outcome.failed

    def _step_and_begin(
        self, actions: NDArray[np.float64], waiting: Mask
    ) -> tuple[Observation, NDArray[np.float64], Mask, Mask, dict[str, Any]]:
        """Begin the waiting environments, whose actions are ignored, and step the others."""
        outcome = self._simulation.step_and_reset(actions, waiting, self._generators)
        truncated = self._is_truncated(outcome)
        self._ended = outcome.terminated | truncated
        self._keep(outcome.observation)
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
        """Keep the observations for those rows that stand still when others are reset."""
        if self._keeps:
            self._kept = {key: array.copy() for key, array in observation.items()}

    def _begin(self, mask: Mask, options: dict[str, Any]) -> None:
        rows = np.flatnonzero(mask)
        self._simulation.reset_rows(rows, [self._generators[row] for row in rows.tolist()], options)
        self._ended[mask], self._begun[mask] = False, True

    def _check_begun(self, name: str) -> None:
        """Raise if some rows have never been reset."""
        if not self._begun.all():
            rows = np.flatnonzero(~self._begun).tolist()
            which = f"of environments {shown(rows)}" if self._begun.any() else ""
            raise gymnasium.error.ResetNeeded(f"{name}() was called before the first reset() {which}".rstrip())

    def _seeds(self, seed: int | list[int | None] | None) -> list[int | None]:
        if seed is None:
            return [None] * self.num_envs
        if isinstance(seed, int | np.integer):
            first = whole_number("seed", seed, least=0, most=None)
            return [first + row for row in range(self.num_envs)]
        seeds = sequence_of("seed", seed, int | np.integer | None)
        if len(seeds) != self.num_envs:
            raise ValueError(f"seed must be an int or {self.num_envs} of them, got {len(seeds)}")
        return [None if own is None else whole_number("seed", own, least=0, most=None) for own in seeds]

    def _checked_mask(self, mask: Any) -> Mask:
        if mask is None:
            return np.ones(self.num_envs, dtype=np.bool_)
        checked = truth_array("options['reset_mask']", mask, (self.num_envs,))
        if not checked.any():
            raise ValueError(f"options['reset_mask'] must have at least one True value, got {shown(mask)}")
        return checked

    def _checked_row(self, row: int) -> int:
        return whole_number("row", row, least=0, most=self.num_envs - 1)

    def _checked_actions(self, actions: ArrayLike) -> Array:
        return finite_array("actions", actions, (self.num_envs, self.mechanism.leg_count))


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
