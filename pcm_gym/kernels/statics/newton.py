"""Newton's method on closure and equilibrium, with a status."""

import math
from typing import NamedTuple

from pcm_gym.arrays import Array
from pcm_gym.kernels.numerics.compilation import formula, kernel
from pcm_gym.kernels.numerics.linear import solve_linear
from pcm_gym.kernels.statics.closure import (
    FORCE_G,
    FORCE_X,
    TIP_G,
    Workspace,
    derivatives,
    evaluate_rods,
    pair,
    place,
    set_inputs,
    set_inverse_matrix,
    set_residual,
    solve_equilibrium_system,
)
from pcm_gym.kernels.statics.formulas import rod_correction

CONVERGED, TOO_FAR, DIVERGED, SINGULAR, ITERATION_LIMIT = range(5)
# Verdict on a correction that is accepted and not the last.
GOES_ON = -1

# Newton's method stops when the correction after the present one is expected to be below this.
LAST_CORRECTION = 1e-13
# Corrections this small may be rounding: their contraction says nothing.
ROUNDING = 1e-12


class NewtonRules(NamedTuple):
    """What Newton's method may do before it gives up."""

    first_correction: float  # largest allowed first correction
    contraction: float  # largest allowed ratio of successive corrections
    iterations: int
    residual: float = 0.0  # a state with errors of closure and force below this is accepted, whatever its correction
    largest_step: float = math.inf  # a longer correction is shortened to this
    reach: float = math.inf  # farthest that the end-effector may come from where it starts


@formula
def is_last(size: float, previous: float) -> bool:
    """Return whether a correction of this size after the previous one is the last that matters.

    Quadratic convergence makes the next one about size (size / previous)^2.
    """
    ratio = size / previous if (size < previous) & (previous < math.inf) else 1.0
    return size * ratio * ratio < LAST_CORRECTION


@formula
def contracts(size: float, previous: float, contraction: float, small: float) -> bool:
    """Return whether a correction is at most `contraction` times the previous one, or so small that this says nothing.

    One that is infinite or not a number is not.
    """
    return (size <= max(contraction * previous, small)) & (size < math.inf)


@formula
def accept_correction(size: float, previous: float, is_first: bool, rules: NewtonRules) -> int:
    """Return the verdict on a correction of this size after the previous one (inf: none): how it ends, or `GOES_ON`.

    Accepted are the verdicts up to `CONVERGED`; a correction is refused before it is made.
    """
    accepted = CONVERGED if is_last(size, previous) else GOES_ON
    verdict = accepted if contracts(size, previous, rules.contraction, ROUNDING) else DIVERGED
    return TOO_FAR if is_first & (size > rules.first_correction) else verdict


@formula
def accepted_part(size: float, rules: NewtonRules) -> float:
    """Return the part of a correction of this size that is made."""
    return min(1.0, rules.largest_step / size) if size > 0.0 else 1.0


@kernel
def correction_size(legs: Array, x: Array, work: Workspace) -> float:
    """Return the size of `work.step`: the largest change of pose, of a rod's tip, or, over 1 + |force|, of its force.

    Unlike the change of g itself, this measure is fair to taut rods, whose g_y is exponentially small.
    """
    pose = 2 * legs.shape[0]
    step, rods = work.step, work.rods
    size = 0.0
    for d in range(x.shape[0]):  # max() drops a nan
        if not math.isfinite(step[d]):
            return math.inf
    for d in range(pose, x.shape[0]):
        size = max(size, abs(step[d]))
    for i in range(legs.shape[0]):
        tip_g, force_g = derivatives(rods[i], TIP_G), derivatives(rods[i], FORCE_G)
        size = max(size, rod_correction(tip_g, force_g, pair(rods[i], FORCE_X), pair(step, 2 * i)))
    return size if math.isfinite(size) else math.inf


@kernel
def solve_forward_locally(
    legs: Array, inputs: Array, load: Array, x: Array, rules: NewtonRules, work: Workspace
) -> int:
    """Correct `x` in place to the equilibrium near it at these inputs; return a status.

    The rod table belongs to the state before the last correction.
    """
    set_inputs(legs, inputs, work)
    previous, pose = math.inf, 2 * legs.shape[0]
    start_x, start_y = x[pose], x[pose + 1]
    for iteration in range(rules.iterations):
        evaluate_rods(legs, x, work)
        if max(set_residual(legs, x, load, work)) < rules.residual:
            return CONVERGED
        if not solve_equilibrium_system(legs, x, work.residual, work):
            return SINGULAR
        size = correction_size(legs, x, work)
        verdict = accept_correction(size, previous, iteration == 0, rules)
        if verdict > CONVERGED:
            return verdict
        part = accepted_part(size, rules)
        for j in range(x.shape[0]):
            x[j] += part * work.step[j]
        if part == 1.0 and verdict == CONVERGED:
            return CONVERGED
        if math.hypot(x[pose] - start_x, x[pose + 1] - start_y) > rules.reach:
            return TOO_FAR
        previous = size if part == 1.0 else math.inf  # a shortened step says nothing about how fast errors fall
    return ITERATION_LIMIT


@kernel
def solve_inverse_locally(
    legs: Array, inputs: Array, load: Array, x: Array, rules: NewtonRules, work: Workspace
) -> int:
    """Correct the rods in `x` and `inputs`, both in place, to the equilibrium near them at the pose in `x`."""
    pose, size = 2 * legs.shape[0], x.shape[0]
    previous = math.inf
    for iteration in range(rules.iterations):
        place(legs, x, inputs, work)
        set_residual(legs, x, load, work)
        set_inverse_matrix(legs, x, work)
        for row in range(size):
            work.vector[row] = -work.residual[row]
        if not solve_linear(work.matrix, work.vector, size):
            return SINGULAR
        largest_input = 0.0
        for j in range(size):
            work.step[j] = work.vector[j] if j < pose else 0.0
            largest_input = max(largest_input, abs(work.vector[j]) if j >= pose else 0.0)
        correction = max(correction_size(legs, x, work), largest_input)
        verdict = accept_correction(correction, previous, iteration == 0, rules)
        if verdict > CONVERGED:
            return verdict
        part = accepted_part(correction, rules)
        for j in range(pose):
            x[j] += part * work.step[j]
        for i in range(legs.shape[0]):
            inputs[i] += part * work.vector[pose + i]
        if part == 1.0 and verdict == CONVERGED:
            return CONVERGED
        previous = correction if part == 1.0 else math.inf
    return ITERATION_LIMIT
