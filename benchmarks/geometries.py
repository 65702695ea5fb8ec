"""A search for geometries that could be built and are worth controlling; the catalogue's are from it, made round.

Points of a Sobol sequence over a family's parameters are judged in stages, the cheapest first: a home at the centre,
unloaded by contact and far from yield; a coarse chart of what stable walks reach from it, not beyond states that yield
or cross; the limits within which no such state is reached and most inputs are covered twice. What is left is judged as
the catalogue is, by `Evidence`. Results go to a file as they come, and a search goes on where that ends.
"""

import json
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy import sparse
from scipy.sparse import csgraph
from scipy.stats import qmc

from benchmarks.evidence import Evidence, Strength
from pcm_gym.arrays import Array, Integers, Mask
from pcm_gym.kernels.charts.walks import walk
from pcm_gym.kernels.statics.states import States, are_same
from pcm_gym.mechanism import SPRING_STEEL, Leg, Mechanism, Prismatic, Revolute, Rod, Strip
from pcm_gym.solving import Equilibrium, solve_forward

_ROD = Rod(1.0, section=Strip(20e-3, 0.5e-3), material=SPRING_STEEL)
_UP = math.pi / 2.0
# Homes: largest rho searched, distance from the centre line, least margin, largest stress.
_RHO_MAX, _CENTRED, _LEAST_MARGIN, _HOME_STRESS = 5.0, 1e-6, 0.03, 0.45
# Charts: margin of the walks, and states beyond which none is grown.
_MARGIN, _MOST_STATES, _LARGEST_STRESS = 0.0225, 40_000, 0.9
# Least share of the inputs that is covered, and of these twice, for a geometry to be judged.
_COVERED, _AGAIN = 0.8, 0.03
_MOVES, _EPISODES = 300, 128


@dataclass(frozen=True)
class Family:
    """Geometries with parameters between two bounds; `make` gives them limits far beyond the chart.

    Attributes
    ----------
    make : callable
        From the parameters to a mechanism whose home inputs are the middle of the chart.
    lower, upper : tuple of float
        Bounds of the parameters.
    pitch : float
        Between the nodes of the chart, rad or m.
    reach : int
        Nodes to either side of home.
    signs : tuple of int
        Sense of each input in which limits are alike.
    """

    make: Callable[[Array], Mechanism]
    lower: tuple[float, ...]
    upper: tuple[float, ...]
    pitch: float
    reach: int
    signs: tuple[int, ...]


def _pair_of_motors(parameters: Array) -> Mechanism:
    (half,) = parameters
    motors = [Revolute(base=(side * half, 0.0), limits=(-9.0, 9.0)) for side in (-1.0, 1.0)]
    inputs = (math.radians(120.0), math.radians(60.0))
    return Mechanism("2RFR", tuple(Leg(motor, _ROD) for motor in motors), home_inputs=inputs)


def _pair_of_rails(parameters: Array) -> Mechanism:
    half, lean, turn = parameters
    rails = [
        Prismatic((side * half, 0.0), _UP - side * lean, _UP + side * turn, limits=(-2.0, 2.0)) for side in (-1.0, 1.0)
    ]
    return Mechanism("2PFR", tuple(Leg(rail, _ROD) for rail in rails), home_inputs=(0.0, 0.0))


def _platform(parameters: Array) -> Mechanism:
    hinge_radius, gap, clamp_turn, rail_turn = parameters
    legs = []
    for direction in np.radians([90.0, 210.0, 330.0]).tolist():
        x, y = math.cos(direction), math.sin(direction)
        base = ((hinge_radius + gap) * x, (hinge_radius + gap) * y)
        rail = Prismatic(base, direction + _UP + rail_turn, direction + math.pi + clamp_turn, limits=(-2.0, 2.0))
        legs.append(Leg(rail, _ROD, (hinge_radius * x, hinge_radius * y)))
    return Mechanism("3PFR", tuple(legs), home_inputs=(0.0, 0.0, 0.0))


FAMILIES = {
    # half the distance of the motors
    "2RFR": Family(_pair_of_motors, (0.1,), (0.5,), math.pi / 18.0, 30, (1, -1)),
    # half the distance of the rails, how far they lean outwards, and the clamps inwards
    "2PFR": Family(_pair_of_rails, (0.03, -0.3, -0.6), (0.6, 2.2, 2.4), 0.05, 16, (1, 1)),
    # circle of the hinges, how far outside the bases are, turns of the clamps from inwards, of the rails from tangents
    "3PFR": Family(_platform, (0.25, 0.7, 0.0, -_UP), (0.85, 0.975, 0.6, _UP), 0.1, 8, (1, 1, 1)),
}


@dataclass(frozen=True)
class Chart:
    """States that stable walks reach from home, not beyond bad ones, on a raster of the inputs around it."""

    offsets: Integers  # (n, legs): nodes from home
    ways: Integers  # (m, 2): states that a walk joins
    is_bad: Mask  # (n,): whether a rod yields or crosses what it must not

    def within(self, least: int, most: int, signs: Integers) -> tuple[float, float, bool]:
        """Return covered share of the inputs within limits, that covered again, and whether a bad state is reached."""
        inside = np.asarray(((self.offsets * signs >= -least) & (self.offsets * signs <= most)).all(axis=1))
        ways, count = self.ways[inside[self.ways].all(axis=1)], len(inside)
        graph = sparse.csr_array((np.ones(len(ways)), (ways[:, 0], ways[:, 1])), shape=(count, count))
        _, labels = csgraph.connected_components(graph, directed=False)
        reached = np.flatnonzero((labels == labels[0]) & inside)
        _, layers = np.unique(self.offsets[reached], axis=0, return_counts=True)
        cells = (least + most + 1) ** self.offsets.shape[1]
        return len(layers) / cells, float(np.mean(layers > 1)), bool(self.is_bad[reached].any())


def chart_around(home: Equilibrium, pitch: float, reach: int) -> Chart:
    """Chart what stable walks from node to node reach from home; cheaper than a roadmap, and not quite complete."""
    mechanism, (x0, inputs0, load) = home.mechanism, home.kernel_values()
    legs = mechanism.leg_count
    step = mechanism.units.kernel_from_inputs(np.full(legs, pitch))
    sides = np.concatenate([np.eye(legs, dtype=np.int64), -np.eye(legs, dtype=np.int64)])
    x, offsets, is_bad, ways = [x0], [np.zeros(legs, dtype=np.int64)], [False], []
    members: dict[tuple[int, ...], list[int]] = {(0,) * legs: [0]}
    done = 0
    while done < len(x) < _MOST_STATES:
        front = [node for node in range(done, len(x)) if not is_bad[node]]
        done = len(x)
        origins, ends = (
            np.repeat(front, 2 * legs),
            np.concatenate([offsets[node] + sides for node in front] or [sides[:0]]),
        )
        inside = (np.abs(ends) <= reach).all(axis=1)
        origins, ends = origins[inside], ends[inside]
        goals = inputs0 + ends * step
        states = States(
            np.array([x[node] for node in origins]).reshape(-1, len(x0)),
            inputs0 + np.array([offsets[node] for node in origins]).reshape(-1, legs) * step,
            np.tile(load, (len(origins), 1)),
        )
        walk(mechanism.leg_table, states, goals, 0.5 * step, np.full(len(origins), 3), _MARGIN)
        for row in np.flatnonzero((states.inputs == goals).all(axis=1)).tolist():
            there = members.setdefault(tuple(ends[row].tolist()), [])
            node = next((own for own in there if are_same(states.x[row], x[own], legs)), len(x))
            if node == len(x):
                there.append(node)
                x.append(states.x[row].copy())
                offsets.append(ends[row])
            ways.append((int(origins[row]), node))
        new = np.array(x[done:]).reshape(-1, len(x0))
        strength = Strength.of(mechanism, new, inputs0 + np.array(offsets[done:]).reshape(-1, legs) * step)
        is_bad += ((strength.stress > _LARGEST_STRESS) | strength.has_contact).tolist()
    return Chart(np.array(offsets), np.array(ways, dtype=np.int64).reshape(-1, 2), np.array(is_bad))


def _homes(mechanism: Mechanism) -> Iterator[Equilibrium]:
    """Yield stable equilibria at the centre that a rod endures easily."""
    for found in solve_forward(mechanism, mechanism.home_inputs or (), rho_max=_RHO_MAX).stable:
        off = found.pose[: mechanism.dof - 1]
        state, inputs, _ = found.kernel_values()
        strength = Strength.of(mechanism, state[None], inputs[None])
        is_fit = strength.stress[0] < _HOME_STRESS and not strength.has_contact[0]
        if is_fit and found.singularity_margin > _LEAST_MARGIN and np.abs(off).max() < _CENTRED:
            yield found


def _limited(home: Equilibrium, least: float, most: float, signs: tuple[int, ...]) -> Mechanism:
    legs = []
    for leg, value, sign in zip(home.mechanism.legs, home.inputs.tolist(), signs, strict=True):
        ends = sorted((value - sign * least, value + sign * most))
        legs.append(replace(leg, actuator=replace(leg.actuator, limits=tuple(ends))))
    return replace(home.mechanism, legs=tuple(legs), home_pose=tuple(home.pose.tolist()))


def _evidence(mechanism: Mechanism) -> dict[str, Any]:
    try:
        evidence = Evidence.of(mechanism, _MOVES, _EPISODES)
    except ValueError as error:  # home is nearer to a fold than starts may be
        return {"failings": [str(error)]}
    return {"lost": evidence.moves.lost, "jacobian": evidence.resolved_rate.safe, "failings": evidence.failings}


def judge(family: Family, parameters: Array) -> list[dict[str, Any]]:
    """Return what is known of each home of a geometry, with the best limits; evidence where these promise much."""
    found = []
    for home in _homes(family.make(parameters)):
        chart, signs = chart_around(home, family.pitch, family.reach), np.array(family.signs)
        best: tuple[float, float, int, int] = (0.0, 0.0, 0, 0)
        for least in range(2, family.reach + 1):
            for most in range(2, family.reach + 1):
                covered, again, is_bad = chart.within(least, most, signs)
                if not is_bad and covered >= _COVERED:
                    best = max(best, (again, covered, least, most))
        again, covered, least, most = best
        limits = family.pitch * least, family.pitch * most
        own: dict[str, Any] = {"pose": home.pose.tolist(), "limits": limits, "covered": covered, "again": again}
        if again >= _AGAIN:
            own |= _evidence(_limited(home, *limits, family.signs))
        found.append(own)
    return found


def search(name: str, count: int, path: Path, advance: Callable[[], None] = lambda: None) -> None:
    """Judge the first `count` points of a family's sequence; those that the file holds already are left out."""
    family = FAMILIES[name]
    points = qmc.scale(qmc.Sobol(len(family.lower), seed=0).random(count), family.lower, family.upper)
    lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
    known = {own["point"] for own in map(json.loads, lines) if own["family"] == name}
    with path.open("a", encoding="utf-8") as file:
        for number, parameters in enumerate(points):
            if number not in known:
                homes = judge(family, parameters)
                line = {"family": name, "point": number, "parameters": parameters.round(4).tolist(), "homes": homes}
                file.write(json.dumps(line) + "\n")
                file.flush()
            advance()
