"""Equilibria followed from one design to another, and along inputs."""

from dataclasses import replace

from numpy.typing import ArrayLike

from pcm_gym.arrays import Array
from pcm_gym.design.parameters import reference_of
from pcm_gym.kernels.branches import designs
from pcm_gym.mechanism import Mechanism
from pcm_gym.mechanism.validation import instance_of
from pcm_gym.solving import BranchTracker, Equilibrium, Event, home_equilibrium


class DesignError(ValueError):
    """No equilibrium continues in the design that was asked for, or measurements do not determine a design."""


def follow_design(equilibrium: Equilibrium, mechanism: Mechanism) -> Equilibrium:
    """Return what becomes of an equilibrium as its mechanism's design changes to another one, inputs and load held.

    Parameters
    ----------
    equilibrium : Equilibrium
    mechanism : Mechanism
        With the same kinds of actuators, leg by leg.

    Raises
    ------
    TypeError, ValueError
        If the mechanism is of another kind.
    DesignError
        If the equilibrium ends on the way, at a fold, or its Morse index changes.
    """
    start = instance_of("equilibrium", equilibrium, Equilibrium).mechanism
    kinds = [type(leg.actuator) for leg in instance_of("mechanism", mechanism, Mechanism).legs]
    if kinds != [type(leg.actuator) for leg in start.legs]:
        raise ValueError(
            f"mechanism must have actuators of the kinds of {start.name!r}, got {[kind.__name__ for kind in kinds]}"
        )
    units, pose = mechanism.units, 2 * mechanism.leg_count
    legs = replace(start, reference=reference_of(mechanism)).leg_table
    x = equilibrium.state.copy()
    x[pose:] = units.kernel_from_pose(equilibrium.pose)
    inputs, load = units.kernel_from_inputs(equilibrium.inputs), units.kernel_from_load(equilibrium.load)
    if not designs.follow_design(legs, mechanism.leg_table, x, inputs, load):
        raise DesignError(
            f"the equilibrium at inputs {equilibrium.inputs.tolist()} does not continue to the design asked for: "
            "it meets a fold on the way"
        )
    return Equilibrium.unchecked(mechanism, x, equilibrium.inputs, equilibrium.load)


def equilibria_along(
    mechanism: Mechanism, inputs: Array, load: ArrayLike | None, start: Equilibrium | None
) -> list[Equilibrium]:
    """Return the equilibria at inputs (n, legs), one after the other along the branch of `start`, by default home.

    Raises
    ------
    TypeError, ValueError
        If `start` is of another mechanism, or not stable.
    DesignError
        If stability is lost on the way.
    """
    load = mechanism.check_load(load)
    if start is None:
        start = home_equilibrium(mechanism, load)
    elif instance_of("start", start, Equilibrium).mechanism != mechanism:
        raise ValueError(f"start must be of the mechanism {mechanism.name!r}, got one of {start.mechanism.name!r}")
    if not start.is_stable:
        raise ValueError(f"start must be stable, got an equilibrium of index {start.index}")
    tracker, found = BranchTracker(mechanism, start), []
    for n, own in enumerate(inputs):
        step = tracker.step(own, load)
        if step.event is not Event.NONE:
            raise DesignError(
                f"{mechanism.name!r} does not reach inputs[{n}] = {own.tolist()} from those before: "
                f"{step.event.message}"
            )
        found.append(step.equilibrium)
    return found
