"""Symmetric platforms on a grid of designs, and what may be wrong with a set of their equilibria.

`python -m tests.reference.symmetric_designs` examines all of them: some minutes.
"""

import itertools
import math
import sys
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from pcm_gym.arrays import Array
from pcm_gym.mechanism import Leg, Mechanism, Prismatic, Revolute, Rod
from pcm_gym.solving import Equilibrium, EquilibriumSet, solve_forward
from tests.reference.rod_ode import integrate_rod

RHO_MAX = 6.5
DIRECTIONS = np.radians([90.0, 210.0, 330.0])


class Design(NamedTuple):
    """Three equal rods of length and stiffness 1 between two circles; `turn` is that of the clamps from inwards."""

    base: float
    platform: float
    turn: float
    has_motors: bool = False

    def mechanism(self) -> Mechanism:
        """Return the mechanism, at whose inputs 0 it is symmetric."""
        legs = []
        for angle in DIRECTIONS:
            outwards, inwards = np.array([math.cos(angle), math.sin(angle)]), angle + math.pi
            base, hinge = tuple(self.base * outwards), tuple(self.platform * outwards)
            rail = Prismatic(base, angle + 0.5 * math.pi, inwards + self.turn)
            motor = Revolute(base, inwards + self.turn)
            legs.append(Leg(motor if self.has_motors else rail, Rod(1.0, 1.0), hinge))
        return Mechanism(f"symmetric {self}", tuple(legs))

    def equilibria(self) -> EquilibriumSet:
        """Return all equilibria at inputs 0."""
        return solve_forward(self.mechanism(), np.zeros(3), rho_max=RHO_MAX)

    @property
    def has_straight_rods(self) -> bool:
        """Whether rods on three lines through the centre just reach from one circle to the other."""
        spans = {0.0: (self.base + self.platform, self.base - self.platform), math.pi: (self.platform - self.base,)}
        return any(abs(span - 1.0) < 1e-9 for span in spans.get(self.turn, ()))


def grid() -> list[Design]:
    """Return the designs: base circle, platform circle, turn of the clamps; in each row one with a sum of L."""
    designs = []
    for base, turn in itertools.product(
        (0.3, 0.5, 0.6, 0.7, 0.9, 1.2), (0.0, 0.3, 0.9, 0.5 * math.pi, 2.2, math.pi, -0.9)
    ):
        reaching = {round(1.0 - base, 12)} if base < 1.0 else {round(base - 1.0, 12)}
        designs += [Design(base, platform, turn) for platform in sorted({0.1, 0.2, 0.3, 0.45, 0.7} | reaching)]
    return designs


def own_residual(equilibrium: Equilibrium) -> float:
    """Return the largest error of closure, and of force and moment over 1 + force, by integrating each rod's ODE."""
    mechanism, state = equilibrium.mechanism, equilibrium.state
    pose = np.append(equilibrium.pose, 0.0)[:3]
    balance, largest, error = -np.append(equilibrium.load, 0.0)[:3], 0.0, 0.0
    for i, (leg, value) in enumerate(zip(mechanism.legs, equilibrium.inputs, strict=True)):
        rod = integrate_rod(state[2 * i], state[2 * i + 1])
        tip = leg.actuator.clamp_point(value) + leg.rod.length * turned(leg.actuator.clamp_direction(value), rod.tip)
        unit = leg.rod.bending_stiffness / leg.rod.length**2
        force = unit * turned(leg.actuator.clamp_direction(value), rod.force)
        arm = turned(pose[2], np.array(leg.attachment))
        error = max(error, float(np.abs(tip - pose[:2] - arm).max()))
        balance += [*force, arm[0] * force[1] - arm[1] * force[0]]
        largest = max(largest, float(np.abs(force).max()))
    return max(error, float(np.abs(balance).max()) / (1.0 + largest))


def turned(angle: float, vector: Array) -> Array:
    """Return a vector turned by an angle."""
    c, s = math.cos(angle), math.sin(angle)
    return np.array([c * vector[0] - s * vector[1], s * vector[0] + c * vector[1]])


def distance(one: Equilibrium, other: Equilibrium) -> float:
    """Return how far two equilibria are apart: pose, or tip forces relative to 1 + the largest of them."""
    pose = one.pose - other.pose
    pose[2:] = np.remainder(pose[2:] + math.pi, 2.0 * math.pi) - math.pi
    forces, others = (np.array([rod.force for rod in each.rods]) for each in (one, other))
    return max(float(np.abs(pose).max()), float(np.abs(forces - others).max() / (1.0 + np.abs(forces).max())))


def doubles(found: Sequence[Equilibrium], least: float = 1e-6) -> list[tuple[Equilibrium, Equilibrium]]:
    """Return the pairs that are one but for `least`."""
    return [pair for pair in itertools.combinations(found, 2) if distance(*pair) < least]


def straight_family_faults(design: Design, found: EquilibriumSet) -> list[str]:
    """Return what is wrong with the families of a design: there is one, of straight rods, where these reach."""
    if not design.has_straight_rods:
        return [f"{family!r} for no reason" for family in found.families]
    if [family.dimension for family in found.families] != [1]:
        return [f"families {found.families}, one of dimension 1 is due"]
    (family,) = found.families
    faults = [f"{family!r} called stable"] if family.representative.is_stable else []
    for amount in (-20.0, -3.0, 0.7, 30.0):
        state = family.representative.state + amount * family.directions[0, : len(family.representative.state)]
        moved = Equilibrium(family.representative.mechanism, state, np.zeros(3), np.zeros(3))
        if own_residual(moved) > 1e-10:
            faults.append(f"{family!r} ends at {amount}")
        if any(distance(moved, member) < 1e-3 for member in found):
            faults.append(f"{family!r} has members among the isolated ones")
    return faults


def faults(design: Design, found: EquilibriumSet, sample: int) -> list[str]:
    """Return what is wrong with a set; of its members so many are integrated, evenly spread."""
    wrong = [f"double {pair}" for pair in doubles(found)] + straight_family_faults(design, found)
    for equilibrium in found[:: max(1, len(found) // sample)]:
        if own_residual(equilibrium) > 1e-9:
            wrong.append(f"{equilibrium!r} has residual {own_residual(equilibrium)}")
    if len(found) > 200:
        wrong.append(f"{len(found)} equilibria")
    return wrong


def main() -> int:
    """Examine the whole grid; return 1 if anything is wrong."""
    designs, wrong = grid(), 0
    for design in designs:
        found = design.equilibria()
        own = faults(design, found, sample=6)
        wrong += bool(own)
        print(design, len(found), "equilibria", *map(repr, found.families), *own, sep="; ", flush=True)
    reaching = sum(design.has_straight_rods for design in designs)
    print(f"{len(designs)} designs, {reaching} with straight rods that just reach, {wrong} with faults")
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main())
