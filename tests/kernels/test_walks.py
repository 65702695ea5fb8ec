"""Ten thousand random walks of 200 steps over the three mechanisms, forth, in half steps, and back again."""

from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

from pcm_gym.kernels.closure import make_workspace
from pcm_gym.kernels.compilation import kernel
from pcm_gym.kernels.continuation import (
    ACTUATOR_LIMIT,
    FOLD,
    INDEX_CHANGE,
    NONE,
    SOLVER_FAILURE,
    make_line,
    track,
)
from pcm_gym.solving import Equilibrium
from tests.reference.mechanisms import FAMILIES, home_by_construction

Array = NDArray[np.float64]

WALKS = {"2RFR": 3334, "2PFR": 3333, "3PFR": 3333}
STEPS = 200
# Largest increments: radians, lengths of the rod, and EI/L^2 of the load, which moves in every third walk.
INPUT_STEP = {"2RFR": 0.12, "2PFR": 0.04, "3PFR": 0.04}
LOAD_STEP = 0.15


class Walks(NamedTuple):
    """What became of each walk; `last` is the state after the last step that reached its target or a limit."""

    events: NDArray[np.int64]
    steps: NDArray[np.int64]  # steps begun
    fractions: Array  # of the last step
    residuals: Array  # the worst on the way
    margins: Array  # singularity margin at the stop
    stopped: Array  # state where it stopped
    last: Array
    returned: Array  # state after walking back from `last`
    back_events: NDArray[np.int64]  # worst event code on the way back
    recoiled: Array  # state after going back from where it stopped to where `last` is
    recoil_events: NDArray[np.int64]


@kernel
def walk(
    legs: Array,
    x_home: Array,
    inputs_home: Array,
    input_steps: Array,
    load_steps: Array,
    substeps: int,
    walks: Walks,
) -> None:
    """Walk from home by these increments (walks, steps, ...), each cut into `substeps`; then back the same way."""
    count, steps, leg_count = input_steps.shape
    dof = load_steps.shape[2]
    line, work = make_line(leg_count, x_home.shape[0]), make_workspace(leg_count, x_home.shape[0])
    inputs_way, load_way = np.zeros((steps + 1, leg_count)), np.zeros((steps + 1, dof))
    for w in range(count):
        x, inputs, load = x_home.copy(), inputs_home.copy(), np.zeros(dof)
        inputs_way[0], load_way[0] = inputs, load
        walks.last[w] = x
        done = 0
        for s in range(steps):
            inputs_start, load_start = inputs.copy(), load.copy()
            event, fraction, margin = NONE, 0.0, 0.0
            for n in range(substeps):
                part = (n + 1) / substeps
                inputs_target = inputs_start + part * input_steps[w, s]
                load_target = load_start + part * load_steps[w, s]
                tracked = track(legs, x, inputs, load, inputs_target, load_target, False, line, work)
                walks.residuals[w] = max(walks.residuals[w], tracked.residual)
                event, fraction, margin = tracked.event, (n + tracked.fraction) / substeps, tracked.singularity_margin
                if event != NONE:
                    break
            walks.events[w], walks.steps[w], walks.fractions[w], walks.margins[w] = event, s + 1, fraction, margin
            if not (event == NONE or event == ACTUATOR_LIMIT):
                break
            done = s + 1
            walks.last[w] = x
            inputs_way[done], load_way[done] = inputs, load
        walks.stopped[w] = x
        tracked = track(legs, x, inputs, load, inputs_way[done], load_way[done], False, line, work)
        walks.recoiled[w], walks.recoil_events[w] = x, tracked.event
        x = walks.last[w].copy()
        inputs[:], load[:] = inputs_way[done], load_way[done]
        for s in range(done - 1, -1, -1):
            tracked = track(legs, x, inputs, load, inputs_way[s], load_way[s], False, line, work)
            walks.residuals[w] = max(walks.residuals[w], tracked.residual)
            walks.back_events[w] = max(walks.back_events[w], tracked.event)
            if tracked.event != NONE:
                break
        walks.returned[w] = x


def run(home: Equilibrium, input_steps: Array, load_steps: Array, substeps: int) -> Walks:
    count, size = len(input_steps), home.mechanism.state_size
    walks = Walks(
        np.zeros(count, np.int64),
        np.zeros(count, np.int64),
        np.zeros(count),
        np.zeros(count),
        np.zeros(count),
        np.full((count, size), np.nan),
        np.full((count, size), np.nan),
        np.full((count, size), np.nan),
        np.zeros(count, np.int64),
        np.full((count, size), np.nan),
        np.zeros(count, np.int64),
    )
    mechanism = home.mechanism
    inputs = home.inputs / mechanism.units.inputs
    walk(np.array(mechanism.leg_table), home.state.copy(), inputs, input_steps, load_steps, substeps, walks)
    return walks


class Outcome(NamedTuple):
    home: Equilibrium
    whole: Walks
    halved: Walks


@pytest.fixture(scope="module", params=FAMILIES)
def outcome(request: pytest.FixtureRequest) -> Outcome:
    family = request.param
    home, count = home_by_construction(family), WALKS[family]
    rng = np.random.default_rng(7)
    input_steps = INPUT_STEP[family] * rng.uniform(-1.0, 1.0, (count, STEPS, home.mechanism.leg_count))
    load_steps = LOAD_STEP * rng.uniform(-1.0, 1.0, (count, STEPS, home.mechanism.dof))
    load_steps[np.arange(count) % 3 > 0] = 0.0
    return Outcome(home, run(home, input_steps, load_steps, 1), run(home, input_steps, load_steps, 2))
