"""What is known of one equilibrium: residual, stability, energy, Jacobian and shape."""

import numpy as np

from pcm_gym.arrays import Array
from pcm_gym.kernels.numerics.compilation import kernel
from pcm_gym.kernels.rods.rod import rod_energy, rod_parameters, rod_shape
from pcm_gym.kernels.statics.closure import (
    LENGTH,
    STIFFNESS,
    Workspace,
    add_input_derivative,
    make_workspace,
    place,
    set_inputs,
    set_residual,
    solve_equilibrium_system,
)
from pcm_gym.kernels.statics.margin import singularity_margin
from pcm_gym.kernels.statics.stability import assess_stability


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
        regular = solve_equilibrium_system(legs, x, rate, work) and regular
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
    place(legs, x, inputs, work)
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
            singularity_margin(legs, x, work),
        ]
    )
    k = verdict.stiffness
    full = np.array([[k.xx, k.xy, k.xz], [k.xy, k.yy, k.yz], [k.xz, k.yz, k.zz]])
    return scalars, rods, full[:dof, :dof].copy(), jacobian, verdict.morse_index, regular


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
