"""Asking without moving: what steps would do, worked out on copies of the rows and in lock-step."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from pcm_gym.arrays import Array, Integers, Mask
from pcm_gym.environments.simulation import Simulation
from pcm_gym.kernels.stepping.report import (
    EVENT,
    LIMIT,
    LOST,
    MORSE_INDEX,
    RESIDUAL,
    SINGULAR,
    SINGULARITY_MARGIN,
    SOLVER,
    STABILITY_MARGIN,
    UNSTABLE,
)


@dataclass(frozen=True)
class Preview:
    """What steps would come to, with each of several actions.

    The leading axes, written ``...``, are those of the actions: (k,) for one environment, (n, k) for a batch. What has
    the name of an info means the same; noise is on observations alone and makes no difference here.

    Attributes
    ----------
    pose : array (..., d)
        Pose of the end-effector after the step, m and rad.
    inputs : array (..., legs)
        Where the clamps are after the step, rad or m: not where they are told to go, if the actuators are not ideal.
    index : int array (...)
    stability_margin, singularity_margin, residual : array (...)
    event : int array (...)
        The event, as its place in `pcm_gym.Event`: 0 for none, 1 fold, 2 index change, 3 actuator limit, 4 solver
        failure.
    cost, cost_unstable, cost_singular, cost_limit, cost_solver : array (...)
    reward : array (...)
        The reward of the step, for the goal that counts then.
    terminated : bool array (...)
        Whether the step would end the episode, because stability is lost.
    """

    pose: Array
    inputs: Array
    index: Integers
    stability_margin: Array
    singularity_margin: Array
    residual: Array
    event: Integers
    cost: Array
    cost_unstable: Array
    cost_singular: Array
    cost_limit: Array
    cost_solver: Array
    reward: Array
    terminated: Mask


def preview(simulation: Simulation, actions: Array) -> Preview:
    """Return what the rows of a simulation would come to with their actions (k, legs) or (n, k, legs)."""
    shape, chosen = actions.shape[:-1], actions.reshape(-1, actions.shape[-1])
    origin = np.repeat(np.arange(simulation.count), len(chosen) // simulation.count)
    motion = simulation.motion.copied(origin)
    report = simulation.foresee(motion, chosen)
    verdicts, costs = _shaped(report.verdicts, shape), _shaped(report.costs, shape)
    mechanism = simulation.settings.mechanism
    pose = motion.x[:, 2 * mechanism.leg_count :] * mechanism.units.pose
    return Preview(
        pose=pose.reshape(*shape, mechanism.dof),
        inputs=(motion.inputs * mechanism.units.inputs).reshape(actions.shape),
        index=verdicts[MORSE_INDEX].astype(np.int64),
        stability_margin=verdicts[STABILITY_MARGIN],
        singularity_margin=verdicts[SINGULARITY_MARGIN],
        residual=verdicts[RESIDUAL],
        event=verdicts[EVENT].astype(np.int64),
        cost=costs.sum(axis=0),
        cost_unstable=costs[UNSTABLE],
        cost_singular=costs[SINGULAR],
        cost_limit=costs[LIMIT],
        cost_solver=costs[SOLVER],
        reward=_rewards(simulation, motion.inputs, report.features, origin).reshape(shape),
        terminated=verdicts[LOST] > 0.0,
    )


def _shaped(table: Array, shape: tuple[int, ...]) -> Array:
    """Return a table (r, m) with the axes of the actions in place of its columns, (r, ...)."""
    return table.reshape(len(table), *shape)


def _rewards(simulation: Simulation, inputs: Array, features: Array, origin: Integers) -> Array:
    """Return the rewards (m,) of steps of the rows `origin` (m,) that lead to inputs (m, legs) and features (m, f)."""
    goals, rows = simulation.settings.task.goals, simulation.rows
    phase = (rows.elapsed[origin] + 1) % rows.goals.shape[1]
    rewards, _ = goals.score(goals.achieved(features, inputs, np.arange(len(origin))), rows.goals[origin, phase])
    return rewards


def checked_choices(actions: ArrayLike, shape: tuple[int | str, ...]) -> Array:
    """Return actions to choose from as a new array of a shape, in which a name stands for any number."""
    try:
        values = np.array(actions, dtype=np.float64, order="C")
    except (TypeError, ValueError):
        raise TypeError(f"actions must be an array of numbers, got {actions!r}") from None
    fits = [isinstance(size, str) or size == own for size, own in zip(shape, values.shape, strict=False)]
    if values.ndim != len(shape) or not all(fits):
        raise ValueError(f"actions must have shape ({', '.join(map(str, shape))}), got {values.shape}")
    is_finite = np.isfinite(values).all(axis=-1)
    if not is_finite.all():
        raise ValueError(f"actions must be finite, got {values[~is_finite].tolist()}")
    return values
