"""Every set of inputs with its equilibria at a given pose, by a join of bounding-volume hierarchies.

At a pose an equilibrium of the mechanism is one point on the surface of what each leg offers (see `cells`), such that
every leg closes and the forces balance. The legs' trees of cells are searched together: a combination of nodes, one of
each leg, that cannot meet is dropped with all its cells. What remains is polished by Newton's method.
"""

import math
from typing import NamedTuple

import numpy as np

from pcm_gym.arrays import Array, Integers
from pcm_gym.kernels.enumeration.cells import (
    ACROSS,
    ALONG,
    CENTER,
    FORCE_X,
    HIGH,
    LOW,
    MISS,
    OFFERS,
    REMAINDER,
    UnitRod,
    cell_of_leaf,
    fill_tree,
    grid_load,
    hinge,
    node_offset,
    reaching_input,
    set_offers,
)
from pcm_gym.kernels.enumeration.found import FOUND, POLISH_RULES, SPENT, SPENT_AT_ONCE, Found, correct_and_keep
from pcm_gym.kernels.numerics.compilation import kernel
from pcm_gym.kernels.numerics.linear import eliminate
from pcm_gym.kernels.rods.rod import rod
from pcm_gym.kernels.statics.closure import ATTACH_X, ATTACH_Y, make_workspace

# From this level on, combinations are tested by the linear system of their models as well as by their bounds.
_LINEAR_TEST_LEVEL = 5
# What a linear test takes, in tests of bounds.
_LINEAR_TEST_COST = 4

# Local coordinates of the starts near a cell's corners.
_CORNER = 0.6


@kernel
def _may_meet(bounds: Array, nodes: Integers, load: Array) -> bool:
    """Return whether the bounds of these nodes, one node per leg, allow an equilibrium below them."""
    for d in range(load.shape[0]):
        low = high = 0.0
        for leg in range(nodes.shape[0]):
            low += bounds[leg, nodes[leg], FORCE_X + d, LOW]
            high += bounds[leg, nodes[leg], FORCE_X + d, HIGH]
        if not low <= load[d] <= high:
            return False
    return True


@kernel
def _may_meet_linearly(tree: Array, nodes: Integers, load: Array, test: Array) -> bool:
    """Return whether the affine models of these nodes, with their remainders, allow an equilibrium below them.

    With the system's inverse Y, a meeting point's local coordinates are within |Y| remainder of Y times the values at
    the centres; outside [-1, 1] there is none. Near a fold Y is large and nothing is dropped. The next to last column
    of `test` is left with the coordinates without remainder.
    """
    leg_count, dof = nodes.shape[0], load.shape[0]
    test[:] = 0.0
    for d in range(dof):
        test[d, 4 * leg_count] = -load[d]
        for leg in range(leg_count):
            _add_offer(tree, nodes, leg, FORCE_X + d, d, test)
    for leg in range(leg_count):
        _add_offer(tree, nodes, leg, MISS, dof + leg, test)
    return _system_may_vanish(2 * leg_count, test)


@kernel
def _add_offer(tree: Array, nodes: Integers, leg: int, k: int, row: int, test: Array) -> None:
    node = nodes[leg]
    test[row, 2 * leg] = tree[leg, node, k, ALONG]
    test[row, 2 * leg + 1] = tree[leg, node, k, ACROSS]
    test[row, 4 * nodes.shape[0]] += tree[leg, node, k, CENTER]
    test[row, -1] += tree[leg, node, k, REMAINDER]


@kernel
def _system_may_vanish(size: int, test: Array) -> bool:
    """Solve the system and compare its solution, with what the remainders may change, with [-1, 1].

    `test` (n, 2 n + 2) holds the matrix, space for the inverse, the values at the centres, and the remainders.
    """
    for row in range(size):
        test[row, size + row] = 1.0
    if not eliminate(test, size, 2 * size + 1):
        test[:, 2 * size] = 0.0
        return True
    may_vanish = True
    for row in range(size):
        test[row, 2 * size] = -test[row, 2 * size]
        reach = 1.0
        for k in range(size):
            reach += abs(test[row, size + k]) * test[k, -1]
        may_vanish = may_vanish and abs(test[row, 2 * size]) <= reach
    return may_vanish


class Forest(NamedTuple):
    """The legs' trees of cells, and the combinations of their nodes that are still to be examined."""

    levels: int
    models: Array  # (legs, nodes, offers, 4); see `cells`
    bounds: Array  # (legs, nodes, offers, 2)
    stack: Integers  # (m, legs + 1): a node of each leg, and the depth
    height: Integers  # (1,): how many combinations are on the stack


def make_forest(levels: int, leg_count: int) -> Forest:
    """Return room for the trees of so many legs, and their roots on the stack."""
    nodes, depth = node_offset(levels + 1), 8 * leg_count * (levels + 1)
    stack = np.zeros((depth + 2**leg_count, leg_count + 1), dtype=np.int64)
    for start in range(2**leg_count):
        stack[start, :leg_count] = (start >> np.arange(leg_count)) & 1
    models, bounds = np.empty((leg_count, nodes, OFFERS, 4)), np.empty((leg_count, nodes, OFFERS, 2))
    return Forest(levels, models, bounds, stack, np.array([2**leg_count]))


@kernel
def plant_tree(legs: Array, leg: int, pose: Array, unit: UnitRod, forest: Forest) -> None:
    """Fill the tree of one leg: what it offers at this pose."""
    count = 2**unit.levels
    offers = np.empty((2, count + 1, count + 1, OFFERS))
    set_offers(legs, leg, pose, unit, offers)
    arm = math.hypot(legs[leg, ATTACH_X], legs[leg, ATTACH_Y])
    fill_tree(unit.levels, offers, arm, leg, forest.models, forest.bounds)


@kernel
def join(forest: Forest, load: Array, place: Integers, combinations: Integers, starts: Array) -> bool:
    """Find combinations of cells, one leaf per leg, that may hold an equilibrium; return whether more are to come.

    They are put into `combinations` (m, legs), and the local coordinates where their models meet, cut to the cells,
    into `starts` (m, 2 legs). A call does a slice of the work; it leaves in `place` (2,) how many it has found, and how
    much it has spent.
    """
    levels, tree, bounds, stack = forest.levels, forest.models, forest.bounds, forest.stack
    leg_count = combinations.shape[1]
    size = 2 * leg_count
    test = np.empty((size, 2 * size + 2))
    nodes = np.empty(leg_count, dtype=np.int64)
    top, count, spent = forest.height[0], 0, 0
    while top > 0 and count < combinations.shape[0] and spent < SPENT_AT_ONCE:
        top -= 1
        depth = stack[top, leg_count]
        split, level = depth % leg_count, depth // leg_count
        for leg in range(leg_count):
            nodes[leg] = stack[top, leg] + node_offset(level + 1 if leg < split else level)
        spent += 1
        if level >= _LINEAR_TEST_LEVEL:
            spent += _LINEAR_TEST_COST
            if not _may_meet_linearly(tree, nodes, load, test):
                continue
        if level == levels:
            combinations[count] = stack[top, :leg_count]
            for k in range(size):
                starts[count, k] = min(max(test[k, 2 * size], -1.0), 1.0)
            count += 1
            continue
        parent = stack[top, split]
        for child in range(4 * parent, 4 * parent + 4):
            nodes[split] = child + node_offset(level + 1)
            if _may_meet(bounds, nodes, load):
                for leg in range(leg_count):
                    stack[top, leg] = nodes[leg] - node_offset(level + 1 if leg <= split else level)
                stack[top, leg_count] = depth + 1
                top += 1
    forest.height[0], place[FOUND], place[SPENT] = top, count, spent
    return bool(top > 0)


@kernel
def _set_start_rods(combination: Integers, start: Array, unit: UnitRod, x: Array) -> None:
    count = 2**unit.levels
    for leg in range(combination.shape[0]):
        side, i, j = cell_of_leaf(combination[leg], unit.levels)
        rho = unit.rho_max * (i + 0.5 + 0.5 * start[2 * leg]) / count
        x[2 * leg], x[2 * leg + 1] = grid_load(rho, (j + 0.5 + 0.5 * start[2 * leg + 1]) / count, side)


@kernel
def polish_combinations(
    legs: Array, pose: Array, load: Array, unit: UnitRod, combinations: Integers, starts: Array, found: Found
) -> None:
    """Correct the starts in these cells to equilibria at `pose`; put the different ones into `found`."""
    leg_count = legs.shape[0]
    work = make_workspace(leg_count, found.x.shape[1])
    x, inputs = np.empty(found.x.shape[1]), np.empty(leg_count)
    start = np.empty(2 * leg_count)
    for n in range(combinations.shape[0]):
        is_open = not starts[n].any()  # the models could not tell where in the cells: try their corners as well
        for corner in range(-1, 4**leg_count if is_open else 0):
            for k in range(2 * leg_count):
                start[k] = starts[n, k] if corner < 0 else _CORNER * (2.0 * ((corner >> k) & 1) - 1.0)
            _set_start_rods(combinations[n], start, unit, x)
            x[2 * leg_count :] = pose
            for leg in range(leg_count):
                point = rod(x[2 * leg], x[2 * leg + 1])
                hinge_x, hinge_y = hinge(legs, leg, pose)
                inputs[leg] = reaching_input(legs, leg, hinge_x, hinge_y, point.tip_x, point.tip_y)
            correct_and_keep(legs, x, inputs, load, POLISH_RULES, work, found)
