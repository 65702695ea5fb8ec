"""Asking without moving: what steps would do, worked out on copies of the rows and in lock-step."""

from dataclasses import dataclass

import numpy as np

from pcm_gym.arrays import Array, Integers, Mask
from pcm_gym.environments.rows import limit_costs, total_cost
from pcm_gym.environments.simulation import Simulation
from pcm_gym.kernels.stepping.report import Costs
from pcm_gym.mechanism.validation import check_kinds
from pcm_gym.solving.limits import LIMIT_NAMES


@dataclass(frozen=True, eq=False)
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
        Numbers of `pcm_gym.Event`: 0 for none, 1 fold, 2 index change, 3 actuator limit, 4 solver failure.
    at_limit : bool array (...)
    losses : int array (...)
    is_dwelling : bool array (...)
    cost, cost_unstable, cost_singular, cost_solver : array (...)
    cost_stress, cost_torque, cost_contact : array (...)
        0 where the environment's `limits` do not name them.
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
    at_limit: Mask
    losses: Integers
    is_dwelling: Mask
    cost: Array
    cost_unstable: Array
    cost_singular: Array
    cost_solver: Array
    cost_stress: Array
    cost_torque: Array
    cost_contact: Array
    reward: Array
    terminated: Mask

    def __post_init__(self) -> None:
        check_kinds(self, **dict.fromkeys(Preview.__annotations__, np.ndarray))


def preview(simulation: Simulation, actions: Array) -> Preview:
    """Return what the rows of a simulation would come to with their actions (k, legs) or (n, k, legs)."""
    shape, chosen = actions.shape[:-1], actions.reshape(-1, actions.shape[-1])
    origin = np.repeat(np.arange(simulation.count), len(chosen) // simulation.count)
    motion = simulation.motion.copied(origin)
    report = simulation.foresee(motion, chosen)
    verdicts, mechanism = report.verdicts.reshape(shape), simulation.settings.mechanism
    units = mechanism.units
    rewards = foreseen_rewards(simulation, motion.inputs, report.features, origin)
    return Preview(
        pose=units.pose_from_kernel(motion.x[:, 2 * mechanism.leg_count :]).reshape(*shape, mechanism.dof),
        inputs=units.inputs_from_kernel(motion.inputs).reshape(actions.shape),
        index=verdicts["index"],
        stability_margin=verdicts["stability_margin"],
        singularity_margin=verdicts["singularity_margin"],
        residual=verdicts["residual"],
        event=verdicts["event"],
        at_limit=verdicts["at_limit"],
        cost=total_cost(verdicts, simulation.settings.limits),
        **{name: verdicts[name] for name in (*Costs.__annotations__, *limit_costs(LIMIT_NAMES))},
        losses=verdicts["losses"],
        is_dwelling=verdicts["is_dwelling"],
        reward=simulation.shaped(rewards, motion, origin, report.verdicts["is_lost"]).reshape(shape),
        terminated=verdicts["is_lost"],
    )


def foreseen_rewards(simulation: Simulation, inputs: Array, features: Array, origin: Integers, ahead: int = 1) -> Array:
    """Return the rewards (m,) of rows `origin` (m,) that come to inputs (m, legs) and features (m, f) some steps on."""
    task, rows = simulation.settings.task, simulation.rows
    achieved = task.goals._achieved(features, inputs, np.arange(len(origin)))
    rewards, _ = task._scored(achieved, rows.goals_ahead(origin, ahead))
    return rewards
