"""Verdicts on lanes that are evaluated: errors, Morse index, stability margin, eigenvalues and axes."""

import math

from pcm_gym.kernels.lockstep.layout import Block, CommonLanes, set_symmetric, set_vector, symmetric, triple, vectors
from pcm_gym.kernels.numerics.compilation import formula, kernel
from pcm_gym.kernels.numerics.linear import (
    JACOBI_SWEEPS,
    Symmetric,
    Vector,
    eigenvalues_2,
    is_diagonal,
    jacobi_sweep,
)
from pcm_gym.kernels.statics.formulas import balance_error, judge_eigenvalues, negative_eigenvalues, rod_index


@formula
def residual(common: CommonLanes, lane: int) -> float:
    """Return the largest error of a lane, as `judge` of `continuation` does."""
    error: float = max(
        common.closure_error[lane], balance_error(triple(common.right, lane), common.largest_force[lane])
    )
    return error


@kernel
def set_index(block: Block, count: int) -> None:
    """Fill the Morse index from rods and stiffness, without eigenvalues."""
    common = block.common[0]
    for lane in range(count):
        common.index[lane] = negative_eigenvalues(symmetric(common.stiffness, lane))
    _add_rod_indices(block, count)


@kernel
def _add_rod_indices(block: Block, count: int) -> None:
    common = block.common[0]
    for i in range(block.legs.shape[0]):
        leg = block.legs[i]
        for lane in range(count):
            common.index[lane] += rod_index(leg.dead_load_index[lane], triple(leg.stiffness, lane))


@kernel
def judge_block(block: Block, count: int, dof: int) -> None:
    """Fill Morse index, stability margin, eigenvalues and axes of the stiffness from rods and stiffness."""
    common = block.common[0]
    _diagonalise(common, count, dof)
    for lane in range(count):
        diagonal = symmetric(common.eigenvalues, lane)
        first, second, third = diagonal.xx, diagonal.yy, diagonal.zz
        if dof == 2:
            first, second = eigenvalues_2(symmetric(common.stiffness, lane))
            third = math.inf
        negative, stability_margin = judge_eigenvalues(first, second, third)
        common.index[lane] = negative
        common.stability_margin[lane] = stability_margin
    _add_rod_indices(block, count)


@kernel
def _diagonalise(common: CommonLanes, count: int, dof: int) -> None:
    """Fill `eigenvalues` with K turned into a diagonal matrix, and `axes` with its eigenvectors.

    A matrix of two rows is diagonal after one turn.
    """
    common.eigenvalues[:] = common.stiffness
    common.axes[:] = 0.0
    for n in range(3):
        common.axes[n, n] = 1.0
    for _ in range(JACOBI_SWEEPS if dof == 3 else 1):
        left = 0
        for lane in range(count):
            before, axes = symmetric(common.eigenvalues, lane), vectors(common.axes, lane)
            is_done = is_diagonal(before)
            after, turned_axes = jacobi_sweep(before, axes)
            set_symmetric(common.eigenvalues, lane, _either_matrix(is_done, before, after))
            set_vector(common.axes, 0, lane, _either(is_done, axes[0], turned_axes[0]))
            set_vector(common.axes, 1, lane, _either(is_done, axes[1], turned_axes[1]))
            set_vector(common.axes, 2, lane, _either(is_done, axes[2], turned_axes[2]))
            left += 0 if is_done else 1
        if left == 0:
            break


@formula
def _either(condition: bool, first: Vector, second: Vector) -> Vector:
    return (
        first[0] if condition else second[0],
        first[1] if condition else second[1],
        first[2] if condition else second[2],
    )


@formula
def _either_matrix(condition: bool, first: Symmetric, second: Symmetric) -> Symmetric:
    return Symmetric(
        first.xx if condition else second.xx,
        first.xy if condition else second.xy,
        first.yy if condition else second.yy,
        first.xz if condition else second.xz,
        first.yz if condition else second.yz,
        first.zz if condition else second.zz,
    )
