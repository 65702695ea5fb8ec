"""Estimating a design from measured poses."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from pcm_gym.arrays import Array
from pcm_gym.design.derivatives import design_derivatives
from pcm_gym.design.following import DesignError, equilibria_along, follow_design
from pcm_gym.design.parameters import DesignParameter, change_design, checked_parameters, least_value
from pcm_gym.mechanism import Mechanism
from pcm_gym.mechanism.validation import (
    check_kinds,
    finite_array,
    finite_vector,
    instance_of,
    positive_number,
    shape_of,
    shown,
)
from pcm_gym.solving import Equilibrium

# Relative changes of parameters and of the sum of squares at which the search ends.
_CONVERGED = 1e-12
# Singular values of the scaled Jacobian below this part of the largest one: the measurements do not tell.
_UNDETERMINED = 1e-9


@dataclass(frozen=True, eq=False)
class Measurements:
    """Poses that were measured at inputs, in the order in which the mechanism went there, without a fall between.

    Parameters
    ----------
    inputs : array_like (n, legs)
        Rad or m.
    poses : array_like (n, d)
        Measured poses, m and rad.
    load : array_like (d,), optional
        Load on the end-effector, N and N m; none by default.
    deviations : array_like (d,), optional
        Standard deviations of the measured components, m and rad. By default they are estimated: all lengths alike, and
        angles as lengths over the mean rod length.

    Raises
    ------
    TypeError, ValueError
        If they are no finite numbers, of shapes that do not fit, or the deviations not greater than 0.
    """

    inputs: Array
    poses: Array
    load: Array | None = None
    deviations: Array | None = None

    def __post_init__(self) -> None:
        size = 3 if shape_of(self.inputs)[-1:] == (3,) else 2  # as many degrees of freedom as legs
        inputs = finite_array("inputs", self.inputs, ("n", size))
        poses = finite_array("poses", self.poses, (len(inputs), size))
        if not len(inputs):
            raise ValueError("inputs must be of one measurement at least, got none")
        checked: dict[str, Array | None] = {"inputs": inputs, "poses": poses}
        if self.load is not None:
            checked["load"] = finite_vector("load", self.load, poses.shape[1])
        if self.deviations is not None:
            deviations = finite_vector("deviations", self.deviations, poses.shape[1])
            for own in deviations.tolist():
                positive_number("deviations", own)
            checked["deviations"] = deviations
        for name, array in checked.items():
            if array is not None:
                array.setflags(write=False)
            object.__setattr__(self, name, array)


@dataclass(frozen=True, eq=False)
class Calibration:
    """Estimated parameters of a design.

    Attributes
    ----------
    mechanism : Mechanism
        The variant with the estimates.
    parameters : tuple of DesignParameter
    values : array (m,)
        The estimates, each in its parameter's unit.
    covariance : array (m, m)
        Of the estimates, to first order.
    residuals : array (n, d)
        Poses of the estimated mechanism less the measured ones, m and rad.
    deviations : array (d,)
        Standard deviations of the measured components: those given, or estimated from the residuals.
    """

    mechanism: Mechanism
    parameters: tuple[DesignParameter, ...]
    values: Array
    covariance: Array
    residuals: Array
    deviations: Array

    def __post_init__(self) -> None:
        check_kinds(self, mechanism=Mechanism, parameters=tuple, values=np.ndarray, covariance=np.ndarray)
        check_kinds(self, residuals=np.ndarray, deviations=np.ndarray)

    @property
    def standard_errors(self) -> Array:
        """Standard errors of the estimates, (m,)."""
        errors: Array = np.sqrt(np.diag(self.covariance))
        return errors


def calibrate(
    mechanism: Mechanism,
    measurements: Measurements,
    parameters: Sequence[DesignParameter],
    start: Equilibrium | None = None,
) -> Calibration:
    """Estimate parameters of a design by least squares, weighted by the deviations, with standard errors.

    The stable branch is followed from `start` through the inputs in their order, and with every trial of the design;
    the derivatives are those of `design_derivatives`. Under no load poses tell of the rods' stiffnesses only as ratios:
    all of them cannot be estimated together.

    Parameters
    ----------
    mechanism : Mechanism
        The nominal design, with which the search begins.
    measurements : Measurements
    parameters : sequence of DesignParameter
        What is to be estimated.
    start : Equilibrium, optional
        A stable equilibrium of the nominal design, under the load of the measurements, from which they were reached;
        `home_equilibrium` by default.

    Returns
    -------
    Calibration

    Raises
    ------
    TypeError, ValueError
        If the arguments do not fit each other.
    DesignError
        If the nominal design loses stability on its way through the inputs, the search does not come to an end, or the
        measurements do not determine the parameters.
    """
    members = checked_parameters(mechanism, parameters)
    _check_fits(mechanism, instance_of("measurements", measurements, Measurements), len(members))
    problem = _Problem(
        mechanism, measurements, members, equilibria_along(mechanism, measurements.inputs, measurements.load, start)
    )
    first = np.array([own.value(mechanism) for own in members])
    least = np.array([least_value(own) for own in members])
    scale = np.where(np.isfinite(least), first, 1.0)
    found = least_squares(
        problem.residuals,
        first,
        problem.jacobian,
        (least, np.inf),
        x_scale=scale,
        xtol=_CONVERGED,
        ftol=_CONVERGED,
        gtol=_CONVERGED,
    )
    if found.status <= 0:
        raise DesignError(f"the search for the parameters does not come to an end: {found.message}")
    return problem.calibration(found.x, scale)


class _Problem:
    """Least squares: weighted residuals (n d,) of the parameters' values, and their Jacobian."""

    def __init__(
        self,
        mechanism: Mechanism,
        measurements: Measurements,
        parameters: tuple[DesignParameter, ...],
        equilibria: Sequence[Equilibrium],
    ) -> None:
        self._nominal, self._measurements, self._parameters = mechanism, measurements, parameters
        # of the design that was looked at last: at first the nominal one, as a variant of itself
        own = change_design(mechanism, parameters, [each.value(mechanism) for each in parameters])
        self._equilibria = tuple(Equilibrium.unchecked(own, each.state, each.inputs, each.load) for each in equilibria)
        given = measurements.deviations
        self._weights = 1.0 / (mechanism.units.pose if given is None else given)

    def residuals(self, values: Array) -> Array:
        """Return weighted errors of the poses; infinite where an equilibrium does not continue to this design."""
        try:
            self._go_to(values)
        except DesignError:
            return np.full(self._measurements.poses.size, np.inf)
        return (self._errors() * self._weights).ravel()

    def jacobian(self, values: Array) -> Array:
        """Return the derivatives of the residuals, (n d, m)."""
        self._go_to(values)
        derivatives = [design_derivatives(own, self._parameters).pose for own in self._equilibria]
        return (np.array(derivatives) * self._weights[:, None]).reshape(-1, len(values))

    def calibration(self, values: Array, scale: Array) -> Calibration:
        """Return what is known of these values, at which the search has ended."""
        jacobian, residuals = self.jacobian(values) * scale, self.residuals(values)
        _, singular, directions = np.linalg.svd(jacobian, full_matrices=False)
        if singular[-1] <= _UNDETERMINED * singular[0]:
            worst = np.abs(directions[-1])
            named = [str(own) for own, part in zip(self._parameters, worst, strict=True) if part > 0.1]
            raise DesignError(f"the measurements do not determine these parameters together: {', '.join(named)}")
        variance, deviations = 1.0, self._measurements.deviations
        if deviations is None:
            variance = float(residuals @ residuals) / (residuals.size - len(values))
            deviations = np.sqrt(variance) * self._nominal.units.pose
        spread = (directions.T * scale[:, None]) / singular
        mechanism = change_design(self._nominal, self._parameters, values)
        covariance = variance * spread @ spread.T
        return Calibration(mechanism, self._parameters, values, covariance, self._errors(), np.array(deviations))

    def _errors(self) -> Array:
        errors: Array = np.array([own.pose for own in self._equilibria]) - self._measurements.poses
        return errors

    def _go_to(self, values: Array) -> None:
        mechanism = change_design(self._nominal, self._parameters, values)
        if mechanism != self._equilibria[0].mechanism:
            self._equilibria = tuple(follow_design(own, mechanism) for own in self._equilibria)


def _check_fits(mechanism: Mechanism, measurements: Measurements, count: int) -> None:
    if measurements.inputs.shape[1] != mechanism.leg_count:
        raise ValueError(
            f"measurements must have inputs of {mechanism.leg_count} numbers for {mechanism.name!r}, "
            f"got {shown(measurements.inputs)}"
        )
    spare = measurements.poses.size - count
    if spare < 0 or (spare == 0 and measurements.deviations is None):
        raise ValueError(
            f"measurements must be more numbers than the {count} parameters, got {measurements.poses.size}"
        )
