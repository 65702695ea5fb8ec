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
from pcm_gym.kernels.rods.elliptic import jacobi
from pcm_gym.kernels.rods.rod import base_end, tip_half_angle
from pcm_gym.kernels.statics.formulas import Pair, turned

# Columns of a curve: tip and tangent there, world frame; load g; length; bound on the magnitude of the curvature.
END_X, END_Y, END_COS, END_SIN, LOAD_X, LOAD_Y, CURVE_LENGTH, CURVATURE = range(8)
CURVE_COLUMNS = 8
# Columns of a point: place, cosine and sine of the tangent.
_X, _Y, _COS, _SIN = range(4)
_POINT_COLUMNS = 4

# Middles of arcs of up to `_KEPT_DEPTH` halvings are kept for the next pair of curves. Bent curves are looked at from
# `_FIRST_DEPTH` halvings on: longer arcs are hardly ever apart.
_KEPT_DEPTH, _FIRST_DEPTH, _DEEPEST = 5, 2, 26
_KEPT = 1 << (_KEPT_DEPTH + 1)
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


class Curves(NamedTuple):
    """Curves, and the middles of their arcs as far as these are known."""

    rows: Array  # (n, 8)
    middles: Array  # (n, kept, 4)
    is_known: Integers  # (n, kept)
    stack: Integers  # (m, 2)
    point: Array  # (2, 4)


@kernel
def make_curves(count: int) -> Curves:
    """Return so many curves, not set yet."""
    return Curves(
        np.zeros((count, CURVE_COLUMNS)),
        np.empty((count, _KEPT, _POINT_COLUMNS)),
        np.zeros((count, _KEPT), np.int64),
        np.empty((_STACK, 2), np.int64),
        np.empty((2, _POINT_COLUMNS)),
    )


@kernel
def set_point(row: Array, part: float, point: Array) -> None:
    """Fill `point` with place and tangent of a curve at the arc length `part` L back from its tip."""
    g_x, g_y = row[LOAD_X], row[LOAD_Y]
    load, frame = math.hypot(g_x, g_y), (row[END_COS], row[END_SIN])
    away, tangent = (part, 0.0), (1.0, 0.0)
    if load > _NO_LOAD:
        kappa, kappa_c = tip_half_angle(g_x, g_y, load)
        argument = max(part * math.sqrt(load), _LEAST_ARGUMENT)
        cos_0, sin_0, _, along, across, _, _ = base_end(argument, kappa, kappa_c, jacobi(argument, kappa, abs(kappa_c)))
        force = (g_x / load, g_y / load)  # its direction, seen from the tip
        away, tangent = turned(force, (part * along, part * across)), turned(force, (cos_0, sin_0))
    away, tangent = turned(frame, away), turned(frame, tangent)
    point[_X], point[_Y] = row[END_X] - row[CURVE_LENGTH] * away[0], row[END_Y] - row[CURVE_LENGTH] * away[1]
    point[_COS], point[_SIN] = tangent


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
def _set_middle(curves: Curves, curve: int, arc: int, depth: int, point: Array) -> None:
    """Fill `point` with the middle of an arc."""
    if depth > _KEPT_DEPTH:
        set_point(curves.rows[curve], _part(arc, depth), point)
        return
    middle = curves.middles[curve, arc]
    if curves.is_known[curve, arc] == 0:
        set_point(curves.rows[curve], _part(arc, depth), middle)
        curves.is_known[curve, arc] = 1
    for n in range(_POINT_COLUMNS):
        point[n] = middle[n]


@formula
def _are_apart(first: Array, second: Array, first_size: Pair, second_size: Pair) -> bool:
    """Return whether two rectangles, half lengths along and across the tangents, are apart: by one of their axes."""
    gap_x, gap_y = second[_X] - first[_X], second[_Y] - first[_Y]
    cosine = abs(first[_COS] * second[_COS] + first[_SIN] * second[_SIN])
    sine = abs(first[_COS] * second[_SIN] - first[_SIN] * second[_COS])
    return bool(
        (
            abs(gap_x * first[_COS] + gap_y * first[_SIN])
            > first_size[0] + second_size[0] * cosine + second_size[1] * sine
        )
        | (
            abs(gap_y * first[_COS] - gap_x * first[_SIN])
            > first_size[1] + second_size[0] * sine + second_size[1] * cosine
        )
        | (
            abs(gap_x * second[_COS] + gap_y * second[_SIN])
            > second_size[0] + first_size[0] * cosine + first_size[1] * sine
        )
        | (
            abs(gap_y * second[_COS] - gap_x * second[_SIN])
            > second_size[1] + first_size[0] * sine + first_size[1] * cosine
        )
    )


@kernel
def find_arc_crossings(curves: Curves, first: int, second: int, shared: int, found: Array) -> int:
    """Put parts (k, 2), of each length back from its tip, of where two curves cross into `found`; return their number.

    No more than k are looked for.
    """
    rows, stack, point = curves.rows, curves.stack, curves.point
    first_row, second_row = rows[first], rows[second]
    size, count = _start(first_row, second_row, stack), 0
    for _ in range(_MOST_PAIRS):
        if size == 0 or count == found.shape[0]:
            break
        size -= 1
        arc, other = stack[size, 0], stack[size, 1]
        depth, other_depth = _depth(arc), _depth(other)
        _set_middle(curves, first, arc, depth, point[0])
        _set_middle(curves, second, other, other_depth, point[1])
        half = 0.5 * first_row[CURVE_LENGTH] / (1 << depth)
        other_half = 0.5 * second_row[CURVE_LENGTH] / (1 << other_depth)
        turn, other_turn = first_row[CURVATURE] * half, second_row[CURVATURE] * other_half
        across, other_across = 0.5 * turn * half, 0.5 * other_turn * other_half
        if _are_apart(point[0], point[1], (half, across), (other_half, other_across)):
            continue
        sine = point[0, _COS] * point[1, _SIN] - point[0, _SIN] * point[1, _COS]
        if abs(sine) > turn + other_turn:  # they cross once at most
            if _are_at_hinge(arc, depth, other, other_depth, shared):
                continue
            if _meet(curves, first, second, (arc, depth), (other, other_depth), found[count]):
                if not (_is_hinge(found[count], shared) or _is_among(found, count)):
                    count += 1
                continue
        is_first_halved = across > other_across
        if (depth if is_first_halved else other_depth) == _DEEPEST or size + 2 > stack.shape[0]:
            continue
        for half_of in range(2):
            stack[size, 0] = 2 * arc + half_of if is_first_halved else arc
            stack[size, 1] = other if is_first_halved else 2 * other + half_of
            size += 1
    return count


@kernel
def _start(first_row: Array, second_row: Array, stack: Integers) -> int:
    """Put the pairs of arcs that are looked at first on the stack; return their number."""
    depth = _FIRST_DEPTH if first_row[CURVATURE] > 0.0 else 0
    other_depth = _FIRST_DEPTH if second_row[CURVATURE] > 0.0 else 0
    size = 0
    for arc in range(1 << depth, 2 << depth):
        for other in range(1 << other_depth, 2 << other_depth):
            stack[size, 0], stack[size, 1] = arc, other
            size += 1
    return size


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
def _meet(curves: Curves, first: int, second: int, arc: tuple[int, int], other: tuple[int, int], parts: Array) -> bool:
    """Fill `parts` with where two arcs (number, depth) cross, from their middles; return whether they surely do."""
    rows, point = curves.rows, curves.point
    length, other_length = rows[first, CURVE_LENGTH], rows[second, CURVE_LENGTH]
    middle, other_middle = _part(arc[0], arc[1]), _part(other[0], other[1])
    part, other_part = middle, other_middle
    for _ in range(_NEWTON_STEPS):
        sine = point[0, _COS] * point[1, _SIN] - point[0, _SIN] * point[1, _COS]
        gap_x, gap_y = point[1, _X] - point[0, _X], point[1, _Y] - point[0, _Y]
        step = (gap_x * point[1, _SIN] - gap_y * point[1, _COS]) / (sine * length)
        other_step = (gap_x * point[0, _SIN] - gap_y * point[0, _COS]) / (sine * other_length)
        # not beyond the ends: parts are measured from the tip, against the arc
        new, new_other = min(max(part - step, 0.0), 1.0), min(max(other_part - other_step, 0.0), 1.0)
        moved = max(abs(new - part), abs(new_other - other_part))
        part, other_part = new, new_other
        if not moved > _ROUNDING:
            break
        set_point(rows[first], part, point[0])
        set_point(rows[second], other_part, point[1])
    gap = math.hypot(point[1, _X] - point[0, _X], point[1, _Y] - point[0, _Y])
    parts[0], parts[1] = part, other_part
    return bool(
        abs(part - middle) <= 0.5 / (1 << arc[1]) + _SLACK
        and abs(other_part - other_middle) <= 0.5 / (1 << other[1]) + _SLACK
        and gap <= _SLACK * (length + other_length)
    )
