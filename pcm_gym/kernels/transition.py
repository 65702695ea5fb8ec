"""One step of many mechanisms at once: increments of the inputs in, tracked states, costs and features out."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pcm_gym.kernels.closure import (
    FORCE_X,
    FORCE_Y,
    HALF_PERIODS,
    LENGTH,
    LOWER,
    STIFFNESS,
    TURN,
    UPPER,
    Workspace,
    evaluate_rods,
    make_workspace,
    set_inputs,
)
from pcm_gym.kernels.compilation import kernel
from pcm_gym.kernels.continuation import (
    ACTUATOR_LIMIT,
    FOLD,
    INDEX_CHANGE,
    NONE,
    SOLVER_FAILURE,
    Tracked,
    judge,
    make_line,
    track,
)

Array = NDArray[np.float64]

# Loads are shown to agents as g / (_LOAD_SCALE + |g|), stiffnesses as k / (_MARGIN_SCALE + |k|): smooth and bounded.
_LOAD_SCALE = 10.0
_MARGIN_SCALE = 20.0

# Columns of the verdicts on a state.
MORSE_INDEX, STABILITY_MARGIN, SINGULARITY_MARGIN, RESIDUAL, EVENT, FRACTION = range(6)
VERDICT_COLUMNS = 6
# Columns of the costs of a step.
UNSTABLE, SINGULAR, LIMIT, SOLVER = range(4)
COST_COLUMNS = 4

# Features of a state that every mechanism has once, and those that each leg has.
STABILITY_FEATURES, ROD_FEATURES = 3, 5


class States(NamedTuple):
    """The dynamic state of a batch, one row per environment; everything else follows from it."""

    x: Array  # (n, size)
    inputs: Array  # (n, legs)
    load: Array  # (n, d)


@kernel
def set_features(
    legs: Array, x: Array, inputs: Array, tracked: Tracked, is_lost: bool, work: Workspace, out: Array
) -> None:
    """Fill `out` with the features of a state at the rod table: pose, inputs, rods, stability."""
    pose, n = 2 * legs.shape[0], 0
    out[0], out[1] = x[pose], x[pose + 1]
    n = 2
    if x.shape[0] - pose == 3:
        out[2], out[3] = math.cos(x[pose + 2]), math.sin(x[pose + 2])
        n = 4
    for i in range(legs.shape[0]):
        lower, upper = legs[i, LOWER], legs[i, UPPER]
        out[n] = (2.0 * inputs[i] - lower - upper) / (upper - lower)
        n += 1
        if legs[i, TURN] != 0.0:
            out[n], out[n + 1] = work.clamps[i, 2], work.clamps[i, 3]
            n += 2
    for i in range(legs.shape[0]):
        _set_rod_features(legs, x, i, work, out[n : n + ROD_FEATURES])
        n += ROD_FEATURES
    out[n] = 0.0 if is_lost else 1.0
    out[n + 1] = tracked.stability_margin / (_MARGIN_SCALE + abs(tracked.stability_margin))
    out[n + 2] = tracked.singularity_margin / (_MARGIN_SCALE + tracked.singularity_margin)


@kernel
def _set_rod_features(legs: Array, x: Array, leg: int, work: Workspace, out: Array) -> None:
    g_x, g_y = x[2 * leg], x[2 * leg + 1]
    scale = 1.0 / (_LOAD_SCALE + math.hypot(g_x, g_y))
    out[0], out[1] = scale * g_x, scale * g_y
    force_scale = scale * legs[leg, LENGTH] ** 2 / legs[leg, STIFFNESS]
    c, s = work.clamps[leg, 2], work.clamps[leg, 3]
    force_x, force_y = work.rods[leg, FORCE_X], work.rods[leg, FORCE_Y]
    out[2] = force_scale * (c * force_x + s * force_y)
    out[3] = force_scale * (c * force_y - s * force_x)
    out[4] = work.rods[leg, HALF_PERIODS] / (1.0 + work.rods[leg, HALF_PERIODS])


@kernel
def step_batch(
    legs: Array,
    states: States,
    actions: Array,
    stride: Array,
    singular_margin: float,
    verdicts: Array,
    costs: Array,
    features: Array,
) -> None:
    """Move the inputs of every environment by its action (n, legs), cut to [-1, 1], times `stride`, in place.

    Inputs beyond an actuator's limit are cut. A solver failure leaves the state as it was. Fills `verdicts`
    (n, 6), `costs` (n, 4) and `features` (n, m).
    """
    count, size = states.x.shape
    line, work = make_line(legs.shape[0], size), make_workspace(legs.shape[0], size)
    x_start, inputs_start, target = np.empty(size), np.empty(legs.shape[0]), np.empty(legs.shape[0])
    for row in range(count):
        x, inputs, load = states.x[row], states.inputs[row], states.load[row]
        x_start[:], inputs_start[:] = x, inputs
        is_cut = _set_target(legs, inputs, actions[row], stride, target)
        tracked = track(legs, x, inputs, load, target, load.copy(), False, line, work)
        if tracked.event == SOLVER_FAILURE:
            x[:], inputs[:] = x_start, inputs_start
            set_inputs(legs, inputs, work)
            evaluate_rods(legs, x, work)
            tracked = judge(legs, x, load, SOLVER_FAILURE, 0.0, work)
        is_lost = tracked.event == FOLD or tracked.event == INDEX_CHANGE or tracked.morse_index > 0
        costs[row, UNSTABLE] = 1.0 if is_lost else 0.0
        costs[row, SINGULAR] = 1.0 if tracked.singularity_margin < singular_margin else 0.0
        costs[row, LIMIT] = 1.0 if is_cut else 0.0
        costs[row, SOLVER] = 1.0 if tracked.event == SOLVER_FAILURE else 0.0
        _set_verdict(tracked, verdicts[row])
        if is_cut and tracked.event == NONE:
            verdicts[row, EVENT] = ACTUATOR_LIMIT
        set_features(legs, x, inputs, tracked, is_lost, work, features[row])


@kernel
def describe_batch(legs: Array, states: States, verdicts: Array, features: Array) -> None:
    """Fill `verdicts` and `features` of states at rest."""
    work = make_workspace(legs.shape[0], states.x.shape[1])
    for row in range(states.x.shape[0]):
        x, inputs = states.x[row], states.inputs[row]
        set_inputs(legs, inputs, work)
        evaluate_rods(legs, x, work)
        tracked = judge(legs, x, states.load[row], NONE, 0.0, work)
        _set_verdict(tracked, verdicts[row])
        set_features(legs, x, inputs, tracked, tracked.morse_index > 0, work, features[row])


@kernel
def _set_target(legs: Array, inputs: Array, action: Array, stride: Array, target: Array) -> bool:
    is_cut = False
    for i in range(legs.shape[0]):
        wish = inputs[i] + min(max(action[i], -1.0), 1.0) * stride[i]
        target[i] = min(max(wish, legs[i, LOWER]), legs[i, UPPER])
        is_cut = is_cut or target[i] != wish
    return is_cut


@kernel
def _set_verdict(tracked: Tracked, verdict: Array) -> None:
    verdict[MORSE_INDEX] = tracked.morse_index
    verdict[STABILITY_MARGIN] = tracked.stability_margin
    verdict[SINGULARITY_MARGIN] = tracked.singularity_margin
    verdict[RESIDUAL] = tracked.residual
    verdict[EVENT] = tracked.event
    verdict[FRACTION] = tracked.fraction


@kernel
def wander(
    legs: Array, x: Array, inputs: Array, load: Array, target: Array, stride: Array, steps: int, least_margin: float
) -> int:
    """Walk towards the inputs `target` in increments of at most `stride`, in place; return the number of steps made.

    It ends at the target, after `steps` steps, or before the first one that would leave the stable branch or come
    under `least_margin`. So whoever repeats the walk meets neither.
    """
    line, work = make_line(legs.shape[0], x.shape[0]), make_workspace(legs.shape[0], x.shape[0])
    x_before, inputs_before, goal = x.copy(), inputs.copy(), inputs.copy()
    for step in range(steps):
        ratio = 0.0
        for i in range(inputs.shape[0]):
            ratio = max(ratio, abs(target[i] - inputs[i]) / stride[i])
        if ratio == 0.0:
            return step
        x_before[:], inputs_before[:] = x, inputs
        for i in range(inputs.shape[0]):
            goal[i] = inputs[i] + (target[i] - inputs[i]) / max(ratio, 1.0)
        tracked = track(legs, x, inputs, load, goal, load.copy(), False, line, work)
        if tracked.event != NONE or tracked.stability_margin < least_margin:
            x[:], inputs[:] = x_before, inputs_before
            return step
    return steps
