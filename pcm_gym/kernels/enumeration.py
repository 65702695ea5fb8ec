"""Every equilibrium of a mechanism, at given inputs or at a given pose, by a join of bounding-volume hierarchies.

An equilibrium of the mechanism is one point on the surface of what each leg offers (see `cells`), such that closure
and the balance of forces hold. The legs' trees of cells are searched together: a combination of nodes, one of each leg,
that cannot meet is dropped with all its cells. What remains is polished by Newton's method.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pcm_gym.kernels.cells import (
    ACROSS,
    ALONG,
    CENTER,
    FORCE_X,
    FORCE_Y,
    HIGH,
    LOW,
    MOMENT,
    OFFERS,
    REMAINDER,
    TIP_X,
    TIP_Y,
    UnitRod,
    cell_of_leaf,
    fill_tree,
    grid_load,
    hinge,
    node_offset,
    reaching_input,
    set_forward_offers,
    set_inverse_offers,
    spread,
)
from pcm_gym.kernels.closure import (
    ATTACH_X,
    ATTACH_Y,
    LENGTH,
    TURN,
    Workspace,
    evaluate_rods,
    make_workspace,
    set_inputs,
    solve_equilibrium_system,
)
from pcm_gym.kernels.compilation import kernel
from pcm_gym.kernels.linear import eliminate
from pcm_gym.kernels.newton import (
    CONVERGED,
    NewtonRules,
    correction_size,
    solve_forward_locally,
    solve_inverse_locally,
)
from pcm_gym.kernels.rod import rod
from pcm_gym.kernels.stability import assess_stability

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

# Rows of what the join has to meet; the span between legs i and j is in column i + j - 1.
_LOAD, _ARMS, _SPANS = range(3)

# From this level on, combinations are tested by the linear system of their models as well as by their bounds.
_LINEAR_TEST_LEVEL = 5

# Near a fold Newton's method halves the error at best, and the correction never falls below the noise.
POLISH_RULES = NewtonRules(first_correction=np.inf, contraction=1e3, iterations=40, residual=2e-15)
# Local coordinates of the starts near a cell's corners.
_CORNER = 0.6
# States nearer than the first are one; states nearer than the second are one if they have the same index.
_SAME_STATE, _SAME_BRANCH = 1e-10, 1e-6
# Below this singularity margin an equilibrium may have a partner across a fold, from this distance on.
_NEAR_FOLD, _LEAST_PARTNER_DISTANCE = 2.0, 1e-8


class Found(NamedTuple):
    """The equilibria found so far."""

    x: Array  # (m, size)
    inputs: Array  # (m, legs)
    indices: Integers  # (m,): Morse indices


@kernel
def _may_meet(bounds: Array, nodes: Integers, search: Array, is_inverse: bool) -> bool:
    """Return whether the bounds of these nodes, one node per leg, allow an equilibrium below them."""
    leg_count = nodes.shape[0]
    if leg_count == 2 and not is_inverse and not _may_touch(bounds, nodes):
        return False
    for k in range(FORCE_X, FORCE_Y + 1):
        low = high = 0.0
        for leg in range(leg_count):
            low += bounds[leg, nodes[leg], k, LOW]
            high += bounds[leg, nodes[leg], k, HIGH]
        if not low <= search[_LOAD, k - FORCE_X] <= high:
            return False
    if leg_count == 2:
        return True
    if is_inverse:
        return _moments_may_balance(bounds, nodes, search, is_inverse)
    for leg in range(leg_count):
        if not _may_span(bounds, nodes, leg, (leg + 1) % leg_count, search):
            return False
    return _moments_may_balance(bounds, nodes, search, is_inverse)


@kernel
def _may_touch(bounds: Array, nodes: Integers) -> bool:
    for k in range(TIP_X, TIP_Y + 1):
        if (
            bounds[0, nodes[0], k, LOW] > bounds[1, nodes[1], k, HIGH]
            or bounds[1, nodes[1], k, LOW] > bounds[0, nodes[0], k, HIGH]
        ):
            return False
    return True


@kernel
def _may_span(bounds: Array, nodes: Integers, leg: int, other: int, search: Array) -> bool:
    least = most = 0.0
    for k in range(TIP_X, TIP_Y + 1):
        below = bounds[leg, nodes[leg], k, LOW] - bounds[other, nodes[other], k, HIGH]
        above = bounds[leg, nodes[leg], k, HIGH] - bounds[other, nodes[other], k, LOW]
        nearest, farthest = max(below, -above, 0.0), max(above, -below)
        least += nearest * nearest
        most += farthest * farthest
    return bool(least <= search[_SPANS, leg + other - 1] ** 2 <= most)


@kernel
def _moments_may_balance(bounds: Array, nodes: Integers, search: Array, is_inverse: bool) -> bool:
    """Return whether the moments may sum to that of the load, about the world's origin in the forward problem."""
    low = high = 0.0
    for leg in range(nodes.shape[0]):
        low += bounds[leg, nodes[leg], MOMENT, LOW]
        high += bounds[leg, nodes[leg], MOMENT, HIGH]
    if not is_inverse:
        force_x, force_y = search[_LOAD, 0], search[_LOAD, 1]
        for k, force in ((TIP_X, force_y), (TIP_Y, -force_x)):
            first = force * (bounds[0, nodes[0], k, LOW] - search[_ARMS, 0])
            second = force * (bounds[0, nodes[0], k, HIGH] + search[_ARMS, 0])
            low -= max(first, second)
            high -= min(first, second)
    return bool(low <= search[_LOAD, 2] <= high)


@kernel
def _may_meet_linearly(tree: Array, nodes: Integers, search: Array, is_inverse: bool, test: Array) -> bool:
    """Return whether the affine models of these nodes, with their remainders, allow an equilibrium below them.

    With the system's inverse Y, a meeting point's local coordinates are within |Y| remainder of Y times the values at
    the centres; outside [-1, 1] there is none. Near a fold Y is large and nothing is dropped. The next to last column
    of `test` is left with the coordinates without remainder.
    """
    leg_count = nodes.shape[0]
    size = 2 * leg_count
    test[:] = 0.0
    row = 0
    for k in range(FORCE_X, FORCE_Y + 1):
        test[row, 2 * size] = -search[_LOAD, k - FORCE_X]
        for leg in range(leg_count):
            _add_offer(tree, nodes, leg, k, 1.0, row, test)
        row += 1
    if is_inverse:
        for leg in range(leg_count):
            _add_offer(tree, nodes, leg, TIP_X, 1.0, row, test)
            row += 1
    elif leg_count == 2:
        for k in range(TIP_X, TIP_Y + 1):
            _add_offer(tree, nodes, 0, k, 1.0, row, test)
            _add_offer(tree, nodes, 1, k, -1.0, row, test)
            row += 1
    else:
        for leg in range(leg_count):
            _add_span(tree, nodes, leg, (leg + 1) % leg_count, search, row, test)
            row += 1
    if leg_count == 3:
        _add_moments(tree, nodes, search, is_inverse, row, test)
    return _system_may_vanish(size, test)


@kernel
def _add_offer(tree: Array, nodes: Integers, leg: int, k: int, factor: float, row: int, test: Array) -> None:
    node = nodes[leg]
    test[row, 2 * leg] += factor * tree[leg, node, k, ALONG]
    test[row, 2 * leg + 1] += factor * tree[leg, node, k, ACROSS]
    test[row, 4 * nodes.shape[0]] += factor * tree[leg, node, k, CENTER]
    test[row, -1] += abs(factor) * tree[leg, node, k, REMAINDER]


@kernel
def _add_span(tree: Array, nodes: Integers, leg: int, other: int, search: Array, row: int, test: Array) -> None:
    """Add the equation |difference of tips|^2 = span^2, its quadratic part bounded."""
    size = 4 * nodes.shape[0]
    for k in range(TIP_X, TIP_Y + 1):
        gap = tree[leg, nodes[leg], k, CENTER] - tree[other, nodes[other], k, CENTER]
        _add_offer(tree, nodes, leg, k, 2.0 * gap, row, test)
        _add_offer(tree, nodes, other, k, -2.0 * gap, row, test)
        test[row, size] -= gap * gap
        swing = spread(tree[leg, nodes[leg], k]) + spread(tree[other, nodes[other], k])
        test[row, -1] += swing * swing
    test[row, size] -= search[_SPANS, leg + other - 1] ** 2


@kernel
def _add_moments(tree: Array, nodes: Integers, search: Array, is_inverse: bool, row: int, test: Array) -> None:
    test[row, 4 * nodes.shape[0]] -= search[_LOAD, 2]
    for leg in range(nodes.shape[0]):
        _add_offer(tree, nodes, leg, MOMENT, 1.0, row, test)
    if not is_inverse:  # the load acts at the origin of the platform, an arm away from the first hinge
        _add_offer(tree, nodes, 0, TIP_X, -search[_LOAD, 1], row, test)
        _add_offer(tree, nodes, 0, TIP_Y, search[_LOAD, 0], row, test)
        test[row, -1] += search[_ARMS, 0] * (abs(search[_LOAD, 0]) + abs(search[_LOAD, 1]))


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


@kernel
def join(
    levels: int, tree: Array, bounds: Array, search: Array, is_inverse: bool, combinations: Integers, starts: Array
) -> int:
    """Find the combinations of cells, one leaf per leg, that may meet; return how many there are.

    They are put into `combinations` (m, legs), and the local coordinates where their models meet, cut to the cells,
    into `starts` (m, 2 legs). If there are more than fit, only one more than fit is counted.
    """
    leg_count = combinations.shape[1]
    size = 2 * leg_count
    test = np.empty((size, 2 * size + 2))
    stack = np.empty((8 * leg_count * (levels + 1) + 2**leg_count, leg_count + 1), dtype=np.int64)
    nodes = np.empty(leg_count, dtype=np.int64)
    top = 0
    for start in range(2**leg_count):
        for leg in range(leg_count):
            stack[top, leg] = (start >> leg) & 1
        stack[top, leg_count] = 0
        top += 1
    count = 0
    while top > 0:
        top -= 1
        depth = stack[top, leg_count]
        split, level = depth % leg_count, depth // leg_count
        for leg in range(leg_count):
            nodes[leg] = stack[top, leg] + node_offset(level + 1 if leg < split else level)
        if level >= _LINEAR_TEST_LEVEL and not _may_meet_linearly(tree, nodes, search, is_inverse, test):
            continue
        if level == levels:
            if count == combinations.shape[0]:
                return count + 1
            combinations[count] = stack[top, :leg_count]
            for k in range(size):
                starts[count, k] = min(max(test[k, 2 * size], -1.0), 1.0)
            count += 1
            continue
        parent = stack[top, split]
        for child in range(4 * parent, 4 * parent + 4):
            nodes[split] = child + node_offset(level + 1)
            if _may_meet(bounds, nodes, search, is_inverse):
                for leg in range(leg_count):
                    stack[top, leg] = nodes[leg] - node_offset(level + 1 if leg <= split else level)
                stack[top, leg_count] = depth + 1
                top += 1
    return count


@kernel
def make_search(legs: Array, load: Array) -> Array:
    """Return what the join has to meet (3, 3): load, hinges' distances from the origin, and from each other."""
    search = np.zeros((3, 3))
    search[_LOAD, : load.shape[0]] = load
    for leg in range(legs.shape[0]):
        search[_ARMS, leg] = math.hypot(legs[leg, ATTACH_X], legs[leg, ATTACH_Y])
        for other in range(leg):
            search[_SPANS, leg + other - 1] = math.hypot(
                legs[leg, ATTACH_X] - legs[other, ATTACH_X], legs[leg, ATTACH_Y] - legs[other, ATTACH_Y]
            )
    return search


@kernel
def find_combinations(
    legs: Array,
    inputs: Array,
    pose: Array,
    load: Array,
    is_inverse: bool,
    unit: UnitRod,
    combinations: Integers,
    starts: Array,
) -> int:
    """Find the combinations of cells that may hold an equilibrium; return how many there are (see `join`)."""
    leg_count, count = legs.shape[0], 2**unit.levels
    work = make_workspace(leg_count, 2 * leg_count + pose.shape[0])
    set_inputs(legs, inputs, work)
    offers = np.empty((2, count + 1, count + 1, OFFERS))
    search = make_search(legs, load)
    tree = np.empty((leg_count, node_offset(unit.levels + 1), OFFERS, 4))
    bounds = np.empty((leg_count, node_offset(unit.levels + 1), OFFERS, 2))
    for leg in range(leg_count):
        if is_inverse:
            set_inverse_offers(legs, leg, pose, unit, offers)
        else:
            set_forward_offers(legs, leg, unit, work, offers)
        fill_tree(unit.levels, offers, is_inverse, search[_ARMS, leg], leg, tree, bounds)
    return join(unit.levels, tree, bounds, search, is_inverse, combinations, starts)


@kernel
def _set_start_rods(combination: Integers, start: Array, unit: UnitRod, x: Array) -> None:
    count = 2**unit.levels
    for leg in range(combination.shape[0]):
        side, i, j = cell_of_leaf(combination[leg], unit.levels)
        rho = unit.rho_max * (i + 0.5 + 0.5 * start[2 * leg]) / count
        x[2 * leg], x[2 * leg + 1] = grid_load(rho, (j + 0.5 + 0.5 * start[2 * leg + 1]) / count, side)


@kernel
def set_pose_from_tips(legs: Array, x: Array, work: Workspace) -> None:
    """Fit the pose in `x` to the tips of its rods, least squares."""
    leg_count = legs.shape[0]
    pose = 2 * leg_count
    mean_x = mean_y = mean_arm_x = mean_arm_y = 0.0
    for leg in range(leg_count):
        point = rod(x[2 * leg], x[2 * leg + 1])
        c, s = legs[leg, LENGTH] * work.clamps[leg, 2], legs[leg, LENGTH] * work.clamps[leg, 3]
        work.rods[leg, 0] = work.clamps[leg, 0] + c * point.tip_x - s * point.tip_y
        work.rods[leg, 1] = work.clamps[leg, 1] + s * point.tip_x + c * point.tip_y
        mean_x += work.rods[leg, 0] / leg_count
        mean_y += work.rods[leg, 1] / leg_count
        mean_arm_x += legs[leg, ATTACH_X] / leg_count
        mean_arm_y += legs[leg, ATTACH_Y] / leg_count
    c, s = 1.0, 0.0
    if x.shape[0] - pose == 3:
        dot = cross = 0.0
        for leg in range(leg_count):
            arm_x, arm_y = legs[leg, ATTACH_X] - mean_arm_x, legs[leg, ATTACH_Y] - mean_arm_y
            tip_x, tip_y = work.rods[leg, 0] - mean_x, work.rods[leg, 1] - mean_y
            dot += arm_x * tip_x + arm_y * tip_y
            cross += arm_x * tip_y - arm_y * tip_x
        phi = math.atan2(cross, dot)
        x[pose + 2] = phi
        c, s = math.cos(phi), math.sin(phi)
    x[pose] = mean_x - c * mean_arm_x + s * mean_arm_y
    x[pose + 1] = mean_y - s * mean_arm_x - c * mean_arm_y


@kernel
def polish_forward(
    legs: Array, inputs: Array, load: Array, unit: UnitRod, combinations: Integers, starts: Array, found: Found
) -> int:
    """Correct the starts in these cells to equilibria; put the different ones into `found`, return how many."""
    work = make_workspace(legs.shape[0], found.x.shape[1])
    x = np.empty(found.x.shape[1])
    count = 0
    for n in range(combinations.shape[0]):
        set_inputs(legs, inputs, work)
        _set_start_rods(combinations[n], starts[n], unit, x)
        set_pose_from_tips(legs, x, work)
        if solve_forward_locally(legs, inputs, load, x, POLISH_RULES, work) == CONVERGED:
            count = _keep(legs, x, inputs, unit.rho_max, work, found, count)
    for n in range(count):
        count = _look_across_fold(legs, inputs, load, unit.rho_max, n, work, found, count)
    return count


@kernel
def _look_across_fold(
    legs: Array, inputs: Array, load: Array, rho_max: float, n: int, work: Workspace, found: Found, count: int
) -> int:
    """Look for the partner of an equilibrium near a fold, along the direction in which the mechanism is softest."""
    x, size = found.x[n].copy(), found.x.shape[1]
    set_inputs(legs, inputs, work)
    evaluate_rods(legs, x, work)
    if assess_stability(legs, x, work).singularity_margin > _NEAR_FOLD:
        return count
    for row in range(size):
        work.residual[row] = 1.0 / (1.0 + row)
    if not solve_equilibrium_system(legs, x, work.residual, work):
        return count
    direction = work.step / max(correction_size(legs, x, work), 1e-300)
    distance = _LEAST_PARTNER_DISTANCE
    while distance < 0.3:
        for sign in (-1.0, 1.0):
            trial = x + sign * distance * direction
            if solve_forward_locally(legs, inputs, load, trial, POLISH_RULES, work) == CONVERGED:
                count = _keep(legs, trial, inputs, rho_max, work, found, count)
        distance *= 3.0
    return count


@kernel
def polish_inverse(
    legs: Array, pose: Array, load: Array, unit: UnitRod, combinations: Integers, starts: Array, found: Found
) -> int:
    """Correct the starts in these cells to equilibria at `pose`; put the different ones into `found`."""
    leg_count = legs.shape[0]
    work = make_workspace(leg_count, found.x.shape[1])
    x, inputs = np.empty(found.x.shape[1]), np.empty(leg_count)
    count = 0
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
            if solve_inverse_locally(legs, inputs, load, x, POLISH_RULES, work) != CONVERGED:
                continue
            for leg in range(leg_count):
                if legs[leg, TURN] != 0.0:
                    inputs[leg] = _principal_angle(inputs[leg])
            count = _keep(legs, x, inputs, unit.rho_max, work, found, count)
    return count


@kernel
def _principal_angle(angle: float) -> float:
    """Return the angle in (-pi, pi]."""
    turned = angle - 2.0 * math.pi * math.ceil((angle - math.pi) / (2.0 * math.pi))
    return math.pi if turned <= -math.pi else turned


@kernel
def _keep(legs: Array, x: Array, inputs: Array, rho_max: float, work: Workspace, found: Found, count: int) -> int:
    """Add an equilibrium to those found if its loads are in range, there is room, and it is new; return their number.

    The platform's angle is brought into (-pi, pi]. Equilibria of different index are two however near they are: they
    meet at a fold.
    """
    for leg in range(legs.shape[0]):
        if math.hypot(x[2 * leg], x[2 * leg + 1]) > rho_max * rho_max:
            return count
    if count == found.x.shape[0]:
        return count
    if x.shape[0] - 2 * legs.shape[0] == 3:
        x[-1] = _principal_angle(x[-1])
    set_inputs(legs, inputs, work)
    evaluate_rods(legs, x, work)
    index = assess_stability(legs, x, work).morse_index
    last = x.shape[0] - 1
    for n in range(count):
        turn = 0.0  # that brings the platform's angle to this side of its seam
        if last - 2 * legs.shape[0] == 2:
            turn = 2.0 * math.pi * round((found.x[n, last] - x[last]) / (2.0 * math.pi))
        x[last] += turn
        gap = max(_gap(found.x[n], x), _gap(found.inputs[n], inputs))
        x[last] -= turn
        if gap < _SAME_STATE or (gap < _SAME_BRANCH and found.indices[n] == index):
            return count
    found.x[count], found.inputs[count], found.indices[count] = x, inputs, index
    return count + 1


@kernel
def _gap(first: Array, second: Array) -> float:
    gap = 0.0
    for j in range(first.shape[0]):
        gap = max(gap, abs(first[j] - second[j]) / (1.0 + abs(first[j])))
    return gap
