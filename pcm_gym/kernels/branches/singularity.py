"""Singular states: where the Jacobian of closure and equilibrium loses its rank.

The unknowns are y = (x, inputs), state and actuator inputs together: all equilibria of a mechanism with n inputs are
an n-dimensional manifold in them. A forward singularity, or fold, is where the Jacobian by (rods, pose) is singular, an
inverse singularity where that by (rods, inputs) is. The condition is the determinant of the full Jacobian, each rod's
columns taken relative to the change of its tip and force. It is smooth wherever the rods are, at straight rods too,
where their stiffness has poles.
"""

import math

import numpy as np

from pcm_gym.arrays import Array
from pcm_gym.kernels.numerics.compilation import kernel
from pcm_gym.kernels.numerics.linear import determinant, null_vector
from pcm_gym.kernels.statics.closure import (
    FORCE_G,
    FORCE_X,
    FORCE_Y,
    TIP_G,
    Workspace,
    add_input_derivative,
    make_workspace,
    place,
    set_inverse_matrix,
    set_matrix,
)
from pcm_gym.kernels.statics.stability import assess_stability

# Kinds of singularity.
FORWARD, INVERSE = range(2)

# Half width of the central differences of the condition, in lengths and relative forces.
_DIFFERENCE = 1e-5


@kernel
def set_unknowns(legs: Array, y: Array, work: Workspace) -> None:
    """Place the clamps and fill the rod table for the unknowns `y`."""
    size = y.shape[0] - legs.shape[0]
    place(legs, y[:size], y[size:], work)


@kernel
def force_scale(work: Workspace) -> float:
    """Return a smooth measure of the rods' forces, at least 1."""
    squared = 1.0
    for i in range(work.rods.shape[0]):
        squared += work.rods[i, FORCE_X] ** 2 + work.rods[i, FORCE_Y] ** 2
    return math.sqrt(squared)


@kernel
def rod_metric(work: Workspace, leg: int, scale: float) -> tuple[float, float, float]:
    """Return xx, xy, yy of the metric of g that measures the rod's change of tip, and of force over `scale`."""
    rods, weight = work.rods, 1.0 / (scale * scale)
    xx = xy = yy = 0.0
    for row in range(2):
        p_x, p_y = rods[leg, TIP_G + 2 * row], rods[leg, TIP_G + 2 * row + 1]
        q_x, q_y = rods[leg, FORCE_G + 2 * row], rods[leg, FORCE_G + 2 * row + 1]
        xx += p_x * p_x + weight * q_x * q_x
        xy += p_x * p_y + weight * q_x * q_y
        yy += p_y * p_y + weight * q_y * q_y
    return xx, xy, yy


@kernel
def _rod_extent(work: Workspace, leg: int, scale: float) -> float:
    """Return the area that the rod's tip and force, over `scale`, sweep per area of g; never zero."""
    rods, squared = work.rods, 0.0
    for first in range(4):
        a = rods[leg, TIP_G + 2 * first] if first < 2 else rods[leg, FORCE_G + 2 * first - 4] / scale
        b = rods[leg, TIP_G + 2 * first + 1] if first < 2 else rods[leg, FORCE_G + 2 * first - 3] / scale
        for second in range(first):
            c = rods[leg, TIP_G + 2 * second] if second < 2 else rods[leg, FORCE_G + 2 * second - 4] / scale
            d = rods[leg, TIP_G + 2 * second + 1] if second < 2 else rods[leg, FORCE_G + 2 * second - 3] / scale
            squared += (a * d - b * c) ** 2
    return math.sqrt(squared)


@kernel
def singularity(legs: Array, x: Array, kind: int, work: Workspace) -> float:
    """Return the scaled determinant of the state `x` at the rod table; zero exactly at a singular state.

    It is of order 1 and smaller.
    """
    size = x.shape[0]
    if kind == FORWARD:
        set_matrix(legs, x, work)
    else:
        set_inverse_matrix(legs, x, work)
    force = force_scale(work)
    scale = 1.0
    for _ in range(size - 2 * legs.shape[0]):
        scale *= force
    for i in range(legs.shape[0]):
        scale *= _rod_extent(work, i, force)
    return determinant(work.matrix, size) / scale


@kernel
def set_singularity_gradient(legs: Array, y: Array, kind: int, beside: Array, work: Workspace, out: Array) -> None:
    """Fill `out` with the derivative of `singularity` by `y`, by central differences; leaves the rod table beside y."""
    count = y.shape[0]
    pose, size = 2 * legs.shape[0], count - legs.shape[0]
    set_unknowns(legs, y, work)
    force = force_scale(work)
    beside[:] = y
    for i in range(legs.shape[0]):
        xx, _, yy = rod_metric(work, i, force)
        out[2 * i], out[2 * i + 1] = _DIFFERENCE / math.sqrt(xx), _DIFFERENCE / math.sqrt(yy)
    out[pose : pose + 2] = 0.0  # a shift of the end-effector changes closure alone
    out[pose + 2 : size] = _DIFFERENCE
    out[size:] = _DIFFERENCE
    for k in range(count):
        if out[k] == 0.0:
            continue
        beside[k] = y[k] + out[k]
        set_unknowns(legs, beside, work)
        above, width = singularity(legs, beside[:size], kind, work), beside[k]
        beside[k] = y[k] - out[k]
        set_unknowns(legs, beside, work)
        below, width = singularity(legs, beside[:size], kind, work), width - beside[k]
        out[k] = (above - below) / width
        beside[k] = y[k]


@kernel
def metric_length(legs: Array, vector: Array, out: Array, work: Workspace) -> float:
    """Return the length of a change of the unknowns at the rod table; fill `out` with metric times `vector`.

    It weighs each rod's change of tip and of force, relative to all forces, and the changes of pose and inputs.
    """
    pose, force, squared = 2 * legs.shape[0], force_scale(work), 0.0
    for i in range(legs.shape[0]):
        xx, xy, yy = rod_metric(work, i, force)
        out[2 * i] = xx * vector[2 * i] + xy * vector[2 * i + 1]
        out[2 * i + 1] = xy * vector[2 * i] + yy * vector[2 * i + 1]
    out[pose:] = vector[pose:]
    for j in range(vector.shape[0]):
        squared += out[j] * vector[j]
    return math.sqrt(max(squared, 0.0))


@kernel
def set_soft_direction(legs: Array, y: Array, work: Workspace, direction: Array) -> None:
    """Fill `direction` (like y) with the motion of the fold at the rod table: inputs held, of unit length."""
    size = y.shape[0] - legs.shape[0]
    set_matrix(legs, y[:size], work)
    direction[:] = 0.0
    null_vector(work.matrix, size, direction)
    direction /= metric_length(legs, direction, np.empty_like(direction), work)


@kernel
def set_normal(legs: Array, y: Array, kind: int, work: Workspace, normal: Array) -> None:
    """Fill `normal` with the unit normal of the singular set at the rod table, projected to inputs or to poses.

    It is that of inputs, (legs,), for a fold, that of poses, (d,), for an inverse singularity; not a number where the
    whole set has no extent there.
    """
    pose, size = 2 * legs.shape[0], y.shape[0] - legs.shape[0]
    force, left, column = force_scale(work), np.empty(size), np.empty(size)
    if kind == FORWARD:
        set_matrix(legs, y[:size], work)
    else:
        set_inverse_matrix(legs, y[:size], work)
    work.matrix[pose:size, :size] /= force  # forces of the size of lengths, for the choice of pivots
    null_vector(work.matrix[:size, :size].T.copy(), size, left)
    left[pose:] /= force
    if kind == INVERSE:
        set_matrix(legs, y[:size], work)
    for k in range(normal.shape[0]):
        if kind == FORWARD:
            column[:] = 0.0
            add_input_derivative(legs, y[:size], work, k, 1.0, column)
        else:
            column[:] = work.matrix[:size, pose + k]
        normal[k] = (left * column).sum()
    normal /= math.sqrt((normal * normal).sum())


def normal_at(legs: Array, y: Array, kind: int) -> Array:
    """Return what `set_normal` fills, (legs,), for the singular state `y`."""
    normal = np.empty(len(legs))
    _set_normal_at(legs, y, kind, normal)
    return normal


@kernel
def _set_normal_at(legs: Array, y: Array, kind: int, normal: Array) -> None:
    work = make_workspace(legs.shape[0], y.shape[0] - legs.shape[0])
    set_unknowns(legs, y, work)
    set_normal(legs, y, kind, work, normal)


@kernel
def fold_sides(legs: Array, y: Array, distance: float) -> tuple[int, int]:
    """Return the Morse indices on the two sides of the fold at `y`, the lesser first.

    They are those of the states `distance` away along the soft direction; near a cusp both may lie on one side.
    """
    size = y.shape[0] - legs.shape[0]
    work, direction = make_workspace(legs.shape[0], size), np.empty_like(y)
    set_unknowns(legs, y, work)
    set_soft_direction(legs, y, work, direction)
    set_unknowns(legs, y - distance * direction, work)
    first = assess_stability(legs, y[:size] - distance * direction[:size], work).morse_index
    set_unknowns(legs, y + distance * direction, work)
    second = assess_stability(legs, y[:size] + distance * direction[:size], work).morse_index
    return min(first, second), max(first, second)
