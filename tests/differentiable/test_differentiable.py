"""Differentiable steps: gradients against differences of tracked equilibria, identities of mechanics, and events."""

import subprocess
import sys
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import pcm_gym
from pcm_gym.arrays import Array
from pcm_gym.solving import BranchTracker, Equilibrium, Event

torch = pytest.importorskip("torch")

from pcm_gym import differentiable  # noqa: E402 (which needs torch)

NAMES = ("2RFR", "2PFR", "3PFR")
TOLD = ("pose", "rod_forces", "actuator_forces", "stability_margin")
_WRONG: Any = [0.0, 0.0]
LOADS = {"2RFR": (0.25, -0.5), "2PFR": (0.5, -0.25), "3PFR": (0.125, -0.25, 0.05)}
# Places and weights of a first difference of fourth order, times 12 widths.
STENCIL = ((-2.0, 1.0), (-1.0, -8.0), (1.0, 8.0), (2.0, -1.0))


def some_states(name: str, count: int, seed: int = 0) -> list[Equilibrium]:
    """Stable states around home, under a load, outside 1e-3 of a fold."""
    mechanism, generator = pcm_gym.get_mechanism(name), np.random.default_rng(seed)
    home = pcm_gym.home_equilibrium(mechanism)
    found: list[Equilibrium] = []
    load = np.array(LOADS[name]) * mechanism.units.load
    while len(found) < count:
        away = generator.uniform(-0.2, 0.2, mechanism.leg_count) * mechanism.units.inputs
        step = BranchTracker(mechanism, home).step(home.inputs + away, load)
        if step.event is Event.NONE and step.equilibrium.singularity_margin > 1e-3:
            found.append(step.equilibrium)
    return found


def told_by(equilibrium: Equilibrium) -> dict[str, Array]:
    return {
        "pose": equilibrium.pose,
        "rod_forces": np.array([rod.force for rod in equilibrium.rods]),
        "actuator_forces": equilibrium.actuator_forces,
        "stability_margin": np.array(equilibrium.stability_margin),
    }


def by_differences(equilibrium: Equilibrium, direction: Array, weights: dict[str, Array]) -> float:
    """Derivative of a weighted sum along a direction of the inputs, through the tracker."""
    mechanism, total = equilibrium.mechanism, 0.0
    width = 4e-4 * min(equilibrium.singularity_margin, 0.1)
    for place, weight in STENCIL:
        target = equilibrium.inputs + place * width * direction * mechanism.units.inputs
        step = BranchTracker(mechanism, equilibrium).step(target)
        assert step.event is Event.NONE
        told = told_by(step.equilibrium)
        total += weight * sum(float((weights[key] * told[key]).sum()) for key in told)
    return total / (12.0 * width)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("part", TOLD)
def test_gradients_are_differences_of_tracked_equilibria(name: str, part: str) -> None:
    """Each row along a direction of its own; the step leads to where the differences are taken, from elsewhere."""
    states, generator = some_states(name, 40), np.random.default_rng(1)
    mechanism = states[0].mechanism
    inputs = np.array([own.inputs for own in states])
    back = generator.uniform(-0.01, 0.01, inputs.shape) * mechanism.units.inputs
    begun = differentiable.advance(differentiable.start(states), torch.from_numpy(-back))
    increments = torch.tensor(back, requires_grad=True)
    reached = differentiable.advance(begun, increments)
    compared = 0
    weights = generator.normal(size=tuple(getattr(reached, part).shape))
    (getattr(reached, part) * torch.from_numpy(weights)).sum().backward()
    gradients = increments.grad.numpy()
    for row, own in enumerate(states):
        if not (begun.is_trusted[row] and reached.is_trusted[row]):
            continue
        compared += 1
        direction = generator.normal(size=mechanism.leg_count)
        chosen = {key: np.zeros_like(value) for key, value in told_by(own).items()} | {part: weights[row]}
        expected = by_differences(own, direction, chosen)
        scale = np.abs(gradients[row] * mechanism.units.inputs).sum() * np.abs(direction).sum()
        found = float(gradients[row] @ (direction * mechanism.units.inputs))
        assert found == pytest.approx(expected, abs=1e-6 * scale)
    assert compared >= 30


@pytest.mark.parametrize("name", NAMES)
def test_what_is_told_is_what_the_equilibrium_tells(name: str) -> None:
    begun = differentiable.start(some_states(name, 5))
    reached = differentiable.advance(begun, torch.full(tuple(begun.inputs.shape), 0.003, dtype=torch.float64))
    for states in (begun, reached):
        for row in range(5):
            own = states.equilibrium(row)
            for key, expected in told_by(own).items():
                scale = np.abs(expected).max() + 1e-12
                assert getattr(states, key)[row].numpy() == pytest.approx(expected, rel=1e-12, abs=1e-12 * scale)
            assert states.singularity_margin[row].item() == pytest.approx(own.singularity_margin, rel=1e-6)
            assert own.residual < 1e-11


def jacobian(states: differentiable.BranchStates, part: str) -> Array:
    """Derivatives of a part of one row by its inputs, last axis, by one step that goes nowhere."""

    def told(increments):
        return getattr(differentiable.advance(states, increments), part)[0]

    return torch.autograd.functional.jacobian(told, torch.zeros_like(states.inputs))[..., 0, :].numpy()


@pytest.mark.parametrize("name", NAMES)
def test_gradients_keep_to_the_laws_of_mechanics(name: str) -> None:
    """The pose's are the motion's Jacobian; what actuators give is the energy's gradient, and reciprocal (Maxwell)."""
    (own,) = some_states(name, 1, seed=3)
    states, units = differentiable.start([own]), own.mechanism.units
    assert jacobian(states, "pose") == pytest.approx(own.forward_jacobian, rel=1e-9)
    efforts = jacobian(states, "actuator_forces") * np.outer(units.inputs, units.inputs) / units.energy
    assert efforts == pytest.approx(efforts.T, rel=1e-9)
    # the forces of the rods balance the load, which is constant
    forces = jacobian(states, "rod_forces")
    assert np.abs(forces.sum(axis=0)).max() < 1e-9 * np.abs(forces).max()


def test_gradients_flow_through_many_steps_as_through_their_sum() -> None:
    begun = differentiable.start(some_states("2RFR", 8))
    increments = [torch.full((8, 2), 0.004, dtype=torch.float64, requires_grad=True) for _ in range(5)]
    states = begun
    for own in increments:
        states = differentiable.advance(states, own)
    states.pose.square().sum().backward()
    together = torch.full((8, 2), 0.02, dtype=torch.float64, requires_grad=True)
    differentiable.advance(begun, together).pose.square().sum().backward()
    for own in increments:
        assert own.grad.numpy() == pytest.approx(together.grad.numpy(), rel=1e-9)


def test_gradients_end_where_states_are_detached() -> None:
    first = torch.full((3, 2), 0.01, dtype=torch.float64, requires_grad=True)
    second = torch.full((3, 2), 0.01, dtype=torch.float64, requires_grad=True)
    states = differentiable.advance(differentiable.start(some_states("2RFR", 3)), first).detach()
    differentiable.advance(states, second).pose.sum().backward()
    assert first.grad is None
    assert second.grad is not None


def test_no_gradient_flows_through_a_component_that_a_limit_cuts() -> None:
    (own,) = some_states("2RFR", 1)
    upper = own.mechanism.upper_limits
    near = BranchTracker(own.mechanism, own)
    for part in np.linspace(0.0, 1.0, 20):
        step = near.step([own.inputs[0] + part * (upper[0] - 0.01 - own.inputs[0]), own.inputs[1]])
        if step.event is not Event.NONE:
            pytest.skip("the branch ends before the limit")
    increments = torch.tensor([[0.05, 0.01]], dtype=torch.float64, requires_grad=True)
    states = differentiable.advance(differentiable.start([near.equilibrium]), increments)
    assert Event(int(states.events[0])) is Event.ACTUATOR_LIMIT
    assert states.inputs[0, 0].item() == upper[0]
    assert not states.is_trusted[0]
    states.pose.sum().backward()
    assert increments.grad[0, 0] == 0.0
    assert increments.grad[0, 1] != 0.0


def test_a_row_that_would_snap_stays_and_passes_no_gradient_while_the_others_go_on() -> None:
    home = pcm_gym.home_equilibrium(pcm_gym.get_mechanism("2RFR-paper"))
    fold = BranchTracker(home.mechanism, home).step(home.inputs + 2.5)
    assert fold.event is Event.FOLD
    states = differentiable.start([fold.equilibrium, home])
    increments = torch.full((2, 2), 0.05, dtype=torch.float64, requires_grad=True)
    after = differentiable.advance(states, increments)
    assert [Event(int(code)) for code in after.events] == [Event.FOLD, Event.NONE]
    assert after.is_trusted.tolist() == [False, True]
    assert torch.equal(after.inputs[0], states.inputs[0])
    (after.pose.sum() + after.inputs.sum()).backward()
    assert increments.grad[0].tolist() == [0.0, 0.0]
    alone = torch.full((1, 2), 0.05, dtype=torch.float64, requires_grad=True)
    lone = differentiable.advance(differentiable.start([home]), alone)
    (lone.pose.sum() + lone.inputs.sum()).backward()
    assert torch.equal(lone.pose[0], after.pose[1])
    assert torch.equal(alone.grad[0], increments.grad[1])


def test_increments_may_be_of_any_layout_and_floating_point_type() -> None:
    states = differentiable.start(some_states("2RFR", 4))
    plain = torch.linspace(-0.01, 0.01, 8, dtype=torch.float64).reshape(4, 2)
    expected = differentiable.advance(states, plain)
    flipped = plain.t().contiguous().t().requires_grad_()
    found = differentiable.advance(states, flipped)
    assert torch.equal(found.pose, expected.pose)
    found.pose.t().sum().backward()
    single = plain.float().requires_grad_()
    differentiable.advance(states, single).pose.sum().backward()
    assert single.grad.dtype == torch.float32
    assert single.grad.numpy() == pytest.approx(flipped.grad.numpy(), rel=1e-5)


def test_second_derivatives_are_refused() -> None:
    increments = torch.zeros((1, 2), dtype=torch.float64, requires_grad=True)
    states = differentiable.advance(differentiable.start(some_states("2RFR", 1)), increments)
    (gradient,) = torch.autograd.grad(states.pose.square().sum(), increments, create_graph=True)
    with pytest.raises(RuntimeError, match="once_differentiable"):
        gradient.sum().backward()


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda own: differentiable.start([]), "equilibria must be one at least"),
        (lambda own: differentiable.start(_WRONG[:1]), "equilibria must be a sequence of Equilibrium"),
        (lambda own: differentiable.advance(own, _WRONG), "increments must be a Tensor"),
        (lambda own: differentiable.advance(own, torch.zeros((1, 2), dtype=torch.int64)), "floating-point"),
        (lambda own: differentiable.advance(own, torch.zeros((2, 2))), r"increments must have shape \(1, 2\)"),
        (lambda own: differentiable.advance(own, torch.full((1, 2), torch.nan)), "increments must be finite"),
        (lambda own: differentiable.advance(_WRONG, torch.zeros((1, 2))), "states must be a BranchStates"),
        (lambda own: own.equilibrium(1), "row must be at most 0"),
    ],
)
def test_wrong_arguments_are_refused_in_words(
    call: Callable[[differentiable.BranchStates], object], message: str
) -> None:
    states = differentiable.start(some_states("2RFR", 1))
    with pytest.raises((TypeError, ValueError), match=message):
        call(states)


def test_states_of_two_mechanisms_are_refused() -> None:
    with pytest.raises(ValueError, match="equilibria must all be of '2RFR'"):
        differentiable.start(some_states("2RFR", 1) + some_states("2PFR", 1))


def test_without_torch_a_sentence_says_what_to_install() -> None:
    code = "import sys; sys.modules['torch'] = None\nimport pcm_gym\npcm_gym.differentiable"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert "pip install 'pcm_gym[differentiable]'" in done.stderr.splitlines()[-1]
