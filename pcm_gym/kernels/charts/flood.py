"""Flood fill over the stable equilibria of a mechanism, on a raster of inputs and a raster of poses at once.

Stable equilibria within the limits form sheets, and these are charted in two ways: by the inputs, over which a stable
sheet is always a graph (the stiffness is positive definite), and by the poses. A state of the pool is the equilibrium
of one sheet at one node of one raster. From each state the fill moves to the neighbouring nodes of its raster and to
the nearest node of the other one. Two states are joined into one branch only where `track` leads from one to the other
along a straight line of inputs, which stays stable and within the limits. Where the limits of a motor are a full turn
apart, the fill steps from one to the other, but the branches are not joined: a limit is a wall.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pcm_gym.arrays import Array, Integers, Mask
from pcm_gym.kernels.branches.continuation import NONE, make_line, track
from pcm_gym.kernels.branches.tracer import Tracer
from pcm_gym.kernels.numerics.compilation import kernel
from pcm_gym.kernels.numerics.rasters import (
    INPUTS,
    NOWHERE,
    POSES,
    Rasters,
    cell_count,
    nearest_cell,
    neighbour,
    set_node,
)
from pcm_gym.kernels.numerics.slices import slices
from pcm_gym.kernels.statics.closure import LOWER, UPPER, Workspace, make_workspace, place
from pcm_gym.kernels.statics.equilibrium import total_energy
from pcm_gym.kernels.statics.newton import CONVERGED, NewtonRules, solve_inverse_locally
from pcm_gym.kernels.statics.stability import assess_stability
from pcm_gym.kernels.statics.states import SAME_STATE, Point, are_same

_INVERSE_RULES = NewtonRules(first_correction=0.3, contraction=0.5, iterations=10)
# Into how many pieces the way from a state to a neighbour is cut where it cannot be gone at once.
_PIECES = 16
# Rows of the scratch arrays.
_TRIAL, _HERE, _NEXT, _START = range(4)
_TARGET, _BETWEEN = range(2)
# States that are moved in one call of compiled code, and that are settled.
_MOVED_AT_ONCE, _SETTLED_AT_ONCE = 256, 1 << 14


class Charted(NamedTuple):
    """What is charted."""

    legs: Array
    load: Array  # (d,)
    rho_max: float
    rasters: Rasters


class Problem(NamedTuple):
    """What is charted, and scratch space."""

    legs: Array
    load: Array
    rho_max: float
    rasters: Rasters
    line: Tracer
    work: Workspace
    x: Array  # (4, size)
    inputs: Array  # (4, legs)
    point: Array  # (2, d)


class Pool(NamedTuple):
    """The states found so far; the first `counts[0]` rows hold them, the first `counts[1]` have been expanded."""

    x: Array  # (capacity, size)
    inputs: Array  # (capacity, legs)
    margin: Array  # (capacity,): stability margin
    cell: Integers  # (capacity,): cells of the inputs first, then those of the poses
    next: Integers  # (capacity,): another state of the same cell
    parent: Integers  # (capacity,): union-find of the branches
    arrived: NDArray[np.uint8]  # (capacity,): bit 2 axis + side is set where the neighbour on that side led here
    first: Integers  # (cells,): a state of the cell
    counts: Integers  # (2,)


@kernel
def _make_problem(charted: Charted) -> Problem:
    leg_count, dof = charted.legs.shape[0], charted.load.shape[0]
    size = 2 * leg_count + dof
    return Problem(
        charted.legs,
        charted.load,
        charted.rho_max,
        charted.rasters,
        make_line(leg_count, size),
        make_workspace(leg_count, size),
        np.zeros((4, size)),
        np.zeros((4, leg_count)),
        np.zeros((2, dof)),
    )


@kernel
def _largest_load(x: Array, leg_count: int) -> float:
    largest = 0.0
    for leg in range(leg_count):
        largest = max(largest, math.hypot(x[2 * leg], x[2 * leg + 1]))
    return largest


@kernel
def move_to_inputs(problem: Problem, x: Array, inputs: Array, target: Array) -> float:
    """Track a stable state to these inputs, in place; return its stability margin there, or -1 where it got lost."""
    load = problem.load
    point = Point(x, inputs, load)
    tracked = track(problem.legs, point, target, load, False, problem.line, problem.work)
    if tracked.event != NONE or tracked.morse_index != 0 or _largest_load(x, inputs.shape[0]) > problem.rho_max**2:
        return -1.0
    return tracked.stability_margin


@kernel
def move_to_pose(problem: Problem, x: Array, inputs: Array, target: Array) -> float:
    """Bring a stable state to this pose, in place; return its stability margin there, or -1 where there is none.

    In one step, or, where the inputs change too fast for that, in small ones.
    """
    start_x, start_inputs = problem.x[_START], problem.inputs[_START]
    start_x[:], start_inputs[:] = x, inputs
    margin = _step_to_pose(problem, x, inputs, target)
    if margin < 0.0:
        x[:], inputs[:] = start_x, start_inputs
        for piece in range(1, _PIECES + 1):
            _set_between(start_x, target, piece / _PIECES, problem.point[_BETWEEN])
            margin = _step_to_pose(problem, x, inputs, problem.point[_BETWEEN])
            if margin < 0.0:
                break
    x[2 * inputs.shape[0] :] = target
    return margin


@kernel
def _step_to_pose(problem: Problem, x: Array, inputs: Array, target: Array) -> float:
    legs, work, leg_count = problem.legs, problem.work, inputs.shape[0]
    x[2 * leg_count :] = target
    if solve_inverse_locally(legs, inputs, problem.load, x, _INVERSE_RULES, work) != CONVERGED:
        return -1.0
    for leg in range(leg_count):
        if not legs[leg, LOWER] <= inputs[leg] <= legs[leg, UPPER]:
            return -1.0
    if _largest_load(x, leg_count) > problem.rho_max**2:
        return -1.0
    place(legs, x, inputs, work)
    verdict = assess_stability(legs, x, work)
    return verdict.stability_margin if verdict.morse_index == 0 else -1.0


@kernel
def _set_between(x: Array, target: Array, part: float, point: Array) -> None:
    """Fill `point` with the pose at this part of the way from the pose in `x` to the target, the short way round."""
    dof = target.shape[0]
    for d in range(dof):
        start = x[x.shape[0] - dof + d]
        way = target[d] - start
        if d == 2:
            way -= 2.0 * math.pi * round(way / (2.0 * math.pi))
        point[d] = start + part * way


@kernel
def _move(problem: Problem, space: int, x: Array, inputs: Array, cell: int) -> float:
    target = problem.point[_TARGET]
    set_node(problem.rasters, space, cell, target)
    if space == INPUTS:
        for leg in range(inputs.shape[0]):
            if problem.rasters.is_closed[INPUTS, leg]:  # from one limit to the other, a turn away
                inputs[leg] -= 2.0 * math.pi * round((inputs[leg] - target[leg]) / (2.0 * math.pi))
        return move_to_inputs(problem, x, inputs, target)
    return move_to_pose(problem, x, inputs, target)


@kernel
def _input_gap(inputs: Array, other: Array) -> float:
    gap = 0.0
    for leg in range(inputs.shape[0]):
        gap = max(gap, abs(inputs[leg] - other[leg]))
    return gap


@kernel
def _place(pool: Pool, cell: int, x: Array, inputs: Array, margin: float) -> int:
    """Return the state of the pool that is this one at this cell, a new one if need be."""
    state = pool.first[cell]
    while state != NOWHERE:
        if are_same(x, pool.x[state], inputs.shape[0]) and _input_gap(inputs, pool.inputs[state]) <= SAME_STATE:
            return int(state)
        state = pool.next[state]
    state = pool.counts[0]
    pool.counts[0] += 1
    pool.x[state], pool.inputs[state], pool.margin[state] = x, inputs, margin
    pool.cell[state], pool.next[state], pool.parent[state], pool.arrived[state] = cell, pool.first[cell], state, 0
    pool.first[cell] = state
    return int(state)


@kernel
def find_root(parent: Integers, state: int) -> int:
    """Return the representative of a state's branch."""
    while parent[state] != state:
        parent[state] = parent[parent[state]]
        state = parent[state]
    return state


@kernel
def _is_tracked(problem: Problem, pool: Pool, state: int, other: int, pieces: int) -> bool:
    """Return whether a stable path leads from one state to the other: straight in the pose, piecewise in the inputs."""
    leg_count, pose = problem.legs.shape[0], 2 * problem.legs.shape[0]
    x, inputs = problem.x[_HERE], problem.inputs[_HERE]
    next_x, next_inputs = problem.x[_NEXT], problem.inputs[_NEXT]
    x[:], inputs[:] = pool.x[state], pool.inputs[state]
    for piece in range(1, pieces + 1):
        if piece == pieces:
            next_x[:], next_inputs[:] = pool.x[other], pool.inputs[other]
        else:
            next_x[:], next_inputs[:] = x, inputs
            _set_between(pool.x[state], pool.x[other, pose:], piece / pieces, problem.point[_TARGET])
            if move_to_pose(problem, next_x, next_inputs, problem.point[_TARGET]) < 0.0:
                return False
        if move_to_inputs(problem, x, inputs, next_inputs) < 0.0 or not are_same(x, next_x, leg_count):
            return False
        x[:], inputs[:] = next_x, next_inputs
    return True


@kernel
def _join(problem: Problem, pool: Pool, state: int, other: int, is_tracked: bool) -> None:
    """Give two states one branch if that is proven already, or proves true."""
    root, other_root = find_root(pool.parent, state), find_root(pool.parent, other)
    if root == other_root:
        return
    if not is_tracked:
        for pieces in (1, _PIECES):
            if _is_tracked(problem, pool, state, other, pieces):
                is_tracked = True
                break
    if is_tracked:
        pool.parent[max(root, other_root)] = min(root, other_root)


@kernel
def _reach(problem: Problem, pool: Pool, state: int, space: int, cell: int) -> int:
    """Return the state of the pool to which a move from `state` to this cell leads; -1 if there is none."""
    x, inputs = problem.x[_TRIAL], problem.inputs[_TRIAL]
    x[:], inputs[:] = pool.x[state], pool.inputs[state]
    margin = _move(problem, space, x, inputs, cell)
    if margin < 0.0:
        return NOWHERE
    offset = 0 if space == INPUTS else cell_count(problem.rasters, INPUTS)
    return _place(pool, offset + cell, x, inputs, margin)


@kernel
def _expand(problem: Problem, pool: Pool, state: int) -> None:
    rasters, dof = problem.rasters, problem.load.shape[0]
    input_cells = cell_count(rasters, INPUTS)
    space = INPUTS if pool.cell[state] < input_cells else POSES
    cell = pool.cell[state] if space == INPUTS else pool.cell[state] - input_cells
    for direction in range(2 * dof):
        if (pool.arrived[state] >> direction) & 1:
            continue
        beside = neighbour(rasters, space, cell, direction // 2, direction % 2)
        other = _reach(problem, pool, state, space, beside) if beside != NOWHERE else NOWHERE
        if other != NOWHERE:
            pool.arrived[other] |= 1 << (direction ^ 1)
            axis = direction // 2
            way = abs(pool.inputs[other, axis] - pool.inputs[state, axis])
            if space == POSES or way < math.pi:  # else a limit is between them
                _join(problem, pool, state, other, space == INPUTS)
    if space == INPUTS:
        beside = nearest_cell(rasters, POSES, pool.x[state, 2 * problem.legs.shape[0] :])
    else:
        beside = nearest_cell(rasters, INPUTS, pool.inputs[state])
    other = _reach(problem, pool, state, 1 - space, beside) if beside != NOWHERE else NOWHERE
    if other != NOWHERE:
        _join(problem, pool, state, other, space == POSES)


@kernel
def flood(charted: Charted, pool: Pool, most: int) -> None:
    """Expand up to `most` states of the pool; it must have room for 2 d + 1 new ones from each."""
    problem = _make_problem(charted)
    for _ in range(most):
        if pool.counts[1] == pool.counts[0]:
            return
        _expand(problem, pool, pool.counts[1])
        pool.counts[1] += 1


@kernel
def plant(charted: Charted, pool: Pool, seed_x: Array, seed_inputs: Array) -> int:
    """Enter a stable equilibrium at the nearest node of each raster; return a state of the pool, or -1.

    The pool must have room for two states.
    """
    problem, planted, leg_count = _make_problem(charted), NOWHERE, seed_inputs.shape[0]
    x, inputs = problem.x[_TRIAL], problem.inputs[_TRIAL]
    for space in (POSES, INPUTS):
        cell = nearest_cell(problem.rasters, space, seed_inputs if space == INPUTS else seed_x[2 * leg_count :])
        if cell == NOWHERE:
            continue
        x[:], inputs[:] = seed_x, seed_inputs
        margin = _move(problem, space, x, inputs, cell)
        if margin >= 0.0:
            offset = 0 if space == INPUTS else cell_count(problem.rasters, INPUTS)
            planted = _place(pool, offset + cell, x, inputs, margin)
    return planted


def settle(legs: Array, load: Array, pool: Pool) -> Array:
    """Point every state straight at the representative of its branch; return the energies of the states (n,)."""
    energies = np.empty(pool.counts[0])
    for first, last in slices(len(energies), _SETTLED_AT_ONCE):
        _settle(legs, load, pool, first, energies[first:last])
    return energies


@kernel
def _settle(legs: Array, load: Array, pool: Pool, first: int, energies: Array) -> None:
    for n in range(energies.shape[0]):
        state = first + n
        pool.parent[state] = find_root(pool.parent, state)
        energies[n] = total_energy(legs, pool.x[state], load)


def move_all(charted: Charted, space: int, x: Array, inputs: Array, targets: Array) -> Array:
    """Move states (n, size) in place to inputs or poses (n, d); return their margins, -1 where one got lost."""
    margins = np.empty(len(x))
    for first, last in slices(len(x), _MOVED_AT_ONCE):
        rows = slice(first, last)
        _move_some(charted, space, x[rows], inputs[rows], targets[rows], margins[rows])
    return margins


@kernel
def _move_some(charted: Charted, space: int, x: Array, inputs: Array, targets: Array, margins: Array) -> None:
    problem = _make_problem(charted)
    for n in range(x.shape[0]):
        if space == INPUTS:
            margins[n] = move_to_inputs(problem, x[n], inputs[n], targets[n])
        else:
            margins[n] = move_to_pose(problem, x[n], inputs[n], targets[n])


def mark_first(x: Array, inputs: Array) -> Mask:
    """Return which states (n, size) are not the same as one before them."""
    is_first = np.ones(len(x), dtype=np.bool_)
    _mark_others(x, inputs, is_first)
    return is_first


@kernel
def _mark_others(x: Array, inputs: Array, is_first: Mask) -> None:
    for n in range(x.shape[0]):
        for other in range(n):
            if are_same(x[n], x[other], inputs.shape[1]) and _input_gap(inputs[n], inputs[other]) <= SAME_STATE:
                is_first[n] = False
                break
