"""A sample of what kernels index: run without compilation, every index beyond an array's end is an error.

The lanes need compilation; their loops have fixed lengths.
``NUMBA_DISABLE_JIT=1 python -m tests.boundary.bounds`` reads home equilibria as JSON, and writes what it comes to.
"""

import json
import sys
from typing import Any

import numpy as np

import pcm_gym
from pcm_gym.arrays import Array
from pcm_gym.kernels.snaps.instability import CONTINUE, HOLD, SNAP, TERMINATE
from pcm_gym.kernels.statics.states import States
from pcm_gym.kernels.stepping.goals import GoalProgress
from pcm_gym.kernels.stepping.report import Moves, StepRules, empty_report
from pcm_gym.kernels.stepping.transition import step_alone
from pcm_gym.tasks import Goals, Reach, feature_layout

ROWS = 4


def numbers(homes: dict[str, Any]) -> list[float]:
    """What a sample of all that environments do comes to, for some mechanisms with the states of their homes."""
    found: list[Array] = []
    for name, (state, inputs) in homes.items():
        mechanism = pcm_gym.get_mechanism(name)
        home = pcm_gym.Equilibrium(mechanism, state, inputs, np.zeros(mechanism.dof))
        found += _of_steps(home)
        found += [_array(home.shape(4)), _array(home.stiffness), np.array([home.energy, home.singularity_margin])]
        step = pcm_gym.BranchTracker(mechanism, home).step(home.inputs + 0.02)
        found.append(np.append(step.equilibrium.state, [step.event, step.fraction]))
    return [float(number) for array in found for number in np.ravel(array)]


def _of_steps(home: pcm_gym.Equilibrium) -> list[Array]:
    mechanism, rng = home.mechanism, np.random.default_rng(0)
    legs, features = mechanism.leg_table, len(feature_layout(mechanism).elements)
    stride = np.full(mechanism.leg_count, 0.05)
    actions = rng.uniform(-1.0, 1.0, (ROWS, mechanism.leg_count))
    actions[0] = 0.0
    every, found = np.arange(ROWS), []
    for behaviour in (TERMINATE, HOLD, SNAP, CONTINUE):
        states, report = _copies(home), empty_report(ROWS, features)
        step_alone(legs, states, every, Moves(actions, stride), StepRules(behaviour, 0.05), report)
        found += [states.x, report.features, _array(report.verdicts["singularity_margin"])]
    goals = Goals(mechanism)
    achieved = goals._achieved(report.features, states.inputs, every)
    progress = GoalProgress(achieved[:, None] + 0.01, np.zeros(ROWS, np.int64), np.zeros(ROWS, np.int64))
    desired, rewards = Reach(goals)._update_goals(
        achieved[:3], every[:3], np.ones(3, np.bool_), np.ones(3, np.bool_), progress
    )
    states = _copies(home)
    return [*found, desired, rewards, goals.of_states(states.x, states.inputs)]


def _copies(home: pcm_gym.Equilibrium) -> States:
    return States(*(np.tile(own, (ROWS, 1)) for own in home.kernel_values()))


def _array(values: Any) -> Array:
    return np.asarray(values, dtype=np.float64)


if __name__ == "__main__":
    print(json.dumps(numbers(json.load(sys.stdin))))
