"""Proof that the equilibria of a mechanism with two legs, at given inputs or at a given pose, are all there are."""

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from pcm_gym.arrays import Array, Integers, Mask
from pcm_gym.kernels.proofs.certification import (
    GOES_ON,
    RESOLVED,
    Undecided,
    find_open_pairs,
    make_open_pairs,
    make_resolution,
    make_undecided,
    prove_all,
    resolve,
    set_parts,
)
from pcm_gym.kernels.proofs.krawczyk import CARTESIAN, Proved, make_proved
from pcm_gym.kernels.proofs.path_proof import LARGEST_GAP
from pcm_gym.kernels.proofs.proved_states import (
    bound_inverse_errors,
    bound_state_errors,
    set_inverse_state,
    set_state,
)
from pcm_gym.kernels.proofs.rod_cells import Frames, UnitCells, make_frames, make_inverse_frames, make_unit_cells
from pcm_gym.mechanism import Mechanism
from pcm_gym.mechanism.validation import check_kinds, instance_of, shown
from pcm_gym.solving.equilibrium import Equilibrium

# Halvings of the rod's table of cells, and loads rho_max beyond which there is one more of them.
_LEVELS, _LARGE_LOADS = 7, (10.0, 16.0)
_MOST_PROVED, _MOST_OPEN, _MOST_UNDECIDED = 4096, 1 << 18, 1 << 14
_MOST_EXAMINED = 1_000_000
# Undecided cells nearer than this, in rho and b, are one region.
_SAME_REGION = 1e-5
_ROUNDING = 1e-14


@dataclass(frozen=True, eq=False)
class UndecidedRegion:
    """A part of the loads of the two rods in which the number of equilibria is not proved.

    Attributes
    ----------
    reason : str
        "fold": equilibria meet here, or all but meet; "rho_max": an equilibrium is at the border of the range of loads,
        inside or outside; "limit": the search was broken off.
    rho : array (2, 2)
        Lower and upper bound of each rod's dimensionless load.
    tip_angle : array (2, 2)
        Lower and upper bound of each rod's angle b from the tip force to the tangent at the tip, rad.
    """

    reason: str
    rho: Array
    tip_angle: Array

    def __post_init__(self) -> None:
        check_kinds(self, reason=str, rho=np.ndarray, tip_angle=np.ndarray)

    def contains(self, equilibrium: Equilibrium) -> bool:
        """Return whether an equilibrium lies in the region, or as near to it as its rounding errors may be."""
        if instance_of("equilibrium", equilibrium, Equilibrium).mechanism.leg_count != 2:
            raise ValueError(f"equilibrium must be one of two legs, got {shown(equilibrium)}")
        return self._contains_loads(_polar_loads(equilibrium.state[np.newaxis])[0])

    def _contains_loads(self, loads: Array) -> bool:
        for loads_of_one, bounds in ((loads[0::2], self.rho), (loads[1::2], self.tip_angle)):
            if np.any(loads_of_one < bounds[:, 0] - _SAME_REGION) or np.any(loads_of_one > bounds[:, 1] + _SAME_REGION):
                return False
        return True

    def __repr__(self) -> str:
        """Return the reason and the bounds."""
        bounds = [
            f"rho in [{rho[0]:.9g}, {rho[1]:.9g}], b in [{b[0]:.9g}, {b[1]:.9g}]"
            for rho, b in zip(self.rho, self.tip_angle, strict=True)
        ]
        return f"{self.reason}: {'; '.join(bounds)}"


@dataclass(frozen=True, eq=False)
class Certificate:
    """What is proved of the number of equilibria with every rod's rho <= rho_max.

    If nothing is undecided, the mechanism has exactly `proved_count` equilibria in the range, at the inputs or at the
    pose that was asked about, each in a box of its own that holds no other, and the set to which this belongs is they
    (before a choice of modes), up to `error`. Otherwise that is proved of everything outside the undecided regions.

    The proof is a computation with enclosures: every part of the plane of loads of either rod is covered by cells, and
    each pair of cells is excluded by rigorous bounds of the closed form of the rods, or lies in a box in which the test
    of Krawczyk proves one equilibrium. All rounding errors are bounded, those of the mechanism's data included, and no
    directed rounding is needed. It rests on assumptions about the computer: double precision by IEEE 754, rounding to
    nearest, and a C library whose sine and cosine are accurate to 4 units in the last place. It is no formal
    verification: the program itself is tested, not proved.

    Attributes
    ----------
    rho_max : float
        Largest dimensionless load.
    proved_count : int
        Equilibria that are proved, one by one, to exist and to be alone in their boxes.
    undecided : tuple of UndecidedRegion
        Where nothing is proved.
    examined : int
        Pairs of cells, one of each rod, that were looked at one by one.
    error : float
        Bound of the errors of the states of the proved equilibria: the largest difference of a component from that of
        the true equilibrium, relative to 1 + its size.
    """

    rho_max: float
    proved_count: int
    undecided: tuple[UndecidedRegion, ...]
    examined: int
    error: float

    def __post_init__(self) -> None:
        check_kinds(self, rho_max=float, proved_count=int, undecided=tuple, examined=int, error=float)

    @property
    def is_proved(self) -> bool:
        """Whether the set is proved to be complete."""
        return not self.undecided

    @property
    def status(self) -> str:
        """Return "proved" or "undecided"."""
        return "proved" if self.is_proved else "undecided"

    def __repr__(self) -> str:
        """Return the status, and a line per undecided region."""
        count, regions = self.proved_count, len(self.undecided)
        if self.is_proved:
            return f"Certificate: proved, exactly {count} equilibria with rho <= {self.rho_max:g}"
        heading = (
            f"Certificate: undecided, {count} equilibria proved, {regions} regions with rho <= {self.rho_max:g} open"
        )
        return "\n".join([heading, *(f"  {region!r}" for region in self.undecided)])


def certify_forward(
    mechanism: Mechanism, inputs: Array, load: Array, rho_max: float, states: Array
) -> tuple[Array, Certificate]:
    """Prove a set of equilibria complete.

    Parameters
    ----------
    mechanism : Mechanism
        With two legs.
    inputs, load : array (2,)
        In the kernels' units.
    rho_max : float
    states : array (m, 6)
        The equilibria that are known.

    Returns
    -------
    states : array (n, 6)
        All that are proved, those that were not known included, and those known ones that lie in undecided regions.
        A known state that is not, to 1e-9, what Newton's method finds in its box gives way to that. What is proved not
        to be an equilibrium of the range, and all but one of what is proved to be the same, is left out.
    certificate : Certificate
    """
    legs, frames = mechanism.leg_table, make_frames(mechanism.leg_table, inputs, load)
    outcome = _prove(frames, rho_max, states)
    found = np.empty((len(outcome.numbers), mechanism.state_size))
    for n, state in zip(outcome.numbers, found, strict=True):
        set_state(legs, inputs, load, outcome.boxes.polar[n], state)
        known = states[outcome.known[n]] if n in outcome.known else state
        if _are_near(known, state):
            state[:] = known
    errors = np.zeros(len(found))
    bound_state_errors(frames, outcome.proved, outcome.numbers, found, errors)
    return np.concatenate([found, states[outcome.open]]), outcome.certificate(rho_max, errors)


def certify_inverse(
    mechanism: Mechanism, pose: Array, load: Array, rho_max: float, states: Array, inputs: Array
) -> tuple[Array, Array, Certificate]:
    """Prove a set of equilibria at a pose complete.

    Parameters
    ----------
    mechanism : Mechanism
        With two legs.
    pose, load : array (2,)
        In the kernels' units.
    rho_max : float
    states : array (m, 6)
        The equilibria that are known.
    inputs : array (m, 2)
        Theirs, in the kernels' units.

    Returns
    -------
    states, inputs, certificate
        As of `certify_forward`, with the inputs.
    """
    legs, frames = mechanism.leg_table, make_inverse_frames(mechanism.leg_table, pose, load)
    outcome = _prove(frames, rho_max, states)
    found, own = np.empty((len(outcome.numbers), mechanism.state_size)), np.empty((len(outcome.numbers), 2))
    for n, state, values in zip(outcome.numbers, found, own, strict=True):
        set_inverse_state(legs, pose, load, outcome.boxes.polar[n], state, values)
        if n in outcome.known:
            known, known_inputs = states[outcome.known[n]], inputs[outcome.known[n]]
            if _are_near(known, state) and _are_near(known_inputs, values):
                state[:], values[:] = known, known_inputs
    errors = np.zeros(len(found))
    bound_inverse_errors(legs, pose, outcome.proved, outcome.numbers, found, own, errors)
    certificate = outcome.certificate(rho_max, errors)
    return np.concatenate([found, states[outcome.open]]), np.concatenate([own, inputs[outcome.open]]), certificate


def _are_near(known: Array, found: Array) -> bool:
    """Return whether a known state or its inputs are what Newton's method finds."""
    return bool(np.all(np.abs(known - found) <= LARGEST_GAP * (1.0 + np.abs(found))))


def _prove(frames: Frames, rho_max: float, states: Array) -> "_Outcome":
    """Prove what can be proved of a set of equilibria."""
    loads = _polar_loads(states)
    proved, undecided = make_proved(_MOST_PROVED), make_undecided(_MOST_UNDECIDED)
    prove_all(frames, loads, proved)
    levels = _LEVELS + sum(rho_max > load for load in _LARGE_LOADS)
    tables = [_unit_cells(levels, rho_max, int(kind)) for kind in frames.kinds]
    pairs = _open_pairs(tables, frames, proved)
    if pairs is not None:
        regions = _undecided_regions(undecided, _is_resolved(tables[0], frames, pairs, proved, undecided))
    else:
        regions = [_region("limit", *np.array([[0.0, -math.pi] * 2, [rho_max, math.pi] * 2]))]
    boxes = _Boxes.of(proved)
    is_inside, is_outside = boxes.in_range(rho_max)
    is_border = ~(is_inside | is_outside)
    for center, error in zip(boxes.polar[is_border], boxes.polar_error[is_border], strict=True):
        regions.append(_region("rho_max", center - error, center + error))
    owners = [boxes.owner(own) for own in loads]
    known: dict[int, int] = {}
    for m, owner in enumerate(owners):
        if owner is not None:
            known.setdefault(owner, m)
    is_open = [
        owner is None and any(r._contains_loads(own) for r in regions) for owner, own in zip(owners, loads, strict=True)
    ]
    numbers = [n for n in range(len(is_inside)) if is_inside[n] or (is_border[n] and n in known)]
    return _Outcome(
        proved,
        boxes,
        tuple(regions),
        np.array(numbers, dtype=np.int64),
        known,
        np.array(is_open, dtype=bool),
        int(is_inside.sum()),
        int(undecided.examined[0]),
    )


@dataclass(frozen=True, eq=False)
class _Outcome:
    """What was proved of a set of equilibria."""

    proved: Proved
    boxes: "_Boxes"
    regions: tuple[UndecidedRegion, ...]
    numbers: Integers  # the boxes in the range, or at its border and known
    known: dict[int, int]  # the first known state in each box that has one
    open: Mask  # (m,): the known states that may be equilibria, in undecided regions
    count: int
    examined: int

    def certificate(self, rho_max: float, errors: Array) -> Certificate:
        """Return the certificate, with bounds of the errors of all states that are returned."""
        return Certificate(rho_max, self.count, self.regions, self.examined, float(errors.max(initial=0.0)))


def _open_pairs(tables: list[UnitCells], frames: Frames, proved: Proved) -> Integers | None:
    """Return the pairs of leaves that may hold another equilibrium, (m, 2); None if they are too many.

    `tables` are those of both legs, with the same cells.
    """
    search = make_open_pairs(tables[0], _MOST_OPEN)
    for leg, table in enumerate(tables):
        set_parts(table, frames, leg, search)
    while find_open_pairs(tables[0], proved, search):
        if search.counts[1] == _MOST_OPEN:
            return None
    return search.pairs[: search.counts[1]]


def _is_resolved(cells: UnitCells, frames: Frames, pairs: Integers, proved: Proved, undecided: Undecided) -> bool:
    """Examine pairs of leaves until all is proved or undecided; return False where a limit was met first."""
    search, status = make_resolution(pairs), GOES_ON
    while status == GOES_ON:
        status = resolve(cells, frames, search, _MOST_EXAMINED, proved, undecided)
    return status == RESOLVED


@dataclass(frozen=True, eq=False)
class _Boxes:
    """The proved boxes, in their own charts, and the equilibria in them, in the polar one."""

    center: Array  # (m, 4)
    radius: Array  # (m, 4)
    is_cartesian: Mask  # (m, 4)
    polar: Array  # (m, 4)
    polar_error: Array  # (m, 4)

    @classmethod
    def of(cls, proved: Proved) -> "_Boxes":
        count = proved.total[0]
        center, error = proved.center[:count], proved.error[:count]
        is_cartesian = np.repeat(proved.charts[:count] == CARTESIAN, 2, axis=1)
        size, reach = np.hypot(center[:, 0::2], center[:, 1::2]), np.hypot(error[:, 0::2], error[:, 1::2])
        rho = np.sqrt(size)
        own_polar, own_error = np.empty_like(center), np.empty_like(error)
        own_polar[:, 0::2], own_polar[:, 1::2] = rho, np.arctan2(-center[:, 1::2], center[:, 0::2])
        own_error[:, 0::2] = np.maximum(np.sqrt(size + reach) - rho, rho - np.sqrt(np.maximum(size - reach, 0.0)))
        own_error[:, 1::2] = math.pi
        return cls(
            center,
            proved.radius[:count],
            is_cartesian,
            np.where(is_cartesian, own_polar, center),
            np.where(is_cartesian, own_error, error),
        )

    def in_range(self, rho_max: float) -> tuple[Mask, Mask]:
        """Return which equilibria have both rho surely up to rho_max, and which have one surely beyond it."""
        rho, reach = self.polar[:, 0::2], self.polar_error[:, 0::2] + _ROUNDING * rho_max
        return np.all(rho + reach <= rho_max, axis=1), np.any(rho - reach > rho_max, axis=1)

    def owner(self, loads: Array) -> int | None:
        """Return the box in which these polar loads (4,) lie, if any."""
        if not len(self.center):
            return None
        cartesian = np.empty(4)
        cartesian[0::2] = loads[0::2] ** 2 * np.cos(loads[1::2])
        cartesian[1::2] = -(loads[0::2] ** 2) * np.sin(loads[1::2])
        gap = np.abs(np.where(self.is_cartesian, cartesian, loads) - self.center)
        is_angle = ~self.is_cartesian & (np.arange(4) % 2 == 1)
        gap = np.where(is_angle, np.minimum(gap, np.abs(gap - 2.0 * math.pi)), gap)
        distance = np.max(gap / self.radius, axis=1)
        nearest = int(np.argmin(distance))
        return nearest if distance[nearest] <= 1.0 else None


@lru_cache(maxsize=2)
def _unit_cells(levels: int, rho_max: float, kind: int) -> UnitCells:
    return make_unit_cells(levels, rho_max, kind)


def _polar_loads(states: Array) -> Array:
    """Return rho and b of both rods, (m, 4)."""
    x, y = states[:, 0:4:2], states[:, 1:4:2]
    loads = np.empty((len(states), 4))
    loads[:, 0::2], loads[:, 1::2] = np.sqrt(np.hypot(x, y)), np.arctan2(-y, x)
    return loads


def _undecided_regions(undecided: Undecided, is_finished: bool) -> list[UndecidedRegion]:
    """Return the regions made of undecided cells that touch; the last cell is what was left when a limit was met."""
    cells = undecided.cells[: undecided.total[0]]
    centers, widths = cells[:, :, 0::2].reshape(-1, 4), cells[:, :, 1::2].reshape(-1, 4)
    hulls: list[tuple[Array, Array]] = []
    folds = len(cells) if is_finished else len(cells) - 1
    for low, high in zip(centers[:folds] - widths[:folds], centers[:folds] + widths[:folds], strict=True):
        apart = []
        for other_low, other_high in hulls:
            if np.all(low <= other_high + _SAME_REGION) and np.all(other_low <= high + _SAME_REGION):
                low, high = np.minimum(low, other_low), np.maximum(high, other_high)
            else:
                apart.append((other_low, other_high))
        hulls = [*apart, (low, high)]
    regions = [_region("fold", low, high) for low, high in hulls]
    if not is_finished:
        regions.append(_region("limit", centers[-1] - widths[-1], centers[-1] + widths[-1]))
    return regions


def _region(reason: str, low: Array, high: Array) -> UndecidedRegion:
    return UndecidedRegion(reason, np.stack([low[0::2], high[0::2]], axis=1), np.stack([low[1::2], high[1::2]], axis=1))
