"""What a controller sees."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import VectorEnv
from numpy.typing import NDArray

from pcm_gym.arrays import Array, Integers, Mask
from pcm_gym.environments.batch import MechanismVectorEnv
from pcm_gym.environments.simulation import Simulation
from pcm_gym.environments.single import MechanismEnv
from pcm_gym.kernels.charts.motions import forward_jacobians
from pcm_gym.mechanism import Mechanism
from pcm_gym.solving import Equilibrium


@dataclass(frozen=True)
class View:
    """Episodes that run side by side, one in each of the n rows of a batch, before their next step.

    Attributes
    ----------
    simulation : Simulation
        For those who know the mechanics: the exact equilibrium, goal and mechanism. Not to be stepped.
    observation : dict of array (n, ...)
        What the environment tells; a learnt policy sees nothing else.
    elapsed : array (n,)
        Steps since each episode began; where it is 0, whatever is remembered of the row is of another episode.
    under_way : array (n,)
        In which rows there is an episode; the actions of the others do not count.
    generators : sequence of n generators
        A source of chance for each episode, which depends on nothing but its seed.
    """

    simulation: Simulation
    observation: dict[str, NDArray[Any]]
    elapsed: Integers
    under_way: Mask
    generators: Sequence[np.random.Generator]

    @classmethod
    def of(
        cls,
        env: gymnasium.Env[Any, Any] | VectorEnv[Any, Any, Any],
        observation: dict[str, NDArray[Any]],
        generators: Sequence[np.random.Generator],
        under_way: Mask | None = None,
    ) -> "View":
        """Return what is seen in an environment or a native batch, wrapped or not, which has just told `observation`.

        Raises
        ------
        TypeError
            If it is none of this package.
        """
        own = env.unwrapped
        if not isinstance(own, MechanismEnv | MechanismVectorEnv):
            raise TypeError(f"env must be an environment of pcm_gym, got {own!r}")
        if isinstance(own, MechanismEnv):
            observation = {key: value[None] for key, value in observation.items()}
        simulation = own._simulation
        if under_way is None:
            under_way = np.ones(simulation.count, dtype=np.bool_)
        return cls(simulation, observation, simulation.rows.elapsed.copy(), under_way, generators)

    @property
    def rows(self) -> list[int]:
        """The rows in which there is an episode."""
        return np.flatnonzero(self.under_way).tolist()

    @property
    def mechanism(self) -> Mechanism:
        """The mechanism; where it is randomised, what its variants deviate from."""
        return self.simulation.settings.mechanism

    @property
    def action_shape(self) -> tuple[int, int]:
        """Shape of the actions of all rows, (n, actuators)."""
        return len(self.under_way), self.mechanism.leg_count

    def equilibrium(self, row: int) -> Equilibrium:
        """Return the present equilibrium of one row."""
        return self.simulation.equilibrium(row)

    @property
    def observed_poses(self) -> Array:
        """The observed poses, dimensionless, (n, d)."""
        return self.poses_of(self.observation["achieved_goal"])

    @property
    def pose_errors(self) -> Array:
        """What takes the observed poses to their goals, dimensionless, (n, d): an angle the shorter way round."""
        error = self.poses_of(self.observation["desired_goal"]) - self.observed_poses
        error[:, 2:] = (error[:, 2:] + np.pi) % (2.0 * np.pi) - np.pi
        return error

    @property
    def jacobians(self) -> Array:
        """Derivatives of the poses by the inputs, dimensionless, (n, d, legs); 0 where they do not exist."""
        found = np.zeros((len(self.elapsed), self.mechanism.dof, self.mechanism.leg_count))
        rows, simulation = np.flatnonzero(self.under_way), self.simulation
        for scene, members in simulation._by_scene(simulation.rows.scene, rows):
            x, inputs = simulation.rows.x[members], simulation.rows.inputs[members]
            found[members] = forward_jacobians(scene.mechanism.leg_table, x, inputs)
        return found

    def poses_of(self, goals: Array) -> Array:
        """Return the poses of goals (m, g), dimensionless, (m, d)."""
        if self.mechanism.dof == 2:
            return goals[:, :2].astype(np.float64)
        angles = np.arctan2(goals[:, 3], goals[:, 2])
        return np.concatenate([goals[:, :2], angles[:, None]], axis=1)
