"""Pseudo-arclength continuation: a point lies on the curve and on its plane; changes of sign are closed in on."""

import math

import numpy as np
import pytest

from pcm_gym.arrays import Array
from pcm_gym.kernels.branches import continuation
from pcm_gym.kernels.branches.steps import STEP_RULES
from pcm_gym.kernels.branches.tracer import Bracket, BracketRules, move, narrowed, next_trial, start
from pcm_gym.kernels.numerics.compilation import kernel
from pcm_gym.kernels.statics.closure import make_workspace, set_residual
from pcm_gym.solving import Event
from tests.reference.mechanisms import FAMILIES, home_by_construction


@kernel
def step_along(legs: Array, x: Array, inputs: Array, rate: Array, arc: float) -> Array:
    """Return success, residual, distance from the plane, and length of the tangents, after a step of `arc` from x."""
    leg_count, size = legs.shape[0], x.shape[0]
    line, work = continuation.make_line(leg_count, size), make_workspace(leg_count, size)
    line.first_inputs[:], line.input_rates[0] = inputs, rate
    line.y[:-1], line.border[-1] = x, 1.0
    is_found = start(legs, 1.0, line, work) and move(legs, arc, STEP_RULES, line, work)
    residual = max(set_residual(legs, line.trial[:-1], line.load, work))
    ahead = (line.border * (line.trial - line.y)).sum()
    return np.array([1.0 if is_found else 0.0, residual, ahead - arc, (line.border * line.tangent).sum()])


@pytest.mark.parametrize("family", FAMILIES)
def test_a_point_lies_on_the_curve_and_on_the_plane_across_the_tangent(family: str) -> None:
    home = home_by_construction(family)
    legs, inputs = np.array(home.mechanism.leg_table), home.inputs / home.mechanism.units.inputs
    rate = np.linspace(0.5, 1.0, len(inputs))
    is_found, residual, beside_plane, length = step_along(legs, home.state.copy(), inputs, rate, 0.03)
    assert is_found
    assert residual < 1e-12
    assert abs(beside_plane) < 1e-13
    assert length == pytest.approx(1.0, abs=1e-14)


@pytest.mark.parametrize("weight", [1.0, 0.5])
@pytest.mark.parametrize("root", [1e-6, 0.3, 0.999])
def test_a_bracket_closes_in_on_the_change_of_sign(weight: float, root: float) -> None:
    rules = BracketRules(trials=100, bisect_every=4, least_part=0.01, weight=weight, tolerance=1e-12)
    bracket = Bracket(0.0, -math.expm1(-root), 1.0, -math.expm1(1.0 - root), 0)
    for number in range(rules.trials):
        arc = next_trial(bracket, number, rules)
        assert bracket.low < arc < bracket.high
        bracket = narrowed(bracket, arc, -math.expm1(arc - root), rules)
        assert bracket.low <= root <= bracket.high
        if bracket.high - bracket.low < rules.tolerance:
            return
    pytest.fail(f"the bracket is still {bracket.high - bracket.low:.1e} wide")


def test_events_have_the_numbers_of_the_kernels() -> None:
    assert [getattr(continuation, event.name) for event in Event] == list(Event) == list(range(5))
