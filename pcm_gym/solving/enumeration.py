"""Every equilibrium at given inputs, and every set of inputs with its equilibria at a given pose."""

from collections.abc import Collection, Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pcm_gym.kernels.enumeration import Found, UnitRod, find_combinations, make_unit_rod, polish_forward, polish_inverse
from pcm_gym.mechanism import Mechanism
from pcm_gym.mechanism.validation import positive_number
from pcm_gym.solving.equilibrium import Equilibrium

Array = NDArray[np.float64]
Modes = Sequence[int | Collection[int]]

# Halvings of the rod's table: a point end-effector, a platform.
_LEVELS = {2: 6, 3: 5}
_FIRST_CAPACITY, _LARGEST_CAPACITY = 1 << 14, 1 << 24
_MOST_FOUND = 4096
_LARGEST_RHO = 30.0


def solve_forward(
    mechanism: Mechanism,
    inputs: ArrayLike,
    load: ArrayLike | None = None,
    rho_max: float = 9.0,
    modes: Modes | None = None,
    *,
    refinement: int = 0,
) -> tuple[Equilibrium, ...]:
    """Return every equilibrium at these inputs, stable or not, in all buckling modes, by ascending energy.

    The solutions are enumerated, not searched for from random starts: the surfaces of all equilibria of the rods are
    cut into cells, and every combination of cells that may close and balance is examined.

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

    Returns
    -------
    tuple of Equilibrium

    Raises
    ------
    ValueError
        If an argument has the wrong shape, is not finite or out of range.

    Notes
    -----
    About 20 ms for two legs. A platform takes seconds, more with larger `rho_max`.
    """
    units = mechanism.units
    inputs = mechanism.check_inputs(inputs)
    load = mechanism.check_load(load)
    unit = _unit_rod(mechanism, rho_max, refinement)
    wanted = _checked_modes(mechanism, modes)
    scaled_inputs, scaled_load = inputs / units.inputs, load / units.load
    combinations, starts = _combinations(mechanism, scaled_inputs, np.zeros(mechanism.dof), scaled_load, False, unit)
    found = _empty(mechanism)
    count = polish_forward(mechanism.leg_table, scaled_inputs, scaled_load, unit, combinations, starts, found)
    return _sorted([Equilibrium(mechanism, found.x[row], inputs, load) for row in range(count)], wanted)


def solve_inverse(
    mechanism: Mechanism,
    pose: ArrayLike,
    load: ArrayLike | None = None,
    rho_max: float = 9.0,
    modes: Modes | None = None,
    *,
    refinement: int = 0,
) -> tuple[Equilibrium, ...]:
    """Return every equilibrium at this pose with the inputs that hold it there, by ascending energy.

    Parameters
    ----------
    mechanism : Mechanism
    pose : array_like (d,)
        Pose of the end-effector, (x, y) in m or (x, y, phi).
    load, rho_max, modes, refinement
        As for `solve_forward`.

    Returns
    -------
    tuple of Equilibrium
        Angles of revolute actuators are in (-pi, pi]. Inputs may be beyond the actuators' limits:
        `Equilibrium.within_limits` tells.

    Raises
    ------
    ValueError
        If an argument has the wrong shape, is not finite or out of range.

    Notes
    -----
    A few ms for two legs, about 0.1 s for a platform. A pose out of reach gives an empty tuple.
    """
    units = mechanism.units
    pose = mechanism.check_pose(pose)
    load = mechanism.check_load(load)
    unit = _unit_rod(mechanism, rho_max, refinement)
    wanted = _checked_modes(mechanism, modes)
    scaled_pose, scaled_load = pose / units.pose, load / units.load
    combinations, starts = _combinations(mechanism, np.zeros(mechanism.leg_count), scaled_pose, scaled_load, True, unit)
    found = _empty(mechanism)
    count = polish_inverse(mechanism.leg_table, scaled_pose, scaled_load, unit, combinations, starts, found)
    return _sorted(
        [Equilibrium(mechanism, found.x[row], found.inputs[row] * units.inputs, load) for row in range(count)], wanted
    )


def _unit_rod(mechanism: Mechanism, rho_max: float, refinement: int) -> UnitRod:
    rho_max = positive_number("rho_max", rho_max)
    if rho_max > _LARGEST_RHO:
        raise ValueError(f"rho_max must be at most {_LARGEST_RHO}, got {rho_max}")
    if refinement not in (0, 1, 2):
        raise ValueError(f"refinement must be 0, 1 or 2, got {refinement!r}")
    return _tabulated(_LEVELS[mechanism.leg_count] + refinement, rho_max)


@lru_cache(maxsize=16)
def _tabulated(levels: int, rho_max: float) -> UnitRod:
    return make_unit_rod(levels, rho_max)


def _checked_modes(mechanism: Mechanism, modes: Modes | None) -> list[set[int]] | None:
    if modes is None:
        return None
    if len(modes) != mechanism.leg_count:
        raise ValueError(f"modes must have one entry per rod, {mechanism.leg_count}, got {modes!r}")
    sets = [{int(mode)} if isinstance(mode, int | np.integer) else {int(one) for one in mode} for mode in modes]
    if any(mode < 1 for allowed in sets for mode in allowed):
        raise ValueError(f"modes must be 1 or greater, got {modes!r}")
    return sets


def _combinations(
    mechanism: Mechanism, inputs: Array, pose: Array, load: Array, is_inverse: bool, unit: UnitRod
) -> tuple[NDArray[np.int64], Array]:
    """Return the combinations of cells to be polished, (m, legs), and where to start in them, (m, 2 legs)."""
    capacity = _FIRST_CAPACITY
    while capacity <= _LARGEST_CAPACITY:
        combinations = np.empty((capacity, mechanism.leg_count), dtype=np.int64)
        starts = np.empty((capacity, 2 * mechanism.leg_count))
        count = find_combinations(mechanism.leg_table, inputs, pose, load, is_inverse, unit, combinations, starts)
        if count <= capacity:
            return combinations[:count], starts[:count]
        capacity *= 8
    raise ValueError(f"rho_max must be smaller for this mechanism: {unit.rho_max} leaves too many cells to examine")


def _empty(mechanism: Mechanism) -> Found:
    return Found(
        np.empty((_MOST_FOUND, mechanism.state_size)),
        np.empty((_MOST_FOUND, mechanism.leg_count)),
        np.empty(_MOST_FOUND, dtype=np.int64),
    )


def _sorted(equilibria: list[Equilibrium], wanted: list[set[int]] | None) -> tuple[Equilibrium, ...]:
    if wanted is not None:
        equilibria = [
            found
            for found in equilibria
            if all(mode in allowed for mode, allowed in zip(found.modes, wanted, strict=True))
        ]
    return tuple(sorted(equilibria, key=lambda found: found.energy))
