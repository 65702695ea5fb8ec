"""Derivatives of an equilibrium by the design."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pcm_gym.arrays import Array
from pcm_gym.design.parameters import DesignParameter, checked_parameters, effects_of
from pcm_gym.kernels.statics.sensitivity import Quantities, set_rates_at
from pcm_gym.mechanism.validation import check_kinds, instance_of
from pcm_gym.solving import Equilibrium


@dataclass(frozen=True, eq=False)
class DesignDerivatives:
    """Derivatives of an equilibrium by m parameters of the design, at held inputs and load.

    All are exact to rounding, by the implicit function theorem from closed forms. Units are those of the quantity over
    that of the parameter.

    Attributes
    ----------
    parameters : tuple of DesignParameter
    pose : array (d, m)
        Of the end-effector's pose.
    rod_forces : array (legs, 2, m)
        Of the force on each rod's tip.
    actuator_forces : array (legs, m)
        Of what each actuator must give.
    stability_margin : array (m,)
        Of the least eigenvalue of the stiffness, with the units of dimensionless numbers held, as those of variants
        with one reference are. At a rod that is straight, where the stiffness has a pole, it is no number.
    """

    parameters: tuple[DesignParameter, ...]
    pose: Array
    rod_forces: Array
    actuator_forces: Array
    stability_margin: Array

    def __post_init__(self) -> None:
        check_kinds(self, parameters=tuple, pose=np.ndarray, rod_forces=np.ndarray)
        check_kinds(self, actuator_forces=np.ndarray, stability_margin=np.ndarray)


def design_derivatives(equilibrium: Equilibrium, parameters: Sequence[DesignParameter]) -> DesignDerivatives:
    """Return the derivatives of an equilibrium by parameters of its mechanism's design.

    Parameters
    ----------
    equilibrium : Equilibrium
    parameters : sequence of DesignParameter

    Returns
    -------
    DesignDerivatives

    Raises
    ------
    TypeError, ValueError
        If a parameter is none of the mechanism.
    numpy.linalg.LinAlgError
        At a singular point, where they do not exist.
    """
    mechanism = instance_of("equilibrium", equilibrium, Equilibrium).mechanism
    members = checked_parameters(mechanism, parameters)
    count, legs, units = len(members), mechanism.leg_count, mechanism.units
    rates = Quantities(
        np.empty((count, mechanism.dof)), np.empty((count, legs, 2)), np.empty((count, legs)), np.empty(count)
    )
    state, inputs, _ = equilibrium.kernel_values()
    effects = effects_of(mechanism, members, equilibrium.inputs)
    is_regular = set_rates_at(mechanism.leg_table, state, inputs, effects, rates)
    if not is_regular or not np.isfinite(rates.pose).all():
        raise np.linalg.LinAlgError("derivatives by the design do not exist: this equilibrium is a singular point")
    return DesignDerivatives(
        members,
        (rates.pose * units.pose).T,
        np.moveaxis(rates.forces * units.force, 0, -1),
        (rates.efforts * (units.energy / units.inputs)).T,
        rates.margin,
    )
