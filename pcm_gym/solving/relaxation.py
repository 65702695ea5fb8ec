"""Where a mechanism snaps to after a fold."""

from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np

from pcm_gym.arrays import Array
from pcm_gym.kernels.snaps import snap as kernels
from pcm_gym.kernels.snaps.relaxation import LARGEST_DISTURBANCE
from pcm_gym.kernels.statics.states import Point
from pcm_gym.mechanism.validation import check_kinds, instance_of
from pcm_gym.solving.equilibrium import Equilibrium

_LARGEST_RESIDUAL = 1e-6
# Stability margins below this are those of singular points, known as well as rounding lets them be.
_SINGULAR = 1e-6


class SnapStatus(StrEnum):
    """How a snap ended."""

    LANDED = "landed"
    STAYED = "stayed"
    NOT_RESOLVED = "not_resolved"
    NOT_SETTLED = "not_settled"
    NOT_POLISHED = "not_polished"

    @property
    def message(self) -> str:
        """What the status means, in a sentence."""
        return _MESSAGES[self]


_MESSAGES = {
    SnapStatus.LANDED: "The mechanism came to rest at a stable equilibrium.",
    SnapStatus.STAYED: "No small disturbance lowers the energy.",
    SnapStatus.NOT_RESOLVED: "The rods bend too sharply for the points by which their motion is followed.",
    SnapStatus.NOT_SETTLED: "The motion did not come to rest; a moment may turn a platform for ever.",
    SnapStatus.NOT_POLISHED: "The motion came to rest, but no exact equilibrium was found there.",
}

# The kernel's codes, in their order.
_STATUSES = tuple(SnapStatus)


@dataclass(frozen=True)
class Snap:
    """Where a mechanism falls from a fold or from an unstable equilibrium.

    Attributes
    ----------
    equilibrium : Equilibrium
        The landing, stable; where the status is not `SnapStatus.LANDED`, the equilibrium that it started from.
    status : SnapStatus
    energy_released : float
        Energy of the start less that of the landing, all of it lost to the damping, in J; 0 without a landing.
    energies : array (steps + 1,)
        Energy after each step of the motion, in J; it never rises. The steps are unequal in time.
    """

    equilibrium: Equilibrium
    status: SnapStatus
    energy_released: float
    energies: Array = field(repr=False, compare=False)

    def __post_init__(self) -> None:
        check_kinds(self, equilibrium=Equilibrium, status=SnapStatus, energy_released=float, energies=np.ndarray)

    @property
    def is_landed(self) -> bool:
        """Whether the mechanism came to rest at a stable equilibrium."""
        return self.status == SnapStatus.LANDED


def snap(equilibrium: Equilibrium) -> Snap:
    """Return where the mechanism falls from a fold or from an unstable equilibrium, at the same inputs and load.

    The whole rods, not only their tips, move as in a viscous fluid that resists every piece of them alike; inputs and
    load are held. They come to rest at a stable equilibrium: neither the nearest one nor that of least energy, but the
    one that lies downhill.

    Parameters
    ----------
    equilibrium : Equilibrium
        One at a fold or another singular point, such as `BranchTracker` ends a step at, or an unstable one.

    Returns
    -------
    Snap
        A motion without a landing is no misuse and raises nothing: `Snap.status` tells.

    Raises
    ------
    ValueError
        If the equilibrium is stable, or none. Stable means that no disturbance of its rods by up to 1.6 % of their
        length lowers the energy: so near to a fold a state counts as being there. At a bifurcation into stable
        branches nothing falls either, but that is an answer: `SnapStatus.STAYED`.

    Notes
    -----
    The fall begins with a disturbance, as small as will do, along the softest motion of the rods, to the side where the
    energy falls; from an unstable equilibrium, where it falls on both, to the lower one. Where both are equal, at a
    pitchfork of a symmetric mechanism, it is a choice: the side on which the tip of the first rod that moves turns
    counter-clockwise. The same equilibrium always gives the same landing.

    That the motion is overdamped is a convention: rods with little damping overshoot, and may land elsewhere. Near the
    border between two basins the landing depends on the law of damping, which no static theory knows:
    ``python -m benchmarks.snaps`` compares with chains of links, and with such as resist turning instead of motion.
    Of 400 falls, 3 ended elsewhere under that other law.

    1 to 2 ms for two rods, about 4 ms for three.
    """
    if not instance_of("equilibrium", equilibrium, Equilibrium).residual < _LARGEST_RESIDUAL:
        raise ValueError(f"equilibrium must be one, got a state with residual {equilibrium.residual:.3g}")
    found = _motion_from(equilibrium)
    is_stable = equilibrium.index == 0 and equilibrium.stability_margin > _SINGULAR
    if found.status == SnapStatus.STAYED and is_stable:
        raise ValueError(
            "equilibrium must be unstable or at a fold to snap, got a stable one with stability_margin "
            f"{equilibrium.stability_margin:.3g}: no disturbance of its rods by up to {LARGEST_DISTURBANCE:.1%} of "
            "their length lowers its energy (at a bifurcation into stable branches, step beyond it first)"
        )
    return found


def _motion_from(equilibrium: Equilibrium) -> Snap:
    mechanism, units = equilibrium.mechanism, equilibrium.mechanism.units
    point = Point(*equilibrium.kernel_values())
    recorded = np.empty(kernels.MOST_ENERGIES)
    code, energy_released, steps = kernels.snap(mechanism.leg_table, point, recorded)
    status, energies = _STATUSES[code], recorded[: steps + 1] * units.energy
    energies.setflags(write=False)
    if status != SnapStatus.LANDED:
        return Snap(equilibrium, status, 0.0, energies)
    landing = Equilibrium.unchecked(mechanism, point.x, equilibrium.inputs, equilibrium.load)
    return Snap(landing, status, energy_released * units.energy, energies)
