"""Limits of the structure: curvature of each rod, force of each actuator, contact; and which states break them."""

from typing import NamedTuple

import numpy as np

from pcm_gym.arrays import Array, Mask
from pcm_gym.kernels.numerics.compilation import kernel
from pcm_gym.kernels.statics.closure import Workspace, make_workspace, place
from pcm_gym.kernels.structure.arcs import Curves, make_curves
from pcm_gym.kernels.structure.contact import has_contact, part_count
from pcm_gym.kernels.structure.strength import set_strength

# Kinds of limits, in the order of the columns of what is broken.
STRESS, TORQUE, CONTACT = range(3)
LIMIT_COUNT = 3


class Bounds(NamedTuple):
    """What the parts of a mechanism endure, dimensionless; infinite where that is not limited."""

    curvature: Array  # (legs,): greatest magnitude of each rod's curvature
    force: Array  # (legs,): greatest magnitude of what each actuator gives
    no_contact: bool


class Judge(NamedTuple):
    """Scratch arrays of who judges states."""

    curvatures: Array  # (legs,)
    forces: Array  # (legs,)
    curves: Curves
    crossing: Array  # (1, 2)


@kernel
def make_judge(leg_count: int, size: int) -> Judge:
    """Return scratch arrays for a mechanism."""
    return Judge(np.empty(leg_count), np.empty(leg_count), make_curves(part_count(leg_count, size)), np.empty((1, 2)))


@kernel
def judge(legs: Array, x: Array, bounds: Bounds, judge: Judge, work: Workspace) -> tuple[bool, bool, bool]:
    """Return which limits the state `x` at the rod table breaks: stress, torque, contact."""
    set_strength(legs, x, work, judge.curvatures, judge.forces)
    breaks_stress = breaks_torque = False
    for i in range(legs.shape[0]):
        breaks_stress = breaks_stress or judge.curvatures[i] > bounds.curvature[i]
        breaks_torque = breaks_torque or abs(judge.forces[i]) > bounds.force[i]
    breaks_contact = bounds.no_contact and has_contact(legs, x, work, judge.curves, judge.crossing)
    return breaks_stress, breaks_torque, breaks_contact


@kernel
def set_broken(legs: Array, states: Array, inputs: Array, bounds: Bounds, broken: Mask) -> None:
    """Fill `broken` (n, 3) with the limits that equilibria break: `states` (n, size) at `inputs` (n, legs)."""
    work, scratch = make_workspace(legs.shape[0], states.shape[1]), make_judge(legs.shape[0], states.shape[1])
    for n in range(states.shape[0]):
        place(legs, states[n], inputs[n], work)
        broken[n, STRESS], broken[n, TORQUE], broken[n, CONTACT] = judge(legs, states[n], bounds, scratch, work)
