"""The home equilibrium of a mechanism."""

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.stats import qmc

from pcm_gym.kernels.equilibrium import search_forward
from pcm_gym.mechanism import Mechanism
from pcm_gym.solving.equilibrium import Equilibrium

_START_COUNT = 4096
_RHO_MAX = 9.0


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


def _search(
    mechanism: Mechanism, inputs: NDArray[np.float64], load: NDArray[np.float64]
) -> list[Equilibrium]:
    units = mechanism.units
    found = np.empty((_START_COUNT, mechanism.state_size))
    count = search_forward(
        mechanism.leg_table, inputs / units.inputs, load / units.load, _starts(mechanism), found
    )
    rounded, keep = np.unique(np.round(found[:count], 6), axis=0, return_index=True)
    loads = np.abs(rounded[:, : 2 * mechanism.leg_count]).max(axis=1, initial=0.0)
    return [Equilibrium(mechanism, found[i], inputs, load) for i in keep[loads <= _RHO_MAX**2]]


def _starts(mechanism: Mechanism) -> NDArray[np.float64]:
    """Return rods spread evenly over tip loads with rho <= 9, taut ones on a logarithmic scale, and platform angles."""
    unit = qmc.Sobol(mechanism.state_size, seed=0).random(_START_COUNT)
    starts = np.zeros((_START_COUNT, mechanism.state_size))
    for leg in range(mechanism.leg_count):
        rho = _RHO_MAX * np.sqrt(unit[:, 2 * leg])
        side = 2.0 * unit[:, 2 * leg + 1] - 1.0
        angle = np.pi * np.sign(side) * np.expm1(rho * np.abs(side)) / np.expm1(rho)
        starts[:, 2 * leg] = rho**2 * np.cos(angle)
        starts[:, 2 * leg + 1] = -(rho**2) * np.sin(angle)
    starts[:, -1] = np.pi * (2.0 * unit[:, -1] - 1.0)
    return starts
