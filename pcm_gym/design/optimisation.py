"""Improving a design: more workspace, more stability, or less effort of the actuators."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import Bounds, OptimizeResult, minimize

from pcm_gym.arrays import Array
from pcm_gym.design.derivatives import design_derivatives
from pcm_gym.design.following import DesignError, equilibria_along, follow_design
from pcm_gym.design.parameters import DesignParameter, change_design, checked_parameters, least_value
from pcm_gym.mechanism import Mechanism
from pcm_gym.mechanism.validation import check_kinds, finite_array, number_not_negative, one_of, whole_number
from pcm_gym.solving import Equilibrium, build_roadmap

Objective = Literal["workspace", "margin", "torque"]
OBJECTIVES: tuple[Objective, ...] = get_args(Objective)

# Change of the objective, by its value at first, at which the search ends, and radii of the trust region without
# gradients, by the width of the bounds.
_CONVERGED, _FIRST_RADIUS, _LAST_RADIUS = 1e-9, 0.1, 1e-3
# Where an equilibrium does not continue to a design, it counts as much worse than at first.
_MUCH_WORSE = 10.0


@dataclass(frozen=True, eq=False)
class OptimisedDesign:
    """A design that was improved.

    Attributes
    ----------
    mechanism : Mechanism
        The variant with the values.
    parameters : tuple of DesignParameter
    values : array (m,)
        Each in its parameter's unit.
    objective : str
        "workspace", "margin" or "torque".
    before, after : float
        What the objective was at first and what it has become, see `optimise_design`.
    evaluations : int
        Designs that were looked at.
    message : str
        Why the search ended.
    """

    mechanism: Mechanism
    parameters: tuple[DesignParameter, ...]
    values: Array
    objective: str
    before: float
    after: float
    evaluations: int
    message: str

    def __post_init__(self) -> None:
        check_kinds(self, mechanism=Mechanism, parameters=tuple, values=np.ndarray, objective=str)
        check_kinds(self, before=float, after=float, evaluations=int, message=str)


def optimise_design(
    mechanism: Mechanism,
    objective: Objective,
    parameters: Sequence[DesignParameter],
    bounds: ArrayLike,
    *,
    inputs: ArrayLike | None = None,
    load: ArrayLike | None = None,
    start: Equilibrium | None = None,
    least_margin: float = 0.05,
    most_evaluations: int = 200,
) -> OptimisedDesign:
    """Search for a better design near a given one: a local optimum within bounds.

    Parameters
    ----------
    mechanism : Mechanism
        The design to begin with.
    objective : str
        "margin": the least `stability_margin` over the inputs is to be large. "torque": the largest magnitude of the
        actuators' forces over the inputs is to be small; dimensionless, in EI/L of motors and EI/L^2 of sliders.
        "workspace": the poses that stable ways lead to from home within the limits of the inputs are to be many: their
        area in m^2, or volume in m^2 rad, counted as often as sheets of the inputs cover it.
    parameters : sequence of DesignParameter
    bounds : array_like (m, 2)
        Least and largest value of each; those of the mechanism are within them.
    inputs : array_like (n, legs), optional
        Where "margin" and "torque" look, rad or m, each reached from the one before, the first one from `start`; the
        home inputs alone by default.
    load : array_like (d,), optional
        Load on the end-effector, N and N m.
    start : Equilibrium, optional
        A stable equilibrium of the mechanism; `home_equilibrium` by default.
    least_margin : float
        Singularity margin that "workspace" keeps.
    most_evaluations : int
        Designs that are looked at, at most.

    Returns
    -------
    OptimisedDesign

    Raises
    ------
    TypeError, ValueError
        If the arguments do not fit each other.
    DesignError
        If the mechanism loses stability on its way through the inputs.

    Notes
    -----
    "margin" and "torque" are least and largest of smooth functions: a bound on all of them is moved, by sequential
    quadratic programming with exact derivatives. "workspace" is a sum over a roadmap, which is grown anew for each
    design in tenths of a second: a quadratic model without derivatives. Local optima depend on where one begins.
    """
    one_of("objective", objective, OBJECTIVES)
    members = checked_parameters(mechanism, parameters)
    space = _Space(mechanism, members, _checked_bounds(mechanism, members, bounds))
    evaluations = whole_number("most_evaluations", most_evaluations, least=1)
    least_margin = number_not_negative("least_margin", least_margin)
    if objective == "workspace":
        if inputs is not None:
            raise ValueError("inputs must be left out with the objective 'workspace', which covers all of them")
        home = equilibria_along(mechanism, np.array([mechanism.home_inputs]), load, start)
        return _enlarge(space, home[0], least_margin, evaluations)
    given: ArrayLike = np.array([mechanism.home_inputs]) if inputs is None else inputs
    places = finite_array("inputs", given, ("n", mechanism.leg_count))
    if not len(places):
        raise ValueError("inputs must be one place at least, got none")
    told = _margins if objective == "margin" else _efforts
    return _level(space, objective, told, equilibria_along(mechanism, places, load, start), evaluations)


@dataclass(frozen=True)
class _Space:
    """Designs as points of the unit cube: each parameter from its least to its largest value."""

    mechanism: Mechanism
    parameters: tuple[DesignParameter, ...]
    bounds: Array  # (m, 2)

    @property
    def width(self) -> Array:
        width: Array = self.bounds[:, 1] - self.bounds[:, 0]
        return width

    @property
    def first(self) -> Array:
        """Point of the mechanism."""
        values = np.array([own.value(self.mechanism) for own in self.parameters])
        first: Array = (values - self.bounds[:, 0]) / self.width
        return first

    def values(self, point: Array) -> Array:
        return np.clip(self.bounds[:, 0] + point * self.width, *self.bounds.T)

    def design(self, point: Array) -> Mechanism:
        return change_design(self.mechanism, self.parameters, self.values(point))


def _margins(space: _Space, equilibria: Sequence[Equilibrium]) -> tuple[Array, Array]:
    """Return what is to be large, (k,), and its derivatives by the point, (k, m)."""
    slopes = [design_derivatives(own, space.parameters).stability_margin for own in equilibria]
    return np.array([own.stability_margin for own in equilibria]), np.array(slopes) * space.width


def _efforts(space: _Space, equilibria: Sequence[Equilibrium]) -> tuple[Array, Array]:
    """Return the same of the actuators' forces, dimensionless, of both signs: the least one is to be large."""
    units = space.mechanism.units
    scale = units.energy / units.inputs
    forces = np.array([own.actuator_forces for own in equilibria]) / scale
    slopes = np.array([design_derivatives(own, space.parameters).actuator_forces for own in equilibria])
    flat, by_point = forces.ravel(), (slopes / scale[:, None] * space.width).reshape(forces.size, -1)
    return np.concatenate([-flat, flat]), np.concatenate([-by_point, by_point])


class _Lowest:
    """The lowest of smooth functions of the design, to be raised: their values and derivatives, worked out once."""

    def __init__(
        self,
        space: _Space,
        told: Callable[[_Space, Sequence[Equilibrium]], tuple[Array, Array]],
        equilibria: Sequence[Equilibrium],
    ) -> None:
        self._space, self._told = space, told
        self._equilibria, self._point = tuple(equilibria), space.first
        self._values, self._slopes = told(space, self._equilibria)
        self.scale = max(1.0, float(np.abs(self._values).max()))
        self._worst = self._values.min() - _MUCH_WORSE * self.scale
        self.count, self.best, self.best_point = 1, float(self._values.min()), self._point

    def at(self, point: Array) -> tuple[Array, Array]:
        """Return values (k,) and derivatives (k, m) at a point; where there is no such equilibrium much worse ones."""
        if np.array_equal(point, self._point):
            return self._values, self._slopes
        self.count += 1
        try:
            mechanism = self._space.design(point)
            equilibria = tuple(follow_design(own, mechanism) for own in self._equilibria)
        except DesignError:
            return np.full_like(self._values, self._worst), np.zeros_like(self._slopes)
        self._equilibria, self._point = equilibria, point.copy()
        self._values, self._slopes = self._told(self._space, equilibria)
        if self._values.min() > self.best:
            self.best, self.best_point = float(self._values.min()), self._point
        return self._values, self._slopes


def _level(
    space: _Space,
    objective: Objective,
    told: Callable[[_Space, Sequence[Equilibrium]], tuple[Array, Array]],
    equilibria: Sequence[Equilibrium],
    evaluations: int,
) -> OptimisedDesign:
    """Raise the lowest of smooth functions: maximise a level t below all of them."""
    lowest = _Lowest(space, told, equilibria)
    count, before = len(space.parameters), lowest.best
    along_level = np.append(np.zeros(count), -1.0)

    def over_level(unknowns: Array) -> Array:
        values: Array = lowest.at(unknowns[:-1])[0] / lowest.scale - unknowns[-1]
        return values

    def slopes(unknowns: Array) -> Array:
        by_point = lowest.at(unknowns[:-1])[1] / lowest.scale
        return np.column_stack([by_point, np.full(len(by_point), -1.0)])

    found = minimize(
        lambda unknowns: -unknowns[-1],
        np.append(space.first, before / lowest.scale),
        method="SLSQP",
        jac=lambda unknowns: along_level,
        bounds=Bounds(np.append(np.zeros(count), -np.inf), np.append(np.ones(count), np.inf)),
        constraints={"type": "ineq", "fun": over_level, "jac": slopes},
        options={"maxiter": evaluations, "ftol": _CONVERGED},
    )
    sign = 1.0 if objective == "margin" else -1.0
    return _design(space, objective, lowest.best_point, (sign * before, sign * lowest.best), lowest.count, found)


def _enlarge(space: _Space, home: Equilibrium, least_margin: float, evaluations: int) -> OptimisedDesign:
    """Enlarge the workspace without derivatives."""
    before = _workspace(home, least_margin)
    if before == 0.0:
        raise ValueError(
            f"least_margin must be below that of the start, {home.singularity_margin:g}; got {least_margin}"
        )
    best, best_point = before, space.first

    def smaller(point: Array) -> float:
        nonlocal best, best_point
        try:
            size = _workspace(follow_design(home, space.design(point)), least_margin)
        except DesignError:
            size = 0.0
        if size > best:
            best, best_point = size, point.copy()
        return -size / before

    found = minimize(
        smaller,
        space.first,
        method="COBYQA",
        bounds=Bounds(np.zeros(len(space.parameters)), np.ones(len(space.parameters))),
        options={
            "maxfev": evaluations,
            "initial_tr_radius": _FIRST_RADIUS,
            "final_tr_radius": _LAST_RADIUS,
        },
    )
    return _design(space, "workspace", best_point, (before, best), int(found.nfev), found)


def _workspace(home: Equilibrium, least_margin: float) -> float:
    """Return the size of the set of poses that stable ways lead to, counted by sheets."""
    if not home.is_stable or home.singularity_margin <= least_margin:
        return 0.0
    mechanism = home.mechanism
    roadmap, units = build_roadmap(mechanism, [home], least_margin=least_margin), mechanism.units
    own = roadmap.components == roadmap.components[roadmap.seeds[0]]
    cell = float(np.prod(units.kernel_from_inputs(np.array(roadmap.raster.pitch))))
    return float(roadmap.pose_densities[own].sum()) * cell * float(np.prod(units.pose))


def _design(
    space: _Space,
    objective: Objective,
    point: Array,
    sizes: tuple[float, float],
    evaluations: int,
    found: OptimizeResult,
) -> OptimisedDesign:
    values, (before, after) = space.values(point), sizes
    mechanism = change_design(space.mechanism, space.parameters, values)
    return OptimisedDesign(
        mechanism, space.parameters, values, objective, before, after, evaluations, str(found.message)
    )


def _checked_bounds(mechanism: Mechanism, parameters: tuple[DesignParameter, ...], bounds: ArrayLike) -> Array:
    pairs = finite_array("bounds", bounds, (len(parameters), 2))
    for own, (lower, upper) in zip(parameters, pairs.tolist(), strict=True):
        value, least = own.value(mechanism), least_value(own)
        if not (lower < upper and lower <= value <= upper):
            raise ValueError(f"bounds must be lower < upper about {own}, {value}, got {(lower, upper)}")
        if lower <= least and math.isfinite(least):
            raise ValueError(f"bounds must be greater than {least:g} for {own}, got {(lower, upper)}")
    return pairs
