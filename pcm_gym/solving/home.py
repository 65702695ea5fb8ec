"""The home equilibrium of a mechanism."""

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.stats import qmc

from pcm_gym.kernels.equilibrium import search_forward
from pcm_gym.kernels.rod_table import make_rod_table
from pcm_gym.mechanism import Mechanism
from pcm_gym.solving.equilibrium import Equilibrium

Array = NDArray[np.float64]

_RHO_MAX = 9.0
_TABLE_SHAPE = (72, 97)
_POSE_COUNT = 256
_MOST_FOUND = 65_536


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
    inputs, load_vector = mechanism.check_inputs(np.asarray(mechanism.home_inputs)), mechanism.check_load(load)
    stable = [found for found in _search(mechanism, inputs, load_vector) if found.is_stable]
    if not stable:
        raise ValueError(f"mechanism {mechanism.name!r} has no stable equilibrium at home_inputs {inputs.tolist()}")
    if mechanism.home_pose is None:
        return min(stable, key=lambda found: found.energy)
    wanted = np.array(mechanism.home_pose)
    return min(stable, key=lambda found: float(np.linalg.norm((found.pose - wanted) / mechanism.units.pose)))


def _search(mechanism: Mechanism, inputs: Array, load: Array) -> list[Equilibrium]:
    """Return the equilibria found near the home pose, or near poses spread over the common reach of the legs."""
    units = mechanism.units
    table = make_rod_table(_RHO_MAX, *_TABLE_SHAPE)
    found = np.empty((_MOST_FOUND, mechanism.state_size))
    count = search_forward(
        mechanism.leg_table, inputs / units.inputs, load / units.load, _start_poses(mechanism), table, found
    )
    _, first = np.unique(np.round(found[:count], 6), axis=0, return_index=True)
    is_within = np.abs(found[first, : 2 * mechanism.leg_count]).max(axis=1, initial=0.0) <= _RHO_MAX**2
    return [Equilibrium(mechanism, found[row], inputs, load) for row in first[is_within]]


def _start_poses(mechanism: Mechanism) -> Array:
    if mechanism.home_pose is not None:
        return np.array([mechanism.home_pose]) / mechanism.units.pose
    unit: Array = 2.0 * qmc.Sobol(mechanism.dof, seed=0).random(_POSE_COUNT) - 1.0
    unit[:, :2] += np.mean([leg.actuator.base for leg in mechanism.legs], axis=0) / mechanism.units.length
    unit[:, 2:] *= np.pi
    return unit
