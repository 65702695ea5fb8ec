"""The home equilibrium of a mechanism."""

import numpy as np
from numpy.typing import ArrayLike

from pcm_gym.mechanism import Mechanism
from pcm_gym.mechanism.validation import instance_of
from pcm_gym.solving.enumeration import solve_forward
from pcm_gym.solving.equilibrium import Equilibrium

# Stable equilibria with larger loads than the first are looked for only if there is none below it.
_RHO_MAX = (6.5, 13.0)


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
        If the mechanism has no stable equilibrium at its home inputs with every rho <= 13.
    """
    inputs = instance_of("mechanism", mechanism, Mechanism).check_inputs(np.asarray(mechanism.home_inputs))
    for rho_max in _RHO_MAX:
        stable = solve_forward(mechanism, inputs, load, rho_max).stable
        if stable:
            break
    else:
        raise ValueError(
            f"mechanism {mechanism.name!r} has no stable equilibrium at home_inputs {mechanism.home_inputs}"
        )
    if mechanism.home_pose is None:
        return stable[0]
    pose = np.array(mechanism.home_pose)
    return min(stable, key=lambda found: float(np.linalg.norm(mechanism.units.kernel_from_pose(found.pose - pose))))
