"""Every equilibrium at given inputs, and every set of inputs with its equilibria at a given pose."""

import math
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from itertools import combinations
from operator import contains
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pcm_gym.arrays import Array
from pcm_gym.kernels.enumeration.cells import UnitRod, make_unit_rod
from pcm_gym.kernels.enumeration.forward_search import find_starts, polish_starts
from pcm_gym.kernels.enumeration.found import Found, make_found
from pcm_gym.kernels.enumeration.inverse_search import find_combinations, polish_combinations
from pcm_gym.kernels.enumeration.sheets import Sheets, make_sheets
from pcm_gym.mechanism import Mechanism
from pcm_gym.mechanism.validation import one_of, positive_number
from pcm_gym.solving.certification import Certificate, certify_forward, certify_inverse
from pcm_gym.solving.equilibrium import Equilibrium
from pcm_gym.solving.solutions import EquilibriumSet

Modes = Sequence[int | Collection[int]]

# Halvings of the rod's table for the inverse problem.
_LEVELS = 6
_CAPACITIES = (1 << 15, 1 << 18, 1 << 21)
_MOST_FOUND = 4096
_LARGEST_RHO = 30.0
_REFINEMENTS = (0, 1, 2)


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
        Largest dimensionless load L sqrt(|f| / EI) of any rod, up to 30.
    modes : sequence of int or of sets of int, optional
        For each rod the buckling mode asked for, or a set of them; all by default.
    refinement : int
        Times the resolution of the cells is doubled; to confirm that a set of solutions is complete.
    certify : bool
        Whether to prove that the set is complete (two legs only); the `certificate` of the set says what is proved.

    Returns
    -------
    EquilibriumSet
        A sequence of `Equilibrium`; an empty one says why in its `reason`.

    Raises
    ------
    ValueError
        If an argument has the wrong shape, is not finite or out of range, or a proof is asked for more than two legs.

    Notes
    -----
    A few ms for two legs and about 0.1 s for a platform, rising steeply with `rho_max`; the first call with a new
    `rho_max` tabulates the rod, which takes some tenths of a second. A proof takes 0.1 s at `rho_max` 9, a few seconds
    at 15, and 0.4 GB of memory beyond 16; near 30 it is given up after about 10 s. The first one in a process also
    tabulates the rod for this `rho_max`, 0.1 s to 2 s.
    """
    inputs = mechanism.check_inputs(inputs)
    _check_certify(mechanism, certify)
    problem = _Problem.checked(mechanism, load, rho_max, modes, refinement)
    scaled, legs = mechanism.units.kernel_from_inputs(inputs), mechanism.leg_table
    sheets = _sheets(problem.rho_max, problem.refinement)
    find = partial(find_starts, legs, scaled, problem.scaled_load, sheets)
    (starts,) = problem.filled(find, (mechanism.state_size, np.float64))
    found = problem.room(is_inverse=False)
    count = polish_starts(legs, scaled, problem.scaled_load, starts, found)
    states, certificate = found.x[:count], None
    if certify:
        states, certificate = certify_forward(mechanism, scaled, problem.scaled_load, problem.rho_max, states)
    obstacle = _too_far_apart(mechanism, inputs)
    return problem.solutions(states, np.tile(inputs, (len(states), 1)), obstacle, certificate)


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
        A sequence of `Equilibrium`; an empty one says why in its `reason`. Angles of revolute actuators are in
        (-pi, pi]. Inputs may be beyond the actuators' limits: `Equilibrium.within_limits` tells.

    Raises
    ------
    ValueError
        If an argument has the wrong shape, is not finite or out of range, or a proof is asked for more than two legs.

    Notes
    -----
    A few ms for two legs, about 0.1 s for a platform; up to a second where the tip is near a motor, about which the rod
    may then turn any way. A pose out of reach gives an empty set. A proof takes about as long as one of
    `solve_forward`, and a few seconds at a pose very near to a motor.
    """
    pose = mechanism.check_pose(pose)
    _check_certify(mechanism, certify)
    problem = _Problem.checked(mechanism, load, rho_max, modes, refinement)
    scaled, legs = mechanism.units.kernel_from_pose(pose), mechanism.leg_table
    unit = _unit_rod(problem.rho_max, problem.refinement)
    find = partial(find_combinations, legs, scaled, problem.scaled_load, unit)
    cells, starts = problem.filled(find, (mechanism.leg_count, np.int64), (2 * mechanism.leg_count, np.float64))
    found = problem.room(is_inverse=True)
    count = polish_combinations(legs, scaled, problem.scaled_load, unit, cells, starts, found)
    states, inputs, certificate = found.x[:count], found.inputs[:count], None
    if certify:
        states, inputs, certificate = certify_inverse(
            mechanism, scaled, problem.scaled_load, problem.rho_max, states, inputs
        )
    own_inputs = mechanism.units.inputs_from_kernel(inputs)
    return problem.solutions(states, own_inputs, _out_of_reach(mechanism, pose), certificate)


def _check_certify(mechanism: Mechanism, certify: bool) -> None:
    if certify and mechanism.leg_count != 2:
        raise ValueError(f"certify is available for two legs, got {mechanism.leg_count}")


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
        one_of("refinement", refinement, _REFINEMENTS)
        return cls(mechanism, mechanism.check_load(load), rho_max, _checked_modes(mechanism, modes), refinement)

    @property
    def scaled_load(self) -> Array:
        return self.mechanism.units.kernel_from_load(self.load)

    def filled(self, find: Callable[..., int], *columns: tuple[int, type]) -> list[NDArray[Any]]:
        """Return arrays with these numbers and types of columns, with as many rows as `find` fills of them.

        Raises
        ------
        ValueError
            If that is more than fits into memory.
        """
        for capacity in _CAPACITIES:
            arrays: list[NDArray[Any]] = [np.empty((capacity, width), dtype) for width, dtype in columns]
            count = find(*arrays)
            if count <= capacity:
                return [array[:count] for array in arrays]
        raise ValueError(f"rho_max must be smaller for this mechanism: {self.rho_max} leaves too much to examine")

    def room(self, *, is_inverse: bool) -> Found:
        """Return arrays for the equilibria to be found."""
        mechanism = self.mechanism
        return make_found(_MOST_FOUND, mechanism.leg_count, mechanism.state_size, self.rho_max, is_inverse)

    def solutions(
        self, states: Array, inputs: Array, obstacle: str, certificate: Certificate | None = None
    ) -> EquilibriumSet:
        """Return the equilibria in the modes asked for, by ascending energy; `obstacle` tells why there are none."""
        equilibria = [
            Equilibrium.unchecked(self.mechanism, state, own, self.load)
            for state, own in zip(states, inputs, strict=True)
        ]
        reason = "" if equilibria else obstacle or f"no equilibrium has all rods' rho <= {self.rho_max:g}"
        if self.modes is not None and equilibria:
            equilibria = [found for found in equilibria if all(map(contains, self.modes, found.modes))]
            reason = "" if equilibria else f"none of the {len(states)} equilibria is in the modes asked for"
        return EquilibriumSet(tuple(sorted(equilibria, key=lambda found: found.energy)), reason, certificate)


def _checked_modes(mechanism: Mechanism, modes: Modes | None) -> tuple[frozenset[int], ...] | None:
    if modes is None:
        return None
    if len(modes) != mechanism.leg_count:
        raise ValueError(f"modes must have one entry per rod, {mechanism.leg_count}, got {modes!r}")
    sets = tuple(frozenset([entry] if isinstance(entry, int | np.integer) else entry) for entry in modes)
    if any(mode < 1 for allowed in sets for mode in allowed):
        raise ValueError(f"modes must be 1 or greater, got {modes!r}")
    return sets


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
        if distance == 0.0 and leg.actuator.is_angle:
            return f"the hinge of leg {i} is on its motor, about which the rod turns freely: a continuum"
    return ""
