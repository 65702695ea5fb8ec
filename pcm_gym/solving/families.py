"""Families of equilibria: where solutions are not isolated but make up curves or surfaces.

On a family the linearised equations have a kernel; but so they have at a fold or a fork, which are isolated. What tells
them apart is a step along the kernel: from there the equations are solved again, with what was stepped held, and on a
family they can be.
"""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pcm_gym.arrays import Array, Integers, Mask
from pcm_gym.kernels.enumeration.found import Found
from pcm_gym.kernels.enumeration.linearisation import linearised
from pcm_gym.kernels.statics.closure import TURN
from pcm_gym.solving.solutions import FamilyKind
from pcm_gym.solving.straight_rods import straight_point

# Singular values below this part of the largest one are zero.
_ZERO = 1e-8
# States are softer than this, see `Found.softness`, wherever they may lie on a family.
_SOFT = 1e5
# Steps along a family, in the units of `linearised`: the one that tells it from a fold, the longest, and the shortest
# before it is given up.
_PROBE, _LONGEST_STEP, _SHORTEST_STEP = 0.05, 0.2, 1e-4
# What the direction of a curve may turn in one step, rad.
_LARGEST_TURN = 0.2
# Corrections: how many, and the scaled residual of a solution.
_CORRECTIONS, _SOLVED = 12, 1e-13
# Two solutions at a fold are one if between them the residual is rounding alone.
_INDISTINCT = 1e-14
# States nearer than the first are one; nearer than the second if the equations hold, to rounding, all the way between.
_SAME, _BLURRED = 1e-6, 0.1
# A rod is straight if its sideways load moves its tip by less than this.
_STRAIGHT = 1e-3
# Changes smaller than this are none.
_NONE = 1e-7


@dataclass(frozen=True, eq=False)
class System:
    """The equations of one problem; a point is a state and inputs, one array (size + legs,), dimensionless."""

    legs: Array
    load: Array
    rho_max: float
    is_inverse: bool

    @property
    def leg_count(self) -> int:
        """Number of legs."""
        return len(self.legs)

    def at(self, point: Array) -> "Linearisation":
        """Return the equations near a point."""
        x, inputs = np.split(point, [-self.leg_count])
        return Linearisation(*linearised(self.legs, x.copy(), inputs.copy(), self.load, self.is_inverse))

    def change(self, unknown: Array) -> Array:
        """Return changes of what is not given, (..., size), as changes of the point."""
        change = np.zeros((*unknown.shape[:-1], unknown.shape[-1] + self.leg_count))
        if self.is_inverse:
            loads = 2 * self.leg_count
            change[..., :loads], change[..., -self.leg_count :] = unknown[..., :loads], unknown[..., loads:]
        else:
            change[..., : -self.leg_count] = unknown
        return change

    def unknown(self, first: Array, second: Array) -> Array:
        """Return what is not given of the way from one point to another, of angles the shorter one."""
        way = second - first
        if self.is_inverse:
            turns = self.legs[:, TURN] != 0.0
            way[-self.leg_count :][turns] = (
                np.remainder(way[-self.leg_count :][turns] + math.pi, 2.0 * math.pi) - math.pi
            )
            return np.delete(way, np.s_[2 * self.leg_count : -self.leg_count])
        way = way[: -self.leg_count]
        if len(way) == 2 * self.leg_count + 3:
            way[-1] = math.remainder(way[-1], 2.0 * math.pi)
        return way

    def largest_rho(self, point: Array) -> float:
        """Return the largest dimensionless load of a rod."""
        loads = point[: 2 * self.leg_count]
        return math.sqrt(float(np.hypot(loads[0::2], loads[1::2]).max()))

    def holds_between(self, first: Array, second: Array, error: float = _SOLVED) -> bool:
        """Return whether all points on the straight way between two are solutions, to rounding."""
        way = self.change(self.unknown(first, second))
        return all(self.at(first + part * way).error < error for part in (0.25, 0.5, 0.75))

    def corrected(self, point: Array, units: Array, held: Array) -> Array | None:
        """Return the solution near a point, in these units across the directions held (k, size); None without one."""
        point = point.copy()
        for _ in range(_CORRECTIONS):
            here = self.at(point)
            if not here.is_finite:
                return None
            matrix = here.matrix * (units / here.units)
            step = -np.linalg.lstsq(matrix - matrix @ held.T @ held, here.residual, rcond=_ZERO)[0]
            size = float(np.abs(step).max())
            if size > _LONGEST_STEP:
                return None
            point += self.change(units * step)
            if size < 1e-3 * _SAME:
                break
        return point if self.at(point).error < _SOLVED else None


@dataclass(frozen=True, eq=False)
class Linearisation:
    """The scaled equations near a point, and what their kernel is."""

    residual: Array
    matrix: Array
    units: Array

    @property
    def is_finite(self) -> bool:
        """Whether there are equations at all: the loads are within what can be computed."""
        return bool(np.isfinite(self.residual).all() and np.isfinite(self.matrix).all())

    @property
    def error(self) -> float:
        """Largest residual."""
        return float(np.abs(self.residual).max()) if self.is_finite else math.inf

    @cached_property
    def kernel(self) -> Array:
        """Orthonormal directions, (k, size), in which the equations do not change, to first order."""
        return _kernel(self.matrix)


def _kernel(matrix: Array) -> Array:
    """Return orthonormal rows that span what a matrix takes to zero."""
    _, values, directions = np.linalg.svd(matrix)
    values = np.pad(values, (0, len(directions) - len(values)))
    kernel: Array = directions[values <= _ZERO * values[0]]
    return kernel


@dataclass(frozen=True, eq=False)
class Continuum:
    """A family found, dimensionless: some of its points, that which stands for all, and directions there."""

    kind: FamilyKind
    points: Array  # (m, size + legs)
    representative: Array  # (size + legs,)
    directions: Array  # (dimension, size + legs), orthonormal

    def holds(self, system: System, point: Array) -> bool:
        """Return whether a solution lies on the family, or so near that rounding cannot tell."""
        if self.kind == FamilyKind.SELF_STRESS:
            nearest = _straightened(system, point)
            if nearest is None:
                return False
            way = system.change(system.unknown(self.representative, nearest))
            beside = np.abs(way - way @ self.directions.T @ self.directions)
            return bool(beside.max() < _SAME * (1.0 + np.abs(way).max())) and _are_one(system, nearest, point)
        return _are_one(system, _nearest(system, self.points, point), point)


def corrected_states(system: System, found: Found) -> Array:
    """Return the states and inputs found, (m, size + legs), with what is not given corrected as far as it can be."""
    points = np.hstack([found.x, found.inputs])
    held = np.zeros((0, found.x.shape[1]))
    solutions = (system.corrected(point, np.ones(found.x.shape[1]), held) for point in points)
    return np.array([point if near is None else near for point, near in zip(points, solutions, strict=True)])


def part_continua(system: System, found: Found, given: Array) -> tuple[Mask, list[Continuum]]:
    """Return which of the solutions found are isolated, each once, and the families on which the others lie.

    `given` are the inputs, or the pose. That all rods are straight is seen from them, whatever was found.
    """
    is_isolated = np.ones(len(found.x), dtype=bool)
    soft = np.flatnonzero(~(found.softness < _SOFT))
    straight = straight_point(system.legs, given, is_inverse=system.is_inverse)
    stress = None if straight is None else _stress_between(system, straight)
    if not len(soft) and stress is None:
        return is_isolated, []
    points = np.hstack([found.x, found.inputs])
    # first what is surely on a family: where others branch off it, there are more directions than it has
    order = sorted(soft, key=lambda n: len(system.at(points[n]).kernel) or math.inf)
    continua = [] if stress is None else [stress]
    alone: list[Array] = []
    for n in order:
        point = points[n]
        is_isolated[n] = False
        if any(continuum.holds(system, point) for continuum in continua):
            continue
        continuum = _stress_through(system, point) or _continuum_through(system, point)
        if continuum is not None:
            continua.append(continuum)
        elif not any(system.holds_between(other, point, _INDISTINCT) for other in alone):
            is_isolated[n] = True
            alone.append(point)
    return is_isolated, continua


def _are_one(system: System, first: Array, second: Array) -> bool:
    """Return whether rounding may have made two of one solution that lies on a family."""
    distance = np.abs(system.unknown(first, second) / system.at(first).units).max()
    return bool(distance < _SAME or (distance < _BLURRED and system.holds_between(first, second)))


def _straight_rods(system: System, point: Array) -> Integers:
    """Return the numbers of the rods that are straight, or all but."""
    sideways = slice(1, 2 * system.leg_count, 2)
    return np.flatnonzero(np.abs(point[sideways]) < _STRAIGHT * system.at(point).units[sideways]).astype(np.int64)


def _straightened(system: System, point: Array) -> Array | None:
    """Return the solution next to this one in which the rods that are all but straight are so; None without one."""
    sideways = 2 * _straight_rods(system, point) + 1
    straight = point.copy()
    straight[sideways] = 0.0
    units = system.at(straight).units
    return system.corrected(straight, units, np.eye(len(units))[sideways])


def _stress_through(system: System, point: Array) -> Continuum | None:
    """Return the family of self-stresses of straight rods through a solution; None without one.

    A straight rod's tip stays where it is whatever the force along the rod: the family is flat.
    """
    straight = _straightened(system, point)
    if straight is None or not _are_one(system, straight, point):
        return None
    along = 2 * _straight_rods(system, straight)
    here = system.at(straight)
    if not len(along) or np.abs(here.matrix[: 2 * system.leg_count, along]).max() > _ZERO:
        return None
    stresses = _kernel(here.matrix[:, along])
    if not len(stresses):
        return None
    unknown = np.zeros((len(stresses), len(here.units)))
    unknown[:, along] = stresses * here.units[along]
    directions = np.linalg.qr(system.change(unknown).T)[0].T
    probes = [straight + sign * system.rho_max**2 * row for row in directions for sign in (0.5, -0.5)]
    if any(system.at(probe).error > _SOLVED for probe in probes):
        return None
    least = straight - straight @ directions.T @ directions
    representative = least if system.largest_rho(least) <= system.rho_max else straight
    return Continuum(FamilyKind.SELF_STRESS, representative[np.newaxis], representative, directions)


def _stress_between(system: System, straight: Array) -> Continuum | None:
    """Return the family of self-stresses of rods that are all straight; None if they bear none or not the load."""
    here, along = system.at(straight), slice(0, 2 * system.leg_count, 2)
    forces = np.zeros(len(here.units))
    forces[along] = here.units[along] * np.linalg.lstsq(here.matrix[:, along], -here.residual, rcond=_ZERO)[0]
    loaded = straight + system.change(forces)
    if system.at(loaded).error > 1e3 * _SOLVED or system.largest_rho(loaded) > system.rho_max:
        return None
    return _stress_through(system, loaded)


def _continuum_through(system: System, point: Array) -> Continuum | None:
    """Return the family through a solution; None if it is isolated."""
    here = system.at(point)
    kernel = here.kernel
    probes = [sign * _PROBE * row for row in kernel for sign in (1.0, -1.0)]
    if not probes or any(_stepped(system, point, here.units, kernel, probe) is None for probe in probes):
        return None
    points = [point]
    for sign in (1.0, -1.0) if len(kernel) == 1 else ():
        followed = _followed(system, point, sign * kernel[0])
        if followed is None:
            return None
        points += followed
    inside = [each for each in points if system.largest_rho(each) <= system.rho_max]
    representative = min(inside, key=system.largest_rho)
    there = system.at(representative)
    if len(there.kernel) != len(kernel):  # other solutions branch off there
        representative, there = point, here
    directions = np.linalg.qr(system.change(there.units * there.kernel).T)[0].T
    loads = slice(2 * system.leg_count)
    is_turning = np.abs(directions[:, loads]).max() < _NONE
    kind = FamilyKind.FREE_ROTATION if is_turning else FamilyKind.OPPOSED_RODS
    return Continuum(kind, np.array(points), representative, directions)


def _stepped(system: System, point: Array, units: Array, held: Array, step: Array) -> Array | None:
    """Return the point of the family a step along it away; None if it does not go on there."""
    reached = system.corrected(point + system.change(units * step), units, held)
    return None if reached is None or not len(system.at(reached).kernel) else reached


def _followed(system: System, start: Array, direction: Array) -> list[Array] | None:
    """Return points along a curve until a rod's load is too large or it closes; None if it ends before."""
    point, units, step, gone = start, system.at(start).units, _PROBE, 0.0
    points: list[Array] = []
    while step > _SHORTEST_STEP:
        reached = _stepped(system, point, units, direction[np.newaxis], step * direction)
        there = None if reached is None else system.at(reached)
        turned = None if there is None else _carried(there.kernel, direction * units / there.units)
        if reached is None or there is None or turned is None:
            step *= 0.5
            continue
        points.append(reached)
        gone += step
        point, units, direction = reached, there.units, turned
        way = system.unknown(point, start) / units
        is_closed = gone > 2.0 * _LONGEST_STEP and np.linalg.norm(way) < step and way @ direction > 0.0
        if is_closed or system.largest_rho(point) > system.rho_max:
            return points
        step = min(1.5 * step, _LONGEST_STEP)
    return None


def _carried(kernel: Array, direction: Array) -> Array | None:
    """Return the direction in the kernel nearest to one from a step before; None if it turns much."""
    onward: Array = kernel.T @ (kernel @ direction)
    length = float(np.linalg.norm(onward))
    return onward / length if length > math.cos(_LARGEST_TURN) * np.linalg.norm(direction) else None


def _nearest(system: System, points: Array, target: Array) -> Array:
    """Return about the point of a family that is nearest to a target, from the nearest of some of its points."""
    units = system.at(target).units
    nearest: Array = min(points, key=lambda each: float(np.linalg.norm(system.unknown(each, target) / units)))
    left = math.inf
    while True:
        here = system.at(nearest)
        step = here.kernel.T @ (here.kernel @ (system.unknown(nearest, target) / here.units))
        length = float(np.linalg.norm(step))
        if length < _SAME or length > left - 0.5 * min(_LONGEST_STEP, left):
            return nearest
        left = length
        reached = _stepped(system, nearest, here.units, here.kernel, step * min(1.0, _LONGEST_STEP / length))
        if reached is None:
            return nearest
        nearest = reached
