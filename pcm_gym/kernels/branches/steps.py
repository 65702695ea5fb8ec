"""One step of a branch along a straight line in (inputs, load): natural, in the fraction s, or by arc length.

Both are an Euler predictor and a Newton corrector, accepted only if the first correction is small, the corrections
contract fast, the Morse index is unchanged (on one branch it can change only at a singular point) and what is known at
both ends tells of one smooth branch, see `smoothness`. Arcs (see `tracer`) pass folds: there ds changes its sign, and
the fold is located.
"""

import math
from typing import NamedTuple

from pcm_gym.arrays import Array
from pcm_gym.kernels.branches.smoothness import (
    UNSEEN,
    Look,
    cubic,
    end_of,
    growth,
    is_clear,
    is_one_branch,
    look,
    look_from_start,
    unevenness,
)
from pcm_gym.kernels.branches.tracer import (
    Tracer,
    cosine_of_turn,
    move,
    move_foreseen,
    place_at,
    set_parameters,
    speed_at_trial,
)
from pcm_gym.kernels.numerics.compilation import formula, kernel
from pcm_gym.kernels.statics.closure import Workspace, evaluate_rods, set_path_derivative, solve_equilibrium_system
from pcm_gym.kernels.statics.newton import CONVERGED, NewtonRules, solve_forward_locally
from pcm_gym.kernels.statics.stability import assess_stability

STEP_RULES = NewtonRules(first_correction=0.05, contraction=0.2, iterations=8)
# Of the angle between the tangents at both ends of an arc.
_LEAST_COSINE = 0.9
# A step that is refused for its defect is made shorter by at least this.
_LARGEST_PART_LEFT = 0.8
# How much of s may be left to a fold, in how many trials it is located, and every which of them halves the bracket.
_FOLD_TOLERANCE, _FOLD_TRIALS, _BISECT_EVERY = 1e-11, 100, 4

# In place of the index of a state that was not found.
LOST = -1
# What became of a step.
TAKEN, REFUSED, OTHER_INDEX, TURNED_BACK, AT_FOLD, AT_END = range(6)


class Step(NamedTuple):
    """What became of a step."""

    outcome: int
    growth: float  # how many times longer the next one is to be
    there: Look  # what is known of its end, where it was looked at


class Slope(NamedTuple):
    """The fraction s at some arc, and d s / d arc."""

    arc: float
    value: float
    rate: float


@formula
def start_naturally(legs: Array, line: Tracer, work: Workspace) -> tuple[int, bool]:
    """Set rod table and tangent of `y`; return its index, and whether there is a tangent."""
    place_at(legs, line.y, line, work)
    is_regular = _set_natural_tangent(legs, line.x, line.tangent, line, work)
    return assess_stability(legs, line.x, work).morse_index, is_regular


@kernel
def _set_natural_tangent(legs: Array, x: Array, tangent: Array, line: Tracer, work: Workspace) -> bool:
    """Fill the tangent at a state, whose rod table is set, with d y / d s; return whether there is one."""
    set_path_derivative(legs, x, line.input_rates[0], line.load_rates[0], work, work.residual)
    is_regular = solve_equilibrium_system(legs, x, work.residual, work)
    for j in range(work.step.shape[0]):
        tangent[j] = work.step[j]
    tangent[-1] = 1.0
    return is_regular


@kernel
def step_naturally(legs: Array, end: float, index: int, here: Look, line: Tracer, work: Workspace) -> Step:
    """Put the state at the fraction `end` into the trial, with its tangent, if the branch leads there.

    It must do so smoothly and with this index all the way. `here` is what is known of `y`.
    """
    if predict_and_correct(legs, end, line, work) != index:
        return Step(REFUSED, 0.5, UNSEEN)
    if not _set_natural_tangent(legs, line.trial_x, line.trial_tangent, line, work):
        return Step(REFUSED, 0.5, UNSEEN)
    way = end - line.y[-1]
    uneven = unevenness(legs, way, way, line, work)
    if not uneven <= 1.0:
        return Step(REFUSED, min(growth(uneven), _LARGEST_PART_LEFT), UNSEEN)
    there = look(legs, line.trial, line.trial_tangent, -way, line, work)
    here = look_from_start(legs, way, here, line, work)
    if not is_clear(end_of(here, way), end_of(there, way), 1.0):
        return Step(REFUSED, 0.5, UNSEEN)
    return Step(TAKEN, growth(uneven), there)


@kernel
def predict_and_correct(legs: Array, end: float, line: Tracer, work: Workspace) -> int:
    """Put a state at the fraction `end` into the trial; return its index, or `LOST`."""
    way = end - line.y[-1]
    for j in range(work.step.shape[0]):
        line.trial[j] = line.y[j] + way * line.tangent[j]
    line.trial[-1] = end
    return _correct_state(legs, line, work)


@formula
def _correct_state(legs: Array, line: Tracer, work: Workspace) -> int:
    """Correct the trial's state at its fraction and set its rod table; return its index, or `LOST`."""
    x = line.trial_x
    set_parameters(line.trial, line)
    if solve_forward_locally(legs, line.inputs, line.load, x, STEP_RULES, work) != CONVERGED:
        return LOST
    evaluate_rods(legs, x, work)
    return assess_stability(legs, x, work).morse_index


@kernel
def step_by_arc(legs: Array, arc: float, reach: float, index: int, here: Look, line: Tracer, work: Workspace) -> Step:
    """Put the point at `arc` into the trial, or that at the fold or the end before it into `y`.

    `here` is what is known of `y`.
    """
    if not move(legs, arc, STEP_RULES, line, work):
        return Step(REFUSED, 0.5, UNSEEN)
    if cosine_of_turn(legs, line, work) < _LEAST_COSINE:
        return Step(REFUSED, 0.5, UNSEEN)
    arc_there = arc * speed_at_trial(line)
    uneven = unevenness(legs, arc, arc_there, line, work)
    if not uneven <= 1.0:
        return Step(REFUSED, min(growth(uneven), _LARGEST_PART_LEFT), UNSEEN)
    trial_index, rate = assess_stability(legs, line.trial_x, work).morse_index, line.trial_tangent[-1]
    there = look(legs, line.trial, line.trial_tangent, -arc_there, line, work)
    here = look_from_start(legs, arc, here, line, work)
    first, last = end_of(here, arc), end_of(there, arc_there)
    if not is_one_branch(first, last, rate):
        if trial_index != index:
            return Step(OTHER_INDEX, 0.5, UNSEEN)
        return Step(TURNED_BACK if rate <= 0.0 else REFUSED, 0.5, UNSEEN)
    if rate <= 0.0:
        return _go_to_fold(legs, arc, reach, index, line, work)
    is_beyond = line.trial[-1] >= reach
    if not is_beyond and trial_index != index:
        return Step(OTHER_INDEX, 0.5, UNSEEN)
    part = (reach - line.y[-1]) / (line.trial[-1] - line.y[-1]) if is_beyond else 1.0
    if not is_clear(first, last, part):
        return Step(REFUSED, 0.5, UNSEEN)
    if is_beyond:
        is_there = _step_back_to(legs, reach, part, index, line, work)
        return Step(AT_END if is_there else REFUSED, 0.5, UNSEEN)
    place_at(legs, line.trial, line, work)
    return Step(TAKEN, growth(uneven), there)


@kernel
def _step_back_to(legs: Array, reach: float, part: float, index: int, line: Tracer, work: Workspace) -> bool:
    """Go to the fraction `reach`, at a part of the step to the trial; return whether this branch is there."""
    for j in range(work.step.shape[0]):
        line.trial[j] = line.y[j] + part * (line.trial[j] - line.y[j])
    line.trial[-1] = reach
    if _correct_state(legs, line, work) != index:
        return False
    line.y[:] = line.trial
    return True


@kernel
def _go_to_fold(legs: Array, arc: float, reach: float, index: int, line: Tracer, work: Workspace) -> Step:
    """Go to the last point before the fold, where ds / darc changes its sign, between `y` and the trial at `arc`.

    If it lies beyond the fraction `reach`, `y` stays, and the next step is to lead to the fold.
    """
    far, far_rate, point = line.trial.copy(), line.trial_tangent * speed_at_trial(line), line.y.copy()
    low, high = Slope(0.0, line.y[-1], line.tangent[-1]), Slope(arc, far[-1], far_rate[-1])
    for number in range(1, _FOLD_TRIALS):
        part, gain = _foreseen_fold(low, high)
        if gain < _FOLD_TOLERANCE:
            break
        middle = low.arc + (0.5 if number % _BISECT_EVERY == 0 else part) * (high.arc - low.arc)
        for j in range(point.shape[0]):
            line.trial[j] = cubic(line.y[j], arc * line.tangent[j], far[j], arc * far_rate[j], middle / arc)
        is_found = move_foreseen(legs, middle, STEP_RULES, line, work)
        rate = line.trial_tangent[-1] * speed_at_trial(line) if is_found else 0.0
        if rate > 0.0 and assess_stability(legs, line.trial_x, work).morse_index == index:
            low, point[:] = Slope(middle, line.trial[-1], rate), line.trial
        else:
            high = Slope(middle, line.trial[-1] if rate < 0.0 else low.value, min(rate, 0.0))
    if point[-1] > reach:
        return Step(REFUSED, low.arc / arc, UNSEEN)
    line.y[:] = point
    return Step(AT_FOLD, 1.0, UNSEEN)


@formula
def _foreseen_fold(low: Slope, high: Slope) -> tuple[float, float]:
    """Return the part of the way from `low` to `high` just before the fold, and how much s is to grow to there.

    s is a cubic, whose maximum is before `high`, so little that s there is less than the tolerance from it.
    """
    width, rise = high.arc - low.arc, high.value - low.value
    first, last = width * low.rate, width * high.rate
    linear, squared = 6.0 * rise - 4.0 * first - 2.0 * last, 3.0 * (first + last - 2.0 * rise)
    root = math.sqrt(max(linear * linear - 4.0 * squared * first, 0.0))  # the curvature there, too
    part = 2.0 * first / (root - linear)
    gain = part * (first + part * (0.5 * linear + part * squared / 3.0))
    before = math.sqrt(_FOLD_TOLERANCE / max(root, _FOLD_TOLERANCE))
    return max(part - before, 0.5 * part), gain
