"""Where two plane curves cross: rods, or a rod and a straight edge, which is a rod without load.

A curve is a row of numbers (columns below): its tip in the world frame, and the load that bends it. Every point of it
is had in closed form from the tip: the part of a rod beyond a cut is itself a clamped rod.

Curves are halved again and again. An arc of half length a whose curvature is at most k lies within a rectangle about
the tangent in its middle, a to both sides along and k a^2 / 2 across: where the rectangles of two arcs are apart, the
arcs do not cross. The tangents of an arc differ from that in its middle by at most k a: where those of two arcs are
never parallel, the arcs cross once at most, because a chord between two crossings would be a tangent of both. Then
Newton's method from the middles decides, on the closed form. So nothing is missed but curves that touch, or are within
`_DEEPEST` halvings of it.

Rods that share a hinge, with each other or with an edge, meet there and do not cross.
"""

import math
from typing import NamedTuple

import numpy as np

from pcm_gym.arrays import Array, Integers
from pcm_gym.kernels.numerics.compilation import formula, kernel
from pcm_gym.kernels.rods.elliptic import LEAST_LANE_COMPLEMENT, jacobi, jacobi_in_lanes
from pcm_gym.kernels.rods.rod import LARGEST_LOAD, SERIES_LOAD, base_end, tip_half_angle
from pcm_gym.kernels.statics.formulas import Pair, turned

# Columns of a curve: tip and tangent there, world frame; load g; length; bound on the magnitude of the curvature.
END_X, END_Y, END_COS, END_SIN, LOAD_X, LOAD_Y, CURVE_LENGTH, CURVATURE = range(8)
CURVE_COLUMNS = 8
# Columns of a point: place, cosine and sine of the tangent.
_X, _Y, _COS, _SIN = range(4)
_POINT_COLUMNS = 4

# Bent curves are looked at in arcs of so many halvings from the first on: longer ones are hardly ever apart.
_FIRST_DEPTH, _FIRST_ARCS = 2, 4
_DEEPEST = 26
# Pairs of arcs that are looked at: many more than curves need that do not follow each other for a way.
_MOST_PAIRS = 20_000
_STACK = 256
_NEWTON_STEPS = 10
# Of the curve's length: steps of Newton's method that are rounding, and how far beyond the end of an arc its crossing
# may be, so that none falls between two.
_ROUNDING, _SLACK = 1e-14, 1e-12
# Crossings nearer to each other, or to a hinge that is shared, than this part of the length are one.
_SAME = 1e-9
# What a rod's cut at the tip is taken for, where the closed form would be 0 / 0, and what load is none.
_LEAST_ARGUMENT, _NO_LOAD = 1e-100, 1e-280

# Where two curves share a hinge: nowhere, at both tips, at the first one's tip and the second one's base.
APART, TIPS, TIP_AND_BASE = range(3)


# Of an arc its half length, how far it goes off the tangent in its middle, and how far that may turn from there.
Size = tuple[float, float, float]


class Curves(NamedTuple):
    """Curves, the middles of the arcs that each is looked at in first, and scratch arrays."""

    rows: Array  # (n, 8)
    middles: Array  # (n, 4, 4): of a straight curve only the first one counts, that of the whole
    stack: Integers  # (m, 2)
    point: Array  # (2, 4)


@kernel
def make_curves(count: int) -> Curves:
    """Return so many curves, not set yet."""
    return Curves(
        np.zeros((count, CURVE_COLUMNS)),
        np.empty((count, _FIRST_ARCS, _POINT_COLUMNS)),
        np.empty((_STACK, 2), np.int64),
        np.empty((2, _POINT_COLUMNS)),
    )


@kernel
def set_point(row: Array, part: float, point: Array) -> None:
    """Fill `point` with place and tangent of a curve at the arc length `part` L back from its tip."""
    g_x, g_y = row[LOAD_X], row[LOAD_Y]
    load = math.hypot(g_x, g_y)
    if load > _NO_LOAD:
        kappa, kappa_c = tip_half_angle(g_x, g_y, load)
        argument = max(part * math.sqrt(load), _LEAST_ARGUMENT)
        functions = jacobi(argument, kappa, abs(kappa_c))
        _put_point(row, part, (g_x / load, g_y / load), base_end(argument, kappa, kappa_c, functions), point)
    else:
        _put_point(row, part, (1.0, 0.0), (1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0), point)


@formula
def _put_point(
    row: Array, part: float, force: Pair, base: tuple[float, float, float, float, float, float, float], point: Array
) -> None:
    """Fill `point` with a cut, whose `base_end` is known; `force` is the force's direction, as the tip sees it."""
    frame = turned((row[END_COS], row[END_SIN]), force)
    away, tangent = turned(frame, (part * base[3], part * base[4])), turned(frame, (base[0], base[1]))
    point[_X], point[_Y] = row[END_X] - row[CURVE_LENGTH] * away[0], row[END_Y] - row[CURVE_LENGTH] * away[1]
    point[_COS], point[_SIN] = tangent


@kernel
def set_middles(curves: Curves, curve: int) -> None:
    """Fill the middles of the first arcs of a curve."""
    row, middles = curves.rows[curve], curves.middles[curve]
    if not row[CURVATURE] > 0.0:
        set_point(row, 0.5, middles[0])
        return
    g_x, g_y = row[LOAD_X], row[LOAD_Y]
    load = math.sqrt(g_x * g_x + g_y * g_y)
    kappa, kappa_c = tip_half_angle(g_x, g_y, max(load, _NO_LOAD))
    if not (abs(kappa_c) >= LEAST_LANE_COMPLEMENT and SERIES_LOAD <= load <= LARGEST_LOAD):
        for arc in range(_FIRST_ARCS):
            set_point(row, _part(_FIRST_ARCS + arc, _FIRST_DEPTH), middles[arc])
        return
    rho, force, complement = math.sqrt(load), (g_x / load, g_y / load), abs(kappa_c)
    for arc in range(_FIRST_ARCS):  # becomes vector instructions
        part = 1.0 - (arc + 0.5) / _FIRST_ARCS
        functions = jacobi_in_lanes(part * rho, kappa, complement)
        _put_point(row, part, force, base_end(part * rho, kappa, kappa_c, functions), middles[arc])


@formula
def _depth(arc: int) -> int:
    """Return the depth of an arc: arcs are numbered like a heap, 1 is the whole curve, 2 k and 2 k + 1 the halves."""
    depth = 0
    while arc > 1:
        arc >>= 1
        depth += 1
    return depth


@formula
def _part(arc: int, depth: int) -> float:
    """Return how far the middle of an arc is from the tip, over L."""
    return 1.0 - (arc - (1 << depth) + 0.5) / (1 << depth)


@formula
def _size(row: Array, depth: int) -> Size:
    """Return the size of an arc of a curve."""
    half = 0.5 * row[CURVE_LENGTH] / (1 << depth)
    turn = row[CURVATURE] * half
    return half, 0.5 * turn * half, turn


@formula
def _are_apart(
    first: Array, second: Array, size: tuple[float, float, float], other: tuple[float, float, float]
) -> bool:
    """Return whether the rectangles of two arcs with these middles are apart: by one of their axes."""
    cos, sin, other_cos, other_sin = first[_COS], first[_SIN], second[_COS], second[_SIN]
    gap_x, gap_y = second[_X] - first[_X], second[_Y] - first[_Y]
    cosine, sine = abs(cos * other_cos + sin * other_sin), abs(cos * other_sin - sin * other_cos)
    return bool(
        (abs(gap_x * cos + gap_y * sin) > size[0] + other[0] * cosine + other[1] * sine)
        | (abs(gap_y * cos - gap_x * sin) > size[1] + other[0] * sine + other[1] * cosine)
        | (abs(gap_x * other_cos + gap_y * other_sin) > other[0] + size[0] * cosine + size[1] * sine)
        | (abs(gap_y * other_cos - gap_x * other_sin) > other[1] + size[0] * sine + size[1] * cosine)
    )


@formula
def _sine(first: Array, second: Array) -> float:
    """Return the sine of the angle between the tangents at two points."""
    sine: float = first[_COS] * second[_SIN] - first[_SIN] * second[_COS]
    return sine


@kernel
def find_arc_crossings(curves: Curves, first: int, second: int, shared: int, found: Array) -> int:
    """Put parts (k, 2), of each length back from its tip, of where two curves cross into `found`; return their number.

    No more than k are looked for. The middles of both must be set.
    """
    row, other_row = curves.rows[first], curves.rows[second]
    middles, other_middles = curves.middles[first], curves.middles[second]
    depth = _FIRST_DEPTH if row[CURVATURE] > 0.0 else 0
    other_depth = _FIRST_DEPTH if other_row[CURVATURE] > 0.0 else 0
    size, other_size = _size(row, depth), _size(other_row, other_depth)
    count = 0
    for arc in range(1 << depth):
        for other in range(1 << other_depth):
            if _are_apart(middles[arc], other_middles[other], size, other_size):
                continue
            pair = (1 << depth) + arc, (1 << other_depth) + other
            may_meet_once = abs(_sine(middles[arc], other_middles[other])) > size[2] + other_size[2]
            if not (may_meet_once and _are_at_hinge(pair[0], depth, pair[1], other_depth, shared)):
                count = _find_below(curves, first, second, pair, shared, found, count)
    return count


@kernel
def _find_below(
    curves: Curves, first: int, second: int, pair: tuple[int, int], shared: int, found: Array, count: int
) -> int:
    """Add crossings of a pair of arcs to the first `count` that are found; return how many there are then."""
    row, other_row, stack, point = curves.rows[first], curves.rows[second], curves.stack, curves.point
    stack[0, 0], stack[0, 1] = pair
    height = 1
    for _ in range(_MOST_PAIRS):
        if height == 0 or count == found.shape[0]:
            break
        height -= 1
        arc, other = stack[height, 0], stack[height, 1]
        depth, other_depth = _depth(arc), _depth(other)
        set_point(row, _part(arc, depth), point[0])
        set_point(other_row, _part(other, other_depth), point[1])
        size, other_size = _size(row, depth), _size(other_row, other_depth)
        if _are_apart(point[0], point[1], size, other_size):
            continue
        if abs(_sine(point[0], point[1])) > size[2] + other_size[2]:  # they cross once at most
            if _are_at_hinge(arc, depth, other, other_depth, shared):
                continue
            if _meet(row, other_row, (arc, depth), (other, other_depth), point, found[count]):
                if not (_is_hinge(found[count], shared) or _is_among(found, count)):
                    count += 1
                continue
        is_first_halved = size[1] > other_size[1]
        if (depth if is_first_halved else other_depth) == _DEEPEST or height + 2 > stack.shape[0]:
            continue
        for half_of in range(2):
            stack[height, 0] = 2 * arc + half_of if is_first_halved else arc
            stack[height, 1] = other if is_first_halved else 2 * other + half_of
            height += 1
    return count


@formula
def _are_at_hinge(arc: int, depth: int, other: int, other_depth: int, shared: int) -> bool:
    """Return whether both arcs end at the hinge that their curves share."""
    is_last, is_other_last = arc + 1 == 2 << depth, other + 1 == 2 << other_depth
    is_other_first = other == 1 << other_depth
    return (shared == TIPS and is_last and is_other_last) or (shared == TIP_AND_BASE and is_last and is_other_first)


@formula
def _is_hinge(parts: Array, shared: int) -> bool:
    is_last, is_other_last, is_other_first = parts[0] < _SAME, parts[1] < _SAME, parts[1] > 1.0 - _SAME
    return (shared == TIPS and is_last and is_other_last) or (shared == TIP_AND_BASE and is_last and is_other_first)


@formula
def _is_among(found: Array, count: int) -> bool:
    """Return whether the crossing after the first `count` is one of them."""
    for n in range(count):
        if abs(found[n, 0] - found[count, 0]) < _SAME and abs(found[n, 1] - found[count, 1]) < _SAME:
            return True
    return False


@kernel
def _meet(
    row: Array, other_row: Array, arc: tuple[int, int], other: tuple[int, int], point: Array, parts: Array
) -> bool:
    """Fill `parts` with where two arcs (number, depth) cross, from their middles `point`; return whether they do."""
    length, other_length = row[CURVE_LENGTH], other_row[CURVE_LENGTH]
    middle, other_middle = _part(arc[0], arc[1]), _part(other[0], other[1])
    part, other_part = middle, other_middle
    for _ in range(_NEWTON_STEPS):
        sine, gap_x, gap_y = _sine(point[0], point[1]), point[1, _X] - point[0, _X], point[1, _Y] - point[0, _Y]
        step = (gap_x * point[1, _SIN] - gap_y * point[1, _COS]) / (sine * length)
        other_step = (gap_x * point[0, _SIN] - gap_y * point[0, _COS]) / (sine * other_length)
        # not beyond the ends: parts are measured from the tip, against the arc
        new, new_other = min(max(part - step, 0.0), 1.0), min(max(other_part - other_step, 0.0), 1.0)
        moved = max(abs(new - part), abs(new_other - other_part))
        part, other_part = new, new_other
        if not moved > _ROUNDING:
            break
        set_point(row, part, point[0])
        set_point(other_row, other_part, point[1])
    gap = math.hypot(point[1, _X] - point[0, _X], point[1, _Y] - point[0, _Y])
    parts[0], parts[1] = part, other_part
    return bool(
        abs(part - middle) <= 0.5 / (1 << arc[1]) + _SLACK
        and abs(other_part - other_middle) <= 0.5 / (1 << other[1]) + _SLACK
        and gap <= _SLACK * (length + other_length)
    )
