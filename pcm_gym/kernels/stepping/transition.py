"""One step of many mechanisms at once: increments of the inputs in, tracked states, costs and features out."""

import numpy as np

from pcm_gym.arrays import Array, Integers, Mask
from pcm_gym.kernels.branches.continuation import NONE, SOLVER_FAILURE, Tracked, judge, make_line
from pcm_gym.kernels.lockstep.lanes import growth_of_lane, rest_block, step_block
from pcm_gym.kernels.lockstep.layout import LANES, Block, make_block
from pcm_gym.kernels.lockstep.rows import load_lane, set_way_point, store_lane
from pcm_gym.kernels.numerics.compilation import formula, kernel
from pcm_gym.kernels.snaps.instability import ENERGY, FALLS, HOLD, TERMINATE, advance, is_instability, make_falls
from pcm_gym.kernels.statics.closure import LOWER, UPPER, make_workspace, place
from pcm_gym.kernels.statics.margin import singularity_margin
from pcm_gym.kernels.statics.states import Point, States
from pcm_gym.kernels.stepping.features import see_block, set_features
from pcm_gym.kernels.stepping.report import Moves, Report, StepRules, make_seen, report_lane, report_row

# In place of a behaviour where stability is lost: what lock-step does not follow is not followed at all. For those who
# look for steps that arrive, and ask about many that do not; tracking each of these to its fold takes fifty times as
# long. What arrives does so to the same bits.
GIVE_UP = -1
# A step that is refused is made in parts, down to this one of it, before it is tracked alone.
_LEAST_PART = 1.0 / 16.0
# With so many rows that lock-step has refused, each of which may snap, a call does no more than these.
_REFUSED_AT_ONCE = 128


def step_batch(
    legs: Array,
    states: States,
    rows: Integers,
    moves: Moves,
    rules: StepRules,
    report: Report,
) -> None:
    """Move the inputs of some rows in place.

    Inputs beyond an actuator's limit are cut. Rows that would lose stability do as the rules say, see `instability`.
    A solver failure leaves the state as it was. Fills `report` in these rows. What becomes of a row does not depend on
    which others are stepped with it.
    """
    left, done = np.empty(len(rows), dtype=np.int64), 0
    while done < len(rows):
        count, not_stepped, not_described = step_in_lanes(legs, states, rows[done:], moves, rules, report, left)
        if not_stepped > 0:
            step_alone(legs, states, left[:not_stepped], moves, rules, report)
        if not_described > 0:
            describe_alone(legs, states, left[-not_described:], rules, report)
        done += count


@kernel
def step_in_lanes(
    legs: Array, states: States, rows: Integers, moves: Moves, rules: StepRules, report: Report, left: Integers
) -> tuple[int, int, int]:
    """Do what `step_batch` does in the first rows, as far as lock-step can; fill `left` with those where it cannot.

    Return how many rows were looked at, all, unless many of them are refused; how many are left to be stepped, the
    first of `left`; and how many have arrived and are left to `describe_alone`, the last of it. Falls and all else that
    the scalar code needs are no part of this kernel: most programs begin without them.
    """
    block, target, seen = make_block(legs.shape[0]), np.empty(legs.shape[0]), make_seen(report)
    actions, stride, common = moves.actions, moves.stride, block.common[0]
    is_cut, refused, parts = np.empty(LANES, np.bool_), np.empty(rows.shape[0], np.int64), np.empty(rows.shape[0])
    done = refused_count = 0
    for first in range(0, rows.shape[0], LANES):
        count = min(LANES, rows.shape[0] - first)
        for lane in range(count):
            row = rows[first + lane]
            is_cut[lane] = _set_target(legs, states.inputs, actions, row, stride, target)
            load_lane(states, row, target, block, lane)
        step_block(legs, block, count, states.load.shape[1])
        see_block(legs, block, count, states.load.shape[1], seen)
        for lane in range(count):
            row = rows[first + lane]
            if common.is_sound[lane] == 0.0:
                refused[refused_count], parts[refused_count] = row, growth_of_lane(common, lane)
                refused_count += 1
                continue
            store_lane(states, row, block, lane)
            report_lane(row, common, lane, seen, is_cut[lane], rules, report)
        done = first + count
        if refused_count >= _REFUSED_AT_ONCE:
            break
    if refused_count == 0:
        return done, 0, 0
    refused, parts = refused[:refused_count], parts[:refused_count]
    is_cut, targets = np.empty(refused_count, np.bool_), np.empty((refused_count, legs.shape[0]))
    for k in range(refused_count):
        is_cut[k] = _set_target(legs, states.inputs, actions, refused[k], stride, targets[k])
    has_arrived = _step_in_parts(legs, states, refused, parts, targets, block)
    odd = _report_arrived(legs, states, refused[has_arrived], is_cut[has_arrived], rules, report, block)
    left[left.shape[0] - odd.shape[0] :] = odd
    remaining = refused[~has_arrived]
    if rules.behaviour == GIVE_UP:
        _give_up(remaining, rules, report)
        return done, 0, int(odd.shape[0])
    left[: remaining.shape[0]] = remaining
    return done, int(remaining.shape[0]), int(odd.shape[0])


@kernel
def _give_up(rows: Integers, rules: StepRules, report: Report) -> None:
    """Report rows as not solved for, which nobody has tried; they are where they were."""
    for row in rows:
        report.features[row] = 0.0
        report_row(row, Tracked(SOLVER_FAILURE, 0.0, 0, 0.0, 0.0), 0.0, False, rules, report)


@kernel
def _step_in_parts(legs: Array, states: States, rows: Integers, part: Array, targets: Array, block: Block) -> Mask:
    """Move rows to the inputs `targets` (m, legs), one each, in lock-step but by parts of the way.

    The first are `part` (m,), which is used up; they are chosen as `track` chooses its steps, down to `_LEAST_PART`.
    Return which rows have arrived; the others are as they were.
    """
    count = rows.shape[0]
    own = States(states.x[rows], states.inputs[rows], states.load[rows])
    common = block.common[0]
    goal, done = np.empty(legs.shape[0]), np.zeros(count)
    going, going_count = np.arange(count), count
    while going_count > 0:
        left = 0
        for first in range(0, going_count, LANES):
            here = min(LANES, going_count - first)
            for lane in range(here):
                k = going[first + lane]
                set_way_point(states.inputs[rows[k]], targets[k], _end_of_part(done[k], part[k]), goal)
                load_lane(own, k, goal, block, lane)
            step_block(legs, block, here, states.load.shape[1])
            for lane in range(here):
                k = going[first + lane]
                if common.is_sound[lane] > 0.0:
                    store_lane(own, k, block, lane)
                    done[k] = _end_of_part(done[k], part[k])
                part[k] *= growth_of_lane(common, lane)
                if done[k] < 1.0 and part[k] >= min(_LEAST_PART, 1.0 - done[k]):
                    going[left] = k
                    left += 1
        going_count = left
    has_arrived: Mask = done == 1.0
    for k in np.flatnonzero(has_arrived):
        states.x[rows[k]], states.inputs[rows[k]] = own.x[k], own.inputs[k]
    return has_arrived


@formula
def _end_of_part(done: float, part: float) -> float:
    """Return where the next part of a way ends; the last one ends exactly at 1."""
    return done + part if part < 1.0 - done else 1.0


@kernel
def step_alone(
    legs: Array,
    states: States,
    rows: Integers,
    moves: Moves,
    rules: StepRules,
    report: Report,
) -> None:
    """Do what `step_batch` does, row by row, with all that `track` can do."""
    size = states.x.shape[1]
    line, work = make_line(legs.shape[0], size), make_workspace(legs.shape[0], size)
    x_start, inputs_start, target = np.empty(size), np.empty(legs.shape[0]), np.empty(legs.shape[0])
    falls = make_falls()
    for row in rows:
        x, inputs, load = states.x[row], states.inputs[row], states.load[row]
        x_start[:], inputs_start[:] = x, inputs
        is_cut = _set_target(legs, states.inputs, moves.actions, row, moves.stride, target)
        tracked = advance(legs, Point(x, inputs, load), target, rules.behaviour, falls, line, work)
        if tracked.event == SOLVER_FAILURE or (rules.behaviour == HOLD and is_instability(tracked.event)):
            x[:], inputs[:] = x_start, inputs_start
            place(legs, x, inputs, work)
            tracked = judge(legs, x, load, tracked.event, 0.0, work)
        set_features(legs, x, inputs, work, report.features[row])
        report_row(row, tracked, singularity_margin(legs, x, work), is_cut, rules, report)
        if tracked.event != SOLVER_FAILURE and falls[FALLS] > 0.0:
            report.verdicts[row]["losses"] = int(falls[FALLS])
            report.verdicts[row]["energy_released"] = falls[ENERGY]


def describe_batch(legs: Array, states: States, rows: Integers, report: Report) -> None:
    """Fill `report` in some rows, for states at rest: no costs, no event."""
    left, rules = np.empty(len(rows), dtype=np.int64), StepRules(TERMINATE, 0.0)
    not_described = describe_in_lanes(legs, states, rows, rules, report, left)
    if not_described > 0:
        describe_alone(legs, states, left[:not_described], rules, report)
    # where no margin is too small, nothing is cut and nothing happens, only instability would cost
    report.verdicts["cost_unstable"][rows] = 0.0
    report.verdicts["is_dwelling"][rows] = False


@kernel
def describe_in_lanes(
    legs: Array, states: States, rows: Integers, rules: StepRules, report: Report, left: Integers
) -> int:
    """Fill `report` in rows at rest; return how many are left to `describe_alone`, the first of `left`."""
    is_cut, block = np.zeros(rows.shape[0], np.bool_), make_block(legs.shape[0])
    odd = _report_arrived(legs, states, rows, is_cut, rules, report, block)
    left[: odd.shape[0]] = odd
    return int(odd.shape[0])


@kernel
def _report_arrived(
    legs: Array,
    states: States,
    rows: Integers,
    is_cut: Mask,
    rules: StepRules,
    report: Report,
    block: Block,
) -> Integers:
    """Fill `report` in rows that have gone the whole way to where they are; return those left to `describe_alone`."""
    seen, common, odd, odd_count = make_seen(report), block.common[0], np.empty_like(rows), 0
    for first in range(0, rows.shape[0], LANES):
        count = min(LANES, rows.shape[0] - first)
        for lane in range(count):
            row = rows[first + lane]
            load_lane(states, row, states.inputs[row], block, lane)
        rest_block(legs, block, count, states.load.shape[1])
        see_block(legs, block, count, states.load.shape[1], seen)
        for lane in range(count):
            row, is_here_cut = rows[first + lane], is_cut[first + lane]
            if common.is_sound[lane] == 0.0:
                report.verdicts[row]["at_limit"] = is_here_cut
                odd[odd_count] = row
                odd_count += 1
            else:
                report_lane(row, common, lane, seen, is_here_cut, rules, report)
    return odd[:odd_count]


@kernel
def describe_alone(legs: Array, states: States, rows: Integers, rules: StepRules, report: Report) -> None:
    """Fill `report` in rows that have gone the whole way; it tells already whether their increment was cut."""
    work = make_workspace(legs.shape[0], states.x.shape[1])
    for row in rows:
        x, inputs, is_cut = states.x[row], states.inputs[row], report.verdicts[row]["at_limit"]
        place(legs, x, inputs, work)
        tracked = judge(legs, x, states.load[row], NONE, 1.0, work)
        set_features(legs, x, inputs, work, report.features[row])
        report_row(row, tracked, singularity_margin(legs, x, work), is_cut, rules, report)


@formula
def _set_target(legs: Array, inputs: Array, actions: Array, row: int, stride: Array, target: Array) -> bool:
    """Set the inputs that an action leads to; return whether they are cut at a limit."""
    is_cut = False
    for i in range(legs.shape[0]):
        wish = inputs[row, i] + min(max(actions[row, i], -1.0), 1.0) * stride[i]
        target[i] = min(max(wish, legs[i, LOWER]), legs[i, UPPER])
        is_cut = is_cut or target[i] != wish
    return is_cut
