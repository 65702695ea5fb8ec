"""The position problem as it is solved without this package: closed form by SciPy's elliptic functions, random starts.

No kernel of the package is used. Points and forces of the plane are complex numbers. Symbols as in the rod's closed
form (Altuzarra et al. 2019, Eqs. 13-25): beta = angle from the force to the tangent, b at the tip and beta0 at the
base; kappa = cos(b/2), kappa_c = sin(b/2), m = kappa^2; eta = d beta0 / d b.
"""

import math
from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import root
from scipy.special import ellipeinc, ellipj

from benchmarks.problems import Problem
from pcm_gym.arrays import Array, Mask
from pcm_gym.solving import Equilibrium

Points = NDArray[np.complex128]

# A state with errors of closure and balance below the first is an equilibrium; two nearer than the second are one.
_SOLVED, _SAME = 1e-8, 1e-5
# Batches are small at first, so that what is found at once counts at once.
_SMALLEST_BATCH, _LARGEST_BATCH = 64, 1024
# Of the batched Newton's method: limited steps meet whole sets several times sooner than full ones, and a start is
# given up where a rod's rho is `_FARTHEST` times the largest that is asked for.
_ITERATIONS, _LONGEST_STEP, _FARTHEST = 25, 0.5, 1.3
# Of scipy.optimize.root, per start.
_EVALUATIONS = 60


class Equations:
    """Closure and equilibrium of a mechanism with their exact Jacobian, for many states at once.

    A state is a row: per rod its load as its tip sees it, g = rho^2 (cos b, -sin b), then what is not given, the pose
    or the inputs. Lengths are in mean rod lengths, forces in mean stiffness / length^2.
    """

    def __init__(self, problem: Problem) -> None:
        mechanism = problem.mechanism
        self._problem, self._units, self._is_inverse = problem, mechanism.units, problem.is_inverse
        self.leg_count = mechanism.leg_count
        self.size = 3 * self.leg_count
        self._is_platform = mechanism.dof == 3
        length = mechanism.units.length
        rods, actuators = [leg.rod for leg in mechanism.legs], [leg.actuator for leg in mechanism.legs]
        self._lengths = np.array([rod.length for rod in rods]) / length
        self._force_units = np.array([rod.bending_stiffness / rod.length**2 for rod in rods]) / mechanism.units.force
        self._bases = np.array([complex(*actuator.base) for actuator in actuators]) / length
        self._angles = np.array([actuator.clamp_angle for actuator in actuators])
        self._turns = np.array([actuator.is_angle for actuator in actuators])
        self._axes = np.array([complex(*actuator.axis) for actuator in actuators])
        self._arms = np.array([complex(*leg.attachment) for leg in mechanism.legs]) / length
        self._load = problem.load / mechanism.units.load
        self._given = problem.given / (mechanism.units.pose if problem.is_inverse else mechanism.units.inputs)

    @np.errstate(all="ignore")  # states that go astray
    def __call__(self, states: Array) -> tuple[Array, Array]:
        """Return residuals (m, size) and Jacobians (m, size, size)."""
        count, legs = len(states), self.leg_count
        pose, inputs = self._pose_and_inputs(states)
        tips, forces, tips_g, forces_g = _rods(states[:, : 2 * legs].reshape(count, legs, 2))
        clamps = np.exp(1j * (self._angles + self._turns * inputs))
        arms = self._arms * np.exp(1j * pose[:, 2:]) if self._is_platform else np.zeros((count, legs), dtype=complex)
        to_tips, to_forces = self._lengths * clamps, self._force_units * clamps
        tips, tips_g = to_tips * tips, to_tips[..., None] * tips_g
        forces, forces_g = to_forces * forces, to_forces[..., None] * forces_g

        residuals, jacobians = np.empty((count, self.size)), np.zeros((count, self.size, self.size))
        closure = self._bases + inputs * self._axes + tips - (pose[:, :1] + 1j * pose[:, 1:2]) - arms
        residuals[:, : 2 * legs] = closure.view(np.float64)
        balance = forces.sum(axis=1)
        residuals[:, 2 * legs], residuals[:, 2 * legs + 1] = balance.real, balance.imag
        if self._is_platform:
            residuals[:, 2 * legs + 2] = _cross(arms, forces).sum(axis=1)
        residuals[:, 2 * legs :] -= self._load

        for leg in range(legs):
            columns = slice(2 * leg, 2 * leg + 2)
            self._set(jacobians, leg, columns, tips_g[:, leg], forces_g[:, leg], arms[:, leg, None])
            if self._is_inverse:
                moves = np.where(self._turns[leg], 1j * tips[:, leg], self._axes[leg])[:, None]
                pulls = (self._turns[leg] * 1j * forces[:, leg])[:, None]
                column = slice(2 * legs + leg, 2 * legs + leg + 1)
                self._set(jacobians, leg, column, moves, pulls, arms[:, leg, None])
            else:
                jacobians[:, 2 * leg, 2 * legs] = jacobians[:, 2 * leg + 1, 2 * legs + 1] = -1.0
        if self._is_platform and not self._is_inverse:
            jacobians[:, : 2 * legs, -1] = (-1j * arms).view(np.float64)
            jacobians[:, -1, -1] = _cross(1j * arms, forces).sum(axis=1)
        return residuals, jacobians

    def _set(self, jacobians: Array, leg: int, columns: slice, moves: Points, pulls: Points, arms: Points) -> None:
        """Fill columns that move the tip of one leg and change its force."""
        jacobians[:, 2 * leg, columns], jacobians[:, 2 * leg + 1, columns] = moves.real, moves.imag
        row = 2 * self.leg_count
        jacobians[:, row, columns], jacobians[:, row + 1, columns] = pulls.real, pulls.imag
        if self._is_platform:
            jacobians[:, row + 2, columns] = _cross(arms, pulls)

    def _pose_and_inputs(self, states: Array) -> tuple[Array, Array]:
        free, given = states[:, 2 * self.leg_count :], np.broadcast_to(self._given, (len(states), self.leg_count))
        return (given, free) if self._is_inverse else (free, given)

    def starts(self, rng: np.random.Generator, count: int) -> Array:
        """Return random states (count, size): loads all over the range, pose or inputs as they fit best.

        The tip angle b of a taut rod is about exp(-rho): it is drawn on that scale.
        """
        legs = self.leg_count
        rho = self._problem.rho_max * np.sqrt(rng.uniform(size=(count, legs)))
        part = rng.uniform(-1.0, 1.0, (count, legs))
        b = math.pi * np.sign(part) * np.expm1(rho * np.abs(part)) / np.expm1(rho)
        g = rho**2 * np.exp(-1j * b)
        tips = self._lengths * _rods(g.view(np.float64).reshape(count, legs, 2))[0]
        free = np.zeros((count, legs))
        if self._is_inverse:
            x, y = self._given[:2]
            phi = self._given[2:].sum()  # none, of a point
            away = x + 1j * y + self._arms * np.exp(1j * phi) - self._bases
            turned = np.angle(away / tips) - self._angles
            slid = ((away - tips * np.exp(1j * self._angles)) * self._axes.conj()).real
            free = np.where(self._turns, turned, slid)
        else:
            turns = rng.uniform(-math.pi, math.pi, (count, 1)) * self._is_platform
            clamps = np.exp(1j * (self._angles + self._turns * self._given))
            hinges = self._bases + self._given * self._axes + tips * clamps
            places = (hinges - self._arms * np.exp(1j * turns)).mean(axis=1)
            free = np.column_stack([places.real, places.imag, turns])[:, :legs]
        return np.hstack([g.view(np.float64), free])

    def step_lengths(self, states: Array, steps: Array) -> Array:
        """Return the size (m,) of steps: the largest change of a rod's load, over 4 + load, or of pose or inputs."""
        rods = 2 * self.leg_count
        g, change = (array[:, :rods].reshape(len(array), self.leg_count, 2) for array in (states, steps))
        relative = np.hypot(change[..., 0], change[..., 1]) / (4.0 + np.hypot(g[..., 0], g[..., 1]))
        lengths: Array = np.maximum(relative.max(axis=1), np.abs(steps[:, rods:]).max(axis=1))
        return lengths

    def in_range(self, states: Array, factor: float = 1.0) -> Mask:
        """Return which states (m, size) have all loads within `factor` times the range."""
        g = states[:, : 2 * self.leg_count].reshape(len(states), self.leg_count, 2)
        loads: Array = np.hypot(g[..., 0], g[..., 1]).max(axis=1)
        return loads <= (factor * self._problem.rho_max) ** 2

    def state_of(self, equilibrium: Equilibrium) -> Array:
        """Return the state (size,) of an equilibrium that the package found."""
        rods = equilibrium.state[: 2 * self.leg_count]
        inputs, pose = equilibrium.inputs / self._units.inputs, equilibrium.pose / self._units.pose
        return np.concatenate([rods, inputs if self._is_inverse else pose])

    def are_same(self, some: Array, others: Array) -> Mask:
        """Return which of two lists of states (m, size), (n, size) are the same equilibrium, (m, n)."""
        some, others = self._marks(some), self._marks(others)
        same: Mask = np.abs(some[:, None] - others[None]).max(axis=2) < _SAME
        return same

    def _marks(self, states: Array) -> Array:
        """Return numbers by which states are compared: loads relative to 1 + load, and angles without their turns."""
        rods, free = states[:, : 2 * self.leg_count], states[:, 2 * self.leg_count :]
        angles = self._turns if self._is_inverse else np.arange(self.leg_count) == 2
        return np.hstack([rods / (1.0 + np.abs(rods)), np.where(angles, np.cos(free), free), np.sin(free)])


def _cross(first: Points, second: Points) -> Array:
    return (first.conj() * second).imag


def _rods(g: Array) -> tuple[Points, Points, Points, Points]:
    """Return tips and tip forces of unit rods in the clamp's frame, (m, legs), and their derivatives by g, (..., 2)."""
    load = np.hypot(g[..., 0], g[..., 1])
    rho, b = np.sqrt(load), np.arctan2(-g[..., 1], g[..., 0])
    kappa, kappa_c = np.cos(0.5 * b), np.sin(0.5 * b)
    m = kappa * kappa
    sn, cn, _, amplitude = ellipj(rho, m)
    dn = np.hypot(cn, kappa_c * sn)  # without the cancellation of 1 - m sn^2
    epsilon = ellipeinc(amplitude, m)
    sd, cd = sn / dn, cn / dn
    back = (kappa * cd - 1j * kappa_c / dn) ** 2  # exp(-i beta0)
    slope = 2.0 * kappa * kappa_c * sd  # d beta / d u at the base
    tips = back * (1.0 - 2.0 * (epsilon - m * sn * cd) / rho + 1j * slope / rho)
    forces = load * back
    excess = epsilon - kappa_c * kappa_c * rho
    eta = cn + sd * excess
    eta_u = -sn * dn + excess * cd / dn + m * sd * cn * cn
    sin_b = 2.0 * kappa * kappa_c
    tips_rho = (1.0 - tips) / rho - 1j * slope * tips
    tips_b = back * (-0.5 * (slope * eta / rho + sin_b) + 1j * eta_u / rho) - 1j * eta * tips
    forces_rho, forces_b = (2.0 / rho - 1j * slope) * forces, -1j * eta * forces
    # rho^2 exp(-i b) = g
    cos_b = g[..., 0] / load
    rho_g = np.stack([cos_b, -sin_b], axis=-1) / (2.0 * rho[..., None])
    b_g = -np.stack([sin_b, cos_b], axis=-1) / load[..., None]
    tips_g = tips_rho[..., None] * rho_g + tips_b[..., None] * b_g
    forces_g = forces_rho[..., None] * rho_g + forces_b[..., None] * b_g
    return tips, forces, tips_g, forces_g


def newton(equations: Equations, rng: np.random.Generator) -> Iterator[Array]:
    """Yield equilibria (m, size), repeated ones among them: Newton's method on whole batches of starts.

    The elliptic functions are SciPy's, the linear systems NumPy's. About a hundred times as many starts are tried in a
    second as one after another.
    """
    size = _SMALLEST_BATCH
    while True:
        states = equations.starts(rng, size)
        for _ in range(_ITERATIONS):
            residuals, jacobians = equations(states)
            errors = np.abs(residuals).max(axis=1)
            yield states[errors < _SOLVED]
            going = (errors >= _SOLVED) & np.isfinite(jacobians).all(axis=(1, 2))
            states = states[going]
            steps = np.linalg.solve(jacobians[going], residuals[going][..., None])[..., 0]
            with np.errstate(all="ignore"):  # where a matrix is nearly singular
                states -= steps * np.minimum(1.0, _LONGEST_STEP / equations.step_lengths(states, steps))[:, None]
            states = states[equations.in_range(states, _FARTHEST)]
        size = min(2 * size, _LARGEST_BATCH)


def levenberg_marquardt(equations: Equations, rng: np.random.Generator) -> Iterator[Array]:
    """Yield equilibria (m, size), repeated ones among them: `scipy.optimize.root` from one start after another.

    Of its methods "lm" converges most often per second here, two to four times as often as "hybr".
    """

    def of_one(state: Array) -> tuple[Array, Array]:
        residuals, jacobians = equations(state[None])
        return residuals[0], jacobians[0]

    options = {"maxiter": _EVALUATIONS}
    while True:
        state = root(of_one, equations.starts(rng, 1)[0], jac=True, method="lm", options=options).x[None]
        yield state[np.abs(equations(state)[0]).max(axis=1) < _SOLVED]


Method = Callable[[Equations, np.random.Generator], Iterator[Array]]
METHODS: dict[str, Method] = {"scipy.optimize.root": levenberg_marquardt, "batched Newton": newton}


def search(equations: Equations, method: Method, rng: np.random.Generator) -> Iterator[Array]:
    """Yield the different equilibria (m, size) with loads in range as they are met; possibly none at a time."""
    met = np.empty((0, equations.size))
    for states in method(equations, rng):
        new = states[equations.in_range(states)]
        new = new[~equations.are_same(new, met).any(axis=1)]
        new = new[~np.triu(equations.are_same(new, new), 1).any(axis=0)]
        met = np.vstack([met, new])
        yield new
