"""Mechanisms for tests: the three families with random geometry, many equilibria of them, and the homes by hand."""

import math

import numpy as np

from pcm_gym.arrays import Array, Mask
from pcm_gym.kernels.numerics.compilation import kernel
from pcm_gym.kernels.rods.rod import rod
from pcm_gym.kernels.statics.closure import TIP_X, TIP_Y, TURN, evaluate_rods, make_workspace, set_inputs
from pcm_gym.kernels.statics.newton import CONVERGED, NewtonRules, solve_forward_locally, solve_inverse_locally
from pcm_gym.mechanism import Leg, Mechanism, Prismatic, Revolute, Rod, get_mechanism
from pcm_gym.solving import Equilibrium

FAMILIES = ("2RFR", "2PFR", "3PFR")


def random_mechanism(family: str, rng: np.random.Generator, *, is_unequal: bool = True) -> Mechanism:
    """Return a mechanism of the family; unequal rods differ by up to 60 % in length and a factor of 3 in stiffness."""

    def rod() -> Rod:
        if not is_unequal:
            return Rod(1.0, 1.0)
        return Rod(float(rng.uniform(0.8, 1.3)), float(3.0 ** rng.uniform(-0.5, 0.5)))

    if family == "3PFR":
        turn, base, hinge = rng.uniform(0.4, 1.2), rng.uniform(0.55, 0.9), rng.uniform(0.15, 0.4)
        legs = []
        for direction in np.radians([90.0, 210.0, 330.0]) + rng.uniform(-0.3, 0.3, 3):
            outwards = np.array([math.cos(direction), math.sin(direction)])
            actuator = Prismatic(tuple(base * outwards), direction + math.pi / 2.0, direction + math.pi + turn)
            legs.append(Leg(actuator, rod(), tuple(hinge * outwards)))
        return Mechanism(family, tuple(legs))
    half = rng.uniform(0.15, 0.45)
    bases = [(-half, rng.uniform(-0.1, 0.1)), (half, rng.uniform(-0.1, 0.1))]
    if family == "2RFR":
        return Mechanism(family, tuple(Leg(Revolute(base), rod()) for base in bases))
    angles = math.pi / 2.0 + rng.uniform(-0.6, 0.6, 2)
    return Mechanism(family, tuple(Leg(Prismatic(base, a, a), rod()) for base, a in zip(bases, angles, strict=True)))


def random_inputs(mechanism: Mechanism, rng: np.random.Generator) -> Array:
    """Return inputs: any direction within the upper half plane for motors, up to 0.3 for sliders."""
    if mechanism.name.startswith("2RFR"):
        return rng.uniform(0.2, math.pi - 0.2, 2)
    return rng.uniform(-0.3, 0.3, mechanism.leg_count)


def random_load(mechanism: Mechanism, rng: np.random.Generator) -> Array:
    """Return a load of a few EI / L^2."""
    return rng.uniform(-1.0, 1.0, mechanism.dof) * mechanism.units.load * 8.0


def random_states(mechanism: Mechanism, rng: np.random.Generator, count: int, rho_max: float = 8.0) -> Array:
    """Return states whose rods carry random loads; not equilibria."""
    states = np.zeros((count, mechanism.state_size))
    for leg in range(mechanism.leg_count):
        rho = rho_max * np.sqrt(rng.uniform(size=count))
        side = rng.uniform(-1.0, 1.0, count)
        b = math.pi * np.sign(side) * np.expm1(rho * np.abs(side)) / np.expm1(rho)
        states[:, 2 * leg] = rho**2 * np.cos(b)
        states[:, 2 * leg + 1] = -(rho**2) * np.sin(b)
    states[:, 2 * mechanism.leg_count :] = rng.uniform(-1.0, 1.0, (count, mechanism.dof))
    return states


_SEARCH_RULES = NewtonRules(first_correction=np.inf, contraction=1e3, iterations=40)


@kernel
def newton_from_all(legs: Array, inputs: Array, load: Array, states: Array) -> Mask:
    """Correct each state (m, size) in place, its pose taken from its rods' tips; return which converged, (m,) bools."""
    leg_count, size = legs.shape[0], states.shape[1]
    pose, work = 2 * leg_count, make_workspace(leg_count, size)
    converged = np.zeros(states.shape[0], dtype=np.bool_)
    for n in range(states.shape[0]):
        x = states[n]
        set_inputs(legs, inputs, work)
        evaluate_rods(legs, x, work)
        x[pose : pose + 2] = 0.0
        for i in range(leg_count):
            x[pose] += (work.clamps[i, 0] + work.rods[i, TIP_X]) / leg_count
            x[pose + 1] += (work.clamps[i, 1] + work.rods[i, TIP_Y]) / leg_count
        converged[n] = solve_forward_locally(legs, inputs, load, x, _SEARCH_RULES, work) == CONVERGED
    return converged


def find_equilibria(
    mechanism: Mechanism, inputs: Array, load: Array, rng: np.random.Generator, starts: int = 200, rho_max: float = 8.0
) -> list[Equilibrium]:
    """Return different equilibria with every rho <= rho_max; some, not all."""
    units = mechanism.units
    states = random_states(mechanism, rng, starts, rho_max)
    converged = newton_from_all(np.array(mechanism.leg_table), inputs / units.inputs, load / units.load, states)
    found = states[converged]
    _, keep = np.unique(np.round(found[:, 2 * mechanism.leg_count :], 5), axis=0, return_index=True)
    equilibria = [Equilibrium(mechanism, found[i], inputs, load) for i in sorted(keep)]
    return [e for e in equilibria if max(rod.rho for rod in e.rods) <= rho_max]


@kernel
def newton_at_pose_from_all(legs: Array, load: Array, states: Array, inputs: Array) -> Mask:
    """Correct each pair of state (m, size) and inputs (m, legs), in place, at its pose; return which converged."""
    work = make_workspace(legs.shape[0], states.shape[1])
    converged = np.zeros(states.shape[0], dtype=np.bool_)
    for n in range(states.shape[0]):
        converged[n] = solve_inverse_locally(legs, inputs[n], load, states[n], _SEARCH_RULES, work) == CONVERGED
    return converged


def find_inverse_equilibria(
    mechanism: Mechanism, pose: Array, load: Array, rng: np.random.Generator, starts: int = 2000, rho_max: float = 8.0
) -> list[Equilibrium]:
    """Return different equilibria at `pose` with every rho <= rho_max; some, not all."""
    units, legs = mechanism.units, mechanism.leg_count
    states = random_states(mechanism, rng, starts, rho_max)
    states[:, 2 * legs :] = pose / units.pose
    inputs = rng.uniform(-1.0, 1.0, (starts, legs)) * np.where(mechanism.leg_table[:, TURN] != 0.0, math.pi, 1.5)
    converged = newton_at_pose_from_all(np.array(mechanism.leg_table), load / units.load, states, inputs)
    states, inputs = states[converged], inputs[converged] * units.inputs
    _, keep = np.unique(np.round(states[:, : 2 * legs], 4), axis=0, return_index=True)
    equilibria = [Equilibrium(mechanism, states[i], inputs[i], load) for i in sorted(keep)]
    return [e for e in equilibria if max(rod.rho for rod in e.rods) <= rho_max]


# Home of the catalogued mechanisms as their design names it: pose, and the rods' common rho (None: any below 2)
HOME_POSES = {"2RFR": (0.0, 0.927501479), "2PFR": (0.0, 0.976), "3PFR": (0.0, 0.0, 0.161919)}
HOME_RHOS = {"2RFR": (0.5, 2.0), "2PFR": (0.5, 2.0), "3PFR": (6.3, 6.42)}


def home_by_construction(name: str) -> Equilibrium:
    """Return the home of a catalogued mechanism: each rod from clamp to hinge at the known pose, then Newton.

    Of the loads in the known range of rho, the one whose rod ends nearest to the hinge.
    """
    mechanism = get_mechanism(f"{name}-paper")
    pose, units = np.array(HOME_POSES[name]), mechanism.units
    inputs = np.array(mechanism.home_inputs)
    state = np.concatenate([np.zeros(2 * mechanism.leg_count), pose / units.pose])
    phi = pose[2] if len(pose) == 3 else 0.0
    for i, leg in enumerate(mechanism.legs):
        actuator, value = leg.actuator, float(inputs[i])
        base, clamp_angle = np.array(actuator.base), actuator.clamp_angle
        if isinstance(actuator, Revolute):
            clamp_angle += value
        else:
            base = base + value * np.array([math.cos(actuator.axis_angle), math.sin(actuator.axis_angle)])
        hinge = pose[:2] + _turned(np.array(leg.attachment), phi)
        state[2 * i : 2 * i + 2] = _load_of_tip(_turned(hinge - base, -clamp_angle) / leg.rod.length, *HOME_RHOS[name])
    work = make_workspace(mechanism.leg_count, mechanism.state_size)
    rules = NewtonRules(first_correction=1.0, contraction=10.0, iterations=20)
    status = solve_forward_locally(
        mechanism.leg_table, inputs / units.inputs, np.zeros(mechanism.dof), state, rules, work
    )
    assert status == CONVERGED
    return Equilibrium(mechanism, state, inputs, np.zeros(mechanism.dof))


def _turned(vector: Array, angle: float) -> Array:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([c * vector[0] - s * vector[1], s * vector[0] + c * vector[1]])


def _load_of_tip(tip: Array, rho_min: float, rho_max: float) -> Array:
    best, least = np.zeros(2), math.inf
    for rho in np.linspace(rho_min, rho_max, 25):
        for b in np.linspace(-math.pi, math.pi, 721):
            g = rho**2 * np.array([math.cos(b), -math.sin(b)])
            distance = float(np.hypot(*(np.array(rod(*g)[:2]) - tip)))
            if distance < least:
                best, least = g, distance
    return best
