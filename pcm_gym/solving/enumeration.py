"""Every equilibrium at given inputs, and every set of inputs with its equilibria at a given pose."""

import math
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache, partial
from itertools import combinations
from operator import contains

import numpy as np
from numpy.typing import ArrayLike

from pcm_gym.arrays import Array
from pcm_gym.kernels.enumeration.cells import UnitRod, make_unit_rod
from pcm_gym.kernels.enumeration.forward_search import find_starts, polish_starts
from pcm_gym.kernels.enumeration.found import (
    FOUND,
    SPENT,
    Found,
    correct_all,
    keep_partners,
    make_found,
    principal_angle,
)
from pcm_gym.kernels.enumeration.inverse_search import join, make_forest, plant_tree, polish_combinations
from pcm_gym.kernels.enumeration.sheets import Sheets, make_sheets
from pcm_gym.kernels.numerics.slices import slices
from pcm_gym.mechanism import Mechanism
from pcm_gym.mechanism.validation import (
    instance_of,
    positive_number,
    sequence_of,
    shown,
    truth_value,
    whole_number,
)
from pcm_gym.solving.budget import Spending
from pcm_gym.solving.certification import Certificate, certify_forward, certify_inverse
from pcm_gym.solving.equilibrium import Equilibrium
from pcm_gym.solving.families import Continuum, System, corrected_states, part_continua
from pcm_gym.solving.search_frame import SearchFrame, beside_motors, search_frame
from pcm_gym.solving.solutions import EquilibriumSet, Family

Modes = Sequence[int | Collection[int]]

# Halvings of the rod's table for the inverse problem.
_LEVELS = 6
# Starts, and combinations of cells, that are corrected in one call; a combination may have many starts.
_STARTS_AT_ONCE, _JOINED_AT_ONCE = 4096, 256
# What it takes to correct a start, in tests.
_CORRECTION_COST = 64
# Room for equilibria: what is needed as a rule, and for the largest sets.
_ROOMS = (1 << 12, 1 << 15)
_LARGEST_RHO = 30.0
_MOST_REFINEMENT = 2


def solve_forward(
    mechanism: Mechanism,
    inputs: ArrayLike,
    load: ArrayLike | None = None,
    rho_max: float = 9.0,
    modes: Modes | None = None,
    *,
    refinement: int = 0,
    certify: bool = False,
) -> EquilibriumSet:
    """Return every equilibrium at these inputs, stable or not, in all buckling modes, by ascending energy.

    The solutions are enumerated, not searched for from random starts: the poses of the end-effector are cut into cells,
    and in each every combination of the rods' sheets for which the forces may balance is examined.

    Parameters
    ----------
    mechanism : Mechanism
    inputs : array_like (legs,)
        Actuator inputs, rad or m; the limits are not checked.
    load : array_like (d,), optional
        Load on the end-effector, N and N m; none by default.
    rho_max : float
        Largest dimensionless load ``L sqrt(|f| / EI)`` of any rod, up to 30.
    modes : sequence of int or of sets of int, optional
        For each rod the buckling mode asked for, or a set of them; all by default.
    refinement : int
        Times the resolution of the cells is doubled; to confirm that a set of solutions is complete.
    certify : bool
        Whether to prove that the set is complete (two legs only); the `certificate` of the set says what is proved.

    Returns
    -------
    EquilibriumSet
        A sequence of `Equilibrium`, the isolated ones; an empty one says why in its `reason`. Those that are not
        isolated belong to its `families`.

    Raises
    ------
    ValueError
        If an argument has the wrong shape, is not finite or out of range, a proof is asked for more than two legs, or
        there is more to return than the search has room for: no set is cut.
    SearchBudgetError
        If the search meets its budget; see `search_budget`.

    Notes
    -----
    A few ms for two legs and about 0.1 s for a platform, rising steeply with `rho_max`; the first call with a new
    `rho_max` tabulates the rod, which takes some tenths of a second. A proof takes 0.1 s at `rho_max` 9, a few seconds
    at 15, and 0.4 GB of memory beyond 16; near 30 it is given up after about 10 s. The first one in a process also
    tabulates the rod for this `rho_max`, 0.1 s to 2 s.
    """
    inputs = instance_of("mechanism", mechanism, Mechanism).check_inputs(inputs)
    _check_certify(mechanism, certify)
    problem = _Problem.checked(mechanism, load, rho_max, modes, refinement)
    searched, scaled_load = problem.searched, problem.scaled_load
    scaled = searched.units.kernel_from_inputs(inputs)
    found = problem.filled(partial(_examine_forward, problem, scaled), is_inverse=False)
    found, families = problem.parted(found, scaled)
    states, certificate = found.x, None
    if certify:
        states, certificate = certify_forward(searched, scaled, scaled_load, problem.rho_max, states)
    reason = _too_far_apart(mechanism, inputs) if not len(states) else ""
    return problem.solutions(states, np.tile(inputs, (len(states), 1)), families, reason, certificate)


def solve_inverse(
    mechanism: Mechanism,
    pose: ArrayLike,
    load: ArrayLike | None = None,
    rho_max: float = 9.0,
    modes: Modes | None = None,
    *,
    refinement: int = 0,
    certify: bool = False,
) -> EquilibriumSet:
    """Return every equilibrium at this pose with the inputs that hold it there, by ascending energy.

    Parameters
    ----------
    mechanism : Mechanism
    pose : array_like (d,)
        Pose of the end-effector, (x, y) in m or (x, y, phi).
    load, rho_max, modes, refinement
        As for `solve_forward`.
    certify : bool
        Whether to prove that the set is complete (two legs only); the `certificate` of the set says what is proved.

    Returns
    -------
    EquilibriumSet
        A sequence of `Equilibrium`, the isolated ones; an empty one says why in its `reason`. Those that are not
        isolated belong to its `families`. Angles of revolute actuators are in (-pi, pi]. Inputs may be beyond the
        actuators' limits: `Equilibrium.within_limits` tells, and `Equilibrium.inputs_within_limits` has the full turns
        added that bring them there.

    Raises
    ------
    ValueError
        If an argument has the wrong shape, is not finite or out of range, a proof is asked for more than two legs, or
        there is more to return than the search has room for: no set is cut.
    SearchBudgetError
        If the search meets its budget; see `search_budget`.

    Notes
    -----
    A few ms for two legs, about 0.1 s for a platform; up to a second where the tip is near a motor, about which the rod
    may then turn any way. A pose out of reach gives an empty set. A proof takes about as long as one of
    `solve_forward`, and a few seconds at a pose very near to a motor.
    """
    pose = instance_of("mechanism", mechanism, Mechanism).check_pose(pose)
    _check_certify(mechanism, certify)
    problem = _Problem.checked(mechanism, load, rho_max, modes, refinement)
    searched, scaled = problem.searched, problem.frame.scaled_pose(pose)
    beside = beside_motors(searched.leg_table, scaled)
    found = problem.filled(partial(_examine_inverse, problem, beside), is_inverse=True)
    if beside is not scaled:
        found = problem.filled(partial(_correct, problem, *problem.moved(found, scaled)), is_inverse=True)
    found, families = problem.parted(found, scaled)
    states, inputs, certificate = found.x, found.inputs, None
    if certify:
        states, inputs, certificate = certify_inverse(
            searched, scaled, problem.scaled_load, problem.rho_max, states, inputs
        )
    own_inputs = searched.units.inputs_from_kernel(inputs)
    reason = _out_of_reach(mechanism, pose) if not len(own_inputs) else ""
    return problem.solutions(states, own_inputs, families, reason, certificate)


def _check_certify(mechanism: Mechanism, certify: bool) -> None:
    if truth_value("certify", certify) and mechanism.leg_count != 2:
        raise ValueError(f"certify is available for two legs, got {mechanism.leg_count} legs")


@lru_cache(maxsize=8)
def _sheets(rho_max: float, refinement: int) -> Sheets:
    return make_sheets(rho_max, refinement)


@lru_cache(maxsize=16)
def _unit_rod(rho_max: float, refinement: int) -> UnitRod:
    return make_unit_rod(_LEVELS + refinement, rho_max)


@dataclass(frozen=True)
class _Problem:
    """What the forward and the inverse problem have in common, validated."""

    mechanism: Mechanism
    load: Array
    rho_max: float
    modes: tuple[frozenset[int], ...] | None
    refinement: int

    @classmethod
    def checked(
        cls, mechanism: Mechanism, load: ArrayLike | None, rho_max: float, modes: Modes | None, refinement: int
    ) -> "_Problem":
        rho_max = positive_number("rho_max", rho_max)
        if rho_max > _LARGEST_RHO:
            raise ValueError(f"rho_max must be at most {_LARGEST_RHO}, got {rho_max}")
        refinement = whole_number("refinement", refinement, least=0, most=_MOST_REFINEMENT)
        return cls(mechanism, mechanism.check_load(load), rho_max, _checked_modes(mechanism, modes), refinement)

    @cached_property
    def frame(self) -> SearchFrame:
        return search_frame(self.mechanism)

    @property
    def searched(self) -> Mechanism:
        return self.frame.searched

    @property
    def scaled_load(self) -> Array:
        return self.searched.units.kernel_from_load(self.load)

    def filled(self, examine: Callable[[Found], None], *, is_inverse: bool) -> Found:
        """Return all that `examine` finds, with the partners across folds.

        Raises
        ------
        ValueError
            If there is no room for so many.
        """
        for capacity in _ROOMS:
            found = make_found(capacity, self.mechanism.leg_count, self.mechanism.state_size, self.rho_max, is_inverse)
            examine(found)
            self._look_across_folds(found)
            count = int(found.total[0])
            if count < capacity:
                return found.chosen(count)
        raise ValueError(
            f"rho_max must be smaller for this mechanism: {self.rho_max} leaves more than {count - 1} equilibria"
        )

    def system(self, *, is_inverse: bool) -> System:
        """Return the equations of the problem."""
        return System(self.searched.leg_table, self.scaled_load, self.rho_max, is_inverse)

    def moved(self, found: Found, pose: Array) -> tuple[Array, Array]:
        """Return states and inputs, (m, size) and (m, legs), found at a pose near by, corrected to this one."""
        found.x[:, 2 * self.mechanism.leg_count :] = pose
        points = corrected_states(self.system(is_inverse=True), found)
        return points[:, : found.x.shape[1]].copy(), points[:, found.x.shape[1] :].copy()

    def parted(self, found: Found, given: Array) -> tuple[Found, tuple[Family, ...]]:
        """Return the isolated ones of what was found, and the families on which the others lie."""
        is_isolated, continua = part_continua(self.system(is_inverse=found.is_inverse), found, given)
        if not continua and is_isolated.all():
            return found, ()
        return found.chosen(is_isolated), tuple(self._family(continuum, found.is_inverse) for continuum in continua)

    def _family(self, continuum: Continuum, is_inverse: bool) -> Family:
        x, inputs = np.split(continuum.representative, [-self.mechanism.leg_count])
        for leg, described in enumerate(self.mechanism.legs):
            if described.actuator.is_angle and is_inverse:
                inputs[leg] = principal_angle(inputs[leg])
        if self.mechanism.dof == 3 and not is_inverse:
            x[-1] = principal_angle(x[-1])
        own_inputs = self.searched.units.inputs_from_kernel(inputs)
        representative = Equilibrium.unchecked(self.mechanism, self.frame.states(x), own_inputs, self.load)
        return Family(continuum.kind, representative, self.frame.directions(continuum.directions))

    def spending(self) -> Spending:
        """Return a new account of what the search spends."""
        return Spending(f"all equilibria of mechanism {self.mechanism.name!r} with rho <= {self.rho_max:g}")

    def _look_across_folds(self, found: Found) -> None:
        """Add the partners across folds of the equilibria found, and theirs."""
        n = 0
        while n < found.total[0]:
            n = keep_partners(self.searched.leg_table, self.scaled_load, n, found)

    def solutions(
        self,
        searched: Array,
        inputs: Array,
        families: tuple[Family, ...],
        obstacle: str,
        certificate: Certificate | None = None,
    ) -> EquilibriumSet:
        """Return the equilibria in the modes asked for, by ascending energy; `obstacle` tells why there are none."""
        states = self.frame.states(searched)
        equilibria = [
            Equilibrium.unchecked(self.mechanism, state, own, self.load)
            for state, own in zip(states, inputs, strict=True)
        ]
        if certificate is not None:
            certificate = replace(certificate, error=self.frame.state_error(certificate.error))
        reason = "" if equilibria else self._reason(families, obstacle)
        if self.modes is not None and equilibria:
            equilibria = [found for found in equilibria if all(map(contains, self.modes, found.modes))]
            reason = "" if equilibria else f"none of the {len(states)} equilibria is in the modes asked for"
        ordered = tuple(sorted(equilibria, key=lambda found: found.energy))
        return EquilibriumSet(ordered, reason, certificate, families)

    def _reason(self, families: tuple[Family, ...], obstacle: str) -> str:
        if families:
            return "none is isolated: " + "; ".join(map(repr, families))
        return obstacle or f"no equilibrium has all rods' rho <= {self.rho_max:g}"


def _examine_forward(problem: _Problem, inputs: Array, found: Found) -> None:
    """Keep every equilibrium at these inputs."""
    legs, load, spending = problem.searched.leg_table, problem.scaled_load, problem.spending()
    sheets = _sheets(problem.rho_max, problem.refinement)
    starts = np.empty((max(_STARTS_AT_ONCE, int(np.diff(sheets.offsets).max())), problem.mechanism.state_size))
    place, is_left = np.zeros(5, dtype=np.int64), True
    while is_left:
        is_left = find_starts(legs, inputs, load, sheets, place, starts)
        spending.spend(int(place[SPENT] + _CORRECTION_COST * place[FOUND]))
        for first, last in slices(int(place[FOUND]), _STARTS_AT_ONCE):
            polish_starts(legs, inputs, load, sheets, starts[first:last], found)


def _examine_inverse(problem: _Problem, pose: Array, found: Found) -> None:
    """Keep every equilibrium at this pose."""
    legs, load, spending = problem.searched.leg_table, problem.scaled_load, problem.spending()
    unit, leg_count = _unit_rod(problem.rho_max, problem.refinement), problem.mechanism.leg_count
    forest = make_forest(unit.levels, leg_count)
    for leg in range(leg_count):
        plant_tree(legs, leg, pose, unit, forest)
    cells, starts = np.empty((_JOINED_AT_ONCE, leg_count), np.int64), np.empty((_JOINED_AT_ONCE, 2 * leg_count))
    place, is_left = np.zeros(2, dtype=np.int64), True
    while is_left:
        is_left = join(forest, load, place, cells, starts)
        spending.spend(int(place[SPENT] + _CORRECTION_COST * place[FOUND]))
        own = slice(place[FOUND])
        polish_combinations(legs, pose, load, unit, cells[own], starts[own], found)


def _correct(problem: _Problem, states: Array, inputs: Array, found: Found) -> None:
    """Keep these states (m, size) at inputs (m, legs), corrected."""
    correct_all(problem.searched.leg_table, states, inputs, problem.scaled_load, found)


def _checked_modes(mechanism: Mechanism, modes: Modes | None) -> tuple[frozenset[int], ...] | None:
    if modes is None:
        return None
    entries = sequence_of("modes", modes, object)
    if len(entries) != mechanism.leg_count:
        raise ValueError(f"modes must have one entry per rod, {mechanism.leg_count}, got {shown(modes)}")
    return tuple(
        frozenset(
            whole_number("modes", mode, least=1)
            for mode in (sequence_of("modes", entry, object) if np.iterable(entry) else [entry])
        )
        for entry in entries
    )


def _too_far_apart(mechanism: Mechanism, inputs: Array) -> str:
    """Return which clamps are too far apart for their rods to meet; nothing if none are."""
    clamps = np.array([leg.actuator.clamp_point(value) for leg, value in zip(mechanism.legs, inputs, strict=True)])
    for (i, first), (j, second) in combinations(enumerate(mechanism.legs), 2):
        distance = math.dist(clamps[i], clamps[j])
        span = math.dist(first.attachment, second.attachment)
        reach = first.rod.length + second.rod.length + span
        if distance > reach:
            return f"the clamps of legs {i} and {j} are {distance:g} apart and their rods reach {reach:g}"
    return ""


def _out_of_reach(mechanism: Mechanism, pose: Array) -> str:
    """Return which leg cannot reach its hinge at this pose whatever its input; nothing if all can."""
    for i, (leg, hinge) in enumerate(zip(mechanism.legs, mechanism.hinges(pose), strict=True)):
        distance = leg.actuator.distance(hinge)
        if distance > leg.rod.length:
            return f"the hinge of leg {i} is {distance:g} from its actuator and the rod is {leg.rod.length:g} long"
    return ""
