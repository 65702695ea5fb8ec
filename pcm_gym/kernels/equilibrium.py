"""What is known of one equilibrium: residual, stability, energy, Jacobian; and a search from many starts."""

import numpy as np
from numpy.typing import NDArray

from pcm_gym.kernels.closure import (
    LENGTH,
    STIFFNESS,
    TIP_X,
    TIP_Y,
    Workspace,
    add_input_derivative,
    evaluate_rods,
    make_workspace,
    set_inputs,
    set_residual,
    solve_equilibrium_system,
)
from pcm_gym.kernels.compilation import kernel
from pcm_gym.kernels.newton import CONVERGED, NewtonRules, solve_forward_locally
from pcm_gym.kernels.rod import rod_energy, rod_parameters, rod_shape
from pcm_gym.kernels.stability import assess_stability

Array = NDArray[np.float64]

_SEARCH_RULES = NewtonRules(first_correction=np.inf, contraction=1e3, iterations=40)


@kernel
def total_energy(legs: Array, x: Array, load: Array) -> float:
    """Return the rods' bending energy less the work of the load on the end-effector."""
    pose = 2 * legs.shape[0]
    energy = 0.0
    for i in range(legs.shape[0]):
        energy += legs[i, STIFFNESS] / legs[i, LENGTH] * rod_energy(x[2 * i], x[2 * i + 1])
    for d in range(x.shape[0] - pose):
        energy -= load[d] * x[pose + d]
    return energy


@kernel
def set_forward_jacobian(legs: Array, x: Array, work: Workspace, jacobian: Array) -> bool:
    """Fill `jacobian` (d, legs) with d pose / d inputs at the rod table; return False where it does not exist."""
    pose, regular = 2 * legs.shape[0], True
    rate = np.zeros(x.shape[0])
    for i in range(legs.shape[0]):
        rate[:] = 0.0
        add_input_derivative(legs, x, work, i, 1.0, rate)
        regular = solve_equilibrium_system(legs, x, rate, work) > 0.0 and regular
        jacobian[:, i] = work.step[pose:]
    return regular and bool(np.isfinite(jacobian).all())


@kernel
def describe_equilibrium(
    legs: Array, x: Array, inputs: Array, load: Array
) -> tuple[Array, Array, Array, Array, int, bool]:
    """Return everything known of the equilibrium `x` at `inputs` under `load`.

    Returns
    -------
    scalars : array (4,)
        Energy, residual, stability margin, singularity margin.
    rods : array (legs, 6)
        Per rod the paper's k, psi, mode and rho, then the tip force in the world frame.
    stiffness : array (d, d)
    jacobian : array (d, legs)
    index : int
    is_regular : bool
        Whether the Jacobian exists.
    """
    size, leg_count = x.shape[0], legs.shape[0]
    dof = size - 2 * leg_count
    work = make_workspace(leg_count, size)
    set_inputs(legs, inputs, work)
    evaluate_rods(legs, x, work)
    closure_error, force_error = set_residual(legs, x, load, work)
    rods = np.zeros((leg_count, 6))
    for i in range(leg_count):
        modulus, psi, mode, rho = rod_parameters(x[2 * i], x[2 * i + 1])
        rods[i, 0], rods[i, 1], rods[i, 2], rods[i, 3] = modulus, psi, mode, rho
        rods[i, 4:6] = work.rods[i, 2:4]
    jacobian = np.zeros((dof, leg_count))
    regular = set_forward_jacobian(legs, x, work, jacobian)
    verdict = assess_stability(legs, x, work)
    scalars = np.array(
        [
            total_energy(legs, x, load),
            max(closure_error, force_error),
            verdict.stability_margin,
            verdict.singularity_margin,
        ]
    )
    return scalars, rods, work.stiffness[:dof, :dof].copy(), jacobian, verdict.morse_index, regular


@kernel
def set_world_shapes(legs: Array, x: Array, inputs: Array, shapes: Array) -> None:
    """Fill `shapes` (legs, points, 2) with the rods' centre lines, base to tip, world frame."""
    work = make_workspace(legs.shape[0], x.shape[0])
    set_inputs(legs, inputs, work)
    for i in range(legs.shape[0]):
        shape = shapes[i]
        rod_shape(x[2 * i], x[2 * i + 1], shape)
        c, s = legs[i, LENGTH] * work.clamps[i, 2], legs[i, LENGTH] * work.clamps[i, 3]
        for n in range(shape.shape[0]):
            along, across = shape[n, 0], shape[n, 1]
            shape[n, 0] = work.clamps[i, 0] + c * along - s * across
            shape[n, 1] = work.clamps[i, 1] + s * along + c * across


@kernel
def search_forward(legs: Array, inputs: Array, load: Array, starts: Array, found: Array) -> int:
    """Correct each of `starts` (m, size) by Newton's method; put those that converge first in `found`, return how many.

    Only the rods of a start are used: its pose is taken from the tips of its rods.
    """
    leg_count, size = legs.shape[0], starts.shape[1]
    work = make_workspace(leg_count, size)
    count = 0
    for n in range(starts.shape[0]):
        x = found[count]
        x[:] = starts[n]
        set_inputs(legs, inputs, work)
        evaluate_rods(legs, x, work)
        pose = 2 * leg_count
        x[pose:] = 0.0
        for i in range(leg_count):
            x[pose] += (work.clamps[i, 0] + work.rods[i, TIP_X]) / leg_count
            x[pose + 1] += (work.clamps[i, 1] + work.rods[i, TIP_Y]) / leg_count
        if size - pose == 3:
            x[pose + 2] = starts[n, pose + 2]
        if solve_forward_locally(legs, inputs, load, x, _SEARCH_RULES, work) == CONVERGED:
            count += 1
            if count == found.shape[0]:
                return count
    return count
