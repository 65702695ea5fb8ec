"""The overdamped motion of a mechanism whose rods are chains of rigid links; independent of the package's kernels.

Each rod is `links` rigid links with torsion springs at the joints. Its middles of links move through a viscous medium,
or, as the other law of damping, its links resist turning. The constraints of closure are kept at the level of
velocities, the error of closure decays by itself (Baumgarte). SciPy's stiff integrator follows the motion until it
rests. The chain converges to the rod with the square of the links' length.
"""

import math
from typing import Any, Literal, NamedTuple

import numpy as np
from scipy.integrate import BDF

from pcm_gym.arrays import Array
from pcm_gym.mechanism import Mechanism, Revolute
from pcm_gym.solving import Equilibrium

Law = Literal["positions", "angles"]

# Rate at which an error of closure decays, and time by which all rests, in drag L^4 / EI.
CLOSING_RATE = 300.0
_LONGEST_TIME = 1e3
# Rate of the links' angles that counts as rest.
_REST = 1e-4


class Rest(NamedTuple):
    """Where the chains came to rest."""

    angles: Array  # (legs, links): world angles of the links
    pose: Array  # (d,)
    joints: Array  # (legs, links + 1, 2): base to tip
    forces: Array  # (legs, 2): of the end-effector on the tips
    times: Array  # (steps,): of the integrator, in drag L^4 / EI
    energies: Array  # (steps,)


class Chains:
    """The rods of a mechanism as chains of links, at fixed inputs and load."""

    def __init__(self, mechanism: Mechanism, inputs: Array, load: Array, links: int, law: Law = "positions") -> None:
        self.mechanism, self.load, self.links = mechanism, np.asarray(load), links
        units = mechanism.units
        self.unit_drag = units.force / units.length**2  # per length and speed: the unit of time is then 1
        if law == "angles":
            self.unit_drag *= units.length**2
        self.law = law
        self.lengths = np.array([leg.rod.length for leg in mechanism.legs]) / links
        self.bases, self.clamps = np.empty((mechanism.leg_count, 2)), np.empty(mechanism.leg_count)
        for i, leg in enumerate(mechanism.legs):
            actuator, value = leg.actuator, float(inputs[i])
            self.bases[i], self.clamps[i] = actuator.clamp_point(value), actuator.clamp_angle
            if isinstance(actuator, Revolute):
                self.clamps[i] += value
        # of the middle of a link, in links, by each link's direction
        self.middles = np.tril(np.ones((links, links)), -1) + 0.5 * np.eye(links)
        self.springs = self._springs()

    def _springs(self) -> Array:
        """Return the chains' bending matrices (legs, links, links); the clamp is half a link from the first middle."""
        one = 2.0 * np.eye(self.links) - np.eye(self.links, k=1) - np.eye(self.links, k=-1)
        one[0, 0], one[-1, -1] = 3.0, 1.0
        stiffness = [leg.rod.bending_stiffness / h for leg, h in zip(self.mechanism.legs, self.lengths, strict=True)]
        return np.array(stiffness)[:, None, None] * one

    def start(self, equilibrium: Equilibrium) -> Array:
        """Return the variables, angles and pose, of the chains through an equilibrium's rods."""
        shape = equilibrium.shape(self.links + 1)
        steps = np.diff(shape, axis=1)
        angles = np.unwrap(np.arctan2(steps[:, :, 1], steps[:, :, 0]), axis=1)
        angles -= 2.0 * math.pi * np.round((angles[:, :1] - self.clamps[:, None]) / (2.0 * math.pi))
        return np.concatenate([angles.ravel(), equilibrium.pose])

    def split(self, z: Array) -> tuple[Array, Array]:
        count = self.mechanism.leg_count * self.links
        return z[:count].reshape(-1, self.links), z[count:]

    def energy(self, z: Array) -> float:
        angles, pose = self.split(z)
        bent = angles - self.clamps[:, None]
        return float(0.5 * np.einsum("ij,ijk,ik", bent, self.springs, bent) - self.load @ pose)

    def joints(self, z: Array) -> Array:
        angles, _ = self.split(z)
        steps = self.lengths[:, None, None] * np.stack([np.cos(angles), np.sin(angles)], axis=2)
        zero = np.zeros((len(angles), 1, 2))
        return self.bases[:, None] + np.concatenate([zero, np.cumsum(steps, axis=1)], axis=1)

    def velocity(self, z: Array) -> tuple[Array, Array]:
        """Return the rates of the variables, and the forces on the tips."""
        angles, pose = self.split(z)
        legs, n, dof = len(angles), self.links, self.mechanism.dof
        size, free = legs * n, legs * n + dof
        matrix, right = np.zeros((free + 2 * legs, free + 2 * legs)), np.zeros(free + 2 * legs)
        right[size:free] = self.load
        phi = pose[2] if dof == 3 else 0.0
        turn = np.array([[math.cos(phi), -math.sin(phi)], [math.sin(phi), math.cos(phi)]])
        for i, leg in enumerate(self.mechanism.legs):
            own, hinge, h = slice(i * n, (i + 1) * n), slice(free + 2 * i, free + 2 * i + 2), self.lengths[i]
            cosine, sine = np.cos(angles[i]), np.sin(angles[i])
            if self.law == "positions":
                across, along = h * self.middles * -sine, h * self.middles * cosine
                matrix[own, own] = self.unit_drag * h * (across.T @ across + along.T @ along)
            else:
                matrix[own, own] = self.unit_drag * h * np.eye(n)
            right[own] = -self.springs[i] @ (angles[i] - self.clamps[i])
            arm = turn @ np.array(leg.attachment)
            slope = np.vstack([-h * sine, h * cosine])
            by_pose = np.eye(2, dof)
            if dof == 3:
                by_pose[:, 2] = -arm[1], arm[0]
            matrix[hinge, own], matrix[own, hinge] = slope, slope.T
            matrix[hinge, size:free], matrix[size:free, hinge] = -by_pose, -by_pose.T
            tip = self.bases[i] + h * np.array([cosine.sum(), sine.sum()])
            right[hinge] = -CLOSING_RATE * (tip - pose[:2] - arm)
        solution: Any = np.linalg.solve(matrix, right)
        return solution[:free], -solution[free:].reshape(legs, 2)

    def settle(self, z: Array, relative_tol: float = 1e-4) -> Rest:
        """Follow the motion from z until it rests."""

        solver = BDF(
            lambda _, z: self.velocity(z)[0], 0.0, z, _LONGEST_TIME, rtol=relative_tol, atol=1e-2 * relative_tol
        )
        times, energies, is_moving = [0.0], [self.energy(z)], True
        while is_moving and solver.status == "running":
            message = solver.step()
            assert solver.status != "failed", message
            times.append(solver.t)
            energies.append(self.energy(solver.y))
            rates, forces = self.velocity(solver.y)
            is_moving = np.abs(rates).max() > _REST
        angles, pose = self.split(solver.y)
        return Rest(angles, pose, self.joints(solver.y), forces, np.array(times), np.array(energies))


def push_over(
    fold: Equilibrium,
    inputs_rate: Array,
    load_rate: Array,
    links: int,
    law: Law = "positions",
    first_push: float = 0.01,
) -> tuple[Rest, Array, Array]:
    """Push the chains a little way through a fold, along the rates of inputs and load, and let them fall.

    Discretised, the fold is elsewhere by the square of the links' length: the push is doubled, up to four times, until
    the chains leave, that is, until a link turns by more than a radian, or by more than twice what it does when pushed
    as far in the other direction. A very short fall may go unnoticed; then it is pushed the farthest. Returns where the
    chains rest, and the inputs and load there.
    """
    for push in first_push * 2.0 ** np.arange(5):
        turns = []
        for signed in (-push, push):
            inputs, load = fold.inputs + signed * inputs_rate, fold.load + signed * load_rate
            chains = Chains(fold.mechanism, inputs, load, links, law)
            z = chains.start(fold)
            rest = chains.settle(z)
            turns.append(np.abs(rest.angles - chains.split(z)[0]).max())
        if turns[1] > min(1.0, 2.0 * turns[0]):
            break
    return rest, inputs, load
