"""Better designs: what is said of them is so, and no neighbour within the bounds is better."""

from typing import Any

import numpy as np
import pytest

import pcm_gym
from pcm_gym.arrays import Array

PARAMETERS = [pcm_gym.DesignParameter("length", 0), pcm_gym.DesignParameter("base_y", 1)]


def asked(name: str) -> tuple[pcm_gym.Mechanism, Array, Array]:
    """A mechanism, bounds about its parameters, and inputs beside home."""
    mechanism = pcm_gym.get_mechanism(name)
    values = np.array([own.value(mechanism) for own in PARAMETERS])
    width = 0.05 * mechanism.units.length
    beside = 0.05 * np.array([[0.0] * mechanism.leg_count, [1.0] * mechanism.leg_count]) * mechanism.units.inputs
    return mechanism, np.column_stack([values - width, values + width]), np.array(mechanism.home_inputs) + beside


def worst(mechanism: pcm_gym.Mechanism, objective: str, inputs: Array) -> float:
    """The objective of a design, by the tracker from its own home; less is worse."""
    tracker = pcm_gym.BranchTracker(mechanism, pcm_gym.home_equilibrium(mechanism))
    found = [tracker.step(own).equilibrium for own in inputs]
    if objective == "margin":
        return min(own.stability_margin for own in found)
    units = mechanism.units
    return -max(float(np.abs(own.actuator_forces * units.inputs / units.energy).max()) for own in found)


@pytest.mark.parametrize("objective", ["margin", "torque"])
@pytest.mark.parametrize("name", ["2RFR", "3PFR"])
def test_no_neighbour_of_the_optimum_is_better(name: str, objective: Any) -> None:
    mechanism, bounds, inputs = asked(name)
    found = pcm_gym.optimise_design(mechanism, objective, PARAMETERS, bounds, inputs=inputs)
    sign = 1.0 if objective == "margin" else -1.0
    assert sign * found.after >= sign * found.before
    if name == "2RFR":  # of the platform two legs alone cannot lower what the third must give
        assert found.after != found.before
    assert worst(mechanism, objective, inputs) == pytest.approx(sign * found.before, rel=1e-8)
    best = worst(found.mechanism, objective, inputs)
    assert best == pytest.approx(sign * found.after, rel=1e-8)
    width = np.ptp(bounds, axis=1)
    for direction in np.random.default_rng(0).normal(size=(12, 2)):
        values = np.clip(found.values + 0.05 * direction * width, *bounds.T)
        neighbour = pcm_gym.change_design(mechanism, PARAMETERS, values)
        assert worst(neighbour, objective, inputs) <= best + 1e-6 * abs(best)


def test_workspace_grows_and_is_the_area_that_the_roadmap_covers() -> None:
    mechanism = pcm_gym.get_mechanism("2PFR")
    parameters = [pcm_gym.DesignParameter("base_y", 1)]
    value, width = parameters[0].value(mechanism), 0.1 * mechanism.units.length
    found = pcm_gym.optimise_design(
        mechanism, "workspace", parameters, [[value - width, value + width]], most_evaluations=8
    )
    assert found.after >= found.before > 0.0
    assert found.evaluations <= 9
    home = pcm_gym.home_equilibrium(mechanism)
    roadmap = pcm_gym.build_roadmap(mechanism, [home], least_margin=0.05)
    own = roadmap.components == roadmap.components[roadmap.seeds[0]]
    # by the corners' poses: each node's cell as the parallelogram that its Jacobian makes of it
    areas = [
        abs(np.linalg.det(roadmap.equilibrium(int(node)).forward_jacobian)) * np.prod(roadmap.raster.pitch)
        for node in np.flatnonzero(own)
    ]
    assert found.before == pytest.approx(sum(areas), rel=1e-9)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"objective": "beauty"}, "objective must be one of"),
        ({"bounds": [[0.0, 1.0]]}, "bounds must have shape"),
        ({"bounds": [[2.0, 3.0], [-1.0, 1.0]]}, "bounds must be lower < upper about length of leg 0"),
        ({"bounds": [[0.0, 3.0], [-1.0, 1.0]]}, "bounds must be greater than 0 for length of leg 0"),
        ({"objective": "workspace", "inputs": [[0.0, 0.0]]}, "inputs must be left out"),
        ({"inputs": np.empty((0, 2))}, "inputs must be one place at least"),
        ({"most_evaluations": 0}, "most_evaluations must be at least 1"),
    ],
)
def test_wrong_arguments_are_refused_in_words(changes: dict[str, Any], message: str) -> None:
    mechanism = pcm_gym.get_mechanism("2RFR")
    length = PARAMETERS[0].value(mechanism)
    given: dict[str, Any] = {"objective": "margin", "bounds": [[0.5 * length, 1.5 * length], [-1.0, 1.0]]} | changes
    with pytest.raises((TypeError, ValueError), match=message):
        pcm_gym.optimise_design(mechanism, given.pop("objective"), PARAMETERS, given.pop("bounds"), **given)
