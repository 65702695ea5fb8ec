"""Largest curvature of a rod, and the forces of the actuators, in closed form from the rod table.

Curvature. The moment in a rod is the tip force times its lever arm, and with it EI theta'(s) obeys the pendulum's
law: |theta'| = (2 rho / L) kappa kappa_c sd(u|m), zero at the tip and growing up to u = K, where the arm is longest
and |theta'| = 2 rho kappa / L. A rod that is longer than that (rho > K) has its largest curvature there; a shorter
one has it at the clamp, where the moment is the tip's position times its force.

Actuator forces. The bending energy E(p) of a rod has the gradient f, its tip force. With the end-effector held, a
slider moves the clamp by its axis a and so the tip, seen from the clamp, by -a; a motor turns the rod's frame. At an
equilibrium nothing else counts (envelope theorem), and the derivative of the energy U by the input is

    dU/dq = -a . f    (slider)        dU/dq = -p x f    (motor)
"""

import math

from pcm_gym.arrays import Array
from pcm_gym.kernels.numerics.compilation import formula, kernel
from pcm_gym.kernels.statics.closure import (
    FORCE_X,
    HALF_PERIODS,
    LENGTH,
    STIFFNESS,
    TIP_X,
    Workspace,
    actuator_of,
    make_workspace,
    pair,
    place,
)
from pcm_gym.kernels.statics.formulas import Actuator, Pair, moment

# Keeps the ratio of two vanishing numbers finite.
_LEAST = 1e-300


@formula
def largest_curvature(g: Pair, half_periods: float, clamp_moment: float, length: float, stiffness: float) -> float:
    """Return the greatest magnitude of a rod's curvature; `clamp_moment` is its tip's position times its force."""
    load = math.sqrt(g[0] * g[0] + g[1] * g[1])
    # (2 rho kappa)^2 = 2 (|g| + g_x), without cancellation
    apart = load + abs(g[0])
    squared = 2.0 * apart if g[0] >= 0.0 else 2.0 * g[1] * g[1] / max(apart, _LEAST)
    return math.sqrt(squared) / length if half_periods > 0.5 else abs(clamp_moment) / stiffness


@formula
def actuator_force(actuator: Actuator, tip: Pair, force: Pair) -> float:
    """Return dU/dq of one actuator: the force or moment that it must give."""
    along = actuator.axis[0] * force[0] + actuator.axis[1] * force[1]
    return -along - actuator.turn * moment(tip, force)


@kernel
def set_strength(legs: Array, x: Array, work: Workspace, curvatures: Array, forces: Array) -> None:
    """Fill the rods' largest curvatures and the actuators' forces, (legs,) each, from the rod table of state `x`."""
    for i in range(legs.shape[0]):
        row = work.rods[i]
        tip, force = pair(row, TIP_X), pair(row, FORCE_X)
        length, stiffness = legs[i, LENGTH], legs[i, STIFFNESS]
        curvatures[i] = largest_curvature(pair(x, 2 * i), row[HALF_PERIODS], moment(tip, force), length, stiffness)
        forces[i] = actuator_force(actuator_of(legs, i), tip, force)


@kernel
def set_strengths(legs: Array, states: Array, inputs: Array, curvatures: Array, forces: Array) -> None:
    """Fill curvatures and forces (n, legs) of many equilibria: `states` (n, size) at `inputs` (n, legs)."""
    work = make_workspace(legs.shape[0], states.shape[1])
    for n in range(states.shape[0]):
        place(legs, states[n], inputs[n], work)
        set_strength(legs, states[n], work, curvatures[n], forces[n])
