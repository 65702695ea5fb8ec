"""Where episodes take place: a mechanism under a load, and where it can go without losing stability."""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from pcm_gym.arrays import Array, Integers, Mask
from pcm_gym.kernels.charts.roadmap import grow, move_rows, pose_densities
from pcm_gym.kernels.charts.walks import walk
from pcm_gym.kernels.enumeration.linearisation import linearised
from pcm_gym.kernels.numerics.notice import expect
from pcm_gym.kernels.numerics.threads import MOST_THREADS, pieces_of, run_all
from pcm_gym.kernels.snaps.instability import TERMINATE
from pcm_gym.kernels.statics.equilibrium import describe_equilibrium
from pcm_gym.kernels.statics.states import States
from pcm_gym.mechanism import Mechanism
from pcm_gym.mechanism.validation import (
    Shape,
    finite_array,
    finite_tuple,
    instance_of,
    number_not_negative,
    shown,
    whole_array,
    whole_number,
)
from pcm_gym.solving import Equilibrium, Roadmap, build_roadmap
from pcm_gym.solving.limits import LimitName, StructuralLimits, limits_of
from pcm_gym.solving.roadmap import roadmap_raster, takes_root
from pcm_gym.tasks.memory import remembered
from pcm_gym.tasks.shipped import shipped_home, shipped_roadmap

# Targets of walks keep this many of the agent's steps from the actuators' limits.
_LIMIT_RESERVE = 2.0
# Starts and goals keep this many times the margin below which a state counts as nearly singular.
_RESERVE = 1.5
_MOST_ROWS = 10_000_000
# States that differ by less, in every number, are the same equilibrium.
_SAME = 1e-6


@dataclass(frozen=True)
class Scene:
    """A mechanism under a load, as its agents move it.

    Equal scenes share what is known of them: it is worked out once, when it is first asked for.

    Attributes
    ----------
    mechanism : Mechanism
    load : tuple of d floats
        Load on the end-effector, in the mechanism's units.
    stride : tuple of float
        Largest increment of each input in a step, dimensionless.
    margin : float
        Singularity margin below which a state counts as nearly singular.
    origin : Equilibrium, optional
        A stable equilibrium under this load from which all episodes begin; by default they begin anywhere that stable
        paths reach from home.
    limits : tuple of "stress", "torque" or "contact"
        Limits of the structure that starts, goals, and the ways between them keep, see `pcm_gym.StructuralLimits`.
    """

    mechanism: Mechanism
    load: tuple[float, ...]
    stride: tuple[float, ...]
    margin: float
    origin: Equilibrium | None = None
    limits: tuple[LimitName, ...] = ()

    def __post_init__(self) -> None:
        mechanism = instance_of("mechanism", self.mechanism, Mechanism)
        object.__setattr__(self, "load", finite_tuple("load", self.load, mechanism.dof))
        object.__setattr__(self, "stride", finite_tuple("stride", self.stride, mechanism.leg_count))
        object.__setattr__(self, "margin", number_not_negative("margin", self.margin))
        object.__setattr__(self, "limits", limits_of(mechanism, self.limits).names)
        if min(self.stride) <= 0.0:
            raise ValueError(f"stride must be greater than 0, got {self.stride}")
        if self.origin is not None and instance_of("origin", self.origin, Equilibrium).mechanism != mechanism:
            raise ValueError(f"origin must be an Equilibrium of {mechanism.name!r}, got {shown(self.origin)}")

    @property
    def reserve(self) -> float:
        """Singularity margin that starts and goals keep; ways between the nodes of the roadmap keep `margin`."""
        return _RESERVE * self.margin

    @cached_property
    def structure(self) -> StructuralLimits:
        """The limits of the structure."""
        return StructuralLimits(self.mechanism, self.limits)

    @cached_property
    def pitch(self) -> tuple[float, ...]:
        """Steps between the nodes of the roadmap, dimensionless: the agent's steps, or larger ones."""
        raster = roadmap_raster(self.mechanism, self.step)
        return tuple(self.mechanism.units.kernel_from_inputs(raster.pitch).tolist())

    @property
    def steps_per_way(self) -> int:
        """Number of the agent's steps that the way between two neighbouring nodes takes."""
        return math.ceil(max(pitch / stride for pitch, stride in zip(self.pitch, self.stride, strict=True)) - 1e-9)

    def announce(self) -> None:
        """Announce the kernels that home and roadmap take, where they must be worked out."""
        if shipped_home(self.mechanism) is None:
            from pcm_gym.kernels.enumeration.forward_search import find_starts, polish_starts
            from pcm_gym.kernels.enumeration.found import keep_partners

            expect(find_starts, polish_starts, keep_partners, linearised)
        if self._shipped_roadmap is None:
            expect(describe_equilibrium, grow, pose_densities)

    @property
    def home(self) -> Equilibrium:
        """The home equilibrium under the load."""
        return _home(self.mechanism, self.load)

    @property
    def step(self) -> Array:
        """Largest increment of each input in a step, rad or m, (legs,)."""
        return self.mechanism.units.inputs_from_kernel(np.array(self.stride))

    @property
    def seed_name(self) -> str:
        """What errors call the equilibrium that all else is reached from."""
        return "home" if self.origin is None else "option equilibrium"

    @property
    def seed(self) -> Equilibrium:
        """The equilibrium that all else is reached from."""
        return self.origin or self.home

    def check_seed(self) -> None:
        """Raise a ValueError if the seed breaks a limit."""
        broken = self.structure.broken_by(self.seed)
        if broken:
            raise ValueError(f"{self.seed_name} must keep the limits {self.limits}, {self.seed!r} breaks {broken}")

    def check_roadmap(self) -> None:
        """Raise a ValueError if nothing can be reached with the reserve: if the seed does not keep it, or a limit."""
        self.check_seed()
        if self._shipped_roadmap is None and not _takes_root(self):
            raise ValueError(
                f"{self.seed_name} must keep the singularity margin of starts and goals, {self.reserve:.3g}, and "
                f"limits {self.limits}, to the middle of its cell of inputs; got {self.seed.singularity_margin:.3g} at "
                f"inputs {self.seed.inputs.tolist()}. It is {_RESERVE} times singular_margin, by default half of the "
                "least max_action: one of these must be smaller"
            )

    @property
    def roadmap(self) -> Roadmap:
        """What stable paths with the reserve reach from the origin, or else from home, step by step of the agent.

        Raises
        ------
        ValueError
            If that equilibrium does not keep the reserve.
        """
        return _roadmap(self)

    @property
    def _shipped_roadmap(self) -> Roadmap | None:
        """The roadmap, if it comes with the package."""
        if self.origin is not None or any(self.load) or self.limits:
            return None
        return shipped_roadmap(self.mechanism, self.step, self.reserve)

    def starts(self, numbers: ArrayLike, threads: int = 1) -> States:
        """Return states (n, ...) drawn by `numbers` from [0, 1), (n, 1 + legs), evenly over the poses of each sheet."""
        numbers = self._checked(numbers, threads, 1)
        return self.beside(self.nodes(numbers[:, 0]), numbers[:, 1:], threads)

    def nodes(self, numbers: ArrayLike) -> Integers:
        """Return nodes (n,) drawn by `numbers` from [0, 1), (n,), evenly over the poses of each sheet."""
        numbers = _fractions(numbers, ("n",))
        sums = self.roadmap.pose_density_sums
        chosen: Integers = np.searchsorted(sums, numbers * sums[-1], side="right")
        return np.minimum(chosen, len(sums) - 1)

    def beside(self, nodes: ArrayLike, numbers: ArrayLike, threads: int = 1) -> States:
        """Return states somewhere in the cells of nodes (n,), as `numbers` from [0, 1), (n, legs), tell."""
        numbers, nodes = self._checked(numbers, threads), self.roadmap.checked_nodes("nodes", nodes)
        if len(numbers) != len(nodes):
            raise ValueError(f"numbers must be as many as the nodes, {len(nodes)}, got {len(numbers)}")
        states = self.at_nodes(nodes)
        self.move_within_cells(states, numbers, threads)
        return states

    def move_within_cells(self, states: States, numbers: ArrayLike, threads: int = 1) -> Mask:
        """Move states of nodes within their cells, as `numbers` from [0, 1), (n, legs), tell, in place.

        Returns which of them arrive: by a straight step that keeps stability and the reserve.
        """
        numbers, pitch = self._checked(numbers, threads), np.array(self.pitch)
        self._check_states(states, len(numbers))
        targets = states.inputs + (numbers - 0.5) * pitch
        self._walk(states, targets, pitch, np.ones(len(numbers), dtype=np.int64), self.reserve, threads)
        arrived: Mask = (states.inputs == targets).all(axis=1)
        return arrived

    def leads_straight(self, start: States, ends: States, threads: int = 1) -> Mask:
        """Return from which starts (n, ...) the straight way of the inputs leads to the end, (n, ...), in stability."""
        self._check_states(start, len(instance_of("start", start, States).x), "start")
        self._check_states(ends, len(start.x), "ends")
        whole_number("threads", threads, least=1, most=MOST_THREADS)
        moved, stride = States(*(array.copy() for array in start)), np.array(self.stride)
        steps = np.abs((ends.inputs - start.inputs) / stride).max(axis=1, initial=0.0)
        self._walk(moved, ends.inputs, stride, np.ceil(steps).astype(np.int64) + 1, 0.0, threads)
        is_there = _are_same(moved, ends)
        if not self.structure:  # a walk may end where its steps are in doubt: the tracker tells
            rows = np.flatnonzero(~is_there)
            stopped, targets = States(*(array[rows] for array in moved)), ends.inputs[rows]
            move_rows(self.mechanism.leg_table, stopped, targets, TERMINATE)
            is_there[rows] = _are_same(stopped, States(*(array[rows] for array in ends)))
        return is_there

    def at_nodes(self, nodes: ArrayLike) -> States:
        """Return the states of nodes (n,) of the roadmap."""
        roadmap = self.roadmap
        nodes = roadmap.checked_nodes("nodes", nodes)
        return self.states(roadmap.states[nodes], self.mechanism.units.kernel_from_inputs(roadmap.inputs[nodes]))

    def states(self, x: ArrayLike, inputs: ArrayLike) -> States:
        """Return states (n, 2 legs + d) at inputs (n, legs), both dimensionless, with the scene's load."""
        x = finite_array("x", x, ("n", self.mechanism.state_size))
        inputs = finite_array("inputs", inputs, (len(x), self.mechanism.leg_count))
        load = np.empty((len(x), self.mechanism.dof))
        load[:] = self.mechanism.units.kernel_from_load(np.array(self.load))
        return States(x, inputs, load)

    def at_equilibrium(self, equilibrium: Equilibrium, count: int) -> States:
        """Return `count` copies of an equilibrium."""
        if instance_of("equilibrium", equilibrium, Equilibrium).mechanism != self.mechanism:
            raise ValueError(f"equilibrium must be of {self.mechanism.name!r}, got {shown(equilibrium)}")
        whole_number("count", count, least=0, most=_MOST_ROWS)
        return States(*(np.tile(value, (count, 1)) for value in equilibrium.kernel_values()))

    def walk(self, states: States, numbers: ArrayLike, steps_range: tuple[int, int], threads: int = 1) -> None:
        """Walk some of the agent's steps towards random inputs within the limits, in place.

        `numbers` from [0, 1), (n, 1 + legs), decide how many steps of `steps_range` and where to. A walk ends before
        the first step that would lose stability or come under the reserve.
        """
        numbers, (lowest, span) = self._checked(numbers, threads, 1), self._walked_range
        self._check_states(states, len(numbers))
        least, most = whole_array("steps_range", steps_range, (2,), 0, _MOST_ROWS).tolist()
        if most < least:
            raise ValueError(f"steps_range must be (least, most), got {shown(steps_range)}")
        steps = least + (numbers[:, 0] * (most - least + 1)).astype(np.int64)
        self._walk(states, lowest + numbers[:, 1:] * span, np.array(self.stride), steps, self.reserve, threads)

    @cached_property
    def _walked_range(self) -> tuple[Array, Array]:
        """Lowest target of walks, and how far above it the highest one is, dimensionless, (legs,) each."""
        lower, upper = self.mechanism.kernel_limits
        edge = np.minimum(_LIMIT_RESERVE * np.array(self.stride), 0.25 * (upper - lower))
        return lower + edge, upper - lower - 2.0 * edge

    def _checked(self, numbers: ArrayLike, threads: int, more: int = 0) -> Array:
        """Return numbers from [0, 1), (n, legs) or more columns, as a new array; threads are checked as well."""
        whole_number("threads", threads, least=1, most=MOST_THREADS)
        return _fractions(numbers, ("n", self.mechanism.leg_count + more))

    def _check_states(self, states: States, count: int, own: str = "states") -> None:
        """Raise unless these are states whose arrays kernels may change."""
        mechanism = self.mechanism
        widths = {"x": mechanism.state_size, "inputs": mechanism.leg_count, "load": mechanism.dof}
        for name, array in instance_of(own, states, States)._asdict().items():
            shape = (count, widths[name])
            is_sound = isinstance(array, np.ndarray) and array.dtype == np.float64 and array.flags.carray
            if not is_sound or array.shape != shape:
                raise ValueError(f"{own}.{name} must be a writable float array {shape} in C order, got {shown(array)}")
            finite_array(f"{own}.{name}", array, shape)

    def _walk(
        self, states: States, targets: Array, stride: Array, steps: Integers, least_margin: float, threads: int
    ) -> None:
        """Walk as `walk` does; a walk also ends before the first step that would break a limit of the structure."""
        if self.structure and steps.max(initial=0) > 1:
            self._walk_step_by_step(states, targets, stride, steps, least_margin, threads)
            return
        known = (states.x.copy(), states.inputs.copy()) if self.structure else ()
        self._walk_freely(states, targets, stride, steps, least_margin, threads)
        if self.structure:
            is_broken = np.logical_not(self.structure.are_kept(states.x, states.inputs))
            for array, values in zip(states, known, strict=False):
                array[is_broken] = values[is_broken]

    def _walk_step_by_step(
        self, states: States, targets: Array, stride: Array, steps: Integers, least_margin: float, threads: int
    ) -> None:
        left, rows = steps.copy(), np.flatnonzero(steps > 0)
        while len(rows):
            moved = States(*(array[rows] for array in states))
            self._walk(moved, targets[rows], stride, np.ones_like(rows), least_margin, threads)
            goes_on = (moved.inputs != states.inputs[rows]).any(axis=1)
            for array, values in zip(states, moved, strict=True):
                array[rows] = values
            left[rows] -= 1
            rows = rows[goes_on & (left[rows] > 0)]

    def _walk_freely(
        self, states: States, targets: Array, stride: Array, steps: Integers, least_margin: float, threads: int
    ) -> None:
        legs = self.mechanism.leg_table

        def part(first: int, last: int) -> None:
            rows = States(*(array[first:last] for array in states))
            walk(legs, rows, targets[first:last], stride, steps[first:last], least_margin)

        run_all(pieces_of(part, len(steps), threads), threads)


def _fractions(numbers: ArrayLike, shape: Shape) -> Array:
    """Return numbers from [0, 1) as a new array of that shape."""
    checked = finite_array("numbers", numbers, shape)
    if checked.size and not (checked.min() >= 0.0 and checked.max() < 1.0):
        raise ValueError(f"numbers must be at least 0 and less than 1, got {shown(numbers)}")
    return checked


def _are_same(states: States, others: States) -> Mask:
    """Return which states (n, ...) are the same."""
    apart = np.abs(np.column_stack([states.x - others.x, states.inputs - others.inputs]))
    same: Mask = apart.max(axis=1, initial=0.0) < _SAME
    return same


def reached(start: Equilibrium, inputs: ArrayLike, load: Array, name: str) -> Equilibrium:
    """Return the equilibrium at `inputs` under `load` on the branch of `start`; raise if the way ends before."""
    from pcm_gym.solving import BranchTracker, Event  # with all that proofs take

    if np.array_equal(inputs, start.inputs) and np.array_equal(load, start.load):
        return start
    step = BranchTracker(start.mechanism, start).step(inputs, load)
    if step.event is not Event.NONE:
        value = load.tolist() if name == "load" else np.asarray(inputs).tolist()
        raise ValueError(
            f"{name} must be reachable from home on stable equilibria, got {value}: "
            f"{step.event} after {step.fraction:.3f} of the way. {step.event.message}"
        )
    return step.equilibrium


@remembered
def _home(mechanism: Mechanism, load: tuple[float, ...]) -> Equilibrium:
    if any(load):
        free = _home(mechanism, (0.0,) * mechanism.dof)
        return reached(free, free.inputs, np.array(load), "load")
    shipped = shipped_home(mechanism)
    if shipped is not None:
        return shipped
    from pcm_gym.solving import home_equilibrium  # with the search for all equilibria

    return home_equilibrium(mechanism)


@remembered
def _roadmap(scene: Scene) -> Roadmap:
    shipped = scene._shipped_roadmap
    if shipped is not None:
        return shipped
    scene.check_roadmap()
    return build_roadmap(
        scene.mechanism, [scene.seed], step=scene.step, least_margin=scene.reserve, limits=scene.limits
    )


@remembered
def _takes_root(scene: Scene) -> bool:
    return takes_root(scene.mechanism, [scene.seed], step=scene.step, least_margin=scene.reserve, limits=scene.limits)
