"""The statics of a mechanism, each equation once: formulas, numbers in and numbers out.

The scalar code loads these numbers from a `Workspace`, the lanes load them from a block of runs; neither has an
equation of its own. Sines and cosines are passed in, because lanes have theirs without branches.

Symbols, world frame: B clamp, p the tip from the clamp, f the force of the end-effector on the tip, c the arm from the
end-effector's origin to the hinge, turned with it; g the load that the tip sees; A = d f / d p the rod's own stiffness;
K that of the end-effector. A move of the end-effector is (x, y, phi), and a force on it (F_x, F_y, M).
"""

import math
from typing import NamedTuple

from pcm_gym.kernels.numerics.compilation import formula
from pcm_gym.kernels.numerics.linear import Symmetric, Vector, adjugate_times, principal_minors
from pcm_gym.kernels.rods.rod import RodPoint

Pair = tuple[float, float]
# Derivatives of a vector (x, y) by g: of x by g_x and g_y, of y by g_x and g_y.
Derivatives = tuple[float, float, float, float]
# xx, xy and yy of A.
LegStiffness = tuple[float, float, float]


class Actuator(NamedTuple):
    """How an input places a clamp: at base + input * axis, pointing along angle + input * turn."""

    base: Pair
    axis: Pair
    angle: float
    turn: float


@formula
def clamp_point(actuator: Actuator, value: float) -> Pair:
    """Return B."""
    return actuator.base[0] + actuator.axis[0] * value, actuator.base[1] + actuator.axis[1] * value


@formula
def clamp_angle(actuator: Actuator, value: float) -> float:
    """Return the direction of a clamp."""
    return actuator.angle + actuator.turn * value


@formula
def input_rate(actuator: Actuator, rate: float, tip: Pair, force: Pair) -> tuple[Pair, Pair]:
    """Return the rates of B + p and of f as the input changes at this rate, g held."""
    turn = actuator.turn
    hinge = rate * (actuator.axis[0] - turn * tip[1]), rate * (actuator.axis[1] + turn * tip[0])
    return hinge, (-rate * turn * force[1], rate * turn * force[0])


@formula
def turned(direction: Pair, vector: Pair) -> Pair:
    """Return a vector turned by the angle with this cosine and sine, or turned and scaled if these are scaled."""
    c, s = direction
    return c * vector[0] - s * vector[1], s * vector[0] + c * vector[1]


@formula
def scaled(factor: float, vector: Pair) -> Pair:
    """Return a vector times a factor."""
    return factor * vector[0], factor * vector[1]


@formula
def force_unit(length: float, stiffness: float) -> float:
    """Return EI / L^2 of a rod."""
    return stiffness / (length * length)


@formula
def placed(point: RodPoint, length: float, unit_force: float, clamp: Pair) -> RodPoint:
    """Return what a rod does in the world frame and its units, clamped in this direction (cosine, sine)."""
    to_tip, to_force = scaled(length, clamp), scaled(unit_force, clamp)
    tip_x, tip_y = turned(to_tip, (point.tip_x, point.tip_y))
    force_x, force_y = turned(to_force, (point.force_x, point.force_y))
    tip_x_gx, tip_y_gx = turned(to_tip, (point.tip_x_gx, point.tip_y_gx))
    tip_x_gy, tip_y_gy = turned(to_tip, (point.tip_x_gy, point.tip_y_gy))
    force_x_gx, force_y_gx = turned(to_force, (point.force_x_gx, point.force_y_gx))
    force_x_gy, force_y_gy = turned(to_force, (point.force_x_gy, point.force_y_gy))
    return RodPoint(
        tip_x,
        tip_y,
        force_x,
        force_y,
        tip_x_gx,
        tip_x_gy,
        tip_y_gx,
        tip_y_gy,
        force_x_gx,
        force_x_gy,
        force_y_gx,
        force_y_gy,
        point.dead_load_index,
        point.half_periods,
    )


@formula
def hinge_gap(clamp: Pair, tip: Pair, pose: Pair, arm: Pair) -> Pair:
    """Return the residual of closure: the tip less the hinge."""
    return clamp[0] + tip[0] - pose[0] - arm[0], clamp[1] + tip[1] - pose[1] - arm[1]


@formula
def moment(arm: Pair, force: Pair) -> float:
    """Return the moment of a force."""
    return arm[0] * force[1] - arm[1] * force[0]


@formula
def larger(size: float, vector: Pair) -> float:
    """Return `size`, or the larger component of a vector if it is larger."""
    return max(size, abs(vector[0]), abs(vector[1]))


@formula
def balance_error(balance: Vector, largest_force: float) -> float:
    """Return the largest residual of equilibrium, relative to 1 + the largest rod force."""
    return max(abs(balance[0]), abs(balance[1]), abs(balance[2])) / (1.0 + largest_force)


@formula
def applied(by_g: Derivatives, step: Pair) -> Pair:
    """Return the change of a vector by a step of g."""
    return by_g[0] * step[0] + by_g[1] * step[1], by_g[2] * step[0] + by_g[3] * step[1]


@formula
def rod_correction(tip_g: Derivatives, force_g: Derivatives, force: Pair, step: Pair) -> float:
    """Return the largest change of a rod's tip, or, over 1 + |f|, of its force, by a step of g."""
    scale = 1.0 + abs(force[0]) + abs(force[1])
    tip_x, tip_y = applied(tip_g, step)
    force_x, force_y = applied(force_g, step)
    return max(abs(tip_x), abs(tip_y), max(abs(force_x), abs(force_y)) / scale)


@formula
def stiffness_from(tip_g: Derivatives, force_g: Derivatives) -> LegStiffness:
    """Return A from the derivatives by g; symmetric, since the force has a potential."""
    p_xx, p_xy, p_yx, p_yy = tip_g
    q_xx, q_xy, q_yx, q_yy = force_g
    inverse = 1.0 / (p_xx * p_yy - p_xy * p_yx)
    return (
        (q_xx * p_yy - q_xy * p_yx) * inverse,
        0.5 * (q_xy * p_xx - q_xx * p_xy + q_yx * p_yy - q_yy * p_yx) * inverse,
        (q_yy * p_xx - q_yx * p_xy) * inverse,
    )


@formula
def pole_distance_from(tip_g: Derivatives) -> float:
    """Return the squared sine of the angle between the two columns of d p / d g; 0 at a pole of A."""
    p_xx, p_xy, p_yx, p_yy = tip_g
    determinant = p_xx * p_yy - p_xy * p_yx
    first, second = p_xx * p_xx + p_yx * p_yx, p_xy * p_xy + p_yy * p_yy
    # a column of rounding errors has a direction of its own: it counts as at least a 1e-8 of the other
    least = 1e-16 * max(first, second)
    columns = max(first, least) * max(second, least)
    return determinant * determinant / columns if columns > 0.0 else 0.0


@formula
def step_from_tip(tip_g: Derivatives, tip: Pair) -> Pair:
    """Return the step of g that moves the tip by this."""
    p_xx, p_xy, p_yx, p_yy = tip_g
    inverse = 1.0 / (p_xx * p_yy - p_xy * p_yx)
    return (p_yy * tip[0] - p_xy * tip[1]) * inverse, (p_xx * tip[1] - p_yx * tip[0]) * inverse


@formula
def pull_of(own: LegStiffness, tip: Pair) -> Pair:
    """Return A times a move of the tip."""
    return own[0] * tip[0] + own[1] * tip[1], own[1] * tip[0] + own[2] * tip[1]


@formula
def condensed_pull(own: LegStiffness, arm: Pair, gap: Pair) -> Vector:
    """Return the force and moment on the end-effector of a leg whose hinge is moved by this gap."""
    pull = pull_of(own, gap)
    return pull[0], pull[1], moment(arm, pull)


@formula
def hinge_move(move: Vector, arm: Pair) -> Pair:
    """Return how a hinge moves with the end-effector."""
    return move[0] - arm[1] * move[2], move[1] + arm[0] * move[2]


@formula
def stiffness_share(own: LegStiffness, arm: Pair, force: Pair) -> Symmetric:
    """Return what one leg adds to K: D' A D - diag(0, 0, c . f), D the derivative of the hinge by the pose."""
    a_xx, a_xy, a_yy = own
    arm_x, arm_y = arm
    turn_x, turn_y = a_xy * arm_x - a_xx * arm_y, a_yy * arm_x - a_xy * arm_y
    zz = arm_x * turn_y - arm_y * turn_x - arm_x * force[0] - arm_y * force[1]
    return Symmetric(a_xx, a_xy, a_yy, turn_x, turn_y, zz)


@formula
def added(first: Symmetric, second: Symmetric) -> Symmetric:
    """Return the sum of two matrices."""
    return Symmetric(
        first.xx + second.xx,
        first.xy + second.xy,
        first.yy + second.yy,
        first.xz + second.xz,
        first.yz + second.yz,
        first.zz + second.zz,
    )


@formula
def negative_directions(own: LegStiffness) -> float:
    """Return the number of negative eigenvalues of A."""
    a_xx, a_xy, a_yy = own
    of_definite = 2.0 if a_xx + a_yy < 0.0 else 0.0
    return 1.0 if a_xx * a_yy - a_xy * a_xy < 0.0 else of_definite


@formula
def rod_index(dead_load_index: float, own: LegStiffness) -> float:
    """Return a rod's part in the Morse index: its own at a free tip, less what holding the tip takes away."""
    return dead_load_index - negative_directions(own)


@formula
def negative_eigenvalues(a: Symmetric) -> float:
    """Return how many eigenvalues of K are negative, by the signs of the characteristic polynomial's coefficients.

    All its roots are real: as many are negative as these signs change (Descartes).
    """
    trace = a.xx + a.yy + a.zz
    _, determinant = adjugate_times(a, 0.0, 0.0, 0.0)
    first, second, third = trace < 0.0, principal_minors(a) < 0.0, determinant < 0.0
    changes = 1.0 if first else 0.0
    changes += 1.0 if first != second else 0.0
    changes += 1.0 if second != third else 0.0
    return changes


@formula
def judge_eigenvalues(first: float, second: float, third: float) -> tuple[float, float]:
    """Return the number of negative eigenvalues of K, and the least one; a nan is negative."""
    negative = (0.0 if first >= 0.0 else 1.0) + (0.0 if second >= 0.0 else 1.0) + (0.0 if third >= 0.0 else 1.0)
    return negative, min(first, second, third)


@formula
def own_turn_stiffness(dof: int) -> float:
    """Return zz of K before the legs: a point end-effector, which cannot turn, has a turn of its own."""
    return 0.0 if dof == 3 else 1.0


@formula
def are_finite(first: Pair, second: Pair) -> bool:
    """Return whether all components are finite; max() would drop a nan."""
    return abs(first[0]) + abs(first[1]) + abs(second[0]) + abs(second[1]) < math.inf
