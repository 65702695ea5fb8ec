"""Newton's method on closure and equilibrium, with a status."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pcm_gym.kernels.closure import (
    FORCE_G,
    FORCE_X,
    FORCE_Y,
    Workspace,
    evaluate_rods,
    set_inputs,
    set_inverse_matrix,
    set_residual,
    solve_equilibrium_system,
)
from pcm_gym.kernels.compilation import kernel
from pcm_gym.kernels.linear import solve_linear

Array = NDArray[np.float64]

CONVERGED, TOO_FAR, DIVERGED, SINGULAR, ITERATION_LIMIT = range(5)

# A correction below this is the last: Newton's next one would be of the order of its square.
LAST_CORRECTION = 1e-11
# Corrections this small may be rounding: their contraction says nothing.
ROUNDING = 1e-12


class NewtonRules(NamedTuple):
    """What Newton's method may do before it gives up."""

    first_correction: float  # largest allowed first correction
    contraction: float  # largest allowed ratio of successive corrections
    iterations: int


@kernel
def correction_size(legs: Array, x: Array, work: Workspace) -> float:
    """Return the size of `work.step`: the largest change of pose or, relative to 1 + |force|, of a rod's force.

    Unlike the change of g itself, this measure is fair to taut rods, whose g_y is exponentially small.
    """
    pose = 2 * legs.shape[0]
    step, rods = work.step, work.rods
    size = 0.0
    for d in range(pose, x.shape[0]):
        size = max(size, abs(step[d]))
    for i in range(legs.shape[0]):
        change_x = rods[i, FORCE_G] * step[2 * i] + rods[i, FORCE_G + 1] * step[2 * i + 1]
        change_y = rods[i, FORCE_G + 2] * step[2 * i] + rods[i, FORCE_G + 3] * step[2 * i + 1]
        force = math.hypot(rods[i, FORCE_X], rods[i, FORCE_Y])
        size = max(size, math.hypot(change_x, change_y) / (1.0 + force))
    return size if math.isfinite(size) else math.inf


@kernel
def solve_forward_locally(legs: Array, inputs: Array, load: Array, x: Array, rules: NewtonRules, work: Workspace) -> int:
    """Correct `x` in place to the equilibrium near it at these inputs; return a status.

    On success the rod table belongs to the last iterate, which differs from the corrected `x` by less than 1e-11.
    """
    set_inputs(legs, inputs, work)
    previous = math.inf
    for iteration in range(rules.iterations):
        evaluate_rods(legs, x, work)
        set_residual(legs, x, load, work)
        if solve_equilibrium_system(legs, x, work.residual, work) == 0.0:
            return SINGULAR
        size = correction_size(legs, x, work)
        if iteration == 0 and size > rules.first_correction:
            return TOO_FAR
        if not size <= max(rules.contraction * previous, ROUNDING):
            return DIVERGED
        for j in range(x.shape[0]):
            x[j] += work.step[j]
        if size < LAST_CORRECTION:
            return CONVERGED
        previous = size
    return ITERATION_LIMIT


@kernel
def solve_inverse_locally(legs: Array, inputs: Array, load: Array, x: Array, rules: NewtonRules, work: Workspace) -> int:
    """Correct the rods in `x` and `inputs`, both in place, to the equilibrium near them at the pose in `x`."""
    pose, size = 2 * legs.shape[0], x.shape[0]
    previous = math.inf
    for iteration in range(rules.iterations):
        set_inputs(legs, inputs, work)
        evaluate_rods(legs, x, work)
        set_residual(legs, x, load, work)
        set_inverse_matrix(legs, x, work)
        for row in range(size):
            work.vector[row] = -work.residual[row]
        if solve_linear(work.matrix, work.vector, size) == 0.0:
            return SINGULAR
        largest_input = 0.0
        for j in range(size):
            work.step[j] = work.vector[j] if j < pose else 0.0
            largest_input = max(largest_input, abs(work.vector[j]) if j >= pose else 0.0)
        correction = max(correction_size(legs, x, work), largest_input)
        if iteration == 0 and correction > rules.first_correction:
            return TOO_FAR
        if not correction <= max(rules.contraction * previous, ROUNDING):
            return DIVERGED
        for j in range(pose):
            x[j] += work.step[j]
        for i in range(legs.shape[0]):
            inputs[i] += work.vector[pose + i]
        if correction < LAST_CORRECTION:
            return CONVERGED
        previous = correction
    return ITERATION_LIMIT
