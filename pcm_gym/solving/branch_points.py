"""Where branches along a way cross: which directions lead away from there."""

import math
from typing import NamedTuple

import numpy as np

from pcm_gym.arrays import Array
from pcm_gym.kernels.branches.curves import polish
from pcm_gym.kernels.branches.problem import Problem
from pcm_gym.kernels.branches.ways import set_equations
from pcm_gym.kernels.enumeration.linearisation import linearised
from pcm_gym.solving.diagram import SpecialKind

# Half width of the differences that give second derivatives, and how far from the point the other branch is begun, in
# the units of `linearised`.
_DIFFERENCE, _BESIDE = 1e-4, 1e-3
# A singular value, and a direction's change of the parameter, that are zero.
_SINGULAR, _UPRIGHT = 1e-4, 1e-2


class Crossing(NamedTuple):
    """What crosses a branch in one of its points."""

    kind: SpecialKind
    direction: Array | None  # of the other branch, of the unknowns; None where it could not be told
    condition: Array  # what is held where that branch is begun


class _Equations:
    """The scaled equations near a point of a way."""

    def __init__(self, legs: Array, y: Array, problem: Problem) -> None:
        self._legs, self._y, self._problem, self._size = legs, y, problem, len(y) - 1
        own = problem.parameters
        inputs = own.inputs + y[-1] * own.input_rates[0]
        load = own.load + y[-1] * own.load_rates[0]
        _, _, units = linearised(legs, y[:-1].copy(), inputs, load, False)
        self.units = np.append(units, 1.0)
        rows = np.abs(self._raw(y) * self.units).max(axis=1)
        self._weights = 1.0 / np.maximum(rows, 1.0)

    def _raw(self, y: Array) -> Array:
        residual, matrix = np.empty(self._size), np.empty((self._size, self._size + 1))
        set_equations(self._legs, y, self._problem, residual, matrix)
        return matrix

    def matrix(self, step: Array) -> Array:
        """Return the derivative, (size, size + 1), a step away from the point."""
        matrix: Array = self._weights[:, None] * self._raw(self._y + self.units * step) * self.units
        return matrix


def crossing_at(legs: Array, y: Array, along: Array, problem: Problem) -> Crossing:
    """Return what crosses the branch at its point `y`, whose direction there is about `along`.

    With the two directions in which the equations do not change, to first order, and the one combination of equations
    that is lost, the tangents are the roots of a quadratic form: that of the second derivatives.
    """
    equations = _Equations(legs, y, problem)
    left, values, right = np.linalg.svd(equations.matrix(np.zeros(len(y))))
    plane, lost = right[-2:], left[:, -1]
    unknown = Crossing(SpecialKind.BRANCH_POINT, None, np.zeros(len(y)))
    if not values[-1] < _SINGULAR * values[0]:
        return unknown
    form = np.empty((2, 2))
    for j, direction in enumerate(plane):
        rate = equations.matrix(_DIFFERENCE * direction) - equations.matrix(-_DIFFERENCE * direction)
        form[:, j] = plane @ (lost @ rate) / (2.0 * _DIFFERENCE)
    directions = _roots(0.5 * (form + form.T))
    if directions is None:
        return unknown
    tangents = directions @ plane
    known = along / equations.units
    cosines = np.abs(tangents @ known) / np.linalg.norm(known)
    other = tangents[int(np.argmin(cosines))]
    upright = np.abs(tangents[:, -1]) < _UPRIGHT * np.linalg.norm(tangents, axis=1)
    if upright.all():
        return unknown
    kind = SpecialKind.PITCHFORK if upright.any() else SpecialKind.TRANSCRITICAL
    return Crossing(kind, equations.units * other, other / equations.units)


def _roots(form: Array) -> Array | None:
    """Return the unit vectors, (2, 2), on which a quadratic form in the plane is zero; None without two of them."""
    values, axes = np.linalg.eigh(form)
    if not values[0] < 0.0 < values[1]:
        return None
    first, second = math.sqrt(values[1]), math.sqrt(-values[0])
    roots = np.array([[first, second], [first, -second]]) @ axes.T
    unit: Array = roots / np.linalg.norm(roots, axis=1, keepdims=True)
    return unit


def points_beside(legs: Array, y: Array, crossing: Crossing, problem: Problem) -> list[Array]:
    """Return points of the crossing branch to both sides of where it crosses; none where that is not known."""
    if crossing.direction is None:
        return []
    found = []
    for sign in (1.0, -1.0):
        beside = y + sign * _BESIDE * crossing.direction
        if polish(legs, beside, crossing.condition, problem):
            found.append(beside)
    return found
