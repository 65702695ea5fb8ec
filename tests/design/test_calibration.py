"""Calibration: what measurements were made with is found again, as surely as its standard errors say."""

from typing import Any

import numpy as np
import pytest

import pcm_gym
from pcm_gym.arrays import Array
from pcm_gym.solving import BranchTracker, Event

PARAMETERS = {
    "2RFR": [("length", 0), ("clamp_angle", 1), ("base_x", 0)],
    "2PFR": [("length", 1), ("axis_angle", 0), ("bending_stiffness", 0)],
    "3PFR": [("length", 0), ("clamp_angle", 1), ("attachment_x", 2)],
}


def parameters_of(name: str) -> list[pcm_gym.DesignParameter]:
    return [pcm_gym.DesignParameter(*own) for own in PARAMETERS[name]]


def true_design(name: str, generator: np.random.Generator) -> tuple[pcm_gym.Mechanism, Array]:
    mechanism, values = pcm_gym.get_mechanism(name), []
    for own in parameters_of(name):
        value, unit = own.value(mechanism), mechanism.units.length
        size = value if own.is_positive else (1.0 if own.name.endswith("angle") else unit)
        values.append(value + generator.uniform(-0.02, 0.02) * size)
    return pcm_gym.change_design(mechanism, parameters_of(name), values), np.array(values)


def measured(
    mechanism: pcm_gym.Mechanism, count: int, generator: np.random.Generator, deviation: float
) -> tuple[Array, Array]:
    """Inputs in a row without a fall, and poses with errors, in lengths and rad."""
    home, units = pcm_gym.home_equilibrium(mechanism), mechanism.units
    tracker = BranchTracker(mechanism, home)
    inputs: list[Array] = []
    poses: list[Array] = []
    while len(inputs) < count:
        target = home.inputs + generator.uniform(-0.15, 0.15, mechanism.leg_count) * units.inputs
        before = tracker.equilibrium
        step = tracker.step(target)
        if step.event is not Event.NONE:
            tracker = BranchTracker(mechanism, before)
            continue
        inputs.append(target)
        poses.append(step.equilibrium.pose + deviation * generator.normal(size=mechanism.dof) * units.pose)
    return np.array(inputs), np.array(poses)


@pytest.mark.parametrize("name", PARAMETERS)
def test_poses_without_errors_give_the_very_design(name: str) -> None:
    generator = np.random.default_rng(0)
    design, values = true_design(name, generator)
    measurements = pcm_gym.Measurements(*measured(design, 12, generator, 0.0))
    found = pcm_gym.calibrate(pcm_gym.get_mechanism(name), measurements, parameters_of(name))
    assert found.values == pytest.approx(values, rel=1e-7)
    assert np.abs(found.residuals).max() < 1e-9
    assert found.mechanism.legs[0].rod.length == pytest.approx(design.legs[0].rod.length, rel=1e-7)


@pytest.mark.parametrize("is_known", [True, False], ids=["known deviations", "estimated"])
def test_standard_errors_are_those_of_the_estimates(is_known: bool) -> None:
    """Errors over standard errors are normal: their mean square is 1, and 3 are hardly ever exceeded."""
    generator, parameters = np.random.default_rng(1), parameters_of("2RFR")
    nominal, ratios = pcm_gym.get_mechanism("2RFR"), []
    for _ in range(25):
        design, values = true_design("2RFR", generator)
        inputs, poses = measured(design, 15, generator, 1e-4)
        deviations = 1e-4 * nominal.units.pose if is_known else None
        found = pcm_gym.calibrate(nominal, pcm_gym.Measurements(inputs, poses, deviations=deviations), parameters)
        ratios.append((found.values - values) / found.standard_errors)
        assert found.deviations == pytest.approx(1e-4 * nominal.units.pose, rel=0.6)
    # of 75 numbers: six standard deviations of the mean square
    assert np.mean(np.square(ratios)) == pytest.approx(1.0, abs=6.0 * np.sqrt(2.0 / 75.0))
    assert np.mean(np.abs(ratios) < 3.0) >= 0.95


def test_weights_change_the_estimate() -> None:
    """A component that is known to be measured badly counts for little."""
    generator, parameters = np.random.default_rng(2), parameters_of("2RFR")
    design, values = true_design("2RFR", generator)
    inputs, poses = measured(design, 15, generator, 0.0)
    poses[:, 0] += 0.01 * design.units.length * generator.normal(size=15)
    nominal = pcm_gym.get_mechanism("2RFR")
    alike = pcm_gym.calibrate(nominal, pcm_gym.Measurements(inputs, poses), parameters)
    weighted = pcm_gym.Measurements(inputs, poses, deviations=np.array([0.01, 1e-6]) * design.units.length)
    found = pcm_gym.calibrate(nominal, weighted, parameters)
    assert np.abs(found.values - values).max() < 0.05 * np.abs(alike.values - values).max()


def test_stiffnesses_that_unloaded_poses_do_not_tell_are_named() -> None:
    generator = np.random.default_rng(3)
    mechanism = pcm_gym.get_mechanism("2RFR")
    measurements = pcm_gym.Measurements(*measured(mechanism, 10, generator, 1e-4))
    parameters = [pcm_gym.DesignParameter("bending_stiffness", leg) for leg in range(2)]
    with pytest.raises(pcm_gym.DesignError, match="bending_stiffness of leg 0, bending_stiffness of leg 1"):
        pcm_gym.calibrate(mechanism, measurements, parameters)


def test_inputs_that_are_not_reached_are_named() -> None:
    mechanism = pcm_gym.get_mechanism("2RFR-paper")
    home = pcm_gym.home_equilibrium(mechanism)
    measurements = pcm_gym.Measurements(np.stack([home.inputs, home.inputs + 2.5]), np.zeros((2, 2)))
    with pytest.raises(pcm_gym.DesignError, match=r"does not reach inputs\[1\]"):
        pcm_gym.calibrate(mechanism, measurements, [pcm_gym.DesignParameter("length", 0)])


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"inputs": [[0.0] * 3], "poses": [[0.0] * 3]}, "measurements must have inputs of 2 numbers"),
        ({"inputs": [[0.0] * 4]}, "inputs must have shape"),
        ({"poses": [[0.0, 0.0, 0.0]]}, "poses must have shape"),
        ({"poses": [[0.0, 0.0], [0.0, 0.0]]}, "poses must have shape"),
        ({"deviations": [1.0, 0.0]}, "deviations must be greater than 0"),
        ({"load": [1.0]}, "load must have shape"),
        ({"inputs": np.empty((0, 2)), "poses": np.empty((0, 2))}, "one measurement at least"),
        ({}, "measurements must be more numbers than the 2 parameters"),
    ],
)
def test_measurements_that_do_not_fit_are_refused(changes: dict[str, Any], message: str) -> None:
    mechanism = pcm_gym.get_mechanism("2RFR")
    parameters = [pcm_gym.DesignParameter("length", leg) for leg in range(2)]
    given: dict[str, Any] = {"inputs": [mechanism.home_inputs], "poses": np.zeros((1, 2))} | changes
    with pytest.raises((TypeError, ValueError), match=message):
        pcm_gym.calibrate(mechanism, pcm_gym.Measurements(**given), parameters)
