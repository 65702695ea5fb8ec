"""Derivatives by the inputs in lanes: the scalar ones, row by row, also where lanes are too near to poles."""

import numpy as np
import pytest

import pcm_gym
from pcm_gym.kernels.lockstep.lanes_gradient import pull_back_in_lanes
from pcm_gym.kernels.statics.sensitivity import CLAMP_TURN, CLAMP_X, CLAMP_Y, EFFECTS, Quantities, pull_back
from pcm_gym.kernels.statics.states import States


def walked(name: str, count: int) -> tuple[pcm_gym.Mechanism, States]:
    """Stable states that random walks from home come to."""
    mechanism, generator = pcm_gym.get_mechanism(name), np.random.default_rng(2)
    tracker = pcm_gym.BranchTracker(mechanism, pcm_gym.home_equilibrium(mechanism))
    values = []
    for _ in range(count):
        away = generator.uniform(-0.05, 0.05, mechanism.leg_count) * mechanism.units.inputs
        values.append(tracker.step(tracker.equilibrium.inputs + away).equilibrium.kernel_values())
    return mechanism, States(*(np.array(own) for own in zip(*values, strict=True)))


@pytest.mark.parametrize("with_margin", [False, True])
@pytest.mark.parametrize("name", ["2RFR", "2PFR", "3PFR"])
def test_lanes_tell_what_the_scalar_code_tells(name: str, with_margin: bool) -> None:
    mechanism, states = walked(name, 70)
    states.x[3, :2] = 0.0  # a straight rod, where the stiffness has a pole: not in lanes
    n, legs, generator = 70, mechanism.leg_count, np.random.default_rng(4)
    weights = Quantities(
        *(generator.normal(size=shape) for shape in ((n, mechanism.dof), (n, legs, 2), (n, legs), (n,)))
    )
    effects = np.zeros((legs, legs, EFFECTS))
    for i, leg in enumerate(mechanism.legs):
        effects[i, i, [CLAMP_X, CLAMP_Y]], effects[i, i, CLAMP_TURN] = leg.actuator.axis, leg.actuator.is_angle
    alone, in_lanes = np.empty((n, legs)), np.empty((n, legs))
    pull_back(mechanism.leg_table, states.x, states.inputs, effects, weights, with_margin, alone)
    pull_back_in_lanes(mechanism.leg_table, states, effects, weights, with_margin, in_lanes)
    scale = np.abs(alone).max(axis=1, keepdims=True)
    assert np.array_equal(in_lanes[3], alone[3], equal_nan=True)
    rest = np.delete(np.arange(n), 3)
    assert np.isfinite(alone[rest]).all()
    assert np.abs((in_lanes - alone)[rest] / scale[rest]).max() < 1e-8
