"""Steps of many mechanisms at once that torch can differentiate; they need the extra ``differentiable``.

`start` makes states of equilibria, `advance` moves their inputs as an environment's step does: each row's branch is
followed by the same compiled code. What comes out are tensors with gradients. On a branch an equilibrium is a function
of the inputs, so that the gradients follow from the implicit function theorem at where a step ends, in closed form:
nothing is unrolled, and where the step began counts for nothing but the inputs.

A row that would lose stability, or that the solver cannot follow, stays where it is, and no gradient flows through it;
nor through a component of the inputs that an actuator's limit cuts. Gradients of the pose grow like one over the square
root of the distance from a fold: `BranchStates.singularity_margin` stands beside them.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from pcm_gym.arrays import Array, Mask
from pcm_gym.kernels.branches.continuation import ACTUATOR_LIMIT, NONE
from pcm_gym.kernels.lockstep.lanes_gradient import pull_back_in_lanes
from pcm_gym.kernels.snaps.instability import HOLD
from pcm_gym.kernels.statics.sensitivity import CLAMP_TURN, CLAMP_X, CLAMP_Y, EFFECTS, Quantities
from pcm_gym.kernels.statics.states import States
from pcm_gym.kernels.stepping.features import feature_columns, set_loads_seen
from pcm_gym.kernels.stepping.report import Moves, Report, StepRules, empty_report
from pcm_gym.kernels.stepping.transition import describe_batch, step_batch
from pcm_gym.mechanism import Mechanism
from pcm_gym.mechanism.validation import instance_of, sequence_of, shown, whole_number
from pcm_gym.solving import Equilibrium

try:
    import torch
    from torch import Tensor
    from torch.autograd.function import once_differentiable
except ImportError as error:
    raise ImportError(
        "pcm_gym.differentiable needs torch, which is not installed: pip install 'pcm_gym[differentiable]'"
    ) from error

__all__ = ["BranchStates", "advance", "start"]

# Increments are whole multiples of a power of two in the kernels, whose actions are cut to [-1, 1]: nothing is rounded.
_SMALLEST_STRIDE = 2.0**-1000


class _Told(NamedTuple):
    """What a step tells of the states that it leads to, in SI."""

    pose: Array
    rod_forces: Array
    actuator_forces: Array
    stability_margin: Array


@dataclass(frozen=True, eq=False)
class BranchStates:
    """Equilibria of one mechanism, n rows, as tensors of double precision on the CPU; `start` and `advance` make them.

    Attributes
    ----------
    mechanism : Mechanism
    inputs : Tensor (n, legs)
        Actuator inputs, rad or m.
    pose : Tensor (n, d)
        Pose of the end-effector, m and rad.
    rod_forces : Tensor (n, legs, 2)
        Force of the end-effector on each rod's tip, world frame, N.
    actuator_forces : Tensor (n, legs)
        What each actuator must give, N m or N, see `Equilibrium.actuator_forces`.
    stability_margin : Tensor (n,)
        Least eigenvalue of the stiffness, dimensionless; zero at a fold. Of all these, gradients flow to the inputs.
    singularity_margin : Tensor (n,)
        About how far the nearest fold is, in rad and mean rod lengths, see `Equilibrium.singularity_margin`. Without a
        gradient: it tells how far to trust those of the others.
    events : Tensor (n,)
        `Event` codes of the step that led here. A row with a fold, a change of index or a solver failure is where the
        step began.
    is_trusted : Tensor (n,)
        Whether the step came to its end without an event, limits of actuators included: gradients flow through all
        components of such a row.
    """

    mechanism: Mechanism
    inputs: Tensor
    pose: Tensor
    rod_forces: Tensor
    actuator_forces: Tensor
    stability_margin: Tensor
    singularity_margin: Tensor
    events: Tensor
    is_trusted: Tensor
    _states: States

    def detach(self) -> "BranchStates":
        """Return the same states, at which gradients end: the beginning of the next horizon."""
        tensors = (self.inputs, self.pose, self.rod_forces, self.actuator_forces, self.stability_margin)
        inputs, pose, rod_forces, actuator_forces, margin = (own.detach() for own in tensors)
        return replace(
            self,
            inputs=inputs,
            pose=pose,
            rod_forces=rod_forces,
            actuator_forces=actuator_forces,
            stability_margin=margin,
        )

    def equilibrium(self, row: int) -> Equilibrium:
        """Return the equilibrium of one row.

        Raises
        ------
        TypeError, ValueError
            If there is no such row.
        """
        row = whole_number("row", row, least=0, most=len(self.inputs) - 1)
        units, own = self.mechanism.units, self._states
        inputs, load = units.inputs_from_kernel(own.inputs[row]), units.load_from_kernel(own.load[row])
        return Equilibrium.unchecked(self.mechanism, own.x[row], inputs, load)


def start(equilibria: Sequence[Equilibrium]) -> BranchStates:
    """Return the states of equilibria of one mechanism, a row each, from which steps can be made.

    Parameters
    ----------
    equilibria : sequence of Equilibrium
        One at least, all of the same mechanism; each keeps its own load.

    Raises
    ------
    TypeError, ValueError
        If they are none, or not of one mechanism.
    """
    members = sequence_of("equilibria", equilibria, Equilibrium)
    if not members:
        raise ValueError("equilibria must be one at least, got none")
    mechanism = members[0].mechanism
    for own in members:
        if own.mechanism != mechanism:
            raise ValueError(f"equilibria must all be of {mechanism.name!r} as the first is, got {shown(own)}")
    states = States(*(np.array(values) for values in zip(*(own.kernel_values() for own in members), strict=True)))
    report = _empty_report(mechanism, states)
    describe_batch(mechanism.leg_table, states, np.arange(len(members)), report)
    told = _tell(mechanism, states, report)
    inputs = torch.from_numpy(mechanism.units.inputs_from_kernel(states.inputs))
    return _made(mechanism, states, report, (inputs, *map(torch.from_numpy, told)))


def advance(states: BranchStates, increments: Tensor) -> BranchStates:
    """Move the inputs of all rows and follow their branches; return the states there.

    Parameters
    ----------
    states : BranchStates
    increments : Tensor (n, legs)
        Changes of the inputs, rad or m, of any floating-point type and on any device. Inputs beyond an actuator's limit
        are cut.

    Returns
    -------
    BranchStates
        Its inputs, poses, forces and stability margins have gradients by the increments, and by the inputs of `states`.
        Gradients of gradients are refused.

    Raises
    ------
    TypeError, ValueError
        If the increments are no tensor of finite floating-point numbers of that shape.
    """
    instance_of("states", states, BranchStates)
    mechanism, before = states.mechanism, states._states
    change = _checked(increments, before.inputs.shape).to("cpu", torch.float64)
    changes = np.ascontiguousarray(mechanism.units.kernel_from_inputs(change.detach().numpy()))
    after = States(before.x.copy(), before.inputs.copy(), before.load)
    report = _empty_report(mechanism, after)
    step_batch(mechanism.leg_table, after, np.arange(len(after.x)), _moves(changes), StepRules(HOLD, 0.0), report)
    lower, upper = mechanism.kernel_limits
    wished, events = before.inputs + changes, report.verdicts["event"]
    arrives = (events == NONE) | (events == ACTUATOR_LIMIT)
    flows = arrives[:, None] & (lower <= wished) & (wished <= upper)
    step = _Step(mechanism, after, flows, _tell(mechanism, after, report))
    return _made(mechanism, after, report, _Advance.apply(states.inputs, change, step))  # type: ignore[no-untyped-call]


class _Step(NamedTuple):
    """What has been computed of a step before torch hears of it."""

    mechanism: Mechanism
    states: States  # where it leads to
    flows: Mask  # (n, legs): where gradients flow
    told: _Told


class _Advance(torch.autograd.Function):
    """A step for torch: inputs and increments in, inputs and what is told of the states out."""

    @staticmethod
    def forward(ctx: Any, inputs: Tensor, increments: Tensor, step: _Step) -> tuple[Tensor, ...]:
        """Hand out what has been computed."""
        ctx.step = step
        ctx.set_materialize_grads(False)
        after = step.mechanism.units.inputs_from_kernel(step.states.inputs)
        return torch.from_numpy(after), *map(torch.from_numpy, step.told)

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, by_inputs: "Tensor | None", *by_told: "Tensor | None") -> tuple[Tensor, Tensor, None]:
        """Carry gradients of the states back to inputs and increments, which share them."""
        mechanism, states, flows, told = ctx.step
        units, total = mechanism.units, np.zeros(states.inputs.shape)
        if any(own is not None for own in by_told):
            weights = Quantities(
                *(
                    np.zeros(array.shape) if own is None else np.ascontiguousarray(own.numpy() * unit)
                    for own, array, unit in zip(by_told, told, _units_of(mechanism), strict=True)
                )
            )
            has_margin = by_told[-1] is not None
            pull_back_in_lanes(mechanism.leg_table, states, _effects(mechanism), weights, has_margin, total)
            total /= units.inputs
        if by_inputs is not None:
            total += by_inputs.numpy()
        gradient = torch.from_numpy(np.where(flows, total, 0.0))
        return gradient, gradient, None


def _checked(increments: Tensor, shape: tuple[int, ...]) -> Tensor:
    """Return increments; raise if they are none for states of that shape."""
    if not instance_of("increments", increments, Tensor).is_floating_point():
        raise TypeError(f"increments must be a tensor of floating-point numbers, got {shown(increments)}")
    if tuple(increments.shape) != shape:
        raise ValueError(f"increments must have shape {shape}, got {tuple(increments.shape)}")
    if not bool(torch.isfinite(increments).all()):
        raise ValueError(f"increments must be finite, got {shown(increments)}")
    return increments


def _moves(changes: Array) -> Moves:
    """Return changes of the inputs (n, legs), dimensionless, as the kernels take them."""
    largest = np.maximum(np.abs(changes).max(axis=0, initial=0.0), _SMALLEST_STRIDE)
    stride = np.ldexp(1.0, np.frexp(largest)[1])
    return Moves(changes / stride, stride)


def _effects(mechanism: Mechanism) -> Array:
    """Return what each input does to each leg, (legs, legs, `EFFECTS`)."""
    effects = np.zeros((mechanism.leg_count, mechanism.leg_count, EFFECTS))
    for n, leg in enumerate(mechanism.legs):
        effects[n, n, [CLAMP_X, CLAMP_Y]] = leg.actuator.axis
        effects[n, n, CLAMP_TURN] = float(leg.actuator.is_angle)
    return effects


def _units_of(mechanism: Mechanism) -> tuple[Any, ...]:
    """Return the units of what is told."""
    units = mechanism.units
    return units.pose, units.force, units.energy / units.inputs, 1.0


def _empty_report(mechanism: Mechanism, states: States) -> Report:
    return empty_report(len(states.x), feature_columns(mechanism.leg_table, mechanism.dof).end)


def _tell(mechanism: Mechanism, states: States, report: Report) -> _Told:
    forces, efforts = np.empty((*states.inputs.shape, 2)), np.empty(states.inputs.shape)
    set_loads_seen(mechanism.leg_table, states.x, states.inputs, report.features, forces, efforts)
    pose, margin = states.x[:, 2 * mechanism.leg_count :], report.verdicts["stability_margin"]
    quantities = (pose, forces, efforts, margin)
    return _Told(*(own * unit for own, unit in zip(quantities, _units_of(mechanism), strict=True)))


def _made(mechanism: Mechanism, states: States, report: Report, tensors: Sequence[Tensor]) -> BranchStates:
    events, margins = report.verdicts["event"].copy(), report.verdicts["singularity_margin"].copy()
    inputs, pose, rod_forces, actuator_forces, stability_margin = tensors
    return BranchStates(
        mechanism,
        inputs,
        pose,
        rod_forces,
        actuator_forces,
        stability_margin,
        torch.from_numpy(margins),
        torch.from_numpy(events),
        torch.from_numpy(events == NONE),
        states,
    )
