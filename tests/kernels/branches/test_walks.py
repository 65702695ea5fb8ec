"""Ten thousand random walks of 200 steps over the three mechanisms, forth, in half steps, and back again."""

from typing import NamedTuple

import numpy as np
import pytest

from pcm_gym.arrays import Array, Integers
from pcm_gym.kernels.branches.continuation import (
    ACTUATOR_LIMIT,
    FOLD,
    INDEX_CHANGE,
    NONE,
    SOLVER_FAILURE,
    make_line,
    track,
)
from pcm_gym.kernels.numerics.compilation import kernel
from pcm_gym.kernels.statics.closure import make_workspace
from pcm_gym.kernels.statics.margin import singularity_margin
from pcm_gym.kernels.statics.states import Point
from pcm_gym.solving import Equilibrium
from tests.reference.mechanisms import FAMILIES, home_by_construction

WALKS = {"2RFR": 3334, "2PFR": 3333, "3PFR": 3333}
STEPS = 200
# Largest increments: radians, lengths of the rod, and EI/L^2 of the load, which moves in every third walk.
INPUT_STEP = {"2RFR": 0.12, "2PFR": 0.04, "3PFR": 0.04}
LOAD_STEP = 0.15


class Walks(NamedTuple):
    """What became of each walk; `last` is the state after the last step that reached its target or a limit."""

    events: Integers
    steps: Integers  # steps begun
    fractions: Array  # of the last step
    residuals: Array  # the worst on the way
    margins: Array  # singularity margin at the stop
    stopped: Array  # state where it stopped
    last: Array
    returned: Array  # state after walking back from `last`
    back_events: Integers  # worst event code on the way back
    recoiled: Array  # state after going back from where it stopped to where `last` is
    recoil_events: Integers


@kernel
def walk(
    legs: Array,
    x_home: Array,
    inputs_home: Array,
    input_steps: Array,
    load_steps: Array,
    substeps: int,
    goes_back: bool,
    walks: Walks,
) -> None:
    """Walk from home by these increments (walks, steps, ...), each cut into `substeps`; then back the same way."""
    count, steps, leg_count = input_steps.shape
    dof = load_steps.shape[2]
    line, work = make_line(leg_count, x_home.shape[0]), make_workspace(leg_count, x_home.shape[0])
    inputs_way, load_way = np.zeros((steps + 1, leg_count)), np.zeros((steps + 1, dof))
    for w in range(count):
        x, inputs, load = x_home.copy(), inputs_home.copy(), np.zeros(dof)
        point = Point(x, inputs, load)
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
                tracked = track(legs, point, inputs_target, load_target, False, line, work)
                walks.residuals[w] = max(walks.residuals[w], tracked.residual)
                event, fraction, margin = (
                    tracked.event,
                    (n + tracked.fraction) / substeps,
                    singularity_margin(legs, x, work),
                )
                if event != NONE:
                    break
            walks.events[w], walks.steps[w], walks.fractions[w], walks.margins[w] = event, s + 1, fraction, margin
            if event not in (NONE, ACTUATOR_LIMIT):
                break
            done = s + 1
            walks.last[w] = x
            inputs_way[done], load_way[done] = inputs, load
        walks.stopped[w] = x
        tracked = track(legs, point, inputs_way[done], load_way[done], False, line, work)
        walks.recoiled[w], walks.recoil_events[w] = x, tracked.event
        if not goes_back:
            continue
        x[:] = walks.last[w]
        inputs[:], load[:] = inputs_way[done], load_way[done]
        for s in range(done - 1, -1, -1):
            tracked = track(legs, point, inputs_way[s], load_way[s], False, line, work)
            walks.residuals[w] = max(walks.residuals[w], tracked.residual)
            walks.back_events[w] = max(walks.back_events[w], tracked.event)
            if tracked.event != NONE:
                break
        walks.returned[w] = x


def run(home: Equilibrium, input_steps: Array, load_steps: Array, substeps: int, *, goes_back: bool) -> Walks:
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
    walk(np.array(mechanism.leg_table), home.state.copy(), inputs, input_steps, load_steps, substeps, goes_back, walks)
    return walks


class Outcome(NamedTuple):
    home: Equilibrium
    whole: Walks
    halved: Walks


def walk_from_home(
    family: str, count: int, steps: int, input_step: float, load_step: float, loaded_part: int
) -> Outcome:
    """Walk `count` times, whole and in half steps; the load moves in one walk of `loaded_part`."""
    home = home_by_construction(family)
    rng = np.random.default_rng(7)
    input_steps = input_step * rng.uniform(-1.0, 1.0, (count, steps, home.mechanism.leg_count))
    load_steps = load_step * rng.uniform(-1.0, 1.0, (count, steps, home.mechanism.dof))
    load_steps[np.arange(count) % loaded_part > 0] = 0.0
    whole = run(home, input_steps, load_steps, 1, goes_back=True)
    return Outcome(home, whole, run(home, input_steps, load_steps, 2, goes_back=False))


# Small steps, in which most walks last; and bold ones, of up to a radian, where most end at a fold.
@pytest.fixture(scope="module", params=[*FAMILIES, *(f"bold {family}" for family in FAMILIES)])
def outcome(request: pytest.FixtureRequest) -> Outcome:
    family = request.param.removeprefix("bold ")
    if request.param == family:
        return walk_from_home(family, WALKS[family], STEPS, INPUT_STEP[family], LOAD_STEP, loaded_part=3)
    return walk_from_home(family, 400, 60, 6.0 * INPUT_STEP[family], 10.0, loaded_part=2)


def relative_difference(a: Array, b: Array) -> Array:
    """Return, per walk, the largest difference of two states: pose in L, load of a rod relative to 1 + itself."""
    return np.abs((a - b) / (1.0 + np.abs(b))).max(axis=1)


def test_no_walk_meets_a_nan(outcome: Outcome) -> None:
    for walks in (outcome.whole, outcome.halved):
        assert np.isfinite(walks.stopped).all()
        assert np.isfinite(walks.residuals).all()


def test_every_state_closes(outcome: Outcome) -> None:
    assert max(outcome.whole.residuals.max(), outcome.halved.residuals.max()) <= 1e-10


def test_every_stop_is_explained(outcome: Outcome) -> None:
    """By a fold or a change of index, where the stiffness is singular; never by the solver."""
    for walks in (outcome.whole, outcome.halved):
        assert not np.any(walks.events == SOLVER_FAILURE)
        stopped = np.isin(walks.events, (FOLD, INDEX_CHANGE))
        assert np.array_equal(stopped, (walks.steps < walks.steps.max()) | stopped)
        # the fold is located along the arc to 1e-11
        assert np.all(walks.margins[stopped] < 1e-8)


def test_fractions_are_parts_of_the_step(outcome: Outcome) -> None:
    for walks in (outcome.whole, outcome.halved):
        assert walks.fractions.min() >= 0.0
        assert walks.fractions.max() <= 1.0


def test_half_steps_end_the_same(outcome: Outcome) -> None:
    """Same event in the same step at the same place. A fold less than 1e-6 before a target may count either way."""
    whole, halved = outcome.whole, outcome.halved
    differs = (whole.events != halved.events) | (whole.steps != halved.steps)
    near_fold = np.minimum(whole.margins, halved.margins) < 1e-6
    near_target = (np.abs(whole.fractions - 1.0) < 1e-6) | (np.abs(halved.fractions - 1.0) < 1e-6)
    assert np.flatnonzero(differs & ~(near_fold & near_target)).tolist() == []
    assert differs.sum() <= 2
    same = ~differs
    assert np.abs(whole.fractions - halved.fractions)[same].max() <= 1e-8
    assert relative_difference(whole.last, halved.last)[same].max() <= 1e-9


def test_way_back_leads_home(outcome: Outcome) -> None:
    assert np.all(outcome.whole.back_events == NONE)
    home = np.broadcast_to(outcome.home.state, outcome.whole.returned.shape)
    assert relative_difference(outcome.whole.returned, home).max() <= 1e-9


def test_from_where_it_stopped_the_way_back_is_open(outcome: Outcome) -> None:
    """At a fold two branches meet that both lead back: the state is on the one it came by."""
    assert np.all(outcome.whole.recoil_events == NONE)
    assert relative_difference(outcome.whole.recoiled, outcome.whole.last).max() <= 1e-9


def test_walks_meet_what_they_should(outcome: Outcome) -> None:
    """Else the other tests would prove little: most small-stepped walks last, bold ones end at folds."""
    events = np.bincount(outcome.whole.events, minlength=5)
    is_bold = len(outcome.whole.events) == 400
    assert events[ACTUATOR_LIMIT] > 0
    assert events[FOLD] >= (100 if is_bold else 0)
    assert is_bold or (outcome.whole.steps == STEPS).sum() > 0.5 * len(outcome.whole.steps)


def test_there_are_ten_thousand() -> None:
    assert sum(WALKS.values()) == 10_000
