"""Random position problems: geometry near the catalogue's, unequal rods, sliders at angles, a load on every third."""

import math
from dataclasses import dataclass

import numpy as np

from pcm_gym.arrays import Array
from pcm_gym.mechanism import Leg, Mechanism, Prismatic, Revolute, Rod
from pcm_gym.solving import EquilibriumSet, solve_forward, solve_inverse

MECHANISMS = ("2RFR", "2PFR", "3PFR")
_STRONGEST_LOAD = 8.0  # in EI / L^2


@dataclass(frozen=True, eq=False)
class Problem:
    """All equilibria at given inputs (forward) or at a given pose (inverse)."""

    mechanism: Mechanism
    is_inverse: bool
    given: Array  # (legs,): the inputs, or the pose
    load: Array  # (d,)
    rho_max: float

    @property
    def kind(self) -> str:
        """What the rod's table is made for."""
        return f"{'inverse' if self.is_inverse else 'forward'}, rho up to {self.rho_max:g}"

    def solve(self) -> EquilibriumSet:
        """Return all equilibria, by the solver of the package."""
        solve = solve_inverse if self.is_inverse else solve_forward
        return solve(self.mechanism, self.given, self.load, self.rho_max)


def make_problems(name: str, count: int, *, is_inverse: bool) -> list[Problem]:
    """Return the first `count` problems of a mechanism's endless list: always the same, each with a solution."""
    problems: list[Problem] = []
    seed = 0
    while len(problems) < count:
        problem = _make_problem(name, is_inverse, len(problems) % 3 == 2, np.random.default_rng([seed, is_inverse]))
        if problem.solve():
            problems.append(problem)
        seed += 1
    return problems


def _make_problem(name: str, is_inverse: bool, is_loaded: bool, rng: np.random.Generator) -> Problem:
    mechanism = _platform(rng) if name == "3PFR" else _pair(name, rng)
    load = rng.uniform(-_STRONGEST_LOAD, _STRONGEST_LOAD, mechanism.dof) * mechanism.units.load * is_loaded
    if is_inverse and name == "3PFR":
        given = rng.uniform([-0.2, -0.2, -0.5], [0.2, 0.2, 0.5])
    elif is_inverse:
        given = rng.uniform([-0.4, 0.1], [0.4, 1.0])
    elif name == "2RFR":
        given = rng.uniform(0.0, math.pi, 2)
    else:
        given = rng.uniform(-0.3, 0.3, mechanism.leg_count)
    return Problem(mechanism, is_inverse, given, load, 6.5 if name == "3PFR" and not is_inverse else 9.0)


def _rod(rng: np.random.Generator) -> Rod:
    return Rod(float(rng.uniform(0.8, 1.3)), float(3.0 ** rng.uniform(-0.5, 0.5)))


def _pair(name: str, rng: np.random.Generator) -> Mechanism:
    legs = []
    for side in (-1.0, 1.0):
        base = (side * rng.uniform(0.1, 0.4), rng.uniform(-0.1, 0.1))
        if name == "2RFR":
            legs.append(Leg(Revolute(base), _rod(rng)))
        else:
            axis, clamp = math.pi / 2.0 + rng.uniform(-0.6, 0.6, 2)
            legs.append(Leg(Prismatic(base, axis, clamp), _rod(rng)))
    return Mechanism(name, tuple(legs))


def _platform(rng: np.random.Generator) -> Mechanism:
    legs = []
    for third in range(3):
        direction = math.pi / 2.0 + third * 2.0 * math.pi / 3.0 + rng.uniform(-0.3, 0.3)
        outwards = np.array([math.cos(direction), math.sin(direction)])
        axis, clamp = direction + math.pi / 2.0 + rng.uniform(-0.3, 0.3), direction + math.pi + rng.uniform(0.4, 1.2)
        actuator = Prismatic(tuple(rng.uniform(0.55, 0.9) * outwards), axis, clamp)
        legs.append(Leg(actuator, _rod(rng), tuple(rng.uniform(0.15, 0.4) * outwards)))
    return Mechanism("3PFR", tuple(legs))
