"""Equilibria as plain geometry in world coordinates, for any front end that draws."""

import math
from dataclasses import dataclass

import numpy as np

from pcm_gym.arrays import Array
from pcm_gym.mechanism import Mechanism
from pcm_gym.solving import Equilibrium


@dataclass(frozen=True, eq=False)
class Polylines:
    """What there is to draw of one equilibrium, world frame, lengths in m."""

    rods: Array  # (legs, points, 2): centre lines, base to tip at equal steps of arc length
    moments: Array  # (legs, points): bending moment EI d theta / d s in N m, positive where the rod bends to the left
    clamp_angles: Array  # (legs,): world angle at which each rod leaves its clamp, rad
    end_effector: Array  # (2,): origin of the end-effector
    platform: Array  # (legs, 2): the attachments; for a point end-effector all at its origin

    @property
    def clamps(self) -> Array:
        """Clamped base points, (legs, 2)."""
        return self.rods[:, 0]

    @property
    def hinges(self) -> Array:
        """Tips of the rods, (legs, 2)."""
        return self.rods[:, -1]


def equilibrium_polylines(equilibrium: Equilibrium, points: int = 60) -> Polylines:
    """Return the polylines of an equilibrium, with the bending moment along each rod.

    The moment is force cross lever about each cut, M(s) = (tip - p(s)) x f, exact to rounding and zero at the hinge.

    Parameters
    ----------
    equilibrium : Equilibrium
    points : int
        Points per rod, at least 2.

    Returns
    -------
    Polylines
        New arrays, which the caller may change.
    """
    mechanism, rods = equilibrium.mechanism, equilibrium.shape(points)
    levers = rods[:, -1:] - rods
    forces = np.array([rod.force for rod in equilibrium.rods])
    return Polylines(
        rods=rods,
        moments=levers[:, :, 0] * forces[:, 1:] - levers[:, :, 1] * forces[:, :1],
        clamp_angles=_clamp_angles(mechanism, equilibrium.inputs),
        end_effector=np.array(equilibrium.pose[:2]),
        platform=platform_points(mechanism, equilibrium.pose),
    )


def platform_points(mechanism: Mechanism, pose: Array) -> Array:
    """Return the attachments in the world frame at `pose` (d,), (legs, 2), in m."""
    angle = float(pose[2]) if mechanism.dof == 3 else 0.0
    c, s = math.cos(angle), math.sin(angle)
    attachments = np.array([leg.attachment for leg in mechanism.legs])
    turned: Array = attachments @ np.array([[c, s], [-s, c]])
    return pose[:2] + turned


def _clamp_angles(mechanism: Mechanism, inputs: Array) -> Array:
    legs = zip(mechanism.legs, inputs.tolist(), strict=True)
    return np.array([leg.actuator.clamp_direction(value) for leg, value in legs])
