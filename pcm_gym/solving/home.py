"""The home equilibrium of a mechanism."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pcm_gym.kernels.equilibrium import search_forward
from pcm_gym.kernels.rod_table import make_rod_table
from pcm_gym.mechanism import Mechanism
from pcm_gym.solving.enumeration import solve_forward
from pcm_gym.solving.equilibrium import Equilibrium

Array = NDArray[np.float64]

_RHO_MAX = 9.0
_TABLE_SHAPE = (72, 97)
_MOST_FOUND = 4096


def home_equilibrium(mechanism: Mechanism, load: ArrayLike | None = None) -> Equilibrium:
    """Return the stable equilibrium at the mechanism's home inputs.

    Of several stable ones it is the one nearest to `home_pose` if the mechanism has one (lengths relative to the mean
    rod length), else the one of least energy.

    Parameters
    ----------
    mechanism : Mechanism
    load : array_like (d,), optional
        Load on the end-effector, N and N m; none by default.

    Raises
    ------
    ValueError
        If the mechanism has no stable equilibrium at its home inputs with every rho <= 9.
    """
    inputs = mechanism.check_inputs(np.asarray(mechanism.home_inputs))
    pose = None if mechanism.home_pose is None else np.array(mechanism.home_pose)
    stable = [] if pose is None else search_stable(mechanism, inputs, mechanism.check_load(load), pose[None])
    stable = stable or [found for found in solve_forward(mechanism, inputs, load, _RHO_MAX) if found.is_stable]
    if not stable:
        raise ValueError(f"mechanism {mechanism.name!r} has no stable equilibrium at home_inputs {inputs.tolist()}")
    if pose is None:
        return stable[0]
    return min(stable, key=lambda found: float(np.linalg.norm((found.pose - pose) / mechanism.units.pose)))


def search_stable(
    mechanism: Mechanism, inputs: Array, load: Array, poses: Array, rho_max: float = _RHO_MAX
) -> list[Equilibrium]:
    """Return the stable equilibria that Newton's method reaches from rods that meet at `poses` (n, d), often twice."""
    units = mechanism.units
    found = np.empty((_MOST_FOUND, mechanism.state_size))
    count = search_forward(
        mechanism.leg_table,
        inputs / units.inputs,
        load / units.load,
        poses / units.pose,
        make_rod_table(rho_max, *_TABLE_SHAPE),
        found,
    )
    is_within = np.abs(found[:count, : 2 * mechanism.leg_count]).max(axis=1, initial=0.0) <= rho_max**2
    equilibria = (Equilibrium(mechanism, state, inputs, load) for state in found[:count][is_within])
    return [equilibrium for equilibrium in equilibria if equilibrium.is_stable]
