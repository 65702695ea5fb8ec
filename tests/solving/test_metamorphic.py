"""What does not matter makes no difference: where a mechanism stands, how it is turned, mirrored, numbered, measured.

The truth is that of another mechanism, which is the same one seen otherwise: the sets of equilibria, forward and
inverse, and the rollouts of environments, correspond to 1e-10.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

import pcm_gym
from pcm_gym.arrays import Array
from pcm_gym.mechanism import Leg, Mechanism, Prismatic, Revolute, Rod
from tests.environments.rollouts import sweeping_actions
from tests.reference.mechanisms import FAMILIES, random_inputs, random_load, random_mechanism

TOLERANCE = 1e-10
# Rounding errors of an equilibrium are those of the data over its least stiffness, in EI / L^2 and rad: none that is
# softer is compared so closely.
LEAST_STIFFNESS = 0.5
RHO_MAX = {"2RFR": 8.0, "2PFR": 8.0, "3PFR": 6.0}


@dataclass(frozen=True)
class View:
    """Another view of the same mechanism: turned by an angle and moved, after being mirrored at the x axis, enlarged.

    Legs are numbered by `order`; rods are stiffer by a factor in N m^2 beside that which their length brings.
    """

    angle: float = 0.0
    shift: tuple[float, float] = (0.0, 0.0)
    is_mirrored: bool = False
    order: tuple[int, ...] | None = None
    length: float = 1.0
    stiffness: float = 1.0

    @property
    def side(self) -> float:
        return -1.0 if self.is_mirrored else 1.0

    def direction(self, vector: Any) -> Array:
        """A vector, turned and mirrored."""
        x, y = vector[0], self.side * vector[1]
        c, s = math.cos(self.angle), math.sin(self.angle)
        return np.array([c * x - s * y, s * x + c * y])

    def point(self, point: Any) -> Array:
        return self.length * self.direction(point) + self.shift

    def pose(self, pose: Array) -> Array:
        return np.append(self.point(pose), self.side * pose[2:] + self.angle)

    def load(self, load: Array) -> Array:
        force = self.stiffness / self.length**2
        return np.append(force * self.direction(load), force * self.length * self.side * load[2:])

    def inputs(self, inputs: Array, mechanism: Mechanism) -> Array:
        factors = [self.side if leg.actuator.is_angle else self.length for leg in mechanism.legs]
        return self.ordered(inputs * factors)

    def ordered(self, values: Any) -> Any:
        return values if self.order is None else np.asarray(values)[list(self.order)]

    def actions(self, actions: Array, mechanism: Mechanism) -> Array:
        signs = [self.side if leg.actuator.is_angle else 1.0 for leg in mechanism.legs]
        return self.ordered((actions * signs).T).T

    def mechanism(self, mechanism: Mechanism) -> Mechanism:
        legs = tuple(map(self._leg, mechanism.legs))
        home = self.inputs(np.array(mechanism.home_inputs), mechanism)
        order = range(len(legs)) if self.order is None else self.order
        return replace(
            mechanism, name="seen otherwise", legs=tuple(legs[n] for n in order), home_inputs=tuple(home.tolist())
        )

    def _leg(self, leg: Leg) -> Leg:
        old, (x, y) = leg.actuator, self.point(leg.actuator.base).tolist()
        clamp = self.side * old.clamp_angle + self.angle
        lower, upper = old.limits
        new: Any
        if isinstance(old, Revolute):
            new = Revolute((x, y), clamp, (-upper, -lower) if self.is_mirrored else (lower, upper))
        else:
            limits = (self.length * lower, self.length * upper)
            new = Prismatic((x, y), self.side * old.axis_angle + self.angle, clamp, limits)
        rod = Rod(self.length * leg.rod.length, self.stiffness * leg.rod.bending_stiffness)
        x, y = leg.attachment
        return Leg(new, rod, (self.length * x, self.length * self.side * y))


VIEWS = {
    "moved": lambda legs: View(shift=(0.7, -1.3)),
    "turned": lambda legs: View(angle=2.1),
    "mirrored": lambda legs: View(is_mirrored=True),
    "numbered otherwise": lambda legs: View(order=(*range(1, legs), 0)),
    "in other units": lambda legs: View(length=37.0, stiffness=0.023),
    "all at once": lambda legs: View(-0.9, (0.3, 0.4), True, tuple(reversed(range(legs))), 0.3, 50.0),
}


@pytest.fixture(params=list(VIEWS))
def view_of(request: pytest.FixtureRequest) -> Callable[[int], View]:
    view: Callable[[int], View] = VIEWS[request.param]
    return view


def turned(gap: Array, period: float = 2.0 * math.pi) -> Array:
    """Differences of angles without full turns."""
    return gap - period * np.round(gap / period)


def gap(equilibrium: pcm_gym.Equilibrium, pose: Array, inputs: Array) -> float:
    """How far an equilibrium is from a pose and inputs, dimensionless, full turns aside."""
    mechanism = equilibrium.mechanism
    of_pose = (equilibrium.pose - pose) / mechanism.units.pose
    of_pose[2:] = turned(of_pose[2:])
    of_inputs = (equilibrium.inputs - inputs) / mechanism.units.inputs
    of_inputs = np.where([leg.actuator.is_angle for leg in mechanism.legs], turned(of_inputs), of_inputs)
    return float(max(np.abs(of_pose).max(), np.abs(of_inputs).max()))


def assert_same_sets(first: pcm_gym.EquilibriumSet, second: pcm_gym.EquilibriumSet, view: View) -> int:
    """Each has its counterpart: same modes, index, energy, pose, inputs; return how many were compared closely."""
    assert len(first) == len(second)
    left, compared = list(second), 0
    for found in first:
        mechanism, units = found.mechanism, second[0].mechanism.units
        there = view.pose(found.pose), view.inputs(found.inputs, mechanism)
        modes = tuple(view.ordered(found.modes))
        candidates = [other for other in left if (other.modes, other.index) == (modes, found.index)]
        other = min(candidates, key=lambda other, there=there: gap(other, *there))  # type: ignore[misc]
        left.remove(other)
        stiffness = np.abs(np.linalg.eigvalsh(found.stiffness / mechanism.units.stiffness)).min()
        if stiffness > LEAST_STIFFNESS:
            compared += 1
            assert gap(other, *there) < TOLERANCE
            # of the rods alone: the potential of a load has its zero where the origin is, and at the angle zero
            bending = view.stiffness / view.length * (found.energy + found.load @ found.pose)
            assert abs(other.energy + other.load @ other.pose - bending) < TOLERANCE * (units.energy + bending)
            assert abs(other.stability_margin - found.stability_margin) < 1e-8 * (1.0 + abs(found.stability_margin))
    return compared


@pytest.mark.parametrize("family", FAMILIES)
def test_the_equilibria_at_inputs_are_the_same_seen_otherwise(family: str, view_of: Callable[[int], View]) -> None:
    rng, compared = np.random.default_rng(5), 0
    for _ in range(1 if family == "3PFR" else 4):
        mechanism = random_mechanism(family, rng)
        inputs, load, view = random_inputs(mechanism, rng), random_load(mechanism, rng), view_of(mechanism.leg_count)
        other = view.mechanism(mechanism)
        first = pcm_gym.solve_forward(mechanism, inputs, load, RHO_MAX[family])
        second = pcm_gym.solve_forward(other, view.inputs(inputs, mechanism), view.load(load), RHO_MAX[family])
        compared += assert_same_sets(first, second, view)
    assert compared > 4


@pytest.mark.parametrize("family", FAMILIES)
def test_the_inputs_and_equilibria_at_a_pose_are_the_same_seen_otherwise(
    family: str, view_of: Callable[[int], View]
) -> None:
    rng, compared = np.random.default_rng(6), 0
    for _ in range(1 if family == "3PFR" else 4):
        mechanism = random_mechanism(family, rng)
        load, view = random_load(mechanism, rng), view_of(mechanism.leg_count)
        start = pcm_gym.solve_forward(mechanism, random_inputs(mechanism, rng), load, RHO_MAX[family])[0]
        first = pcm_gym.solve_inverse(mechanism, start.pose, load, RHO_MAX[family])
        second = pcm_gym.solve_inverse(
            view.mechanism(mechanism), view.pose(start.pose), view.load(load), RHO_MAX[family]
        )
        compared += assert_same_sets(first, second, view)
    assert compared > 4


@pytest.mark.parametrize(
    ("name", "behaviour"), [("2RFR", "terminate"), ("2RFR", "hold"), ("2PFR", "continue"), ("3PFR", "hold")]
)
def test_rollouts_are_the_same_seen_otherwise(name: str, behaviour: Any, view_of: Callable[[int], View]) -> None:
    """All but starts and goals, which are asked for: they are drawn from rasters, which do not turn with mechanisms."""
    mechanism = pcm_gym.get_mechanism(f"{name}-paper")
    view, load = view_of(mechanism.leg_count), 0.3 * mechanism.units.load
    other = view.mechanism(mechanism)
    arguments: dict[str, Any] = {"on_instability": behaviour, "hold_steps": 1, "success_distance": 0.1}
    first = pcm_gym.MechanismEnv(mechanism, max_action=0.1, **arguments)
    sizes = np.abs(view.inputs(first.max_action, mechanism))
    arguments["success_distance"] *= view.length
    second = pcm_gym.MechanismEnv(other, max_action=sizes, **arguments)
    home = pcm_gym.BranchTracker(mechanism, pcm_gym.home_equilibrium(mechanism)).step(
        np.array(mechanism.home_inputs), load
    )
    begun = pcm_gym.Equilibrium(other, _seen(home.equilibrium.state, view, mechanism), *_at(home.equilibrium, view))
    goal = home.equilibrium.pose - 0.05
    first.reset(seed=0, options={"equilibrium": home.equilibrium, "goal": goal})
    second.reset(seed=0, options={"equilibrium": begun, "goal": view.pose(goal)})
    for action in sweeping_actions(60, (mechanism.leg_count,), seed=3).astype(np.float64):
        one, two = first.step(action), second.step(view.actions(action[None], mechanism)[0])
        assert one[2:4] == two[2:4]
        here, there = one[4], two[4]
        for key in ("event", "at_limit", "index", "is_success", "cost"):
            assert here[key] == there[key], key
        if one[2] or one[3]:
            break  # the last state before a fold is known as well as folds are, to 1e-8
        assert abs(one[1] - two[1]) < TOLERANCE * 100.0  # the reward falls by 10 over a rod's length
        gap = (second.equilibrium.pose - view.pose(first.equilibrium.pose)) / other.units.pose
        gap[2:] = turned(gap[2:])
        scale = 1.0 / min(1.0, max(here["singularity_margin"], 1e-3))
        assert np.abs(gap).max() < TOLERANCE * scale
        assert np.abs(view.inputs(first.equilibrium.inputs, mechanism) - second.equilibrium.inputs).max() < TOLERANCE
        assert abs(here["stability_margin"] - there["stability_margin"]) < 1e-8 * scale * (
            1.0 + here["stability_margin"]
        )
        assert abs(here["singularity_margin"] - there["singularity_margin"]) < 1e-8 * scale


def _at(equilibrium: pcm_gym.Equilibrium, view: View) -> tuple[Array, Array]:
    return view.inputs(equilibrium.inputs, equilibrium.mechanism), view.load(equilibrium.load)


def _seen(state: Array, view: View, mechanism: Mechanism) -> Array:
    """The kernels' state seen otherwise: loads as the tips see them, dimensionless, and the pose."""
    legs, other = mechanism.leg_count, view.mechanism(mechanism)
    loads = state[: 2 * legs].reshape(-1, 2) * [1.0, view.side]
    pose = view.pose(mechanism.units.pose_from_kernel(state[2 * legs :]))
    return np.concatenate([np.ravel(view.ordered(loads)), other.units.kernel_from_pose(pose)])
