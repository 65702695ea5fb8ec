"""Small dense linear algebra without allocation: a general solver, and symmetric 3 x 3 matrices as six numbers."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pcm_gym.kernels.numerics.compilation import formula, kernel

JACOBI_SWEEPS = 10

Vector = tuple[float, float, float]
# The eigenvectors that belong to xx, yy and zz of a matrix that is being made diagonal.
Axes = tuple[Vector, Vector, Vector]
IDENTITY: Axes = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


class Symmetric(NamedTuple):
    """A symmetric 3 x 3 matrix by (x, y, z); a 2 x 2 one is its upper left corner."""

    xx: float
    xy: float
    yy: float
    xz: float
    yz: float
    zz: float


@kernel
def solve_linear(matrix: NDArray[np.float64], right: NDArray[np.float64], size: int) -> bool:
    """Solve matrix x = right in place (Gauss, partial pivoting); return False where a pivot is zero or not finite.

    `matrix` (>= size, >= size) is destroyed, `right` (>= size) becomes x.
    """
    for column in range(size):
        pivot_row, pivot = column, abs(matrix[column, column])
        for row in range(column + 1, size):
            if abs(matrix[row, column]) > pivot:
                pivot_row, pivot = row, abs(matrix[row, column])
        if not 0.0 < pivot < math.inf:
            return False
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
    return True


@kernel
def determinant(matrix: NDArray[np.float64], size: int) -> float:
    """Return the determinant of the first `size` rows and columns of `matrix`, which is destroyed."""
    product = 1.0
    for column in range(size):
        best = column
        for row in range(column + 1, size):
            if abs(matrix[row, column]) > abs(matrix[best, column]):
                best = row
        pivot = matrix[best, column]
        if pivot == 0.0:
            return 0.0
        if best != column:
            product = -product
            for j in range(column, size):
                matrix[column, j], matrix[best, j] = matrix[best, j], matrix[column, j]
        product *= pivot
        for row in range(column + 1, size):
            factor = matrix[row, column] / pivot
            for j in range(column + 1, size):
                matrix[row, j] -= factor * matrix[column, j]
    return product


@kernel
def null_vector(matrix: NDArray[np.float64], size: int, out: NDArray[np.float64]) -> None:
    """Fill `out` (size,) with the direction that a singular matrix sends to zero, by full pivoting.

    `matrix` is destroyed. Of a regular one it is the direction that belongs to the last pivot.
    """
    order = np.arange(size)
    for column in range(size - 1):
        best_row, best_column = column, column
        for row in range(column, size):
            for j in range(column, size):
                if abs(matrix[row, j]) > abs(matrix[best_row, best_column]):
                    best_row, best_column = row, j
        for j in range(size):
            matrix[column, j], matrix[best_row, j] = matrix[best_row, j], matrix[column, j]
        for row in range(size):
            matrix[row, column], matrix[row, best_column] = matrix[row, best_column], matrix[row, column]
        order[column], order[best_column] = order[best_column], order[column]
        for row in range(column + 1, size):
            factor = matrix[row, column] / matrix[column, column]
            for j in range(column, size):
                matrix[row, j] -= factor * matrix[column, j]
    out[order[size - 1]] = 1.0
    for row in range(size - 2, -1, -1):
        total = matrix[row, size - 1]
        for j in range(row + 1, size - 1):
            total += matrix[row, j] * out[order[j]]
        out[order[row]] = -total / matrix[row, row]


@kernel
def eliminate(table: NDArray[np.float64], size: int, columns: int) -> bool:
    """Turn the first `size` columns of `table` into the identity (Gauss-Jordan), and the other `columns` with them.

    Returns False where the matrix is singular.
    """
    for column in range(size):
        best = column
        for row in range(column + 1, size):
            if abs(table[row, column]) > abs(table[best, column]):
                best = row
        if not abs(table[best, column]) > 0.0:
            return False
        if best != column:
            for k in range(columns):
                table[column, k], table[best, k] = table[best, k], table[column, k]
        inverse = 1.0 / table[column, column]
        for k in range(column, columns):
            table[column, k] *= inverse
        for row in range(size):
            factor = table[row, column]
            if row != column and factor != 0.0:
                for k in range(column, columns):
                    table[row, k] -= factor * table[column, k]
    return True


@formula
def solve_symmetric(a: Symmetric, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Return the solution of a symmetric 3 x 3 system by its adjugate; not finite where the matrix is singular."""
    (x, y, z), determinant = adjugate_times(a, x, y, z)
    inverse = 1.0 / determinant
    return x * inverse, y * inverse, z * inverse


@formula
def adjugate_times(a: Symmetric, x: float, y: float, z: float) -> tuple[tuple[float, float, float], float]:
    """Return the adjugate of a symmetric 3 x 3 matrix times a vector, and the determinant; finite of any matrix."""
    c_xx = a.yy * a.zz - a.yz * a.yz
    c_xy = a.xz * a.yz - a.xy * a.zz
    c_xz = a.xy * a.yz - a.xz * a.yy
    c_yy = a.xx * a.zz - a.xz * a.xz
    c_yz = a.xy * a.xz - a.xx * a.yz
    c_zz = a.xx * a.yy - a.xy * a.xy
    product = (c_xx * x + c_xy * y + c_xz * z, c_xy * x + c_yy * y + c_yz * z, c_xz * x + c_yz * y + c_zz * z)
    return product, a.xx * c_xx + a.xy * c_xy + a.xz * c_xz


@formula
def principal_minors(a: Symmetric) -> float:
    """Return the sum of the principal minors of two rows: that of the products of two eigenvalues."""
    return a.xx * a.yy - a.xy * a.xy + a.xx * a.zz - a.xz * a.xz + a.yy * a.zz - a.yz * a.yz


@formula
def trace_of_inverse(a: Symmetric) -> float:
    """Return the sum of the inverse eigenvalues."""
    _, determinant = adjugate_times(a, 0.0, 0.0, 0.0)
    return principal_minors(a) / determinant


@formula
def eigenvalues_2(a: Symmetric) -> tuple[float, float]:
    """Return the eigenvalues of the upper left 2 x 2 corner, the lesser first."""
    mean, half = 0.5 * (a.xx + a.yy), 0.5 * (a.xx - a.yy)
    radius = math.sqrt(half * half + a.xy * a.xy)
    outer = mean + radius if mean > 0.0 else mean - radius
    # the smaller in absolute value from the determinant, where the difference would lose its digits
    inner = (a.xx * a.yy - a.xy * a.xy) / outer if mean != 0.0 else radius
    return (inner, outer) if mean > 0.0 else (outer, inner)


@kernel
def eigenvalues_3(a: Symmetric) -> tuple[float, float, float]:
    """Return the eigenvalues, in no particular order, by Jacobi's rotations."""
    for _ in range(JACOBI_SWEEPS):
        if is_diagonal(a):
            break
        a, _ = jacobi_sweep(a, IDENTITY)
    return a.xx, a.yy, a.zz


@kernel
def diagonalize(matrix: NDArray[np.float64], vectors: NDArray[np.float64]) -> None:
    """Turn a symmetric `matrix` (n, n) into the diagonal one of its eigenvalues; column k of `vectors` belongs to k."""
    size = matrix.shape[0]
    for i in range(size):
        for j in range(size):
            vectors[i, j] = 1.0 if i == j else 0.0
    for _ in range(JACOBI_SWEEPS):
        for i in range(size):
            for j in range(i + 1, size):
                c, s, _ = rotation(matrix[i, i], matrix[j, j], matrix[i, j])
                for k in range(size):
                    matrix[k, i], matrix[k, j] = (
                        c * matrix[k, i] - s * matrix[k, j],
                        s * matrix[k, i] + c * matrix[k, j],
                    )
                    vectors[k, i], vectors[k, j] = (
                        c * vectors[k, i] - s * vectors[k, j],
                        s * vectors[k, i] + c * vectors[k, j],
                    )
                for k in range(size):
                    matrix[i, k], matrix[j, k] = (
                        c * matrix[i, k] - s * matrix[j, k],
                        s * matrix[i, k] + c * matrix[j, k],
                    )
                matrix[i, j] = matrix[j, i] = 0.0
        off = 0.0
        for i in range(size):
            for j in range(i):
                off += abs(matrix[i, j])
        if off == 0.0:
            break


@formula
def is_diagonal(a: Symmetric) -> bool:
    """Return whether the matrix is diagonal to rounding."""
    return abs(a.xy) + abs(a.xz) + abs(a.yz) <= 1e-17 * (abs(a.xx) + abs(a.yy) + abs(a.zz))


@formula
def jacobi_sweep(a: Symmetric, axes: Axes) -> tuple[Symmetric, Axes]:
    """Return the matrix after three rotations, each of which makes one off-diagonal element vanish, and turned axes."""
    xx, xy, yy, xz, yz, zz = a
    first, second, third = axes
    c, s, shift = rotation(xx, yy, xy)
    xx, yy = xx - shift, yy + shift
    xz, yz = c * xz - s * yz, s * xz + c * yz
    first, second = _turned(first, second, c, s)
    c, s, shift = rotation(xx, zz, xz)
    xx, zz = xx - shift, zz + shift
    xy, yz = -s * yz, c * yz
    first, third = _turned(first, third, c, s)
    c, s, shift = rotation(yy, zz, yz)
    second, third = _turned(second, third, c, s)
    return Symmetric(xx, c * xy, yy - shift, s * xy, 0.0, zz + shift), (first, second, third)


@formula
def _turned(first: Vector, second: Vector, c: float, s: float) -> tuple[Vector, Vector]:
    return (
        (c * first[0] - s * second[0], c * first[1] - s * second[1], c * first[2] - s * second[2]),
        (s * first[0] + c * second[0], s * first[1] + c * second[1], s * first[2] + c * second[2]),
    )


@formula
def rotation(first: float, second: float, off: float) -> tuple[float, float, float]:
    """Return cosine, sine and shift of the diagonal of the rotation that makes `off` vanish.

    The eigenvectors of the 2 x 2 matrix are (cosine, -sine), of `first` - shift, and (sine, cosine).
    """
    theta = 0.5 * (second - first) / off
    t = math.copysign(1.0, theta) / (abs(theta) + math.sqrt(theta * theta + 1.0))
    t = t if off != 0.0 else 0.0
    c = 1.0 / math.sqrt(t * t + 1.0)
    return c, t * c, t * off
