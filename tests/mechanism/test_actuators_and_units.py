"""Actuators tell by their properties what the kernels make of them; units lead into the kernels and out again."""

import math

import numpy as np
import pytest

from pcm_gym.kernels.statics.closure import make_workspace, set_inputs
from pcm_gym.mechanism import Prismatic, Revolute
from tests.reference.mechanisms import FAMILIES, random_mechanism


@pytest.mark.parametrize("family", FAMILIES)
def test_clamps_are_where_the_kernels_place_them(family: str) -> None:
    rng = np.random.default_rng(7)
    for _ in range(20):
        mechanism = random_mechanism(family, rng)
        inputs = rng.uniform(mechanism.lower_limits, mechanism.upper_limits)
        work = make_workspace(mechanism.leg_count, mechanism.state_size)
        set_inputs(mechanism.leg_table, mechanism.units.kernel_from_inputs(inputs), work)
        for leg, value, clamp in zip(mechanism.legs, inputs.tolist(), work.clamps, strict=True):
            angle = leg.actuator.clamp_direction(value)
            point = np.array(leg.actuator.clamp_point(value)) / mechanism.units.length
            expected = [*point, math.cos(angle), math.sin(angle)]
            np.testing.assert_allclose(clamp, expected, rtol=0.0, atol=1e-13)


def test_input_is_an_angle_with_a_period_or_a_distance_along_a_rail() -> None:
    motor, slider = Revolute((1.0, 2.0)), Prismatic((1.0, 2.0), axis_angle=0.3, clamp_angle=0.1)
    assert (motor.is_angle, motor.unit, motor.period, motor.axis, motor.rail_angle) == (
        True,
        "rad",
        2.0 * math.pi,
        (0.0, 0.0),
        None,
    )
    assert (slider.is_angle, slider.unit, slider.period, slider.rail_angle) == (False, "m", 0.0, 0.3)
    assert slider.axis == (math.cos(0.3), math.sin(0.3))


@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize("shape", [(), (4,), (2, 3)])
def test_ways_into_the_kernels_and_out_are_inverse(family: str, shape: tuple[int, ...]) -> None:
    rng = np.random.default_rng(3)
    mechanism = random_mechanism(family, rng)
    units = mechanism.units
    for out, into, factors in (
        (units.inputs_from_kernel, units.kernel_from_inputs, units.inputs),
        (units.pose_from_kernel, units.kernel_from_pose, units.pose),
        (units.load_from_kernel, units.kernel_from_load, units.load),
    ):
        values = rng.normal(size=(*shape, len(factors)))
        before = values.copy()
        np.testing.assert_allclose(into(out(values)), values, rtol=1e-15)
        np.testing.assert_array_equal(out(np.ones(len(factors))), factors)
        np.testing.assert_array_equal(values, before)


@pytest.mark.parametrize("family", FAMILIES)
def test_limits_of_the_kernels_are_those_of_the_leg_table(family: str) -> None:
    mechanism = random_mechanism(family, np.random.default_rng(4))
    np.testing.assert_array_equal(np.column_stack(mechanism.kernel_limits), mechanism.leg_table[:, -2:])
