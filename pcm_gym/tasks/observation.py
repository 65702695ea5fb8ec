"""What an agent observes of a state, element by element."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from gymnasium import spaces

from pcm_gym.arrays import Mask
from pcm_gym.kernels.stepping.features import DISTANCE_SCALE, LOAD_SCALE, STIFFNESS_SCALE, feature_columns
from pcm_gym.mechanism import Mechanism
from pcm_gym.mechanism.validation import check_kinds, instance_of


@dataclass(frozen=True)
class Element:
    """One element of the observation: its name, meaning, unit and range."""

    name: str
    meaning: str
    unit: str
    low: float
    high: float

    def __post_init__(self) -> None:
        check_kinds(self, name=str, meaning=str, unit=str, low=float, high=float)


_STABILITY_ELEMENT = Element("is_stable", "1 while the equilibrium is stable, 0 once stability is lost", "1", 0.0, 1.0)
_MARGIN_ELEMENTS = (
    Element(
        "stability_margin", f"s / ({STIFFNESS_SCALE:g} + |s|), s = least eigenvalue of the stiffness", "1", -1.0, 1.0
    ),
    Element(
        "singularity_margin", f"d / ({DISTANCE_SCALE:g} + d), d = estimated distance of the nearest fold", "1", 0.0, 1.0
    ),
)


@dataclass(frozen=True)
class Part:
    """Elements that follow one another, under one name.

    Attributes
    ----------
    name : str
    elements : tuple of Element
    is_measured : bool
        Whether sensors measure them, and noise disturbs them.
    """

    name: str
    elements: tuple[Element, ...]
    is_measured: bool = False


@dataclass(frozen=True)
class Layout:
    """Parts that follow one another; `layout["rods"]` is the slice of the part of that name."""

    parts: tuple[Part, ...]

    def __getitem__(self, name: str) -> slice:
        start = 0
        for part in self.parts:
            if part.name == name:
                return slice(start, start + len(part.elements))
            start += len(part.elements)
        raise KeyError(f"name must be one of {[part.name for part in self.parts]}, got {name!r}")

    @property
    def elements(self) -> tuple[Element, ...]:
        """The elements of all parts."""
        return tuple(element for part in self.parts for element in part.elements)

    @property
    def is_measured(self) -> Mask:
        """Which elements are measured, (elements,)."""
        return np.array([part.is_measured for part in self.parts for _ in part.elements], dtype=np.bool_)


def feature_layout(mechanism: Mechanism) -> Layout:
    """Return where the kernels put the features of a state: pose, inputs, rods, efforts, is_stable and margins."""
    layout = Layout(
        (
            Part("pose", pose_elements(mechanism), is_measured=True),
            Part("inputs", _clamp_elements(mechanism), is_measured=True),
            Part("rods", _rod_elements(mechanism), is_measured=True),
            Part("efforts", _effort_elements(mechanism), is_measured=True),
            Part("is_stable", (_STABILITY_ELEMENT,)),
            Part("margins", _MARGIN_ELEMENTS),
        )
    )
    starts = [layout[part.name].start for part in layout.parts[1:]]
    assert (*starts, len(layout.elements)) == feature_columns(mechanism.leg_table, mechanism.dof)
    return layout


def observation_elements(mechanism: Mechanism) -> tuple[Element, ...]:
    """Return the elements of the observation of a mechanism, in the order in which the kernels fill them.

    Notes
    -----
    All are of order one and continuous in the state, chart seams of the rods' parameters included: the modulus k and
    the direction psi of the force are given as the load at the tip and at the clamp, the mode as a number that grows
    through the modes. The load of a rod is rho = L sqrt(R / EI), with the force R at its tip, and w its part in the
    elements. The eigenvalue s is dimensionless (EI = L = 1), the distance d in rad and mean rod lengths.
    """
    return feature_layout(instance_of("mechanism", mechanism, Mechanism)).elements


def load_elements(mechanism: Mechanism) -> tuple[Element, ...]:
    """Return the elements that tell a load drawn from a box."""
    names = ("force along x", "force along y", "moment")[: mechanism.dof]
    return tuple(
        Element(f"load_{n}", f"{name} on the end-effector within its range", "half range", -1.0, 1.0)
        for n, name in enumerate(names, start=1)
    )


def command_elements(mechanism: Mechanism) -> tuple[Element, ...]:
    """Return the elements that tell what the actuators have been told, where they do not follow at once."""
    return tuple(
        Element(f"command_{n}", f"commanded position of actuator {n} within its limits", "half range", -1.0, 1.0)
        for n in range(1, mechanism.leg_count + 1)
    )


def pose_elements(mechanism: Mechanism, suffix: str = "", what: str = " of the end-effector") -> tuple[Element, ...]:
    """Return the elements that tell a pose."""
    reach = pose_reach(mechanism)
    elements = [
        Element(f"x{suffix}", f"position{what} along x", "mean rod length", -reach, reach),
        Element(f"y{suffix}", f"position{what} along y", "mean rod length", -reach, reach),
    ]
    if mechanism.dof == 3:
        elements.append(Element(f"cos_phi{suffix}", f"cosine of the angle{what}", "1", -1.0, 1.0))
        elements.append(Element(f"sin_phi{suffix}", f"sine of the angle{what}", "1", -1.0, 1.0))
    return tuple(elements)


def input_elements(mechanism: Mechanism, suffix: str = "", what: str = "") -> tuple[Element, ...]:
    """Return the elements that tell the inputs as they are."""
    bounds = zip(mechanism.legs, *mechanism.kernel_limits, strict=True)
    return tuple(
        Element(
            f"input_{n}{suffix}",
            f"input of actuator {n}{what}",
            "rad" if leg.actuator.is_angle else "mean rod length",
            float(low),
            float(high),
        )
        for n, (leg, low, high) in enumerate(bounds, start=1)
    )


def _clamp_elements(mechanism: Mechanism) -> tuple[Element, ...]:
    elements = []
    for n, leg in enumerate(mechanism.legs, start=1):
        elements.append(Element(f"input_{n}", f"position of actuator {n} within its limits", "half range", -1.0, 1.0))
        if leg.actuator.is_angle:
            elements.append(Element(f"cos_clamp_{n}", f"cosine of the angle of clamp {n}", "1", -1.0, 1.0))
            elements.append(Element(f"sin_clamp_{n}", f"sine of the angle of clamp {n}", "1", -1.0, 1.0))
    return tuple(elements)


def _rod_elements(mechanism: Mechanism) -> tuple[Element, ...]:
    w = f"w = rho^2 / ({LOAD_SCALE:g} + rho^2)"
    return tuple(
        element
        for n in range(1, mechanism.leg_count + 1)
        for element in (
            Element(f"tip_load_along_{n}", f"force on rod {n} along its tip, w (2 k^2 - 1), {w}", "1", -1.0, 1.0),
            Element(f"tip_load_across_{n}", f"force on rod {n} across its tip", "1", -1.0, 1.0),
            Element(f"clamp_load_along_{n}", f"force on rod {n} along its clamp, w cos(psi)", "1", -1.0, 1.0),
            Element(f"clamp_load_across_{n}", f"force on rod {n} across its clamp, w sin(psi)", "1", -1.0, 1.0),
            Element(f"mode_{n}", f"p / (1 + p), buckling mode of rod {n} = 1 + integer part of p", "1", 0.0, 1.0),
        )
    )


def pose_reach(mechanism: Mechanism) -> float:
    """Return a bound on |x| and |y| of the end-effector, in mean rod lengths: no rod is longer than stretched."""
    reach = math.inf
    for leg in mechanism.legs:
        actuator = leg.actuator
        travel = 0.0 if actuator.is_angle else max(abs(limit) for limit in actuator.limits)
        own = math.hypot(*actuator.base) + travel + leg.rod.length + math.hypot(*leg.attachment)
        reach = min(reach, own)
    return reach / mechanism.units.length


def _effort_elements(mechanism: Mechanism) -> tuple[Element, ...]:
    """Return the elements that tell what the actuators give."""
    scale = f"t / ({LOAD_SCALE:g} + |t|)"
    return tuple(
        Element(f"effort_{n}", f"{scale}, t = {what} of actuator {n}, dimensionless", "1", -1.0, 1.0)
        for n, what in enumerate(("torque" if leg.actuator.is_angle else "force" for leg in mechanism.legs), start=1)
    )


def box_of(elements: Sequence[Element]) -> spaces.Box:
    """Return the space of elements, (elements,), float64."""
    return spaces.Box(
        np.array([element.low for element in elements]),
        np.array([element.high for element in elements]),
        dtype=np.float64,
    )
