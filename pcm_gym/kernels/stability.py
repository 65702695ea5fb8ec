"""Stability of an equilibrium: stiffness, Morse index and margin, exact and without discretisation."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pcm_gym.kernels.closure import (
    DEAD_LOAD_INDEX,
    TIP_G,
    Workspace,
    evaluate_rods,
    is_condensable,
    set_leg_stiffness,
    set_stiffness,
)
from pcm_gym.kernels.compilation import kernel
from pcm_gym.kernels.linear import symmetric_eigenvalues

Array = NDArray[np.float64]

# Sideways displacement, in lengths of the rod, by which a rod is moved off a pole of its stiffness.
_NUDGE = 1e-5


class Stability(NamedTuple):
    """Verdict on one equilibrium; the stiffness itself is in the workspace."""

    morse_index: int  # unstable directions of the total energy under the closure constraints
    stability_margin: float  # least eigenvalue of K; of a stable state, zero exactly at the loss of stability
    singularity_margin: float  # least absolute eigenvalue of K: zero exactly at a fold


@kernel
def assess_stability(legs: Array, x: Array, work: Workspace) -> Stability:
    """Return index and margins from the rod table of the equilibrium `x`, and fill `work.stiffness`.

    index = n_minus(K) + sum (zeros of eta - n_minus(A)) over the legs (A: stiffness of one rod at its tip). The sum is
    unchanged across a pole of A, so at a pole the rods are judged a hair beside it.
    """
    if not set_leg_stiffness(legs, work):
        _evaluate_beside_poles(legs, x, work)
    set_stiffness(legs, x, work)
    dof = x.shape[0] - 2 * legs.shape[0]
    for d in range(dof):
        for e in range(dof):
            work.small_matrix[d, e] = work.stiffness[d, e]
    symmetric_eigenvalues(work.small_matrix, dof)
    index, least, least_absolute = 0, math.inf, math.inf
    for d in range(dof):
        eigenvalue = work.small_matrix[d, d]
        least, least_absolute = min(least, eigenvalue), min(least_absolute, abs(eigenvalue))
        if eigenvalue < 0.0:
            index += 1
    for i in range(legs.shape[0]):
        index += int(work.rods[i, DEAD_LOAD_INDEX]) - _negative_directions(work.leg_stiffness[i])
    return Stability(index, least, least_absolute)


@kernel
def _negative_directions(leg_stiffness: Array) -> int:
    a_xx, a_xy, a_yy = leg_stiffness[0], leg_stiffness[1], leg_stiffness[2]
    if a_xx * a_yy - a_xy * a_xy < 0.0:
        return 1
    return 2 if a_xx + a_yy < 0.0 else 0


@kernel
def _evaluate_beside_poles(legs: Array, x: Array, work: Workspace) -> None:
    """Set the legs' stiffness with each rod at a pole moved sideways by about `_NUDGE`; tips and forces are kept."""
    beside = x.copy()
    for i in range(legs.shape[0]):
        if not is_condensable(work, i):
            g_x, g_y = x[2 * i], x[2 * i + 1]
            load = max(math.hypot(g_x, g_y), 1.0)
            # taut rods answer to a sideways load like exp(rho)
            beside[2 * i + 1] = g_y + _NUDGE * load * (math.exp(-math.sqrt(load)) if g_x > 0.0 else 1.0)
    forces = work.rods[:, :TIP_G].copy()
    evaluate_rods(legs, beside, work)
    set_leg_stiffness(legs, work)
    work.rods[:, :TIP_G] = forces
