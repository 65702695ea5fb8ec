"""Folds and pitchforks of two rods by shooting and a bordered system: no elliptic function, no code of the package.

The unknowns of each rod are the curvature at its clamp and the force on its tip; its equation is integrated from the
clamp with steps of fourth order and those half as long, extrapolated, in complex numbers, so that derivatives are exact
to rounding. A singular point of the
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

_STEPS = 200
_COMPLEX_STEP, _DIFFERENCE = 1e-30, 1e-6
_NEWTON_STEPS = 20


class TwoRods(NamedTuple):
    """Two rods with a common tip; clamps and load are linear in s."""

    lengths: Array  # (2,)
    stiffnesses: Array  # (2,)
    clamps: Callable[[Complex], tuple[Complex, Complex, Complex]]  # x, y, angle, (..., 2) each, at s (...)
    load: Callable[[Complex], tuple[Complex, Complex]]


def residual(rods: TwoRods, z: Complex, s: Complex) -> Complex:
    """Return the errors (n, 6) of both hinges' moments, of the common tip and of the balance, (z, s) (n, 7)."""
    coarse, fine = (_integrated(rods, z, s, steps) for steps in (_STEPS, 2 * _STEPS))
    tip = fine + (fine - coarse) / 15.0
    load_x, load_y = rods.load(s)
    errors = [tip[3, :, 0], tip[3, :, 1], tip[0, :, 0] - tip[0, :, 1], tip[1, :, 0] - tip[1, :, 1]]
    balance = [z[:, 1::3].sum(axis=1) - load_x, z[:, 2::3].sum(axis=1) - load_y]
    return np.stack([*errors, *balance], axis=1)


def _integrated(rods: TwoRods, z: Complex, s: Complex, steps: int) -> Complex:
    """Return x, y, angle and curvature of both tips, (4, n, 2)."""
    force_x, force_y = z[:, 1::3] / rods.stiffnesses, z[:, 2::3] / rods.stiffnesses
    state = np.stack(np.broadcast_arrays(*rods.clamps(s), z[:, 0::3] + 0j))
    h = rods.lengths / steps

    def slope(at: Complex) -> Complex:
        rate = np.empty_like(at)
        rate[0], rate[1], rate[2] = np.cos(at[2]), np.sin(at[2]), at[3]
        rate[3] = rate[1] * force_x - rate[0] * force_y
        return rate

    for _ in range(steps):
        first = slope(state)
        second = slope(state + 0.5 * h * first)
        third = slope(state + 0.5 * h * second)
        fourth = slope(state + h * third)
        state = state + h / 6.0 * (first + 2.0 * second + 2.0 * third + fourth)
    return state


def _with_derivatives(rods: TwoRods, y: Array) -> tuple[Array, Array]:
    """Return residual (n, 6) and its derivative (n, 6, 7) at the places y (n, 7) = (z, s)."""
    steps = 1j * _COMPLEX_STEP * np.eye(7)
    moved = (y[:, None] + steps).reshape(-1, 7)
    value = residual(rods, moved[:, :6], moved[:, 6]).reshape(len(y), 7, 6)
    return value[:, 0].real, np.swapaxes(value.imag, 1, 2) / _COMPLEX_STEP


def singular_place(rods: TwoRods, z: Array, s: float) -> tuple[float, Array, float]:
    """Return s and z of the singular point near a guess, and the size of the last correction."""
    y, size = np.append(z, s), np.inf
    v = np.linalg.svd(_with_derivatives(rods, y[None])[1][0, :, :6])[2][-1]
    moves = _DIFFERENCE * np.eye(7)
    for _ in range(_NEWTON_STEPS):
        values, rates = _with_derivatives(rods, np.vstack([y, y + moves, y - moves]))
        by_z, by_s = rates[0, :, :6], rates[0, :, 6]
        second = (rates[1:8, :, :6] - rates[8:, :, :6]) @ v / (2.0 * _DIFFERENCE)  # derivatives of G_z v, (7, 6)
        matrix = np.zeros((13, 13))
        matrix[:6, :6], matrix[:6, 12] = by_z, by_s
        matrix[6:12, :6], matrix[6:12, 6:12], matrix[6:12, 12] = second[:6].T, by_z, second[6]
        matrix[12, 6:12] = 2.0 * v
        right = np.concatenate([values[0], by_z @ v, [v @ v - 1.0]])
        step = -np.linalg.lstsq(matrix, right, rcond=1e-7)[0]
        y, v, size = y + step[[0, 1, 2, 3, 4, 5, 12]], v + step[6:12], float(np.abs(step).max())
        if size < 1e-10:
            break
    return float(y[6]), y[:6], size
