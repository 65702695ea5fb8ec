"""The equations of an equilibrium near a state, scaled so that their singular values mean something."""

import numpy as np

from pcm_gym.arrays import Array
from pcm_gym.kernels.numerics.compilation import kernel
from pcm_gym.kernels.statics.closure import (
    FORCE_G,
    FORCE_X,
    FORCE_Y,
    TIP_G,
    make_workspace,
    place,
    set_inverse_matrix,
    set_matrix,
    set_residual,
)
from pcm_gym.kernels.statics.states import Point

# A rod's load counts at least this much: one that moves nothing at all has no scale of its own.
_LEAST_EFFECT = 1e-300


def linearised(legs: Array, x: Array, inputs: Array, load: Array, is_inverse: bool) -> tuple[Array, Array, Array]:
    """Return residual, its Jacobian by what is not given, and the units of that, scaled.

    Forces and moments are relative to 1 + the largest rod force. The unit of a rod's load is the change that moves its
    tip by 1 or its force by that: so taut rods, which answer to a sideways load like exp(rho), count as others do.

    Returns
    -------
    residual : array (n,)
    matrix : array (n, n)
        By the rods' loads, then by the pose or, where that is given, by the inputs, in their units.
    units : array (n,)
    """
    size = len(x)
    residual, matrix, units = np.empty(size), np.empty((size, size)), np.ones(size)
    _linearise(legs, Point(x, inputs, load), is_inverse, residual, matrix, units)
    return residual, matrix, units


@kernel
def _linearise(legs: Array, point: Point, is_inverse: bool, residual: Array, matrix: Array, units: Array) -> None:
    x, inputs, load = point.x, point.inputs, point.load
    leg_count, size = legs.shape[0], x.shape[0]
    pose = 2 * leg_count
    work = make_workspace(leg_count, size)
    place(legs, x, inputs, work)
    set_residual(legs, x, load, work)
    if is_inverse:
        set_inverse_matrix(legs, x, work)
    else:
        set_matrix(legs, x, work)
    force = 1.0
    for leg in range(leg_count):
        force = max(force, 1.0 + abs(work.rods[leg, FORCE_X]), 1.0 + abs(work.rods[leg, FORCE_Y]))
    for leg in range(leg_count):
        row = work.rods[leg]
        for k in range(2):
            tip = max(abs(row[TIP_G + k]), abs(row[TIP_G + 2 + k]))
            own = max(abs(row[FORCE_G + k]), abs(row[FORCE_G + 2 + k])) / force
            units[2 * leg + k] = 1.0 / max(tip, own, _LEAST_EFFECT)
    residual[:], matrix[:] = work.residual, work.matrix[:size, :size]
    residual[pose:] /= force
    matrix[pose:] /= force
    matrix *= units
