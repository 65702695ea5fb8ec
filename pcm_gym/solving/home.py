"""The home equilibrium of a mechanism."""

from collections.abc import Sequence

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

    Of several it is the one nearest to `home_pose` if the mechanism has one (lengths relative to the mean rod length),
    else the one of least energy. A family of equilibria competes too, but cannot be home.

    Parameters
    ----------
    mechanism : Mechanism
    load : array_like (d,), optional
        Load on the end-effector, N and N m; none by default.

    Raises
    ------
    ValueError
        If the mechanism has no stable equilibrium at its home inputs with every rho <= 13, or a family comes first.
    """
    inputs = instance_of("mechanism", mechanism, Mechanism).check_inputs(np.asarray(mechanism.home_inputs))
    name, place = f"mechanism {mechanism.name!r}", f"at home_inputs {mechanism.home_inputs}"
    for rho_max in _RHO_MAX:
        found = solve_forward(mechanism, inputs, load, rho_max)
        if found.stable:
            break
    families = {family.representative: family for family in found.families}
    if not (found.stable or families):
        raise ValueError(
            f"{name} has no stable equilibrium with every rho <= {rho_max:g} {place}; larger loads were not searched"
        )
    home = _first([*found.stable, *families], mechanism)
    if home in families:
        raise ValueError(f"{name} lies {place} on a family of equilibria, which is no home: {families[home]!r}")
    return home


def _first(equilibria: Sequence[Equilibrium], mechanism: Mechanism) -> Equilibrium:
    """Return the one nearest to the home pose, or of least energy."""
    if mechanism.home_pose is None:
        return min(equilibria, key=lambda each: each.energy)
    pose = np.array(mechanism.home_pose)
    return min(equilibria, key=lambda each: float(np.linalg.norm(mechanism.units.kernel_from_pose(each.pose - pose))))
