"""Where, and in which units, the equilibria of a mechanism are searched for."""

import math
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from pcm_gym.arrays import Array
from pcm_gym.kernels.enumeration.cells import hinge
from pcm_gym.kernels.statics.closure import BASE_X, BASE_Y, LENGTH, TURN
from pcm_gym.mechanism import Mechanism

# The search takes lengths and forces of about 1, and a mechanism near the origin. Where the reference rod differs from
# the mean one by more than the first factor, or a base is further away than the second, in mean rod lengths, it has
# units and origin of its own.
_FOREIGN, _FAR = 2.0, 100.0
# Nearer than this to a motor, in rod lengths, no direction leads from it to the hinge: the search is made this far off.
_LEAST_DISTANCE = 1e-6
_WAYS = 8
# Of the change of frame, relative to what goes into it.
_ROUNDING = 1e-15


@dataclass(frozen=True, eq=False)
class SearchFrame:
    """A mechanism as it is, and as the search sees it; the door between their dimensionless numbers.

    Attributes
    ----------
    mechanism, searched : Mechanism
        The same object where there is no need for another.
    origin : array (2,)
        Origin of the search in the mechanism's own frame, m.
    """

    mechanism: Mechanism
    searched: Mechanism
    origin: Array

    @property
    def is_own(self) -> bool:
        """Whether the search sees the mechanism as it is."""
        return self.searched is self.mechanism

    def scaled_pose(self, pose: Array) -> Array:
        """Return a pose, m and rad, as the search takes it."""
        moved = pose.copy()
        moved[:2] -= self.origin
        return self.searched.units.kernel_from_pose(moved)

    def states(self, searched: Array) -> Array:
        """Return states (..., size) of the search as states of the mechanism."""
        if self.is_own:
            return searched
        states, pose = searched.copy(), np.s_[..., 2 * self.mechanism.leg_count :]
        poses = self.searched.units.pose_from_kernel(searched[pose])
        poses[..., :2] += self.origin
        states[pose] = self.mechanism.units.kernel_from_pose(poses)
        return states

    def state_error(self, searched: float) -> float:
        """Bound the errors of the mechanism's states and inputs by that of the search's, relative to 1 + their size."""
        if self.is_own:
            return searched
        own, other = self.mechanism.units, self.searched.units
        stretch = max(1.0, float(np.max(other.pose / own.pose)), float(np.max(other.inputs / own.inputs)))
        return stretch * searched + _ROUNDING * (1.0 + stretch + float(np.abs(self.origin).max()) / own.length)

    def directions(self, searched: Array) -> Array:
        """Return orthonormal changes (k, size + legs) of state and inputs as such of the mechanism."""
        if self.is_own:
            return searched
        own, other, loads = self.mechanism.units, self.searched.units, np.ones(2 * self.mechanism.leg_count)
        units = np.concatenate([loads, other.pose / own.pose, other.inputs / own.inputs])
        return np.linalg.qr((searched * units).T)[0].T


@lru_cache(maxsize=256)
def search_frame(mechanism: Mechanism) -> SearchFrame:
    """Return where and in which units to search."""
    rods, own = [leg.rod for leg in mechanism.legs], mechanism.units
    length = math.fsum(rod.length for rod in rods) / len(rods)
    stiffness = math.fsum(rod.bending_stiffness for rod in rods) / len(rods)
    ratios = own.length / length, own.force * own.length**2 / stiffness
    bases = np.array([leg.actuator.base for leg in mechanism.legs])
    is_far = bool(np.abs(bases).max() > _FAR * length)
    if not is_far and all(1.0 / _FOREIGN <= ratio <= _FOREIGN for ratio in ratios):
        return SearchFrame(mechanism, mechanism, np.zeros(2))
    origin = bases[0] if is_far else np.zeros(2)
    legs = tuple(
        replace(leg, actuator=replace(leg.actuator, base=tuple(base - origin)))
        for leg, base in zip(mechanism.legs, bases, strict=True)
    )
    return SearchFrame(mechanism, replace(mechanism, legs=legs, home_pose=None, reference=None), origin)


def beside_motors(legs: Array, pose: Array) -> Array:
    """Return the pose, dimensionless, or one beside it where a hinge is on its motor or all but.

    The equations themselves have no trouble there; what leads to solutions beside the motor is a hair from those on it.
    """
    if not any(_distance_from_motor(legs, leg, pose) < 0.5 * _LEAST_DISTANCE for leg in range(len(legs))):
        return pose
    step = _LEAST_DISTANCE * float(legs[:, LENGTH].min())
    ways = 0.5 + 2.0 * math.pi / _WAYS * np.arange(_WAYS)
    beside = [np.append(pose[:2] + step * np.array([math.cos(way), math.sin(way)]), pose[2:]) for way in ways]
    return max(beside, key=lambda each: min(_distance_from_motor(legs, leg, each) for leg in range(len(legs))))


def _distance_from_motor(legs: Array, leg: int, pose: Array) -> float:
    """Return the distance of a hinge from its motor in rod lengths; inf for a slider."""
    if legs[leg, TURN] == 0.0:
        return math.inf
    x, y = hinge(legs, leg, pose)
    return math.hypot(x - legs[leg, BASE_X], y - legs[leg, BASE_Y]) / float(legs[leg, LENGTH])
