"""A mechanism's total elastic energy in finitely many variables; independent of the package's kernels.

Each rod is the tangent's angle theta(s) as a polynomial in the arc length: theta(0) is the clamp's angle and theta' a
sum of Legendre polynomials, orthonormal in the bending energy, so that the energy's Hessian is the identity plus a
compact part. The tips meet the end-effector by constraints with Lagrange multipliers; nothing is assumed of how the
forces balance. Converges exponentially: with 56 polynomials per rod the equilibria of rods with rho <= 8 are exact to
better than 1e-10 (test_stability measures it).
"""

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.polynomial import legendre

from pcm_gym.arrays import Array
from pcm_gym.mechanism import Mechanism, Revolute
from pcm_gym.solving import Equilibrium
from tests.reference.rod_ode import integrate_rod

POLYNOMIALS = 56
_NODES = 96


@lru_cache
def _basis() -> tuple[Array, Array, Array]:
    """Return Gauss nodes and weights on (0, 1), and (nodes, polynomials): the angle of each unit of curvature there."""
    nodes, weights = legendre.leggauss(_NODES)
    s, w = 0.5 * (nodes + 1.0), 0.5 * weights
    angles = np.empty((_NODES, POLYNOMIALS))
    for n in range(POLYNOMIALS):
        coefficients = np.zeros(n + 1)
        coefficients[n] = math.sqrt(2 * n + 1)  # orthonormal on (0, 1)
        integral = legendre.legint(coefficients, lbnd=-1.0) * 0.5
        angles[:, n] = legendre.legval(nodes, integral)
    return s, w, angles


@lru_cache
def _curvatures() -> Array:
    nodes, _ = legendre.leggauss(_NODES)
    return legendre.legvander(nodes, POLYNOMIALS - 1) * np.sqrt(2.0 * np.arange(POLYNOMIALS) + 1.0)


class Curves(NamedTuple):
    """Derivatives of the Lagrangian at z = (curvatures of all rods, pose, multipliers)."""

    gradient: Array
    hessian: Array


class DiscreteEnergy:
    """The Lagrangian of a mechanism under dead load, as a function of its variables and of the inputs."""

    def __init__(self, mechanism: Mechanism) -> None:
        self.mechanism = mechanism
        self.rods = mechanism.leg_count * POLYNOMIALS
        self.free = self.rods + mechanism.dof
        self.size = self.free + 2 * mechanism.leg_count

    def start(self, equilibrium: Equilibrium) -> Array:
        """Return z near an equilibrium: its rods' loads integrated and projected on the polynomials."""
        z = np.zeros(self.size)
        s, w, _ = _basis()
        curvatures = _curvatures()
        for i in range(self.mechanism.leg_count):
            g_x, g_y = equilibrium.state[2 * i : 2 * i + 2]
            angle = integrate_rod(float(g_x), float(g_y), 1e-9).angle
            step = 1e-4  # fourth-order difference of a smooth function, only a start
            slope = (8.0 * (angle(s + step) - angle(s - step)) - angle(s + 2 * step) + angle(s - 2 * step)) / (
                12.0 * step
            )
            z[i * POLYNOMIALS : (i + 1) * POLYNOMIALS] = curvatures.T @ (w * slope)
            z[self.free + 2 * i : self.free + 2 * i + 2] = -equilibrium.rods[i].force
        z[self.rods : self.free] = equilibrium.pose
        return z

    def clamp(self, leg: int, value: float) -> tuple[float, float, float]:
        actuator = self.mechanism.legs[leg].actuator
        x, y = actuator.base
        if isinstance(actuator, Revolute):
            return x, y, actuator.clamp_angle + value
        c, s = math.cos(actuator.axis_angle), math.sin(actuator.axis_angle)
        return x + value * c, y + value * s, actuator.clamp_angle

    def derivatives(self, z: Array, inputs: Array, load: Array) -> Curves:
        """Return gradient and Hessian of energy - load . pose + multipliers . (tip - hinge)."""
        mechanism, rods, free = self.mechanism, self.rods, self.free
        gradient, hessian = np.zeros(self.size), np.zeros((self.size, self.size))
        gradient[rods:free] = -load
        _, w, angles = _basis()
        phi = z[rods + 2] if mechanism.dof == 3 else 0.0
        for i, leg in enumerate(mechanism.legs):
            own = slice(i * POLYNOMIALS, (i + 1) * POLYNOMIALS)
            force = slice(free + 2 * i, free + 2 * i + 2)
            length, stiffness = leg.rod.length, leg.rod.bending_stiffness
            x, y, clamp_angle = self.clamp(i, float(inputs[i]))
            theta = clamp_angle + angles @ z[own]
            cosine, sine = length * w * np.cos(theta), length * w * np.sin(theta)
            pull = z[force]
            gradient[own] += stiffness / length * z[own]
            hessian[own, own] += stiffness / length * np.eye(POLYNOMIALS)
            tip_slope = np.vstack([-angles.T @ sine, angles.T @ cosine])
            gradient[own] += pull @ tip_slope
            hessian[own, own] -= angles.T @ ((pull[0] * cosine + pull[1] * sine)[:, None] * angles)
            hessian[force, own] = tip_slope
            hessian[own, force] = tip_slope.T
            c, s = math.cos(phi), math.sin(phi)
            arm = np.array([[c, -s], [s, c]]) @ np.array(leg.attachment)
            gradient[force] = np.array([x + cosine.sum(), y + sine.sum()]) - z[rods : rods + 2] - arm
            gradient[rods : rods + 2] -= pull
            hinge_slope = np.zeros((2, mechanism.dof))
            hinge_slope[:, :2] = np.eye(2)
            if mechanism.dof == 3:
                hinge_slope[:, 2] = -arm[1], arm[0]
                gradient[rods + 2] -= pull @ hinge_slope[:, 2]
                hessian[rods + 2, rods + 2] += pull @ arm
            hessian[force, rods:free] = -hinge_slope
            hessian[rods:free, force] = -hinge_slope.T
        return Curves(gradient, hessian)

    def solve(self, z: Array, inputs: Array, load: Array) -> Array:
        """Return the equilibrium near z, by Newton."""
        for _ in range(12):
            curves = self.derivatives(z, inputs, load)
            step = np.linalg.solve(curves.hessian, -curves.gradient)
            z = z + step
            if np.abs(step).max() < 1e-11 * (1.0 + np.abs(z).max()):
                return z
        raise AssertionError("the discretised energy has no equilibrium nearby")

    def eigenvalues(self, z: Array, inputs: Array, load: Array) -> Array:
        """Return the eigenvalues of the energy's Hessian on the motions that keep the tips on the end-effector.

        Scaled: lengths, forces and stiffness in the mechanism's mean rod, so that 1 is the order of the rods' bending.
        """
        units = self.mechanism.units
        scale = np.ones(self.size)
        scale[self.rods : self.free] = units.pose
        scale[self.free :] = units.force
        hessian = self.derivatives(z, inputs, load).hessian * np.outer(scale, scale) / units.energy
        constraints = hessian[self.free :, : self.free]
        basis, _ = np.linalg.qr(constraints.T, mode="complete")
        motions = basis[:, constraints.shape[0] :]
        return np.linalg.eigvalsh(motions.T @ hessian[: self.free, : self.free] @ motions)

    def stiffness(self, z: Array, inputs: Array, load: Array) -> Array:
        """Return d force / d pose: the Hessian of the energy with everything else at rest, a Schur complement."""
        hessian = self.derivatives(z, inputs, load).hessian
        pose = np.arange(self.rods, self.free)
        rest = np.setdiff1d(np.arange(self.size), pose)
        coupling = hessian[np.ix_(rest, pose)]
        return hessian[np.ix_(pose, pose)] - coupling.T @ np.linalg.solve(hessian[np.ix_(rest, rest)], coupling)

    def input_derivative(self, z: Array, inputs: Array, load: Array, rate: Array) -> Array:
        """Return the gradient's derivative along `rate` in the inputs, exact for sliders and motors alike."""
        out = np.zeros(self.size)
        _, w, angles = _basis()
        del load
        for i, leg in enumerate(self.mechanism.legs):
            own = slice(i * POLYNOMIALS, (i + 1) * POLYNOMIALS)
            force = slice(self.free + 2 * i, self.free + 2 * i + 2)
            actuator = leg.actuator
            if not isinstance(actuator, Revolute):
                out[force] += rate[i] * np.array([math.cos(actuator.axis_angle), math.sin(actuator.axis_angle)])
                continue
            theta = self.clamp(i, float(inputs[i]))[2] + angles @ z[own]
            cosine, sine = leg.rod.length * w * np.cos(theta), leg.rod.length * w * np.sin(theta)
            out[force] += rate[i] * np.array([-sine.sum(), cosine.sum()])
            pull = z[force]
            out[own] += rate[i] * (angles.T @ (-pull[0] * cosine - pull[1] * sine))
        return out
