"""What each leg offers to a mechanism at a given pose, over all equilibria of its rod, in cells with affine models.

The equilibria of one rod are a plane, and what a leg offers (by how much it misses its hinge, which force it takes, and
the moment of that) is a smooth surface over it. The surface is cut into cells; what a cell offers is enclosed in an
affine model with a remainder; the cells are gathered in a tree. The unit rod's surface is tabulated once and serves
every rod by scaling and rotation. Cells are graded towards tension (b = 0), where b lives on the scale exp(-rho).
"""

import math
from typing import NamedTuple

import numpy as np

from pcm_gym.arrays import Array
from pcm_gym.kernels.numerics.compilation import kernel
from pcm_gym.kernels.numerics.slices import slices
from pcm_gym.kernels.rods.rod import rod
from pcm_gym.kernels.statics.closure import (
    ATTACH_X,
    ATTACH_Y,
    AXIS_X,
    AXIS_Y,
    BASE_X,
    BASE_Y,
    CLAMP_ANGLE,
    LENGTH,
    STIFFNESS,
    TURN,
)

# What a cell offers.
MISS, REACH, FORCE_X, FORCE_Y, MOMENT = range(5)
OFFERS = 5

# The tree (legs, nodes, offers, columns) holds an affine model of each offer of each cell and node, level by level, the
# children of a node side by side. With local coordinates s, t in [-1, 1] the offer is center + s along + t across,
# within the remainder, and so within its bounds (legs, nodes, offers, 2); low is inf where no cell below can close.
CENTER, ALONG, ACROSS, REMAINDER = range(4)
LOW, HIGH = range(2)

# The remainder of a cell's affine model, as multiples of the second differences: 1/8 would be exact for a parabola.
_BULGE = 0.15
# A cell in which the tip comes nearer to the motor than this part of its own extent is one in which the rod may turn.
_CONE = 1.0
# Weight c of the even part of the grid along b.
_EVENNESS = 3.0
_GRADE_STEPS = 8
# Rods in one call of compiled code.
_RODS_AT_ONCE = 1 << 16


class UnitRod(NamedTuple):
    """The unit rod on the nodes of the grid: [side of b, rho, grade of b]."""

    levels: int  # the grid has 2^levels cells along rho and along b, on either side of b = 0
    rho_max: float
    values: Array  # (2, n + 1, n + 1, 4): tip and force in the clamp's frame


@kernel
def grid_angle(rho: float, grade: float) -> float:
    """Return |b| in [0, pi] at rho and a grade in [0, 1].

    Grades are equal steps of log(1 + b / exp(-rho)) + c b: even, but logarithmic towards tension.
    """
    scale = math.exp(-rho)
    wanted = grade * (math.log1p(math.pi / scale) + _EVENNESS * math.pi)
    b = scale * math.expm1(wanted / (1.0 + _EVENNESS * scale)) if wanted < rho else math.pi * grade
    for _ in range(_GRADE_STEPS):  # Newton's method on a concave function
        b -= (math.log1p(b / scale) + _EVENNESS * b - wanted) / (1.0 / (scale + b) + _EVENNESS)
        b = min(max(b, 0.0), math.pi)
    return b


@kernel
def grid_load(rho: float, grade: float, side: int) -> tuple[float, float]:
    """Return the load g at rho and a grade of |b| (see `grid_angle`); b > 0 on side 0."""
    b = grid_angle(rho, grade)
    sine = math.sin(b) if side == 0 else -math.sin(b)
    return rho * rho * math.cos(b), -rho * rho * sine


def make_unit_rod(levels: int, rho_max: float) -> UnitRod:
    """Return the unit rod tabulated for rho up to `rho_max`."""
    return UnitRod(levels, rho_max, unit_rod_values(levels, rho_max))


def unit_rod_values(levels: int, rho_max: float) -> Array:
    """Return tip and force of the unit rod on the nodes of its grid, (2, n + 1, n + 1, 4); see `UnitRod`."""
    count = 2**levels
    values = np.zeros((2, count + 1, count + 1, 4))
    for first, last in slices(count + 1, max(1, _RODS_AT_ONCE // (2 * count))):
        _fill_values(rho_max, values, first, last)
    return values


@kernel
def _fill_values(rho_max: float, values: Array, first_row: int, last_row: int) -> None:
    count = values.shape[1] - 1
    for side in range(2):
        for i in range(first_row, last_row):
            for j in range(count + 1):
                g_x, g_y = grid_load(rho_max * i / count, j / count, side)
                point = rod(g_x, g_y)
                values[side, i, j, 0], values[side, i, j, 1] = point.tip_x, point.tip_y
                values[side, i, j, 2], values[side, i, j, 3] = point.force_x, point.force_y


@kernel
def node_offset(level: int) -> int:
    """Return where the nodes of a level begin: level 0 has the two sides, each node has four children."""
    return int(2 * (4**level - 1) // 3)


@kernel
def cell_of_leaf(leaf: int, levels: int) -> tuple[int, int, int]:
    """Return side, rho cell and grade cell of a leaf, whose number interleaves the bits of the two."""
    i = j = 0
    for bit in range(levels):
        j |= ((leaf >> (2 * bit)) & 1) << bit
        i |= ((leaf >> (2 * bit + 1)) & 1) << bit
    return leaf >> (2 * levels), i, j


@kernel
def reaching_input(legs: Array, leg: int, hinge_x: float, hinge_y: float, tip_x: float, tip_y: float) -> float:
    """Return the input that brings a rod's tip, clamp's frame, to the hinge, or as near as this actuator can."""
    length = legs[leg, LENGTH]
    away_x, away_y = hinge_x - legs[leg, BASE_X], hinge_y - legs[leg, BASE_Y]
    if legs[leg, TURN] != 0.0:
        return math.atan2(away_y, away_x) - math.atan2(tip_y, tip_x) - float(legs[leg, CLAMP_ANGLE])
    c, s = math.cos(legs[leg, CLAMP_ANGLE]), math.sin(legs[leg, CLAMP_ANGLE])
    gap_x, gap_y = away_x - length * (c * tip_x - s * tip_y), away_y - length * (s * tip_x + c * tip_y)
    return float(legs[leg, AXIS_X] * gap_x + legs[leg, AXIS_Y] * gap_y)


@kernel
def hinge(legs: Array, leg: int, pose: Array) -> tuple[float, float]:
    """Return the hinge of a leg at a pose (2,) or (3,), world frame."""
    c, s = (math.cos(pose[2]), math.sin(pose[2])) if pose.shape[0] == 3 else (1.0, 0.0)
    arm_x = c * legs[leg, ATTACH_X] - s * legs[leg, ATTACH_Y]
    arm_y = s * legs[leg, ATTACH_X] + c * legs[leg, ATTACH_Y]
    return pose[0] + arm_x, pose[1] + arm_y


@kernel
def set_offers(legs: Array, leg: int, pose: Array, unit: UnitRod, offers: Array) -> None:
    """Fill `offers` with what a leg offers when its actuator brings the tip as near to its hinge as it can.

    MISS holds the miss that remains (zero where the leg closes), REACH the distance of the tip from a motor (inf for a
    slider), FORCE and MOMENT the force at that input.
    """
    hinge_x, hinge_y = hinge(legs, leg, pose)
    length = legs[leg, LENGTH]
    force = legs[leg, STIFFNESS] / (length * length)
    away_x, away_y = hinge_x - legs[leg, BASE_X], hinge_y - legs[leg, BASE_Y]
    away = math.hypot(away_x, away_y)
    clamp_c, clamp_s = math.cos(legs[leg, CLAMP_ANGLE]), math.sin(legs[leg, CLAMP_ANGLE])
    for side in range(2):
        for i in range(offers.shape[1]):
            for j in range(offers.shape[2]):
                tip_x, tip_y = unit.values[side, i, j, 0], unit.values[side, i, j, 1]
                force_x, force_y = unit.values[side, i, j, 2], unit.values[side, i, j, 3]
                c, s, reach = clamp_c, clamp_s, math.inf
                if legs[leg, TURN] != 0.0:
                    reach = length * math.hypot(tip_x, tip_y)
                    miss = reach - away
                    scale = length / max(reach * away, 1e-12)
                    c = scale * (tip_x * away_x + tip_y * away_y)
                    s = scale * (tip_x * away_y - tip_y * away_x)
                else:
                    gap_x = away_x - length * (c * tip_x - s * tip_y)
                    gap_y = away_y - length * (s * tip_x + c * tip_y)
                    miss = legs[leg, AXIS_X] * gap_y - legs[leg, AXIS_Y] * gap_x
                out = offers[side, i, j]
                out[MISS], out[REACH] = miss, reach
                out[FORCE_X] = force * (c * force_x - s * force_y)
                out[FORCE_Y] = force * (s * force_x + c * force_y)
                out[MOMENT] = (hinge_x - pose[0]) * out[FORCE_Y] - (hinge_y - pose[1]) * out[FORCE_X]


@kernel
def fill_tree(levels: int, offers: Array, arm: float, leg: int, tree: Array, bounds: Array) -> None:
    """Fill the models of one leg; leave out the cells whose miss cannot vanish.

    `arm` is the distance of the leg's hinge from the end-effector's origin.
    """
    start = node_offset(levels)
    for leaf in range(2 * 4**levels):
        side, i, j = cell_of_leaf(leaf, levels)
        _set_model(offers[side], i, j, 1, leg, start + leaf, tree)
        _set_cell_remainder(offers[side], i, j, tree[leg, start + leaf, :, REMAINDER])
        if _turns_much(offers[side], i, j):
            _allow_all_directions(offers[side], i, j, arm, tree[leg, start + leaf])
        _set_bounds(leg, start + leaf, tree, bounds)
        if not bounds[leg, start + leaf, MISS, LOW] <= 0.0 <= bounds[leg, start + leaf, MISS, HIGH]:
            bounds[leg, start + leaf, :, LOW] = math.inf
            bounds[leg, start + leaf, :, HIGH] = -math.inf
    for level in range(levels - 1, -1, -1):
        start, below = node_offset(level), node_offset(level + 1)
        for node in range(2 * 4**level):
            side, i, j = cell_of_leaf(node, level)
            width = 2 ** (levels - level)
            _set_model(offers[side], i * width, j * width, width, leg, start + node, tree)
            _set_node_remainder(leg, start + node, below + 4 * node, tree, bounds)


@kernel
def _turns_much(offers: Array, i: int, j: int) -> bool:
    """Return whether the reach of a motor's rod may be small in a cell against its change: the rod may turn any way."""
    first, second = offers[i, j, REACH], offers[i + 1, j, REACH]
    third, fourth = offers[i, j + 1, REACH], offers[i + 1, j + 1, REACH]
    low, high = min(first, second, third, fourth), max(first, second, third, fourth)
    return bool(low < _CONE * max(high - low, 0.1 * high))


@kernel
def _allow_all_directions(offers: Array, i: int, j: int, arm: float, model: Array) -> None:
    """Turn the model (5, 4) of a cell into one that knows only how large the offers are."""
    reach = force = 0.0
    for corner in range(4):
        offer = offers[i + corner // 2, j + corner % 2]
        reach = max(reach, offer[REACH])
        force = max(force, math.hypot(offer[FORCE_X], offer[FORCE_Y]))
    away = offers[i, j, REACH] - offers[i, j, MISS]
    model[:, :] = 0.0
    model[MISS, CENTER], model[MISS, REMAINDER] = reach - away, reach
    model[FORCE_X, REMAINDER] = model[FORCE_Y, REMAINDER] = 1.5 * force
    model[MOMENT, REMAINDER] = 1.5 * arm * force


@kernel
def _set_model(offers: Array, i: int, j: int, width: int, leg: int, node: int, tree: Array) -> None:
    for k in range(OFFERS):
        first, second = offers[i, j, k], offers[i + width, j, k]
        third, fourth = offers[i, j + width, k], offers[i + width, j + width, k]
        tree[leg, node, k, CENTER] = 0.25 * (first + second + third + fourth)
        tree[leg, node, k, ALONG] = 0.25 * (second + fourth - first - third)
        tree[leg, node, k, ACROSS] = 0.25 * (third + fourth - first - second)


@kernel
def spread(model: Array) -> float:
    """Return how far an offer may be from the centre of its model (4,)."""
    return float(abs(model[ALONG]) + abs(model[ACROSS]) + model[REMAINDER])


@kernel
def _set_bounds(leg: int, node: int, tree: Array, bounds: Array) -> None:
    for k in range(OFFERS):
        center, half_width = tree[leg, node, k, CENTER], spread(tree[leg, node, k])
        bounds[leg, node, k, LOW], bounds[leg, node, k, HIGH] = center - half_width, center + half_width


@kernel
def _set_cell_remainder(offers: Array, i: int, j: int, remainder: Array) -> None:
    last = offers.shape[0] - 1
    inner_i, inner_j = min(max(i, 1), last - 1), min(max(j, 1), last - 1)
    for k in range(OFFERS):
        along = offers[inner_i + 1, j, k] - 2.0 * offers[inner_i, j, k] + offers[inner_i - 1, j, k]
        across = offers[i, inner_j + 1, k] - 2.0 * offers[i, inner_j, k] + offers[i, inner_j - 1, k]
        twist = offers[i, j, k] - offers[i + 1, j, k] - offers[i, j + 1, k] + offers[i + 1, j + 1, k]
        remainder[k] = _BULGE * (abs(along) + abs(across) + abs(twist))


@kernel
def _set_node_remainder(leg: int, node: int, first_child: int, tree: Array, bounds: Array) -> None:
    """Enclose the children's models in the node's; set its bounds, empty if those of all children are."""
    tree[leg, node, :, REMAINDER] = -math.inf
    for child in range(4):
        if bounds[leg, first_child + child, 0, LOW] == math.inf:
            continue
        s, t = (child >> 1) - 0.5, (child & 1) - 0.5
        for k in range(OFFERS):
            along, across = tree[leg, node, k, ALONG], tree[leg, node, k, ACROSS]
            gap = tree[leg, first_child + child, k, CENTER] - tree[leg, node, k, CENTER] - s * along - t * across
            reach = (
                abs(gap)
                + abs(tree[leg, first_child + child, k, ALONG] - 0.5 * along)
                + abs(tree[leg, first_child + child, k, ACROSS] - 0.5 * across)
                + tree[leg, first_child + child, k, REMAINDER]
            )
            tree[leg, node, k, REMAINDER] = max(tree[leg, node, k, REMAINDER], reach)
    if tree[leg, node, 0, REMAINDER] == -math.inf:
        bounds[leg, node, :, LOW] = math.inf
        bounds[leg, node, :, HIGH] = -math.inf
    else:
        _set_bounds(leg, node, tree, bounds)
