"""Long steps along branches against the same way in many parts: does a step ever jump, or pass an unstable window?

Mechanisms are random: two legs of any kinds, platforms, and mirror images beside pitchforks with small asymmetries. A
step and the parts must come to the same event at the same place, and to the same state. Where they do not, still
smaller parts decide who is wrong. A solver failure is told, and so is no jump; where the rods are all but stretched, so
that forces exceed what is solved for, it is expected.
"""

import math
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.random import Generator

from pcm_gym.arrays import Array
from pcm_gym.kernels.branches.continuation import INDEX_CHANGE, NONE, SOLVER_FAILURE, follow_branch
from pcm_gym.kernels.statics.states import Point
from pcm_gym.mechanism import Leg, Mechanism, Prismatic, Revolute, Rod
from pcm_gym.solving import BranchTracker, Equilibrium, Event, solve_forward

Pair = tuple[float, float]

# Kinds of the legs' actuators.
TWO_LEGS, PLATFORMS = ("RR", "RP", "PP"), ("RRR", "RRP", "RPP", "PPP")
# Parts of a way, and of one that is in doubt.
PARTS, MORE_PARTS = 64, 4096
# Length of a step, from and to, in rad and lengths; the loads' largest, in EI / L^2.
SHORTEST, LONGEST, LARGEST_LOAD = 0.01, 2.0, 15.0
# Part of the ways that begin beside a pitchfork: within this distance, with asymmetries from and to.
_BESIDE, _NEAR, _LEAST_ASYMMETRY, _MOST_ASYMMETRY = 1.0 / 3.0, 1e-3, 1e-12, 1e-2
# Rods with larger loads than this are all but stretched.
_TAUT = 2e3
_LIMITS = (-50.0, 50.0)
# States and events are the same if they differ by less; at a fold states differ by the root of that.
_SAME_STATE, _SAME_FOLD, _SAME_FRACTION, _SAME_BIFURCATION = 1e-4, 3e-2, 1e-6, 1e-3


@dataclass(frozen=True)
class End:
    """Where a way ended."""

    event: int
    fraction: float
    x: Array  # (size,)

    @property
    def is_given_up(self) -> bool:
        """Whether the solver failed with rods that are all but stretched."""
        return self.event == SOLVER_FAILURE and float(np.abs(self.x).max()) > _TAUT

    def is_like(self, other: "End") -> bool:
        """Return whether both are one event at one place."""
        if self.event != other.event:
            return False
        room = _SAME_FRACTION + (_SAME_BIFURCATION if self.event == INDEX_CHANGE else 0.0)
        if abs(self.fraction - other.fraction) > room:
            return False
        tolerance = _SAME_STATE if self.event == NONE else _SAME_FOLD
        return bool(np.all(np.abs(self.x - other.x) <= tolerance * (1.0 + np.abs(other.x))))


@dataclass(frozen=True)
class Way:
    """A straight way of inputs and load, from an equilibrium."""

    start: Equilibrium
    inputs: Array
    load: Array
    asymmetry: float | None = None  # of a mechanism beside a pitchfork

    def gone(self, parts: int) -> End:
        """Return where the way ends, gone in so many steps."""
        mechanism = self.start.mechanism
        x, inputs, load = self.start.kernel_values()
        goal, goal_load = mechanism.units.kernel_from_inputs(self.inputs), mechanism.units.kernel_from_load(self.load)
        point = Point(x.copy(), inputs.copy(), load.copy())
        for part in range(1, parts + 1):
            ratio = part / parts
            target = goal if part == parts else inputs + ratio * (goal - inputs)
            target_load = goal_load if part == parts else load + ratio * (goal_load - load)
            event, fraction = follow_branch(mechanism.leg_table, point, target, target_load, False)
            if event != NONE:
                return End(event, (part - 1 + fraction) / parts, point.x)
        return End(NONE, 1.0, point.x)


@dataclass
class Tally:
    """What became of ways gone in one step."""

    events: Counter[int] = field(default_factory=Counter)
    given_up: int = 0
    wrong: list[Way] = field(default_factory=list)  # the step came to something else than the way in parts
    unresolved: list[Way] = field(default_factory=list)  # the parts did, as more of them show

    def judge(self, way: Way) -> None:
        """Go a way in one step and in parts, and count what they say."""
        once, parts = way.gone(1), way.gone(PARTS)
        self.events[once.event] += 1
        if once.is_given_up or parts.is_given_up:
            self.given_up += 1
        elif not once.is_like(parts):
            (self.unresolved if once.is_like(way.gone(MORE_PARTS)) else self.wrong).append(way)

    @property
    def jumps(self) -> list[Way]:
        """The wrong ones whose step says that it arrived, or found an event, but not where the branch has it."""
        return [way for way in self.wrong if way.gone(1).event != SOLVER_FAILURE]


def judged(count: int, seed: int, advance: Callable[[], None] = lambda: None) -> Tally:
    """Return what became of so many random ways."""
    tally, generator = Tally(), np.random.default_rng(seed)
    while tally.events.total() < count:
        is_beside = generator.random() < _BESIDE
        for way in ways_beside_pitchforks(generator) if is_beside else random_ways(generator):
            tally.judge(way)
            advance()
            if tally.events.total() == count:
                break
    return tally


def random_ways(generator: Generator) -> Iterator[Way]:
    """Yield ways from equilibria of a random loaded mechanism, stable and unstable; a third change the load too."""
    kinds = generator.choice(TWO_LEGS + PLATFORMS, p=[0.25] * 3 + [0.0625] * 4)
    mechanism = _random_mechanism(kinds, generator)
    load = _direction(generator, mechanism.dof) * generator.uniform(0.0, LARGEST_LOAD)
    is_angle = np.array([leg.actuator.is_angle for leg in mechanism.legs])
    inputs = generator.uniform(-1.5, 1.5, len(kinds)) * np.where(is_angle, 1.0, 0.4)
    found = list(solve_forward(mechanism, inputs, load, rho_max=9.0 if len(kinds) == 2 else 6.0))
    generator.shuffle(found)
    for start in found[:8]:
        for _ in range(8):
            length = _length(generator)
            moved = load + _direction(generator, mechanism.dof) * length if generator.random() < 1.0 / 3.0 else load
            yield Way(start, inputs + length * _direction(generator, len(kinds)), moved)


def ways_beside_pitchforks(generator: Generator) -> Iterator[Way]:
    """Yield ways from equilibria near a pitchfork of a mirror image, which is not quite one."""
    logarithms = math.log10(_LEAST_ASYMMETRY), math.log10(_MOST_ASYMMETRY)
    asymmetry, seed = 10.0 ** generator.uniform(*logarithms), generator.integers(2**62)
    kind = generator.choice(("RR", "PP"))
    even, odd = (_mirror_image(kind, each, np.random.default_rng(seed)) for each in (0.0, asymmetry))
    load, middle = np.array([0.0, generator.uniform(-LARGEST_LOAD, LARGEST_LOAD)]), generator.uniform(-1.0, 1.0)
    for pitchfork, place in _pitchforks(even, kind, load, middle):
        beside = place + 10.0 ** generator.uniform(-9.0, math.log10(_NEAR)) * generator.choice((-1.0, 1.0))
        inputs = _even_inputs(kind, beside) + generator.choice((0.0, asymmetry)) * generator.normal(size=2)
        near = [each for each in solve_forward(odd, inputs, load) if math.dist(each.pose, pitchfork.pose) < 0.15]
        for start in near[:5]:
            for _ in range(4):
                length = _length(generator)
                along = _even_inputs(kind, beside + generator.choice((-1.0, 1.0)) * length) - _even_inputs(kind, beside)
                is_along = generator.random() < 0.6
                yield Way(start, inputs + (along if is_along else length * _direction(generator, 2)), load, asymmetry)


def _pitchforks(even: Mechanism, kind: str, load: Array, middle: float) -> Iterator[tuple[Equilibrium, float]]:
    """Yield the states before pitchforks of a mirror image, and where on the line of even inputs they are."""
    found = [each for each in solve_forward(even, _even_inputs(kind, middle), load) if abs(each.pose[0]) < 1e-9]
    for each in found[:6]:
        for way in (1.5, -1.5):
            step = BranchTracker(even, each).step(_even_inputs(kind, middle + way))
            if step.event == Event.INDEX_CHANGE:
                yield step.equilibrium, middle + way * step.fraction


def _even_inputs(kind: str, value: float) -> Array:
    """Return inputs with which a mirror image stays one."""
    return np.array([0.5 * math.pi + value, 0.5 * math.pi - value]) if kind == "RR" else np.array([value, value])


def _mirror_image(kind: str, asymmetry: float, generator: Generator) -> Mechanism:
    """Return two legs that are mirror images about the y-axis, but for so much."""
    half, clamp, axis = generator.uniform(0.03, 0.6), *generator.uniform(0.0, math.pi, 2)
    legs = []
    for side in (-1.0, 1.0):
        off = asymmetry * generator.uniform(-1.0, 1.0, 6)
        base = (side * half + off[0], off[1])
        angle, axis_angle = (0.5 * math.pi - side * (each - 0.5 * math.pi) for each in (clamp, axis))
        actuator = (
            Revolute(base, clamp_angle=off[2], limits=_LIMITS)
            if kind == "RR"
            else Prismatic(base, axis_angle=axis_angle + off[2], clamp_angle=angle + off[3], limits=_LIMITS)
        )
        legs.append(Leg(actuator, Rod(length=1.0 + off[4], bending_stiffness=1.0 + off[5]), (0.0, 0.0)))
    return Mechanism("mirror image", tuple(legs), home_inputs=(0.0, 0.0))


def _random_mechanism(kinds: str, generator: Generator) -> Mechanism:
    if len(kinds) == 2:
        half = generator.uniform(0.03, 0.6)
        bases = [(side * half, generator.uniform(-0.1, 0.1)) for side in (-1.0, 1.0)]
        attachments = [(0.0, 0.0)] * 2
    else:
        outer, inner = generator.uniform(0.3, 1.0), generator.uniform(0.05, 0.3)
        angles = np.array([0.5, 2.6, 4.7]) + generator.uniform(-0.3, 0.3, 3)
        bases, attachments = ([(r * math.cos(a), r * math.sin(a)) for a in angles] for r in (outer, inner))
    legs = tuple(_random_leg(*each, generator) for each in zip(kinds, bases, attachments, strict=True))
    return Mechanism(kinds, legs, home_inputs=(0.0,) * len(kinds))


def _random_leg(kind: str, base: Pair, attachment: Pair, generator: Generator) -> Leg:
    clamp_angle, axis_angle = generator.uniform(-math.pi, math.pi, 2)
    rod = Rod(length=generator.uniform(0.6, 1.4), bending_stiffness=generator.uniform(0.5, 2.0))
    actuator = (
        Revolute(base, clamp_angle=clamp_angle, limits=_LIMITS)
        if kind == "R"
        else Prismatic(base, axis_angle=axis_angle, clamp_angle=clamp_angle, limits=_LIMITS)
    )
    return Leg(actuator, rod, attachment)


def _length(generator: Generator) -> float:
    return float(10.0 ** generator.uniform(math.log10(SHORTEST), math.log10(LONGEST)))


def _direction(generator: Generator, count: int) -> Array:
    drawn: Array = generator.normal(size=count)
    return drawn / np.linalg.norm(drawn)


def described(way: Way) -> str:
    """Return a line on what a way comes to."""
    ends = ", ".join(
        f"{parts}: {Event(end.event)} at {end.fraction:.9f}"
        for parts in (1, PARTS, MORE_PARTS)
        for end in (way.gone(parts),)
    )
    beside = "" if way.asymmetry is None else f", asymmetry {way.asymmetry:.1e}"
    length = float(np.linalg.norm(np.asarray(way.inputs) - way.start.inputs))
    return f"{way.start.mechanism.name}{beside}, index {way.start.index}, length {length:.4f}; {ends}"
