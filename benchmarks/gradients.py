"""Gradients of differentiable steps: against differences of tracked equilibria, and what they cost."""

import itertools
import time
from collections.abc import Callable, Sequence
from typing import Annotated

import numpy as np
import typer
from rich.console import Console
from rich.progress import track
from rich.table import Table

import pcm_gym
from benchmarks.margins import states_anywhere, states_beside_folds
from pcm_gym.arrays import Array
from pcm_gym.solving import BranchTracker, Equilibrium, Event

NAMES = ("2RFR", "2PFR", "3PFR")
PARTS = ("pose", "rod_forces", "actuator_forces", "stability_margin")
# Nearer to a fold than this no gradient is compared, and more than this is an error.
NEAREST, BOUND = 1e-3, 1e-6
# Places and weights of a first difference of fourth order, times 12 widths.
_STENCIL = ((-2.0, 1.0), (-1.0, -8.0), (1.0, 8.0), (2.0, -1.0))
# Width by the margin, or by this where it is larger; how often a difference that disagrees is taken with less.
_WIDTH, _LARGEST_MARGIN, _TRIALS = 1e-3, 0.1, 5
_ROWS = 4096


def gradients(
    states: Annotated[int, typer.Option(min=2, help="States of each mechanism.")] = 10_000,
    mechanisms: Annotated[list[str] | None, typer.Option("--mechanism", help="Only these; all by default.")] = None,
    seed: Annotated[int, typer.Option()] = 0,
) -> None:
    """Compare gradients with differences, at states anywhere and beside folds, and time them; some minutes.

    The exit status is 1 if one disagrees by more than a millionth.
    """
    console, worst = Console(), 0.0
    table = Table("mechanism", "states", "median error", "largest error", title="Gradients against differences")
    for name in mechanisms or NAMES:
        errors = errors_of(some_states(name, states, seed), seed)
        worst = max(worst, float(errors.max()))
        table.add_row(name, f"{len(errors)}", f"{np.median(errors):.1e}", f"{errors.max():.1e}")
    console.print(table)
    table = Table("mechanism", "quantities", "forward (µs)", "with backward (µs)", "ratio", "steps/s", title="Cost")
    for name in mechanisms or NAMES:
        for parts in (PARTS[:1], PARTS):
            forward, both = cost_of(name, parts)
            row = f"{1e6 * forward:.2f}", f"{1e6 * both:.2f}", f"{both / forward:.2f}", f"{1.0 / both:,.0f}"
            table.add_row(name, ", ".join(parts), *row)
    console.print(table)
    if worst > BOUND:
        raise typer.Exit(1)


def some_states(name: str, count: int, seed: int) -> list[Equilibrium]:
    """Return stable states outside `NEAREST`: half of them anywhere, the others beside folds."""
    generator = np.random.default_rng(seed)

    def outside(own: Equilibrium) -> bool:
        lower, upper, room = (
            own.mechanism.lower_limits,
            own.mechanism.upper_limits,
            NEAREST * own.mechanism.units.inputs,
        )
        is_free = ((lower + room < own.inputs) & (own.inputs < upper - room)).all()  # differences go to both sides
        return bool(is_free) and own.singularity_margin > NEAREST

    anywhere = list(itertools.islice(filter(outside, states_anywhere(name, generator)), (count + 1) // 2))
    return anywhere + list(itertools.islice(filter(outside, states_beside_folds(anywhere, generator)), count // 2))


def errors_of(states: Sequence[Equilibrium], seed: int) -> Array:
    """Return how far the gradient of a random sum of each state is from differences along a random direction.

    It is relative to the gradient's length times the direction's. A difference of states between which another
    eigenvalue becomes the least says nothing: one that disagrees is taken again with a smaller width.
    """
    import torch  # only this command takes it

    from pcm_gym import differentiable

    mechanism, generator = states[0].mechanism, np.random.default_rng(seed)
    begun = differentiable.start(states)
    increments = torch.zeros_like(begun.inputs, requires_grad=True)
    reached, total, weights = differentiable.advance(begun, increments), 0.0, {}
    for part in PARTS:
        told = getattr(reached, part)
        # of the size of one, whatever the unit and the number
        scale = told.detach().abs().amax(dim=tuple(range(1, told.ndim)), keepdim=True)
        weights[part] = torch.from_numpy(generator.normal(size=tuple(told.shape))) / scale
        total = total + (weights[part] * told).sum()
    total.backward()  # type: ignore[attr-defined]
    found = increments.grad.numpy() * mechanism.units.inputs  # type: ignore[union-attr]
    directions = generator.normal(size=found.shape)
    errors = np.empty(len(states))
    for row, own in enumerate(track(states, description=mechanism.name, transient=True)):
        sums = {part: weight[row].numpy() for part, weight in weights.items()}
        slope, size = float(found[row] @ directions[row]), np.linalg.norm(found[row]) * np.linalg.norm(directions[row])
        width, errors[row] = _WIDTH * min(own.singularity_margin, _LARGEST_MARGIN), np.inf
        for _ in range(_TRIALS):
            difference = _difference(own, directions[row], width, sums)
            errors[row] = min(errors[row], abs(difference - slope) / size)
            if errors[row] < BOUND:
                break
            width /= 4.0
    return errors


def _difference(own: Equilibrium, direction: Array, width: float, weights: dict[str, Array]) -> float:
    """Return the derivative of a weighted sum along a direction by the tracker; nan where it meets an event."""
    total, step_width = 0.0, width * direction * own.mechanism.units.inputs
    for place, weight in _STENCIL:
        step = BranchTracker(own.mechanism, own).step(own.inputs + place * step_width)
        if step.event is Event.FOLD or step.event is Event.SOLVER_FAILURE:
            return np.nan
        there = step.equilibrium
        forces, margin = np.array([rod.force for rod in there.rods]), np.array(there.stability_margin)
        told = there.pose, forces, there.actuator_forces, margin
        total += weight * sum(float((weights[part] * value).sum()) for part, value in zip(PARTS, told, strict=True))
    return total / (12.0 * width)


def cost_of(name: str, parts: Sequence[str]) -> tuple[float, float]:
    """Return the seconds of a row's step alone and with the gradients of these quantities, on one thread."""
    import torch

    from pcm_gym import differentiable

    torch.set_num_threads(1)
    home, generator = pcm_gym.home_equilibrium(pcm_gym.get_mechanism(name)), np.random.default_rng(0)
    legs, stride = home.mechanism.leg_count, 0.02 * home.mechanism.units.inputs
    states = differentiable.start([home] * _ROWS)
    for _ in range(3):
        states = differentiable.advance(states, torch.from_numpy(generator.uniform(-1.0, 1.0, (_ROWS, legs)) * stride))
    states = states.detach()
    increments = torch.from_numpy(generator.uniform(-1.0, 1.0, (_ROWS, legs)) * stride).requires_grad_()

    def both() -> None:
        reached = differentiable.advance(states, increments)
        torch.stack([getattr(reached, part).sum() for part in parts]).sum().backward()

    return _fastest(lambda: differentiable.advance(states, increments)), _fastest(both)


def _fastest(call: Callable[[], object]) -> float:
    """Return the seconds for a row of the fastest of many calls: other work on the machine only adds."""
    call()
    times = []
    for _ in range(30):
        before = time.perf_counter()
        call()
        times.append(time.perf_counter() - before)
    return min(times) / _ROWS
