"""Small dense linear algebra without allocation: one solver, one symmetric eigenvalue routine."""

import math

from numpy.typing import NDArray
import numpy as np

from pcm_gym.kernels.compilation import kernel

_JACOBI_SWEEPS = 12


@kernel
def solve_linear(matrix: NDArray[np.float64], right: NDArray[np.float64], size: int) -> float:
    """Solve matrix x = right in place (Gauss, partial pivoting); return the ratio of the least to the largest pivot.

    `matrix` (>= size, >= size) is destroyed, `right` (>= size) becomes x. At ratio 0 the matrix is singular and
    `right` is meaningless.
    """
    least, largest = math.inf, 0.0
    for column in range(size):
        pivot_row, pivot = column, abs(matrix[column, column])
        for row in range(column + 1, size):
            if abs(matrix[row, column]) > pivot:
                pivot_row, pivot = row, abs(matrix[row, column])
        least, largest = min(least, pivot), max(largest, pivot)
        if not pivot > 0.0:
            return 0.0
        if pivot_row != column:
            for j in range(column, size):
                matrix[column, j], matrix[pivot_row, j] = matrix[pivot_row, j], matrix[column, j]
            right[column], right[pivot_row] = right[pivot_row], right[column]
        inverse = 1.0 / matrix[column, column]
        for row in range(column + 1, size):
            factor = matrix[row, column] * inverse
            if factor != 0.0:
                for j in range(column + 1, size):
                    matrix[row, j] -= factor * matrix[column, j]
                right[row] -= factor * right[column]
    for row in range(size - 1, -1, -1):
        total = right[row]
        for j in range(row + 1, size):
            total -= matrix[row, j] * right[j]
        right[row] = total / matrix[row, row]
    return least / largest


@kernel
def symmetric_eigenvalues(matrix: NDArray[np.float64], size: int) -> None:
    """Turn the symmetric `matrix` (>= size, >= size) in place into a diagonal of its eigenvalues (cyclic Jacobi)."""
    for _ in range(_JACOBI_SWEEPS):
        off, total = 0.0, 0.0
        for i in range(size):
            total += abs(matrix[i, i])
            for j in range(i):
                off += abs(matrix[i, j])
        if off <= 1e-17 * total:
            return
        for i in range(size - 1):
            for j in range(i + 1, size):
                _rotate_away(matrix, size, i, j)


@kernel
def _rotate_away(matrix: NDArray[np.float64], size: int, i: int, j: int) -> None:
    off = matrix[i, j]
    if off == 0.0:
        return
    theta = 0.5 * (matrix[j, j] - matrix[i, i]) / off
    t = math.copysign(1.0, theta) / (abs(theta) + math.sqrt(theta * theta + 1.0))
    c = 1.0 / math.sqrt(t * t + 1.0)
    s = t * c
    matrix[i, i] -= t * off
    matrix[j, j] += t * off
    matrix[i, j] = matrix[j, i] = 0.0
    for n in range(size):
        if n != i and n != j:
            at_i, at_j = matrix[n, i], matrix[n, j]
            matrix[n, i] = matrix[i, n] = c * at_i - s * at_j
            matrix[n, j] = matrix[j, n] = s * at_i + c * at_j
