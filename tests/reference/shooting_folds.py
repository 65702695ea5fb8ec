"""Folds and pitchforks of two rods by shooting and a bordered system: no elliptic function, no code of the package.

The unknowns of each rod are the curvature at its clamp and the force on its tip; its equation is integrated from the
clamp with steps of fourth order, in complex numbers, so that derivatives are exact to rounding. A singular point of the
equations G(z, s) = 0 along a line s of inputs and load solves the system of Moore and Spence,

    G(z, s) = 0,   G_z(z, s) v = 0,   v . v = 1,

by Newton's method. At a pitchfork it is singular across the symmetric states alone: the least correction stays in them.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pcm_gym.arrays import Array

Complex = NDArray[np.complex128]

_STEPS = 1500
_COMPLEX_STEP, _DIFFERENCE = 1e-30, 1e-6
_NEWTON_STEPS = 20


class TwoRods(NamedTuple):
    """Two rods with a common tip; clamps and load are linear in s."""

    lengths: Array  # (2,)
    stiffnesses: Array  # (2,)
    clamps: Callable[[Complex], tuple[Complex, Complex, Complex]]  # x, y, angle, (..., 2) each, at s (...)
    load: Callable[[Complex], tuple[Complex, Complex]]


def residual(rods: TwoRods, z: Complex, s: Complex) -> Complex:
    """Return the errors (n, 6) of both hinges' moments, of the common tip and of the balance, for z (n, 6)."""
    curvature, force_x, force_y = z[:, 0::3], z[:, 1::3], z[:, 2::3]
    x, y, angle = (np.array(part, dtype=complex) for part in rods.clamps(s))
    h = rods.lengths / _STEPS
    state = np.stack(np.broadcast_arrays(x, y, angle, curvature + 0j))

    def slope(at: Complex) -> Complex:
        c, si = np.cos(at[2]), np.sin(at[2])
        return np.stack([c, si, at[3], (si * force_x - c * force_y) / rods.stiffnesses])

    for _ in range(_STEPS):
        first = slope(state)
        second = slope(state + 0.5 * h * first)
        third = slope(state + 0.5 * h * second)
        fourth = slope(state + h * third)
        state = state + h / 6.0 * (first + 2.0 * second + 2.0 * third + fourth)
    load_x, load_y = rods.load(s)
    return np.stack(
        [
            state[3, :, 0],
            state[3, :, 1],
            state[0, :, 0] - state[0, :, 1],
            state[1, :, 0] - state[1, :, 1],
            force_x.sum(axis=1) - load_x,
            force_y.sum(axis=1) - load_y,
        ],
        axis=1,
    )


def _with_derivatives(rods: TwoRods, z: Array, s: float) -> tuple[Array, Array, Array]:
    """Return residual (6,), its derivative by z (6, 6) and by s (6,)."""
    steps = 1j * _COMPLEX_STEP * np.eye(7)
    moved = residual(rods, z + steps[:, :6], s + steps[:, 6])
    rates = moved.imag.T / _COMPLEX_STEP
    return moved[0].real, rates[:, :6], rates[:, 6]


def singular_place(rods: TwoRods, z: Array, s: float) -> tuple[float, Array, float]:
    """Return s and z of the singular point near a guess, and the size of the last correction."""
    _, by_z, _ = _with_derivatives(rods, z, s)
    v = np.linalg.svd(by_z)[2][-1]
    size = np.inf
    for _ in range(_NEWTON_STEPS):
        value, by_z, by_s = _with_derivatives(rods, z, s)
        second = np.empty((6, 7))  # derivatives of G_z v
        for k in range(7):
            move = _DIFFERENCE * np.eye(7)[k]
            above = _with_derivatives(rods, z + move[:6], s + move[6])[1]
            below = _with_derivatives(rods, z - move[:6], s - move[6])[1]
            second[:, k] = (above - below) @ v / (2.0 * _DIFFERENCE)
        matrix = np.zeros((13, 13))
        matrix[:6, :6], matrix[:6, 12] = by_z, by_s
        matrix[6:12, :6], matrix[6:12, 6:12], matrix[6:12, 12] = second[:, :6], by_z, second[:, 6]
        matrix[12, 6:12] = 2.0 * v
        right = np.concatenate([value, by_z @ v, [v @ v - 1.0]])
        step = -np.linalg.lstsq(matrix, right, rcond=1e-7)[0]
        z, v, s = z + step[:6], v + step[6:12], s + float(step[12])
        size = float(np.abs(step).max())
        if size < 1e-11:
            break
    return s, z, size
