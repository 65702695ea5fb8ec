"""The set of folds in the space of the loads, at constant inputs: its normal."""

import math

import numpy as np

from pcm_gym.arrays import Array
from pcm_gym.kernels.branches.singularity import force_scale, set_unknowns
from pcm_gym.kernels.numerics.compilation import kernel
from pcm_gym.kernels.numerics.linear import null_vector
from pcm_gym.kernels.statics.closure import make_workspace, set_matrix


def load_normal_at(legs: Array, y: Array) -> Array:
    """Return the unit normal of the set of folds in the space of the loads, (d,), at the fold `y`, up to its sign.

    The load enters the equilibrium of the end-effector alone, so it is what the left null vector of the Jacobian has
    there: the end-effector's own motion in the fold, because the stiffness is symmetric.
    """
    normal = np.empty(len(y) - 3 * len(legs))
    _set_load_normal_at(legs, y, normal)
    return normal


@kernel
def _set_load_normal_at(legs: Array, y: Array, normal: Array) -> None:
    pose, size = 2 * legs.shape[0], y.shape[0] - legs.shape[0]
    work, left = make_workspace(legs.shape[0], size), np.empty(size)
    set_unknowns(legs, y, work)
    set_matrix(legs, y[:size], work)
    work.matrix[pose:size, :size] /= force_scale(work)  # forces of the size of lengths, for the choice of pivots
    null_vector(work.matrix[:size, :size].T.copy(), size, left)
    normal[:] = left[pose:]
    normal /= math.sqrt((normal * normal).sum())
