"""Whether one smooth branch leads from one end of a step to the other, judged by what is known at both ends.

Newton's method at the end of a step sees nothing of what lies between: it may have come to another branch that happens
to be there with the same index, or the branch may have lost its stability on the way and found it again. At both ends
the tangent of the branch is known, and D, the scaled determinant that vanishes exactly at singular states, with its
rate along the tangent. Symbols, over a step of length h: y_0, y_1 the ends, t_0, t_1 the tangents, D_0, D_1 and D'_0,
D'_1. If a smooth branch joins the ends, then

    y_1 - y_0 = h (t_0 + t_1) / 2   and   D_1 - D_0 = h (D'_0 + D'_1) / 2

up to terms of third order, which also measure how much more of the branch the ends do not tell; t_1 and D'_1 are by the
step's own parameter, with arcs not by the length along the tangent there. A step is accepted if both are small, if the
ends' determinants are not too unlike, and if the cubic through the values and rates of D keeps farther from zero than
that, and than a part of the smaller end. A longer step than the branch's own scale fails, and is divided. This is a
test, not a proof.
"""

import math
from typing import NamedTuple

from pcm_gym.arrays import Array
from pcm_gym.kernels.branches.singularity import FORWARD, singularity
from pcm_gym.kernels.branches.tracer import Tracer, place_at
from pcm_gym.kernels.numerics.compilation import formula, kernel
from pcm_gym.kernels.statics.closure import Workspace
from pcm_gym.kernels.statics.margin import STIFF
from pcm_gym.kernels.statics.newton import correction_size

# Largest defect of a step, relative to its length.
_LARGEST_DEFECT = 0.01
# Defects this small are rounding.
_ROUNDING = 1e-10
# Largest defect of the determinant, relative to the larger one of both ends.
_LARGEST_SPREAD = 0.05
# Beside a determinant at the other end so much larger, one is nothing.
_NOTHING = 1e-6
# Largest ratio of the determinants at both ends, and least one of the cubic between them and the smaller end: beyond
# that the ends do not tell whether it vanishes beside one of them, or in a dip between two that are much alike.
_LARGEST_RATIO, _LEAST_RATIO = 8.0, 0.25
# A step that begins at a determinant as small as this begins at a singular state.
_SINGULAR = 1e-8
# What is known of an end serves for later steps from it, until one is this part of the step it was looked at for.
_KEPT = 1.0 / 8.0
# Part of the largest defect that a step is to have, and by how much it grows or shrinks at most.
_WANTED, _LEAST_GROWTH, _LARGEST_GROWTH = 0.7, 0.1, 2.0
# The cubic must keep farther from zero than this many defects.
_CLEARANCE = 1.0
# Part of a step over which the rate of the determinant is differenced.
_DIFFERENCE = 1e-3
# For lanes: half the largest gain and loss of a squared eigenvalue over a step, relative to its end; largest error of
# the sum of the compliances.
_MOST_GAINED, _MOST_LOST = 0.35, 1.0
_LARGEST_SURPRISE = 0.3
# Points at which the cubic is looked at, beside the ends.
_SAMPLES = 8


class Look(NamedTuple):
    """The determinant at a point of a branch, and its rate along the tangent there."""

    value: float
    rate: float
    way: float  # length of the step that it was made for


class End(NamedTuple):
    """The determinant at one end of a step, and how much it would change over the whole step at its rate there."""

    value: float
    change: float


# Of a point that was not looked at, which serves for no step.
UNSEEN = Look(0.0, 0.0, math.inf)


@kernel
def look(legs: Array, y: Array, tangent: Array, way: float, line: Tracer, work: Workspace) -> Look:
    """Return what is known of the end `y` of a step, in which the tangent, times `way`, leads to the other end.

    The rod table must be that of `y`, and is one beside it afterwards. The step is the absolute value of `way` long.
    """
    size = work.step.shape[0]
    value = singularity(legs, y[:size], FORWARD, work)
    for j in range(y.shape[0]):
        line.vector[j] = y[j] + _DIFFERENCE * way * tangent[j]
    place_at(legs, line.vector, line, work)
    beside = singularity(legs, line.vector[:size], FORWARD, work)
    return Look(value, (beside - value) / (_DIFFERENCE * way), abs(way))


@kernel
def look_from_start(legs: Array, way: float, known: Look, line: Tracer, work: Workspace) -> Look:
    """Return what is known of `y`, from which a step of `way` leads: the same as before where that will do."""
    if known.way * _KEPT <= way:
        return known
    place_at(legs, line.y, line, work)
    return look(legs, line.y, line.tangent, way, line, work)


@formula
def end_of(seen: Look, way: float) -> End:
    """Return what is known of an end of a step of this length, in the parameter of its rate."""
    return End(seen.value, way * seen.rate)


@formula
def unevenness(legs: Array, way: float, way_there: float, line: Tracer, work: Workspace) -> float:
    """Return how much the tangents at `y` and at the trial, whose rod table is set, disagree with their chord.

    Each is taken times its own `way`; 1 is the most that is allowed.
    """
    for j in range(work.step.shape[0]):
        work.step[j] = 0.5 * (way * line.tangent[j] + way_there * line.trial_tangent[j])
    length = correction_size(legs, line.trial_x, work)
    for j in range(work.step.shape[0]):
        work.step[j] -= line.trial[j] - line.y[j]
    return relative_defect(correction_size(legs, line.trial_x, work), length)


@formula
def relative_defect(defect: float, length: float) -> float:
    """Return how much the mean of both tangents, of this length, disagrees with the chord; 1 is the most allowed."""
    return defect / max(_LARGEST_DEFECT * length, _ROUNDING)


@formula
def growth(uneven: float) -> float:
    """Return how many times longer the next step is to be after one so uneven, which is of second order."""
    factor = math.sqrt(_WANTED / max(uneven, _ROUNDING)) if uneven < math.inf else 0.0
    return min(max(factor, _LEAST_GROWTH), _LARGEST_GROWTH)


@formula
def is_one_branch(here: End, there: End, rate: float) -> bool:
    """Return whether the determinant turned its sign if, and only if, the way did, from forwards to this rate.

    Along one branch their ratio, the determinant of the bordered system, vanishes nowhere: it would at a bifurcation.
    """
    defect = abs(there.value - here.value - 0.5 * (here.change + there.change))
    greatest = max(abs(here.value), abs(there.value))
    has_turned = ((here.value > 0.0) != (there.value > 0.0)) & (abs(here.value) > _NOTHING * greatest)
    return (has_turned == (rate <= 0.0)) & (defect <= _LARGEST_SPREAD * greatest)


@formula
def is_clear(here: End, there: End, part: float) -> bool:
    """Return whether the determinant keeps its sign over a part of a step, as far as its ends tell.

    The step may begin at a singular state, but for rounding. Otherwise such states are left and approached by steps in
    which the determinant changes by no more than a factor.
    """
    defect = abs(there.value - here.value - 0.5 * (here.change + there.change))
    least, greatest = math.inf, max(abs(here.value), abs(there.value))
    is_nothing = abs(here.value) <= _NOTHING * greatest
    sign = 1.0 if (there.value if is_nothing else here.value) > 0.0 else -1.0
    for k in range(1, _SAMPLES + 1):
        least = min(least, sign * cubic(here.value, here.change, there.value, there.change, part * k / _SAMPLES))
    smaller = min(abs(here.value), abs(there.value))
    is_close = (_LARGEST_RATIO * smaller >= greatest) | (abs(here.value) <= _SINGULAR)
    keeps_off = least > max(_CLEARANCE * defect, _LEAST_RATIO * smaller)
    return (defect <= _LARGEST_SPREAD * greatest) & keeps_off & is_close


@formula
def cubic(first: float, change: float, last: float, last_change: float, part: float) -> float:
    """Return Hermite's cubic at a part of a step, from the values and rates, per step, at both ends."""
    rest, chord = 1.0 - part, last - first
    return first + part * chord + part * rest * ((change - chord) * rest - (last_change - chord) * part)


@formula
def is_far_from_zero(eigenvalue: float, along: float) -> bool:
    """Return whether an eigenvalue k of the stiffness seems not to have vanished in the step that ends here.

    `along` is half the change of k^2 over the step at its rate here. Near a fold k^2 is linear, see `margin`: it then
    began with k^2 - 2 along. That must not be much less than here, nor much more.
    """
    square = eigenvalue * eigenvalue
    ratio = eigenvalue / STIFF
    own = square + square * ratio * ratio
    return (along <= _MOST_GAINED * own) & (-along <= _MOST_LOST * own)


@formula
def compliance_before(eigenvalue: float, along: float) -> float:
    """Return 1 / k at the start of a step from what its end tells, see `is_far_from_zero`."""
    square = eigenvalue * eigenvalue
    before = math.sqrt(max(square - 2.0 * along, (1.0 - 2.0 * _MOST_GAINED) * square))
    return 1.0 / before if eigenvalue > 0.0 else -1.0 / before


@formula
def is_as_foreseen(foreseen: float, greatest: float, found: float) -> bool:
    """Return whether the sum of the compliances at the start of a step is what its end tells.

    `greatest` is the sum of their absolute values. Stiff directions, whose eigenvalues change fast, count for little.
    """
    return abs(foreseen - found) <= _LARGEST_SURPRISE * greatest
