"""One environment class for every mechanism and task."""

import copy
from typing import Any, Unpack

import gymnasium
import numpy as np
from numpy.typing import ArrayLike, NDArray

from pcm_gym.arrays import Array
from pcm_gym.environments.arguments import EnvironmentArguments
from pcm_gym.environments.pictures import Pictures
from pcm_gym.environments.preview import Preview, preview
from pcm_gym.environments.rows import Outcome, generator_of, saved_parts
from pcm_gym.environments.settings import Settings
from pcm_gym.environments.simulation import Simulation
from pcm_gym.mechanism import Mechanism
from pcm_gym.mechanism.validation import finite_array, finite_vector, shape_of, truth_value, whole_number
from pcm_gym.solving import Equilibrium
from pcm_gym.tasks import Element, Task

Observation = dict[str, Array]

RENDER_FPS = 20
_TRAIL_LENGTH = 100


class MechanismEnv(gymnasium.Env[Observation, NDArray[np.float32]]):
    """Move a planar parallel continuum mechanism, on stable equilibria only.

    The mechanism's elastic rods are solved exactly: every step follows the branch of equilibria along the straight
    line from the present actuator inputs to the next ones. Where the branch folds, the mechanism snaps:
    the episode ends there, or goes on as `on_instability` says.

    Action
    ------
    Increments of the actuator inputs, one for each leg, from -1 to 1 times `max_action`. What would lead beyond an
    actuator's limits is cut there.

    Observation
    -----------
    A dict of `observation`, `achieved_goal` and `desired_goal`. `elements` lists what `observation` holds,
    `goal_elements` what a goal holds. A load that is drawn and actuators that do not follow at once add elements; no
    other argument changes what there is, so that with "snap" and "hold" `is_stable` is always 1.

    Reward
    ------
    `compute_reward(achieved_goal, desired_goal, info)`, of one goal or of many; it makes no use of `info`. It is never
    negative, so that ending an episode early never pays. Costs are no part of it.

    Episode end
    -----------
    Terminated where stability is lost, if `on_instability` says so. Truncated by the time limit, or when the solver
    fails; the state then stays as it was. Reaching the goal does not end an episode.

    Loss of stability
    -----------------
    A step that meets a fold, or a bifurcation at which the Morse index changes, costs `cost_unstable`. What comes of it
    is up to `on_instability`:

    - "terminate": the episode ends, in the last state before it.
    - "snap": the mechanism falls as `pcm_gym.snap` does, to a stable equilibrium at the same inputs, and the step goes
      on from there; if need be it falls again. Just beyond a bifurcation into stable branches, nearer to it than can be
      resolved, the step ends there. A fall without a landing is a failure of the solver.
    - "hold": the increment is refused; state and inputs stay as they were.
    - "continue": the branch is followed while it exists, stable or not; only a fold ends the episode, in the last state
      before it.

    Info
    ----
    What `Info` lists, of each state: success, costs, stability and what happened on the way. A task from outside the
    package may add metrics.

    Parameters
    ----------
    mechanism : Mechanism or str
        The mechanism, or its name in the catalogue.
    **arguments
        Any of `EnvironmentArguments`.

    Version history
    ---------------
    - v0: the first.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": RENDER_FPS}  # noqa: RUF012 (gymnasium's own convention)

    def __init__(self, mechanism: Mechanism | str = "2RFR", **arguments: Unpack[EnvironmentArguments]) -> None:
        settings = Settings.from_arguments(mechanism, arguments)
        self.render_mode = settings.render_mode
        self._pictures = Pictures(settings)
        self._simulation = Simulation(settings, 1)
        self.observation_space, self.action_space = self._simulation.spaces()
        self._action_shape = self.action_space.shape
        self._stability_lost = False
        self._trail: list[Array] = []

    @property
    def mechanism(self) -> Mechanism:
        """The mechanism; where it is randomised, what its variants deviate from."""
        return self._simulation.settings.mechanism

    @property
    def task(self) -> Task:
        """Goals, rewards and what episodes are drawn."""
        return self._simulation.settings.task

    @property
    def elements(self) -> tuple[Element, ...]:
        """What `observation` holds, element by element."""
        return self._simulation.sensors.layout.elements

    @property
    def goal_elements(self) -> tuple[Element, ...]:
        """What `achieved_goal` and `desired_goal` hold, element by element."""
        return self.task.goals.elements

    @property
    def max_action(self) -> Array:
        """Increment of each input for an action of 1, (legs,), rad or m."""
        return self._simulation.settings.max_action.copy()

    @property
    def success_distance(self) -> float:
        """Distance to the goal, in m, that counts as reached."""
        return self.task.goals.success_distance

    @property
    def singular_margin(self) -> float:
        """Threshold of `cost_singular`, in rad and mean rod lengths."""
        return self._simulation.settings.singular_margin

    @property
    def equilibrium(self) -> Equilibrium:
        """The present equilibrium."""
        return self._simulation.equilibrium(0)

    @property
    def goal(self) -> Array:
        """The goal as a pose, (d,), in m and rad."""
        return self.task.goals.pose(self._simulation.goal(0))

    @property
    def witness(self) -> Equilibrium | None:
        """An equilibrium that meets the first goal of the episode, not observed; None for a pose asked of `reset`."""
        return self._simulation.witness(0)

    def true_mechanism(self) -> Mechanism:
        """Return the mechanism of the episode, of which the agent is not told where mechanisms are drawn."""
        return self.equilibrium.mechanism

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin an episode with a start and a goal drawn from stable equilibria.

        Parameters
        ----------
        seed : int, optional
            Seed of the environment's random numbers. Same seed and arguments, same episodes.
        options : dict, optional
            Any of the options.

        Options
        -------
        inputs : array_like (legs,)
            Inputs of the start, rad or m: the equilibrium to which the branch of home leads, or that of `equilibrium`.
        equilibrium : Equilibrium
            The start itself, with its load. Only with `on_instability="continue"` may it be unstable; its goal is then
            one that home leads to.
        goal : array_like (d,) or Equilibrium
            The goal: a pose, m and rad, within the reach of the rods, or what an equilibrium meets. Where goals hold
            the inputs it must be an equilibrium.
        load : array_like (d,)
            Load on the end-effector in this episode, N (and N m), under which home must stay stable.

        Raises
        ------
        ValueError
            If an option is unknown, of wrong shape, or cannot be met on stable equilibria.
        """
        super().reset(seed=None if seed is None else whole_number("seed", seed, least=0, most=None))
        generators, row = [self.np_random], np.zeros(1, dtype=np.int64)
        self._simulation.reset_rows(row, generators, options)
        self._stability_lost = False
        self._trail = []
        outcome = self._simulation.observe(row, generators)
        return self._observation(outcome), outcome.row_info(0)

    def step(self, action: ArrayLike) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Move the inputs by `action` times `max_action` along the present branch of equilibria."""
        outcome = self._simulation.step(self._checked(action), [self.np_random])
        self._stability_lost = bool(outcome.terminated[0])
        if self.render_mode is not None:
            self._trail = [*self._trail[1 - _TRAIL_LENGTH :], self.equilibrium.pose[:2]]
        return (
            self._observation(outcome),
            float(outcome.reward[0]),
            self._stability_lost,
            bool(outcome.failed[0]),
            outcome.row_info(0),
        )

    def preview(self, actions: ArrayLike) -> Preview:
        """Return what `step` would do with each of several actions (k, legs), from here, without doing it.

        Nothing is moved and no random number is drawn; `step` of an action does what was told of it, to the last bit.
        """
        return preview(self._simulation, finite_array("actions", actions, ("k", self.mechanism.leg_count)))

    def compute_reward(self, achieved_goal: ArrayLike, desired_goal: ArrayLike, info: Any) -> Any:
        """Return the reward of achieved for desired goals, (g,) or (n, g); `info` is not used."""
        return self.task.compute_reward(achieved_goal, desired_goal)

    def render(self) -> NDArray[np.uint8] | None:
        """Return a picture of the present state, (height, width, 3); None without `render_mode`."""
        if self.render_mode is None:
            gymnasium.logger.warn("render() was called without a render_mode; pass render_mode='rgb_array' to make().")
            return None
        return self._pictures.draw(self._simulation, 0, np.array(self._trail) if self._trail else None)

    def save_state(self) -> dict[str, Any]:
        """Return everything that the rest of the episode depends on; `restore_state` takes it back exactly."""
        return {
            "rows": {name: array.copy() for name, array in self._simulation.rows._asdict().items()},
            "stability_lost": self._stability_lost,
            "trail": list(self._trail),
            "generator": copy.deepcopy(self.np_random.bit_generator.state),
        }

    def restore_state(self, state: dict[str, Any]) -> None:
        """Go back to what `save_state` returned, here or in another environment made with the same arguments.

        Raises
        ------
        TypeError, ValueError
            If it is none, or one of an environment of another kind; nothing is changed then.
        """
        parts = saved_parts("state", state, ("rows", "stability_lost", "trail", "generator"))
        rows = self._simulation.checked_rows(parts["rows"])
        generator = generator_of("state['generator']", parts["generator"])
        has_trail = shape_of(parts["trail"]) != (0,)
        trail = finite_array("state['trail']", parts["trail"], ("n", 2)) if has_trail else ()
        is_lost = truth_value("state['stability_lost']", parts["stability_lost"])
        self._simulation.restore_rows(rows)
        self._stability_lost, self._trail = is_lost, list(trail)
        self.np_random.bit_generator.state = generator.bit_generator.state

    def _checked(self, action: ArrayLike) -> Array:
        return finite_vector("action", action, self.mechanism.leg_count)[None]

    @staticmethod
    def _observation(outcome: Outcome) -> Observation:
        return {key: array[0] for key, array in outcome.observation.items()}
