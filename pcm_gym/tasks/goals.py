"""What a goal is, how far it is, and what being near it is worth."""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from gymnasium import spaces
from numpy.typing import ArrayLike

from pcm_gym.arrays import Array, Integers, Mask
from pcm_gym.kernels.stepping.goals import Scale, poses_seen, score_goals
from pcm_gym.mechanism import Mechanism
from pcm_gym.mechanism.validation import (
    finite_array,
    finite_vector,
    instance_of,
    one_of,
    positive_number,
    shown,
    truth_value,
    whole_number,
)
from pcm_gym.solving import Equilibrium
from pcm_gym.tasks.observation import Element, box_of, feature_layout, input_elements, pose_elements

RewardType = Literal["dense", "sparse"]

# An input off by 1 rad, or by a mean rod length, counts as this distance where goals tell the inputs.
_INPUT_WEIGHT = 0.1


@dataclass(frozen=True)
class Goals:
    """Goals as rows of numbers: position in mean rod lengths, (cos phi, sin phi) of a platform, inputs on request.

    Distance
    --------
    The distance `e` between achieved and desired goal is the root of the sum of `weight * (achieved - desired)^2` over
    their elements, in mean rod lengths. A turn of a platform counts as the path of its hinges, in the root mean square;
    1 rad or mean rod length of an input counts as a tenth of a mean rod length.

    Reward
    ------
    - "dense": `(1 / (1 + e) + exp(-e / 0.05)) / 2`. One half grows wherever the goal comes nearer, the other near it.
    - "sparse": 1 within `success_distance` of the goal, else 0.

    Attributes
    ----------
    mechanism : Mechanism
    reward_type : "dense" or "sparse"
    success_distance : float
        Distance in m that counts as reached.
    with_inputs : bool
        Whether a goal is a whole equilibrium, and the inputs belong to it.
    """

    mechanism: Mechanism
    reward_type: RewardType = "dense"
    success_distance: float = 0.02
    with_inputs: bool = False

    def __post_init__(self) -> None:
        instance_of("mechanism", self.mechanism, Mechanism)
        one_of("reward_type", self.reward_type, ("dense", "sparse"))
        object.__setattr__(self, "success_distance", positive_number("success_distance", self.success_distance))
        truth_value("with_inputs", self.with_inputs)

    @cached_property
    def scale(self) -> Scale:
        """What differences from a goal count, for the kernels."""
        squares = [x * x + y * y for x, y in (leg.attachment for leg in self.mechanism.legs)]
        arm = math.fsum(squares) / len(squares) / self.mechanism.units.length**2
        pose = [1.0, 1.0, arm, arm][self._pose]
        inputs = [_INPUT_WEIGHT**2] * (self.mechanism.leg_count if self.with_inputs else 0)
        return Scale(np.array(pose + inputs), self.tolerance, self.reward_type == "sparse", False)

    @property
    def tolerance(self) -> float:
        """Goal distance in mean rod lengths that counts as reached."""
        return self.success_distance / self.mechanism.units.length

    @cached_property
    def size(self) -> int:
        """How many numbers g a goal has."""
        return len(self.elements)

    @property
    def elements(self) -> tuple[Element, ...]:
        """What a goal holds, element by element."""
        elements = pose_elements(self.mechanism)
        return elements + input_elements(self.mechanism) if self.with_inputs else elements

    def elements_in(self, steps: int) -> tuple[Element, ...]:
        """Return the elements that tell what the goal will be after some steps."""
        whole_number("steps", steps, least=1, most=1 << 30)
        suffix, what = f"_in_{steps}", f" of the goal {steps} step{'s' * (steps > 1)} from now"
        elements = pose_elements(self.mechanism, suffix, what)
        return elements + input_elements(self.mechanism, suffix, what) if self.with_inputs else elements

    @property
    def box(self) -> spaces.Box:
        """The space of achieved and desired goals."""
        return box_of(self.elements)

    @cached_property
    def _pose(self) -> slice:
        """Where the features of a state, and goals, hold the pose."""
        return feature_layout(self.mechanism)["pose"]

    def _achieved(self, features: Array, inputs: Array, rows: Integers) -> Array:
        """Return the goals (m, g) that some rows meet, with features (m, f) and inputs (n, legs)."""
        poses = features[:, self._pose]
        return np.concatenate([poses, inputs[rows]], axis=1) if self.with_inputs else poses.copy()

    def of_states(self, x: ArrayLike, inputs: ArrayLike) -> Array:
        """Return the goals (n, g) that states (n, 2 legs + d) at inputs (n, legs) meet, both dimensionless."""
        x = finite_array("x", x, ("n", self.mechanism.state_size))
        inputs = finite_array("inputs", inputs, (len(x), self.mechanism.leg_count))
        poses = poses_seen(x, self.mechanism.leg_count)
        return np.concatenate([poses, inputs], axis=1) if self.with_inputs else poses

    def of_pose(self, pose: ArrayLike) -> Array:
        """Return the goal (g,) of a pose (d,) in the mechanism's units; goals must not tell the inputs."""
        pose = self.mechanism.check_pose(pose)
        position = pose[:2] / self.mechanism.units.length
        return position if self.mechanism.dof == 2 else np.append(position, [math.cos(pose[2]), math.sin(pose[2])])

    def of_equilibrium(self, equilibrium: Equilibrium) -> Array:
        """Return the goal (g,) that an equilibrium meets."""
        if instance_of("equilibrium", equilibrium, Equilibrium).mechanism.dof != self.mechanism.dof:
            raise ValueError(f"equilibrium must be of {self.mechanism.name!r}, got {shown(equilibrium)}")
        goal = self.of_pose(equilibrium.pose)
        if not self.with_inputs:
            return goal
        return np.append(goal, self.mechanism.units.kernel_from_inputs(equilibrium.inputs))

    def pose(self, goal: ArrayLike) -> Array:
        """Return the pose (d,) in the mechanism's units that a goal (g,) stands for."""
        goal = finite_vector("goal", goal, self.size)
        position = goal[:2] * self.mechanism.units.length
        return position if self.mechanism.dof == 2 else np.append(position, math.atan2(goal[3], goal[2]))

    def score(self, achieved: ArrayLike, desired: ArrayLike) -> tuple[Array, Mask]:
        """Return rewards, and whether goals are reached, (n,) each, for achieved and desired goals (n, g)."""
        achieved = finite_array("achieved", achieved, ("n", self.size))
        desired = finite_array("desired", desired, achieved.shape)
        rewards, distances = score_goals(achieved, desired, self.scale)
        return rewards, distances <= self.tolerance

    def distance(self, achieved: ArrayLike, desired: ArrayLike) -> Array:
        """Return the distances (n,) in m of achieved from desired goals (n, g)."""
        achieved = finite_array("achieved", achieved, ("n", self.size))
        desired = finite_array("desired", desired, achieved.shape)
        return score_goals(achieved, desired, self.scale)[1] * self.mechanism.units.length
