"""Walks of many rows at once along stable equilibria, towards inputs: how starts and goals are drawn."""

from typing import NamedTuple

import numpy as np

from pcm_gym.arrays import Array, Integers
from pcm_gym.kernels.branches.continuation import NONE, make_line, track_in_one_step
from pcm_gym.kernels.branches.tracer import Tracer
from pcm_gym.kernels.lockstep.lanes import step_block
from pcm_gym.kernels.lockstep.layout import LANES, CommonLanes, make_block
from pcm_gym.kernels.lockstep.rows import load_lane, store_lane
from pcm_gym.kernels.numerics.compilation import formula, kernel
from pcm_gym.kernels.numerics.rasters import NOWHERE
from pcm_gym.kernels.statics.closure import Workspace, make_workspace
from pcm_gym.kernels.statics.margin import singularity_margin
from pcm_gym.kernels.statics.states import Point, States

# A step that is refused is halved, down to this part of it, which is then made alone.
_LEAST_PART = 0.25


class _Walked(NamedTuple):
    """How walks have gone so far."""

    part: Array  # (n,): of a step, that is tried next
    left: Array  # (n,): steps
    refused: Integers  # (n,): rows whose next step lock-step cannot make, the first of these


def walk(legs: Array, states: States, targets: Array, stride: Array, steps: Integers, least_margin: float) -> None:
    """Walk in every row towards the inputs `targets` (n, legs) in increments of at most `stride`, in place.

    A walk ends at its target, after `steps` (n,) steps, or before the first one that, made in quarters, would leave
    the stable branch or come nearer to a fold than `least_margin`. So whoever repeats the walk meets neither.
    """
    count, rows = len(steps), np.arange(len(steps))
    walked = _Walked(np.ones(count), steps.astype(np.float64), np.empty(count, dtype=np.int64))
    while count > 0:
        count = walk_in_lanes(legs, states, targets, stride, walked, least_margin, rows)
        rows = walked.refused[:count].copy()
        if count > 0:
            _step_alone(legs, states, targets, stride, walked, least_margin, rows)


@kernel
def walk_in_lanes(
    legs: Array,
    states: States,
    targets: Array,
    stride: Array,
    walked: _Walked,
    least_margin: float,
    rows: Integers,
) -> int:
    """Walk in some rows, whose array is used up, as far as lock-step can; return how many it refuses."""
    block, goal, refused_count = make_block(legs.shape[0]), np.empty(legs.shape[0]), 0
    part, left = walked.part, walked.left
    count = _keep_walking(states, targets, left, rows, rows.shape[0])
    while count > 0:
        for first in range(0, count, LANES):
            here = min(LANES, count - first)
            for lane in range(here):
                row = rows[first + lane]
                _set_goal(states.inputs[row], targets[row], stride, min(part[row], left[row]), goal)
                load_lane(states, row, goal, block, lane)
            step_block(legs, block, here, states.load.shape[1])
            for lane in range(here):
                row = rows[first + lane]
                if block.common[0].is_sound[lane] == 0.0:
                    if part[row] > _LEAST_PART:
                        part[row] *= 0.5
                    else:
                        walked.refused[refused_count] = row
                        refused_count += 1
                        rows[first + lane] = NOWHERE
                    continue
                made = min(part[row], left[row])
                is_kept = _is_kept(block.common[0], lane, least_margin)
                if is_kept:
                    store_lane(states, row, block, lane)
                left[row] = left[row] - made if is_kept else 0.0
        count = _keep_walking(states, targets, left, rows, count)
    return refused_count


@kernel
def _step_alone(
    legs: Array,
    states: States,
    targets: Array,
    stride: Array,
    walked: _Walked,
    least_margin: float,
    rows: Integers,
) -> None:
    """Make the next step of walks in rows where lock-step cannot, by all that `track` can do."""
    line, work = make_line(legs.shape[0], states.x.shape[1]), make_workspace(legs.shape[0], states.x.shape[1])
    goal, part, left = np.empty(legs.shape[0]), walked.part, walked.left
    for row in rows:
        made = min(part[row], left[row])
        _set_goal(states.inputs[row], targets[row], stride, made, goal)
        is_kept = _walk_alone(legs, states, row, goal, least_margin, line, work)
        left[row] = left[row] - made if is_kept else 0.0


@formula
def _is_kept(common: CommonLanes, lane: int, least_margin: float) -> bool:
    is_far: bool = common.singularity_margin[lane] >= least_margin
    return is_far and common.index[lane] == 0.0


@kernel
def _set_goal(inputs: Array, target: Array, stride: Array, part: float, goal: Array) -> None:
    """Set the inputs after the next step towards `target`, of at most a part of the stride."""
    ratio = 1.0
    for i in range(inputs.shape[0]):
        ratio = max(ratio, abs(target[i] - inputs[i]) / (part * stride[i]))
    for i in range(inputs.shape[0]):
        goal[i] = inputs[i] + (target[i] - inputs[i]) / ratio


@kernel
def _walk_alone(
    legs: Array, states: States, row: int, goal: Array, least_margin: float, line: Tracer, work: Workspace
) -> bool:
    """Make one step of a walk outside the block, or leave the row as it was; return whether it was made."""
    point = Point(states.x[row].copy(), states.inputs[row].copy(), states.load[row])
    tracked = track_in_one_step(legs, point, goal, line, work)
    if tracked.event != NONE or tracked.morse_index > 0 or singularity_margin(legs, point.x, work) < least_margin:
        return False
    states.x[row], states.inputs[row] = point.x, point.inputs
    return True


@kernel
def _keep_walking(states: States, targets: Array, left: Array, rows: Integers, count: int) -> int:
    """Move the rows that have further to walk to the front, `NOWHERE` left out; return how many they are."""
    kept = 0
    for k in range(count):
        row, is_there = rows[k], True
        if row == NOWHERE:
            continue
        for i in range(targets.shape[1]):
            is_there = is_there and states.inputs[row, i] == targets[row, i]
        if left[row] > 0.0 and not is_there:
            rows[kept] = row
            kept += 1
    return kept
