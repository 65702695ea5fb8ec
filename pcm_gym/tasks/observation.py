"""What an agent observes of a state, element by element."""

import math
from dataclasses import dataclass

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from pcm_gym.mechanism import Mechanism, Revolute


@dataclass(frozen=True)
class Element:
    """One element of the observation: its name, meaning, unit and range."""

    name: str
    meaning: str
    unit: str
    low: float
    high: float


def observation_elements(mechanism: Mechanism) -> tuple[Element, ...]:
    """Return the elements of the observation of a mechanism, in the order in which the kernels fill them.

    All are of order one and continuous in the state, chart seams of the paper's rod parameters included: k and psi
    are given as the load at the tip and at the clamp, the mode as a number that grows through the modes.
    """
    elements = _pose_elements(mechanism)
    for n, leg in enumerate(mechanism.legs, start=1):
        elements.append(Element(f"input_{n}", f"position of actuator {n} within its limits", "half range", -1.0, 1.0))
        if isinstance(leg.actuator, Revolute):
            elements.append(Element(f"cos_clamp_{n}", f"cosine of the angle of clamp {n}", "1", -1.0, 1.0))
            elements.append(Element(f"sin_clamp_{n}", f"sine of the angle of clamp {n}", "1", -1.0, 1.0))
    for n in range(1, mechanism.leg_count + 1):
        elements += _rod_elements(n)
    elements += [
        Element("is_stable", "1 while the equilibrium is stable, 0 once stability is lost", "1", 0.0, 1.0),
        Element("stability_margin", "s / (20 + |s|), s = least eigenvalue of the stiffness", "EI = L = 1", -1.0, 1.0),
        Element("singularity_margin", "d / (0.1 + d), d = estimated distance of the nearest fold", "input", 0.0, 1.0),
    ]
    return tuple(elements)


def _pose_elements(mechanism: Mechanism) -> list[Element]:
    reach = pose_reach(mechanism)
    elements = [
        Element("x", "position of the end-effector", "mean rod length", -reach, reach),
        Element("y", "position of the end-effector", "mean rod length", -reach, reach),
    ]
    if mechanism.dof == 3:
        elements.append(Element("cos_phi", "cosine of the platform's angle", "1", -1.0, 1.0))
        elements.append(Element("sin_phi", "sine of the platform's angle", "1", -1.0, 1.0))
    return elements


def _rod_elements(n: int) -> list[Element]:
    load = "rho^2 / (10 + rho^2)"
    return [
        Element(f"tip_load_along_{n}", f"force on rod {n} along its tip, {load} (2 k^2 - 1)", "1", -1.0, 1.0),
        Element(f"tip_load_across_{n}", f"force on rod {n} across its tip", "1", -1.0, 1.0),
        Element(f"clamp_load_along_{n}", f"force on rod {n} along its clamp, {load} cos(psi)", "1", -1.0, 1.0),
        Element(f"clamp_load_across_{n}", f"force on rod {n} across its clamp, {load} sin(psi)", "1", -1.0, 1.0),
        Element(f"mode_{n}", f"p / (1 + p), buckling mode of rod {n} = 1 + integer part of p", "1", 0.0, 1.0),
    ]


def pose_reach(mechanism: Mechanism) -> float:
    """Return a bound on |x| and |y| of the end-effector, in mean rod lengths: no rod is longer than stretched."""
    reach = math.inf
    for leg in mechanism.legs:
        actuator = leg.actuator
        travel = 0.0 if isinstance(actuator, Revolute) else max(abs(limit) for limit in actuator.limits)
        own = math.hypot(*actuator.base) + travel + leg.rod.length + math.hypot(*leg.attachment)
        reach = min(reach, own)
    return reach / mechanism.units.length


def observation_box(mechanism: Mechanism) -> spaces.Box:
    """Return the space of the observation, (elements,), float64."""
    elements = observation_elements(mechanism)
    return spaces.Box(
        np.array([element.low for element in elements]),
        np.array([element.high for element in elements]),
        dtype=np.float64,
    )


def goal_box(mechanism: Mechanism) -> spaces.Box:
    """Return the space of achieved and desired goals: (x, y) in mean rod lengths, a platform's (cos phi, sin phi)."""
    reach = pose_reach(mechanism)
    bounds: NDArray[np.float64] = np.array([reach, reach, 1.0, 1.0][: 2 * (mechanism.dof - 1)])
    return spaces.Box(-bounds, bounds, dtype=np.float64)
