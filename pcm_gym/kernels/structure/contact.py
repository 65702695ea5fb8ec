"""Where the parts of a mechanism cross: each rod itself, rods each other, rods the edges of the platform."""

import numpy as np

from pcm_gym.arrays import Array, Mask
from pcm_gym.kernels.numerics.compilation import formula, kernel
from pcm_gym.kernels.statics.closure import (
    ARM_X,
    CLAMP_COS,
    CLAMP_X,
    FORCE_X,
    HALF_PERIODS,
    LENGTH,
    STIFFNESS,
    TIP_X,
    Workspace,
    make_workspace,
    pair,
    place,
)
from pcm_gym.kernels.statics.formulas import Pair, force_unit, moment
from pcm_gym.kernels.structure.arcs import (
    APART,
    CURVATURE,
    CURVE_LENGTH,
    END_COS,
    END_SIN,
    END_X,
    END_Y,
    LOAD_X,
    LOAD_Y,
    TIP_AND_BASE,
    TIPS,
    Curves,
    find_arc_crossings,
    make_curves,
    set_middles,
    set_point,
)
from pcm_gym.kernels.structure.loops import crosses_itself, find_loops
from pcm_gym.kernels.structure.strength import largest_curvature

# Columns of the crossings of a mechanism: numbers of the parts, arc lengths from their bases, place. The parts are the
# legs' rods, then the platform's edges: edge k, from hinge k to the next one, has the number legs + k.
FIRST_PART, SECOND_PART, FIRST_ARC, SECOND_ARC, PLACE_X, PLACE_Y = range(6)
CROSSING_COLUMNS = 6
# Crossings of one pair of parts that are looked for.
_MOST_OF_PAIR = 64
# Part of a rod's load below which it has no direction of its own.
_LEAST = 1e-300


@formula
def part_count(leg_count: int, size: int) -> int:
    """Return the number of rods, and of edges of a platform."""
    return 2 * leg_count if size - 2 * leg_count == 3 else leg_count


@kernel
def set_curves(legs: Array, x: Array, work: Workspace, curves: Curves) -> None:
    """Fill the curves of all parts from the rod table of the state `x`."""
    rows, leg_count, pose = curves.rows, legs.shape[0], 2 * legs.shape[0]
    for i in range(leg_count):
        row, rod_row, g = rows[i], work.rods[i], pair(x, 2 * i)
        tip, force, clamp = pair(rod_row, TIP_X), pair(rod_row, FORCE_X), pair(work.clamps[i], CLAMP_X)
        length, stiffness = legs[i, LENGTH], legs[i, STIFFNESS]
        row[END_X], row[END_Y] = clamp[0] + tip[0], clamp[1] + tip[1]
        row[END_COS], row[END_SIN] = _tip_direction(g, force, force_unit(length, stiffness), work, i)
        row[LOAD_X], row[LOAD_Y], row[CURVE_LENGTH] = g[0], g[1], length
        row[CURVATURE] = largest_curvature(g, rod_row[HALF_PERIODS], moment(tip, force), length, stiffness)
    for i in range(leg_count, rows.shape[0]):
        arm, next_arm = pair(work.rods[i - leg_count], ARM_X), pair(work.rods[(i + 1) % leg_count], ARM_X)
        away_x, away_y = next_arm[0] - arm[0], next_arm[1] - arm[1]
        length, row = np.hypot(away_x, away_y), rows[i]
        row[:] = 0.0
        row[END_X], row[END_Y], row[CURVE_LENGTH] = x[pose] + next_arm[0], x[pose + 1] + next_arm[1], length
        row[END_COS], row[END_SIN] = away_x / max(length, _LEAST), away_y / max(length, _LEAST)
    for i in range(rows.shape[0]):
        set_middles(curves, i)


@formula
def _tip_direction(g: Pair, force: Pair, unit_force: float, work: Workspace, leg: int) -> Pair:
    """Return cosine and sine of the tangent at a rod's tip: it turns the load that the tip sees into the force."""
    squared = (g[0] * g[0] + g[1] * g[1]) * unit_force
    if squared < _LEAST:  # straight
        return pair(work.clamps[leg], CLAMP_COS)
    cosine, sine = force[0] * g[0] + force[1] * g[1], force[1] * g[0] - force[0] * g[1]
    return cosine / squared, sine / squared


@formula
def _shared_hinge(first: int, second: int, leg_count: int, is_platform: bool) -> int:
    """Return where two parts, the first a rod, share a hinge."""
    if second < leg_count:
        return APART if is_platform else TIPS
    edge = second - leg_count
    if edge == first:
        return TIP_AND_BASE
    return TIPS if (edge + 1) % leg_count == first else APART


@kernel
def has_contact(legs: Array, x: Array, work: Workspace, curves: Curves, first: Array) -> bool:
    """Return whether the state `x` at the rod table has a crossing that is a contact.

    That is a rod with itself; on a platform also rods with each other and with the platform's edges. Two rods of a
    point end-effector may cross, one above the other. `first` (1, 2) is scratch.
    """
    leg_count = legs.shape[0]
    for i in range(leg_count):
        if crosses_itself(x[2 * i], x[2 * i + 1], work.rods[i, HALF_PERIODS]):
            return True
    if x.shape[0] - 2 * leg_count == 2:
        return False
    set_curves(legs, x, work, curves)
    for i in range(leg_count):
        for j in range(i + 1, curves.rows.shape[0]):
            is_there = j < leg_count or curves.rows[j, CURVE_LENGTH] > 0.0  # two hinges may be in one place
            if is_there and find_arc_crossings(curves, i, j, _shared_hinge(i, j, leg_count, True), first) > 0:
                return True
    return False


@kernel
def set_contacts(legs: Array, states: Array, inputs: Array, contacts: Mask) -> None:
    """Fill `contacts` (n,) with whether there is a contact, see `has_contact`: `states` (n, size) at `inputs`."""
    work = make_workspace(legs.shape[0], states.shape[1])
    curves, first = make_curves(part_count(legs.shape[0], states.shape[1])), np.empty((1, 2))
    for n in range(states.shape[0]):
        place(legs, states[n], inputs[n], work)
        contacts[n] = has_contact(legs, states[n], work, curves, first)


@kernel
def find_crossings(legs: Array, x: Array, inputs: Array, crossings: Array) -> int:
    """Put all crossings of the parts (k, 6) into `crossings`; return their number, more than k if there is no room."""
    leg_count, size = legs.shape[0], x.shape[0]
    work, curves = make_workspace(leg_count, size), make_curves(part_count(leg_count, size))
    place(legs, x, inputs, work)
    set_curves(legs, x, work, curves)
    found, loops, count = np.empty((_MOST_OF_PAIR, 2)), np.empty((crossings.shape[0], 2)), 0
    for i in range(leg_count):
        loop_count = find_loops(x[2 * i], x[2 * i + 1], loops)
        for n in range(min(loop_count, loops.shape[0] - count)):
            _put(i, i, 1.0 - loops[n, 0], 1.0 - loops[n, 1], curves, crossings[count + n])
        count += loop_count
        for j in range(i + 1, curves.rows.shape[0]):
            if j >= leg_count and not curves.rows[j, CURVE_LENGTH] > 0.0:
                continue  # two hinges in one place
            pair_count = find_arc_crossings(
                curves, i, j, _shared_hinge(i, j, leg_count, size - 2 * leg_count == 3), found
            )
            for n in range(min(pair_count, crossings.shape[0] - count)):
                _put(i, j, found[n, 0], found[n, 1], curves, crossings[count + n])
            count += pair_count
    return count


@kernel
def _put(first: int, second: int, part: float, other_part: float, curves: Curves, crossing: Array) -> None:
    crossing[FIRST_PART], crossing[SECOND_PART] = first, second
    crossing[FIRST_ARC] = (1.0 - part) * curves.rows[first, CURVE_LENGTH]
    crossing[SECOND_ARC] = (1.0 - other_part) * curves.rows[second, CURVE_LENGTH]
    set_point(curves.rows[first], part, curves.point[0])
    crossing[PLACE_X], crossing[PLACE_Y] = curves.point[0, 0], curves.point[0, 1]
