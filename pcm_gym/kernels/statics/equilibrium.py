"""What is known of one equilibrium: residual, stability, energy, Jacobian and shape."""

import numpy as np

from pcm_gym.arrays import Array
from pcm_gym.kernels.numerics.compilation import kernel
from pcm_gym.kernels.rods.rod import rod_energy, rod_parameters, rod_shape
from pcm_gym.kernels.statics.closure import (
    CLAMP_COS,
    CLAMP_X,
    FORCE_X,
    FORCE_Y,
    LENGTH,
    STIFFNESS,
    Workspace,
    add_input_derivative,
    make_workspace,
    pair,
    place,
    set_inputs,
    set_residual,
    solve_equilibrium_system,
)
from pcm_gym.kernels.statics.formulas import scaled, turned
from pcm_gym.kernels.statics.margin import singularity_margin
from pcm_gym.kernels.statics.stability import assess_stability
from pcm_gym.kernels.statics.states import Point

# Entries of the scalars and columns of the rods that `describe_equilibrium` returns.
ENERGY, RESIDUAL, STABILITY_MARGIN, SINGULARITY_MARGIN = range(4)
MODULUS, PSI, MODE, RHO, TIP_FORCE_X, TIP_FORCE_Y = range(6)
_SCALAR_COUNT, _ROD_COLUMNS = 4, 6


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
        Morse index.
    is_regular : bool
        Whether the Jacobian exists.
    """
    leg_count, dof = len(legs), len(load)
    scalars, rods = np.empty(_SCALAR_COUNT), np.empty((leg_count, _ROD_COLUMNS))
    stiffness, jacobian = np.empty((dof, dof)), np.empty((dof, leg_count))
    index, is_regular = _describe(legs, Point(x, inputs, load), scalars, rods, stiffness, jacobian)
    return scalars, rods, stiffness, jacobian, index, is_regular


@kernel
def _describe(
    legs: Array, point: Point, scalars: Array, rods: Array, stiffness: Array, jacobian: Array
) -> tuple[int, bool]:
    (x, inputs, load), leg_count = point, legs.shape[0]
    work = make_workspace(leg_count, x.shape[0])
    place(legs, x, inputs, work)
    closure_error, force_error = set_residual(legs, x, load, work)
    for i in range(leg_count):
        rods[i, MODULUS], rods[i, PSI], rods[i, MODE], rods[i, RHO] = rod_parameters(x[2 * i], x[2 * i + 1])
        rods[i, TIP_FORCE_X], rods[i, TIP_FORCE_Y] = work.rods[i, FORCE_X], work.rods[i, FORCE_Y]
    regular = set_forward_jacobian(legs, x, work, jacobian)
    verdict = assess_stability(legs, x, work)
    scalars[ENERGY] = total_energy(legs, x, load)
    scalars[RESIDUAL] = max(closure_error, force_error)
    scalars[STABILITY_MARGIN] = verdict.stability_margin
    scalars[SINGULARITY_MARGIN] = singularity_margin(legs, x, work)
    k = verdict.stiffness
    full = np.array([[k.xx, k.xy, k.xz], [k.xy, k.yy, k.yz], [k.xz, k.yz, k.zz]])
    stiffness[:] = full[: load.shape[0], : load.shape[0]]
    return verdict.morse_index, regular


@kernel
def set_world_shapes(legs: Array, x: Array, inputs: Array, shapes: Array) -> None:
    """Fill `shapes` (legs, points, 2) with the rods' centre lines, base to tip, world frame."""
    work = make_workspace(legs.shape[0], x.shape[0])
    set_inputs(legs, inputs, work)
    for i in range(legs.shape[0]):
        shape = shapes[i]
        rod_shape(x[2 * i], x[2 * i + 1], shape)
        clamp = pair(work.clamps[i], CLAMP_X)
        frame = scaled(legs[i, LENGTH], pair(work.clamps[i], CLAMP_COS))
        for n in range(shape.shape[0]):
            away = turned(frame, pair(shape[n], 0))
            shape[n, 0], shape[n, 1] = clamp[0] + away[0], clamp[1] + away[1]
