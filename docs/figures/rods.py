"""Single rods of unit length and stiffness: from the paper's parameters to loads, shapes and stability."""

import math

import numpy as np
from scipy.special import ellipk, ellipkinc

from pcm_gym.arrays import Array
from pcm_gym.kernels.rods.rod import RodPoint, rod, rod_parameters, rod_shape

_ITERATIONS = 30
_TIP_TOL = 1e-12


def load_from_parameters(modulus: float, psi: float, mode: int) -> Array:
    """Load seen from the tip of the rod with modulus k, force direction psi and buckling mode q (Eqs. 20, 21, 23)."""
    parameter = modulus**2
    base_angle = math.asin(math.cos(0.5 * psi) / modulus)
    rho = (2 * mode - 1) * ellipk(parameter) - ellipkinc(base_angle, parameter)
    half_angle = math.acos(abs(modulus)) * (-1.0 if (modulus > 0.0) == (mode % 2 == 1) else 1.0)
    return float(rho) ** 2 * np.array([math.cos(2.0 * half_angle), -math.sin(2.0 * half_angle)])


def shape_of(load: Array, points: int = 150) -> Array:
    """Centre line of the rod with this load, (points, 2), from its clamp at the origin."""
    shape = np.empty((points, 2))
    rod_shape(load[0], load[1], shape)
    return shape


def index_under_dead_load(load: Array) -> int:
    """Number of unstable directions of the rod under a constant force at its free tip."""
    return int(rod(load[0], load[1]).dead_load_index)


def rho_of(load: Array) -> float:
    """Dimensionless load L sqrt(R / EI)."""
    return math.sqrt(math.hypot(load[0], load[1]))


def mode_of(load: Array) -> int:
    """Buckling mode."""
    return rod_parameters(load[0], load[1])[2]


def force_of(load: Array) -> Array:
    """Force at the tip, in the clamp's frame."""
    point = rod(load[0], load[1])
    return np.array([point.force_x, point.force_y])


def load_for_tip(tip: Array, start: Array) -> Array | None:
    """Load on the sheet of `start` that brings the tip there, by Newton's method; None where the sheet has ended.

    A sheet of loads has one load for each tip; it ends where the determinant of d tip / d load changes its sign.
    """
    load = start.copy()
    sign = np.sign(np.linalg.det(_tip_derivative(rod(load[0], load[1]))))
    for _ in range(_ITERATIONS):
        point = rod(load[0], load[1])
        matrix = _tip_derivative(point)
        if np.sign(np.linalg.det(matrix)) != sign:
            return None
        miss = np.array([point.tip_x, point.tip_y]) - tip
        if math.hypot(*miss) < _TIP_TOL:
            return load
        load = load - np.linalg.solve(matrix, miss)
    return None


def _tip_derivative(point: RodPoint) -> Array:
    return np.array([[point.tip_x_gx, point.tip_x_gy], [point.tip_y_gx, point.tip_y_gy]])


def held_index(point: RodPoint) -> int:
    """Number of unstable directions of the rod with its tip held: those under a dead load less those that hold it back.

    The second are the negative eigenvalues of d force / d tip, whose determinant and trace have the signs used here.
    """
    tip = point.tip_x_gx * point.tip_y_gy - point.tip_x_gy * point.tip_y_gx
    force = point.force_x_gx * point.force_y_gy - point.force_x_gy * point.force_y_gx
    trace = (point.force_x_gx * point.tip_y_gy - point.force_x_gy * point.tip_y_gx) + (
        point.force_y_gy * point.tip_x_gx - point.force_y_gx * point.tip_x_gy
    )
    if tip * force < 0.0:
        return int(point.dead_load_index) - 1
    return int(point.dead_load_index) - (2 if tip * trace < 0.0 else 0)
