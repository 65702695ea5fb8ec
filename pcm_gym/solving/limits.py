"""Limits of the structure: which of a mechanism's equilibria break none."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from pcm_gym.arrays import Mask
from pcm_gym.kernels.structure.limits import LIMIT_COUNT, Bounds, set_broken
from pcm_gym.mechanism import Mechanism
from pcm_gym.mechanism.validation import finite_array, instance_of, one_of, sequence_of, shown
from pcm_gym.solving.equilibrium import Equilibrium

# In the order of the kernels' columns.
LimitName = Literal["stress", "torque", "contact"]
LIMIT_NAMES: tuple[LimitName, ...] = get_args(LimitName)


@dataclass(frozen=True)
class StructuralLimits:
    """Some limits of a mechanism's structure.

    Attributes
    ----------
    mechanism : Mechanism
    names : tuple of "stress", "torque" or "contact"
        "stress": no rod is bent beyond the yield stress of its material. "torque": no actuator gives more than its
        greatest torque or force. "contact": no rod crosses itself; with a platform also no other rod and no edge of the
        platform. The two rods of a point end-effector may cross, one above the other.

    Raises
    ------
    TypeError, ValueError
        If a name is another one or comes twice, a rod has no section and material where stress is limited, or an
        actuator no greatest torque or force where these are.
    """

    mechanism: Mechanism
    names: tuple[LimitName, ...] = ()

    def __post_init__(self) -> None:
        mechanism = instance_of("mechanism", self.mechanism, Mechanism)
        names = tuple(one_of("limits", name, LIMIT_NAMES) for name in sequence_of("limits", self.names, str))
        if len(set(names)) < len(names):
            raise ValueError(f"limits must be named once each, got {names}")
        object.__setattr__(self, "names", tuple(name for name in LIMIT_NAMES if name in names))
        for n, leg in enumerate(mechanism.legs):
            if "stress" in names and leg.rod.material is None:
                raise ValueError(f"limits: 'stress' takes rods with section and material, the rod of leg {n} has none")
            if "torque" in names and leg.actuator.greatest_effort is None:
                what = "greatest_torque" if leg.actuator.is_angle else "greatest_force"
                raise ValueError(f"limits: 'torque' takes actuators with a {what}, that of leg {n} has none")

    def __bool__(self) -> bool:
        """Return whether anything is limited."""
        return bool(self.names)

    @cached_property
    def bounds(self) -> Bounds:
        """The limits as the kernels take them."""
        units, curvatures, forces = self.mechanism.units, *np.full((2, self.mechanism.leg_count), np.inf)
        for n, leg in enumerate(self.mechanism.legs):
            if "stress" in self.names:
                curvatures[n] = leg.rod.yield_curvature * units.length
            if "torque" in self.names and leg.actuator.greatest_effort is not None:
                forces[n] = leg.actuator.greatest_effort * units.inputs[n] / units.energy
        return Bounds(curvatures, forces, "contact" in self.names)

    def broken(self, states: ArrayLike, inputs: ArrayLike) -> Mask:
        """Return which limits equilibria break, (n, 3): stress, torque, contact.

        `states` (n, 2 legs + d) and `inputs` (n, legs) are the kernels', dimensionless. Limits that are not named are
        not broken.
        """
        states = finite_array("states", states, ("n", self.mechanism.state_size))
        inputs = finite_array("inputs", inputs, (len(states), self.mechanism.leg_count))
        broken = np.zeros((len(states), LIMIT_COUNT), dtype=np.bool_)
        if self:
            set_broken(self.mechanism.leg_table, states, inputs, self.bounds, broken)
        return broken

    def are_kept(self, states: ArrayLike, inputs: ArrayLike) -> Mask:
        """Return which equilibria break none, (n,); see `broken`."""
        kept: Mask = np.logical_not(self.broken(states, inputs).any(axis=1))
        return kept

    def broken_by(self, equilibrium: Equilibrium) -> tuple[LimitName, ...]:
        """Return the names of the limits that an equilibrium breaks."""
        if instance_of("equilibrium", equilibrium, Equilibrium).mechanism != self.mechanism:
            raise ValueError(f"equilibrium must be of {self.mechanism.name!r}, got {shown(equilibrium)}")
        state, inputs, _ = equilibrium.kernel_values()
        return tuple(np.array(LIMIT_NAMES)[self.broken(state[None], inputs[None])[0]].tolist())


def limits_of(mechanism: Mechanism, names: Sequence[LimitName]) -> StructuralLimits:
    """Return the limits of a mechanism with these names, checked."""
    return StructuralLimits(mechanism, tuple(sequence_of("limits", names, str)))
