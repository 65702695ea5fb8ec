"""Stability of an equilibrium: stiffness, Morse index and margin, exact and without discretisation."""

import math
from typing import NamedTuple

from pcm_gym.arrays import Array
from pcm_gym.kernels.numerics.compilation import kernel
from pcm_gym.kernels.numerics.linear import Symmetric, eigenvalues_2, eigenvalues_3
from pcm_gym.kernels.statics.closure import (
    DEAD_LOAD_INDEX,
    TIP_G,
    Workspace,
    evaluate_rods,
    pole_distance,
    set_leg_stiffness,
    stiffness,
    stiffness_of,
)
from pcm_gym.kernels.statics.formulas import judge_eigenvalues, rod_index

# Nearer than this to a pole the entries of the stiffness say nothing any more.
_POLE_LIMIT = 1e-14
# Sideways displacement, in lengths of the rod, by which a rod is moved off a pole of its stiffness.
_NUDGE = 1e-5


class Stability(NamedTuple):
    """Verdict on one equilibrium."""

    morse_index: int  # unstable directions of the total energy under the closure constraints
    stability_margin: float  # least eigenvalue of K; of a stable state, zero exactly at the loss of stability
    stiffness: Symmetric  # K; of a point end-effector its upper left corner


@kernel
def assess_stability(legs: Array, x: Array, work: Workspace) -> Stability:
    """Return index and margin from the rod table of the equilibrium `x`.

    index = n_minus(K) + sum (zeros of eta - n_minus(A)) over the legs (A: stiffness of one rod at its tip). The sum is
    unchanged across a pole of A, so at a pole the rods are judged a hair beside it.
    """
    if set_leg_stiffness(legs, work) > _POLE_LIMIT:
        return judge_stiffness(legs, x, work)
    table = work.rods.copy()
    _evaluate_beside_poles(legs, x, work)
    work.rods[:, :TIP_G] = table[:, :TIP_G]  # the tips and forces themselves are not in doubt
    verdict = judge_stiffness(legs, x, work)
    work.rods[:] = table
    return verdict


@kernel
def judge_stiffness(legs: Array, x: Array, work: Workspace) -> Stability:
    """Return the verdict from the legs' stiffness and the arms, forces and indices in the rod table."""
    matrix = stiffness(legs, x, work)
    index = 0
    for i in range(legs.shape[0]):
        index += int(rod_index(work.rods[i, DEAD_LOAD_INDEX], stiffness_of(work, i)))
    if x.shape[0] - 2 * legs.shape[0] == 2:
        first, second = eigenvalues_2(matrix)
        third = math.inf
    else:
        first, second, third = eigenvalues_3(matrix)
    negative, stability_margin = judge_eigenvalues(first, second, third)
    return Stability(index + int(negative), stability_margin, matrix)


@kernel
def _evaluate_beside_poles(legs: Array, x: Array, work: Workspace) -> None:
    """Fill rod table and legs' stiffness with each rod at a pole moved sideways by about `_NUDGE`."""
    beside = x.copy()
    for i in range(legs.shape[0]):
        if pole_distance(work, i) < _POLE_LIMIT:
            g_x, g_y = x[2 * i], x[2 * i + 1]
            load = max(math.hypot(g_x, g_y), 1.0)
            # taut rods answer to a sideways load like exp(rho)
            beside[2 * i + 1] = g_y + _NUDGE * load * (math.exp(-math.sqrt(load)) if g_x > 0.0 else 1.0)
    evaluate_rods(legs, beside, work)
    set_leg_stiffness(legs, work)
