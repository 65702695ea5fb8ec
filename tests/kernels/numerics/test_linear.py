"""The small linear algebra against LAPACK."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from pcm_gym.kernels.numerics.linear import (
    Symmetric,
    determinant,
    diagonalize,
    eigenvalues_2,
    eigenvalues_3,
    null_vector,
    solve_linear,
    solve_symmetric,
)

ENTRIES = st.floats(-10.0, 10.0, allow_subnormal=False)
SIZES = st.integers(1, 10)
EPS = np.finfo(float).eps


@st.composite
def systems(draw: st.DrawFn) -> tuple[np.ndarray, np.ndarray]:
    size = draw(SIZES)
    return draw(arrays(float, (size, size), elements=ENTRIES)), draw(arrays(float, size, elements=ENTRIES))


@given(system=systems())
def test_solution_has_a_small_backward_error(system: tuple[np.ndarray, np.ndarray]) -> None:
    """Partial pivoting: the solution is that of a matrix nearby, whatever its condition (growth at most 2^(n - 1))."""
    matrix, right = system
    size = len(right)
    solution = right.copy()
    if not solve_linear(matrix.copy(), solution, size) or not np.isfinite(solution).all():
        assert np.linalg.cond(matrix) > 1e12
        return
    bound = 2.0 ** (size - 1) * size**2 * EPS * (np.abs(matrix).max() * np.abs(solution).max() + np.abs(right).max())
    assert np.abs(matrix @ solution - right).max() <= bound + 1e-300


@given(system=systems())
def test_solution_agrees_with_lapack(system: tuple[np.ndarray, np.ndarray]) -> None:
    matrix, right = system
    matrix = matrix + 40.0 * np.eye(len(right))[::-1]  # well conditioned, and no pivot on the diagonal
    condition = np.linalg.cond(matrix)
    solution = right.copy()
    assert solve_linear(matrix.copy(), solution, len(right))
    expected = np.linalg.solve(matrix, right)
    np.testing.assert_allclose(
        solution, expected, rtol=0.0, atol=100.0 * EPS * condition * (np.abs(expected).max() + 1e-12)
    )


@given(system=systems())
def test_only_the_leading_block_is_used(system: tuple[np.ndarray, np.ndarray]) -> None:
    matrix, right = system
    size = len(right)
    large, long = np.full((size + 2, size + 2), np.nan), np.full(size + 2, np.nan)
    large[:size, :size], long[:size] = matrix, right
    alone = right.copy()
    regular = solve_linear(matrix.copy(), alone, size)
    assert solve_linear(large, long, size) == regular
    if regular:
        np.testing.assert_array_equal(long[:size], alone)


@pytest.mark.parametrize(
    "matrix",
    [
        np.zeros((2, 2)),
        np.array([[1.0, 2.0], [2.0, 4.0]]),
        np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, 2.0, 3.0]]),
        np.array([[np.nan, 1.0], [1.0, 1.0]]),
        np.array([[1.0, np.nan], [1.0, 1.0]]),
    ],
)
def test_singular_or_undefined_matrix_is_reported(matrix: np.ndarray) -> None:
    assert not solve_linear(matrix.copy(), np.ones(len(matrix)), len(matrix))


def packed(matrix: np.ndarray) -> Symmetric:
    full = np.zeros((3, 3))
    full[: len(matrix), : len(matrix)] = matrix
    return Symmetric(full[0, 0], full[0, 1], full[1, 1], full[0, 2], full[1, 2], full[2, 2])


@st.composite
def symmetric_matrices(draw: st.DrawFn) -> np.ndarray:
    size = draw(st.sampled_from([2, 3]))
    matrix = draw(arrays(float, (size, size), elements=ENTRIES))
    matrix[np.abs(matrix) < 1e-120] = 0.0  # their squares would vanish; dimensionless stiffness is never so small
    return (matrix + matrix.T) * 2.0 ** draw(st.integers(-60, 60))


def eigenvalues(matrix: np.ndarray) -> np.ndarray:
    found = eigenvalues_2(packed(matrix)) if len(matrix) == 2 else eigenvalues_3(packed(matrix))
    return np.sort(np.array(found))


@given(matrix=symmetric_matrices())
def test_eigenvalues_agree_with_lapack(matrix: np.ndarray) -> None:
    expected = np.linalg.eigvalsh(matrix)
    np.testing.assert_allclose(eigenvalues(matrix), expected, rtol=0.0, atol=20.0 * EPS * np.abs(expected).max())


@pytest.mark.parametrize("matrix", [np.zeros((2, 2)), np.zeros((3, 3)), np.diag([1.0, -1.0]), np.eye(3), -np.eye(2)])
def test_eigenvalues_of_plain_matrices_are_exact(matrix: np.ndarray) -> None:
    np.testing.assert_array_equal(eigenvalues(matrix), np.sort(np.diag(matrix)))


@given(signs=arrays(float, 3, elements=st.sampled_from([-1.0, 1.0])), seed=st.integers(0, 2**32 - 1))
def test_signs_survive_a_wide_spread(signs: np.ndarray, seed: int) -> None:
    """Eigenvalues of 1, 1e-6 and 1e-12 in a turned basis: the index counts signs, also of the small ones."""
    for size in (2, 3):
        basis, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(size, size)))
        matrix = (basis * (signs * [1.0, 1e-6, 1e-12])[:size]) @ basis.T
        found = eigenvalues(0.5 * (matrix + matrix.T))
        assert (found < 0.0).sum() == (signs[:size] < 0.0).sum()


@given(matrix=symmetric_matrices(), right=arrays(float, 3, elements=ENTRIES))
def test_symmetric_solution_agrees_with_lapack(matrix: np.ndarray, right: np.ndarray) -> None:
    """By its adjugate: no pivoting, so the error may grow with the square of the condition number."""
    if len(matrix) == 2:
        matrix = np.block([[matrix, np.zeros((2, 1))], [np.zeros((1, 2)), np.array([[np.abs(matrix).max()]])]])
    if not np.abs(matrix).max() > 1e-60 or np.linalg.cond(matrix) > 1e6:
        return
    expected = np.linalg.solve(matrix, right)
    tolerance = 20.0 * EPS * np.linalg.cond(matrix) ** 2 * np.abs(expected).max()
    np.testing.assert_allclose(solve_symmetric(packed(matrix), *right), expected, rtol=0.0, atol=tolerance)


def test_symmetric_solution_of_a_singular_matrix_is_not_finite() -> None:
    for matrix in (np.zeros((3, 3)), np.diag([1.0, 2.0, 0.0]), np.ones((3, 3))):
        assert not np.isfinite(solve_symmetric(packed(matrix), 1.0, 2.0, 4.0)).all()


@pytest.mark.parametrize("size", [1, 2, 3, 6, 9])
def test_determinant_as_numpy(size: int) -> None:
    matrix = np.random.default_rng(size).normal(size=(size, size))
    assert determinant(matrix.copy(), size) == pytest.approx(np.linalg.det(matrix), rel=1e-12)


@pytest.mark.parametrize("size", [2, 3, 6, 9])
def test_null_vector_is_sent_to_zero(size: int) -> None:
    rng, found = np.random.default_rng(size), np.empty(size)
    matrix = rng.normal(size=(size, size - 1)) @ rng.normal(size=(size - 1, size))
    null_vector(matrix.copy(), size, found)
    tolerance = float(1e-11 * np.linalg.norm(found) * np.linalg.norm(matrix))
    np.testing.assert_allclose(matrix @ found, 0.0, atol=tolerance)


@pytest.mark.parametrize("eigenvalues", [(1.0, 2.0), (3.0, 3.0, 5.0), (1e6, -2.0, 1e-3)])
def test_diagonalize_finds_values_and_vectors(eigenvalues: tuple[float, ...]) -> None:
    turn, _ = np.linalg.qr(np.random.default_rng(0).normal(size=(len(eigenvalues), len(eigenvalues))))
    matrix = turn @ np.diag(eigenvalues) @ turn.T
    diagonal, vectors = 0.5 * (matrix + matrix.T), np.empty_like(matrix)
    diagonalize(diagonal, vectors)
    scale = max(map(abs, eigenvalues))
    np.testing.assert_allclose(np.sort(np.diag(diagonal)), np.sort(eigenvalues), atol=1e-14 * scale)
    np.testing.assert_allclose(vectors @ diagonal @ vectors.T, matrix, atol=1e-14 * scale)
