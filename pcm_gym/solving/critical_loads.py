"""The least load that destabilises an equilibrium: the nearest fold in the space of the loads."""

from dataclasses import dataclass

import numpy as np

from pcm_gym.arrays import Array
from pcm_gym.kernels.branches.continuation import FOLD, INDEX_CHANGE, follow_branch
from pcm_gym.kernels.branches.load_normal import load_normal_at
from pcm_gym.kernels.statics.states import Point
from pcm_gym.mechanism.validation import check_kinds, instance_of, positive_number, shown
from pcm_gym.solving.equilibrium import Equilibrium
from pcm_gym.solving.fold_search import Hit, Space, nearest_hit, polled

# Largest load looked at by default, in EI / L^2: about that of a rod with rho = 10.
_REACH = 100.0
# The largest that may be asked for: rods with rho = 100, straight but for their ends.
_LARGEST_REACH = 1e4


@dataclass(frozen=True, eq=False)
class CriticalLoad:
    """The least load that, added to an equilibrium's own, takes its stability.

    Attributes
    ----------
    equilibrium : Equilibrium
        The equilibrium at which stability is lost, under both loads.
    load : array (d,)
        The load that is added, (Fx, Fy) in N, on a platform also M in N m.
    size : float
        Its size in N; a moment counts like the force that makes it at the mean rod length.
    """

    equilibrium: Equilibrium
    load: Array
    size: float

    def __post_init__(self) -> None:
        check_kinds(self, equilibrium=Equilibrium, load=np.ndarray, size=float)

    @property
    def direction(self) -> Array:
        """Unit vector of the load, (d,), with a moment counted as in `size`."""
        units = self.equilibrium.mechanism.units
        direction: Array = self.load / (self.size * units.load / units.force)
        return direction


def critical_load(equilibrium: Equilibrium, reach: float | None = None) -> CriticalLoad | None:
    """Return the least load on the end-effector that destabilises a stable equilibrium, or None within `reach`.

    The inputs are held while the load grows in proportion. On the branch of the equilibrium, stability is lost where
    the stiffness K first becomes singular, det K = 0; these loads are a curve, or a surface, in the space of the loads,
    whose nearest point is returned. There the load is normal to it: it acts along the motion v of the end-effector with
    K v = 0. Any smaller load that grows along a straight line leaves the equilibrium stable, which makes this the safe
    payload in a conservative design: compare it with weight, contact forces and what else may come, in any direction.

    Parameters
    ----------
    equilibrium : Equilibrium
        A stable one, under any load.
    reach : float, optional
        Largest load looked at, in N, at most 10,000 EI / L^2 of the mean rod; by default 100.

    Raises
    ------
    ValueError
        If the equilibrium is not stable, or `reach` not greater than 0 or too great.

    Notes
    -----
    Rays are tracked in 128 directions, as `nearest_fold` does in the space of the inputs, and the shortest are turned
    until they meet the folds at a right angle. Folds that no ray comes near are missed. The size is exact to about
    1e-8. Some 20 to 200 ms.
    """
    if not instance_of("equilibrium", equilibrium, Equilibrium).is_stable:
        raise ValueError(f"equilibrium must be stable, got one of index {equilibrium.index}: {equilibrium!r}")
    units = equilibrium.mechanism.units
    size = _REACH if reach is None else positive_number("reach", reach) / units.force
    if size > _LARGEST_REACH:
        raise ValueError(f"reach must be at most {_LARGEST_REACH * units.force:.6g} N, got {shown(reach)}")
    _, inputs, load = equilibrium.kernel_values()
    legs = equilibrium.mechanism.leg_table

    def shoot(direction: Array, reach: float) -> Hit | None:
        point = Point(np.array(equilibrium.state), inputs.copy(), load.copy())
        event, fraction = follow_branch(legs, point, inputs, load + reach * direction, False)
        return Hit(fraction * reach, direction, point.x, point.load) if event in (FOLD, INDEX_CHANGE) else None

    def normal(hit: Hit) -> Array:
        return load_normal_at(legs, np.concatenate([hit.state, inputs]))

    space = Space(len(load), shoot, normal)
    hit = nearest_hit(space, size)
    if hit is None:
        return None
    hit = polled(space, hit)
    at_fold = Equilibrium.unchecked(
        equilibrium.mechanism, hit.state, equilibrium.inputs, units.load_from_kernel(hit.parameters)
    )
    return CriticalLoad(at_fold, units.load_from_kernel(hit.distance * hit.direction), hit.distance * units.force)
