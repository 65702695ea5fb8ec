"""Every wrong argument is refused with an error that names the argument, its value and what is allowed."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from pcm_gym.mechanism import Leg, Mechanism, Prismatic, Revolute, Rod, get_mechanism
from pcm_gym.solving import Equilibrium

LEG = Leg(Revolute((0.0, 0.0)))
PLATFORM = tuple(Leg(Revolute((x, 0.0)), attachment=(0.1 * x, 0.0)) for x in (-1.0, 0.0, 1.0))


def mechanism(**changed: Any) -> Mechanism:
    return Mechanism(**{"name": "mine", "legs": (LEG, LEG), **changed})


def prismatic(**changed: Any) -> Prismatic:
    return Prismatic(**{"base": (0.0, 0.0), "axis_angle": 0.0, "clamp_angle": 0.0, **changed})


def revolute(**changed: Any) -> Revolute:
    return Revolute(**{"base": (0.0, 0.0), **changed})


def leg(**changed: Any) -> Leg:
    return Leg(**{"actuator": revolute(), **changed})


# what is built, its argument, the bad value, the error, and what its message must say:
# what is allowed, and what was given
WRONG = [
    (Rod, "length", 0.0, ValueError, "greater than 0", "0.0"),
    (Rod, "length", -1.0, ValueError, "greater than 0", "-1.0"),
    (Rod, "length", math.nan, ValueError, "finite", "nan"),
    (Rod, "length", math.inf, ValueError, "finite", "inf"),
    (Rod, "length", "long", TypeError, "number", "'long'"),
    (Rod, "length", None, TypeError, "number", "None"),
    (Rod, "length", [1.0, 2.0], TypeError, "number", "[1.0, 2.0]"),
    (Rod, "bending_stiffness", 0.0, ValueError, "greater than 0", "0.0"),
    (Rod, "bending_stiffness", -0.1, ValueError, "greater than 0", "-0.1"),
    (Rod, "bending_stiffness", math.nan, ValueError, "finite", "nan"),
    (Rod, "bending_stiffness", "stiff", TypeError, "number", "'stiff'"),
    (revolute, "base", (0.0,), ValueError, "shape (2,)", "0.0"),
    (revolute, "base", (0.0, 0.0, 0.0), ValueError, "shape (2,)", "0.0"),
    (revolute, "base", (0.0, math.nan), ValueError, "finite", "nan"),
    (revolute, "base", "here", TypeError, "2 numbers", "'here'"),
    (revolute, "base", 1.0, ValueError, "shape (2,)", "1.0"),
    (revolute, "clamp_angle", math.inf, ValueError, "finite", "inf"),
    (revolute, "clamp_angle", "up", TypeError, "number", "'up'"),
    (revolute, "limits", (1.0, 1.0), ValueError, "lower < upper", "1.0"),
    (revolute, "limits", (1.0, -1.0), ValueError, "lower < upper", "1.0"),
    (revolute, "limits", (-1.0,), ValueError, "shape (2,)", "-1.0"),
    (revolute, "limits", (-math.inf, 1.0), ValueError, "finite", "1.0"),
    (prismatic, "base", (math.inf, 0.0), ValueError, "finite", "0.0"),
    (prismatic, "axis_angle", math.nan, ValueError, "finite", "nan"),
    (prismatic, "axis_angle", "x", TypeError, "number", "'x'"),
    (prismatic, "clamp_angle", math.nan, ValueError, "finite", "nan"),
    (prismatic, "limits", (0.5, -0.5), ValueError, "lower < upper", "0.5"),
    (leg, "actuator", 1.0, TypeError, "Revolute or a Prismatic", "1.0"),
    (leg, "rod", 1.0, TypeError, "a Rod", "1.0"),
    (leg, "attachment", (0.0,), ValueError, "shape (2,)", "0.0"),
    (leg, "attachment", (0.0, math.nan), ValueError, "finite", "nan"),
    (mechanism, "legs", (LEG, 1.0), TypeError, "sequence of Leg", "1.0"),
    (mechanism, "legs", (), ValueError, "2 (point end-effector) or 3 (platform)", "got 0"),
    (mechanism, "legs", (LEG,), ValueError, "2 (point end-effector) or 3 (platform)", "got 1"),
    (mechanism, "legs", (LEG,) * 4, ValueError, "2 (point end-effector) or 3 (platform)", "got 4"),
    (mechanism, "legs", (LEG, PLATFORM[0]), ValueError, "(0, 0)", "(-0.1, 0.0)"),
    (mechanism, "legs", (LEG, LEG, LEG), ValueError, "must not all coincide", "(0.0, 0.0)"),
    (mechanism, "home_inputs", (0.0,), ValueError, "shape (2,)", "0.0"),
    (mechanism, "home_inputs", (0.0, math.nan), ValueError, "finite", "nan"),
    (mechanism, "home_inputs", (0.0, 4.0), ValueError, "within the limits", "4.0"),
    (mechanism, "home_pose", (0.0, 0.0, 0.0), ValueError, "shape (2,)", "0.0"),
    (mechanism, "home_pose", (0.0, math.inf), ValueError, "finite", "inf"),
    (get_mechanism, "name", "4RFR", ValueError, "['2RFR', '2PFR', '3PFR', ", "'4RFR'"),
]


@pytest.mark.parametrize(("make", "argument", "value", "error", "allowed", "shown"), WRONG)
def test_error_names_argument_value_and_what_is_allowed(
    make: Callable[..., Any], argument: str, value: Any, error: type[Exception], allowed: str, shown: str
) -> None:
    with pytest.raises(error) as caught:
        make(**{argument: value})
    message = str(caught.value)
    assert argument in message or (argument == "legs" and "attachments" in message)
    assert allowed in message
    assert shown in message


def test_home_inputs_default_to_the_middle_of_the_limits() -> None:
    limits = ((-1.0, 3.0), (0.0, 0.5))
    legs = tuple(Leg(Revolute((0.0, 0.0), limits=pair)) for pair in limits)
    assert Mechanism("mine", legs).home_inputs == (1.0, 0.25)


@pytest.mark.parametrize(
    ("method", "value", "message"),
    [
        ("check_inputs", [0.0], r"inputs must have shape \(2,\)"),
        ("check_inputs", [0.0, math.nan], "inputs must be finite"),
        ("check_inputs", "ab", "inputs must be 2 numbers"),
        ("check_pose", [0.0, 0.0, 0.0], r"pose must have shape \(2,\)"),
        ("check_load", [0.0, 0.0, 1.0], r"load must have shape \(2,\)"),
        ("check_load", [math.inf, 0.0], "load must be finite"),
    ],
)
def test_arguments_of_solvers_are_checked(method: str, value: Any, message: str) -> None:
    with pytest.raises((ValueError, TypeError), match=message):
        getattr(get_mechanism("2RFR"), method)(value)


def test_load_may_lack_its_moment() -> None:
    np.testing.assert_array_equal(get_mechanism("3PFR").check_load([1.0, 2.0]), [1.0, 2.0, 0.0])
    np.testing.assert_array_equal(get_mechanism("3PFR").check_load(None), np.zeros(3))
    np.testing.assert_array_equal(get_mechanism("2PFR").check_load([1.0, 2.0]), [1.0, 2.0])


def test_checked_arrays_are_copies() -> None:
    inputs = np.array([0.1, 0.2])
    checked = get_mechanism("2RFR").check_inputs(inputs)
    checked[0] = 9.0
    assert inputs[0] == 0.1


@pytest.mark.parametrize("points", [1, 0, -3])
def test_shape_needs_two_points(points: int) -> None:
    equilibrium = Equilibrium(get_mechanism("2PFR"), np.zeros(6), np.zeros(2), np.zeros(2))
    with pytest.raises(ValueError, match=f"points must be at least 2, got {points}"):
        equilibrium.shape(points)
