"""One environment class for every mechanism and task."""

import copy
import math
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import ArrayLike, NDArray

from pcm_gym.environments.simulation import OnInstability, Outcome, Settings, Simulation
from pcm_gym.mechanism import Mechanism
from pcm_gym.mechanism.validation import one_of
from pcm_gym.solving import Equilibrium
from pcm_gym.tasks import ReachTask, goal_box, observation_box
from pcm_gym.tasks.reach import RewardType

Array = NDArray[np.float64]
Observation = dict[str, Array]

RENDER_FPS = 20
_TRAIL_LENGTH = 100


def single_spaces(mechanism: Mechanism) -> tuple[spaces.Space[Any], spaces.Space[Any]]:
    """Return observation and action space of one environment."""
    observation_space = spaces.Dict(
        {
            "observation": observation_box(mechanism),
            "achieved_goal": goal_box(mechanism),
            "desired_goal": goal_box(mechanism),
        }
    )
    return observation_space, spaces.Box(-1.0, 1.0, (mechanism.leg_count,), np.float32)


class MechanismEnv(gymnasium.Env[Observation, NDArray[np.float32]]):
    """Reach a goal pose with a planar parallel continuum mechanism, on stable equilibria only.

    The mechanism's elastic rods are solved exactly: every step follows the branch of equilibria along the straight
    line from the present actuator inputs to the next ones. Where the branch folds, the mechanism snaps: the episode
    ends there, or goes on as `on_instability` says.

    Action
        Box(-1, 1, (legs,)): increments of the actuator inputs, times `max_action`. Cut at the actuators' limits.

    Observation
        Dict of `observation` (see `pcm_gym.tasks.observation_elements`), `achieved_goal` and `desired_goal`: position
        in mean rod lengths, for a platform also cosine and sine of its angle.

    Reward
        `compute_reward(achieved_goal, desired_goal, info)`; never negative, see `pcm_gym.tasks.ReachTask`.

    Episode end
        Terminated where `on_instability` says so; truncated by the time limit, or when the solver fails (the state then
        stays as it was). Reaching the goal does not end an episode.

    Info
        `is_success`, at the goal and stable; `cost`, the sum of `cost_unstable` (stability was lost on the way, or the
        state is unstable), `cost_singular` (singularity margin below `singular_margin`), `cost_limit` (an increment was
        cut) and `cost_solver`, each 0 or 1 and 0 at reset; `index`, `stability_margin`, `singularity_margin` and
        `residual` of the present equilibrium; `event`, the first loss of stability on the way ("fold",
        "index_change"), "solver_failure", "actuator_limit" or "none".

    Parameters
    ----------
    mechanism : Mechanism or str
        The mechanism, or its name in the catalogue.
    reward_type : "dense" or "sparse"
    on_instability : "terminate", "snap", "hold" or "continue"
        What happens where a step meets a fold, or a bifurcation at which the Morse index changes; every such step costs
        `cost_unstable`.

        - "terminate": the episode ends, in the last state before it.
        - "snap": the mechanism falls as `pcm_gym.snap` does, to a stable equilibrium at the same inputs, and the step
          goes on from there; if need be it falls again. Just beyond a bifurcation into stable branches, nearer to it
          than can be resolved, the step ends there. A fall without a landing is a failure of the solver.
        - "hold": the increment is refused; state and inputs stay as they were.
        - "continue": the branch is followed while it exists, stable or not; only a fold ends the episode. The one
          behaviour in which `reset` takes an unstable `equilibrium`; its goal is then walked to from home.
    load : array_like (d,), optional
        Constant load on the end-effector, N (and N m).
    max_action : float or array_like (legs,), optional
        Increment of each input for an action of 1; 0.1 rad or 0.03 mean rod lengths by default.
    success_distance : float
        Distance to the goal, in m, that counts as reached.
    singular_margin : float
        Threshold of `cost_singular`, in units of EI = L = 1.
    render_mode : "rgb_array", optional
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": RENDER_FPS}  # noqa: RUF012 (gymnasium's own convention)

    def __init__(
        self,
        mechanism: Mechanism | str = "2RFR",
        *,
        reward_type: RewardType = "dense",
        on_instability: OnInstability = "terminate",
        load: ArrayLike | None = None,
        max_action: ArrayLike | None = None,
        success_distance: float = 0.02,
        singular_margin: float = 1.0,
        render_mode: str | None = None,
    ) -> None:
        settings = Settings.from_arguments(
            mechanism, reward_type, on_instability, load, max_action, success_distance, singular_margin
        )
        self.render_mode = one_of("render_mode", render_mode, (None, *self.metadata["render_modes"]))
        self.observation_space, self.action_space = single_spaces(settings.mechanism)
        self._simulation = Simulation(settings, 1)
        self._action_shape = self.action_space.shape
        self._stability_lost = False
        self._trail: list[Array] = []
        self._renderer: Any = None

    @property
    def mechanism(self) -> Mechanism:
        """The mechanism."""
        return self._simulation.settings.mechanism

    @property
    def task(self) -> ReachTask:
        """Goals, rewards and success."""
        return self._simulation.settings.task

    @property
    def max_action(self) -> Array:
        """Increment of each input for an action of 1, (legs,), rad or m."""
        return self._simulation.settings.max_action.copy()

    @property
    def success_distance(self) -> float:
        """Distance to the goal, in m, that counts as reached."""
        return self.task.success_distance

    @property
    def singular_margin(self) -> float:
        """Threshold of `cost_singular`."""
        return self._simulation.settings.singular_margin

    @property
    def equilibrium(self) -> Equilibrium:
        """The present equilibrium."""
        return self._simulation.equilibrium(0)

    @property
    def goal(self) -> Array:
        """The goal as a pose, (d,), in m and rad."""
        return self.task.pose_from_goal(self._simulation.goals[0])

    @property
    def witness(self) -> Array:
        """Inputs that reach the goal, (legs,), rad or m; not observed."""
        witness: Array = self._simulation.witnesses[0] * self.mechanism.units.inputs
        return witness

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin an episode with a start and a goal drawn from stable equilibria.

        Parameters
        ----------
        seed : int, optional
        options : dict, optional
            Any of `inputs` (the start is the equilibrium there on the branch of home), `equilibrium` (the start
            itself), `goal` (a pose) and `load`.
        """
        super().reset(seed=seed)
        self._simulation.reset_rows([0], [self.np_random], options)
        self._stability_lost = False
        self._trail = []
        outcome = self._simulation.observe(np.zeros(1, dtype=np.intp))
        return self._observation(outcome), outcome.row_info(0)

    def step(self, action: NDArray[np.float32]) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Move the inputs by `action` times `max_action` along the present branch of equilibria."""
        outcome = self._simulation.step(self._checked(action))
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

    def compute_reward(self, achieved_goal: ArrayLike, desired_goal: ArrayLike, info: Any) -> Any:
        """Return the reward of achieved for desired goals, (g,) or (n, g); `info` is not used."""
        return self.task.compute_reward(achieved_goal, desired_goal)

    def render(self) -> NDArray[np.uint8] | None:
        """Return a picture of the present state, (height, width, 3); None without `render_mode`."""
        if self.render_mode is None:
            gymnasium.logger.warn("render() was called without a render_mode; pass render_mode='rgb_array' to make().")
            return None
        if self._renderer is None:
            from pcm_gym.rendering import FrameRenderer  # drawing is loaded only when a picture is asked for

            self._renderer = FrameRenderer(self.mechanism)
        trail = np.array(self._trail) if self._trail else None
        picture: NDArray[np.uint8] = self._renderer.draw(
            self.equilibrium,
            goal=self.goal,
            success_distance=self.success_distance,
            trail=trail,
            stability_lost=self._stability_lost,
        )
        return picture

    def save_state(self) -> dict[str, Any]:
        """Return everything that the rest of the episode depends on; `restore_state` takes it back exactly."""
        simulation = self._simulation
        return {
            "states": tuple(array.copy() for array in simulation.states),
            "goals": simulation.goals.copy(),
            "witnesses": simulation.witnesses.copy(),
            "stability_lost": self._stability_lost,
            "trail": list(self._trail),
            "generator": copy.deepcopy(self.np_random.bit_generator.state),
        }

    def restore_state(self, state: dict[str, Any]) -> None:
        """Go back to what `save_state` returned."""
        simulation = self._simulation
        for array, saved in zip(simulation.states, state["states"], strict=True):
            array[:] = saved
        simulation.goals[:] = state["goals"]
        simulation.witnesses[:] = state["witnesses"]
        self._stability_lost = state["stability_lost"]
        self._trail = list(state["trail"])
        self.np_random.bit_generator.state = copy.deepcopy(state["generator"])

    def _checked(self, action: ArrayLike) -> Array:
        values = np.asarray(action, dtype=np.float64)
        if values.shape != self._action_shape:
            raise ValueError(f"action must have shape {self._action_shape}, got {values.shape}")
        if not all(map(math.isfinite, values)):
            raise ValueError(f"action must be finite, got {values.tolist()}")
        return values[None]

    @staticmethod
    def _observation(outcome: Outcome) -> Observation:
        return {key: array[0] for key, array in outcome.observation.items()}
