"""One step of many mechanisms at once: increments of the inputs in, tracked states, costs and features out."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pcm_gym.kernels import lanes
from pcm_gym.kernels.closure import (
    FORCE_X,
    FORCE_Y,
    HALF_PERIODS,
    LENGTH,
    LOWER,
    STIFFNESS,
    TURN,
    UPPER,
    Workspace,
    evaluate_rods,
    make_workspace,
    set_inputs,
)
from pcm_gym.kernels.compilation import formula, kernel
from pcm_gym.kernels.continuation import (
    ACTUATOR_LIMIT,
    FOLD,
    NONE,
    SOLVER_FAILURE,
    Line,
    Tracked,
    judge,
    make_line,
    track_in_one_step,
)
from pcm_gym.kernels.instability import CONTINUE, HOLD, TERMINATE, advance, is_instability
from pcm_gym.kernels.lanes import LANES, Block, make_block, residual, rest_block, step_block
from pcm_gym.kernels.lanes_margin import set_margins
from pcm_gym.kernels.margin import singularity_margin

Array = NDArray[np.float64]
Rows = NDArray[np.int64]
Mask = NDArray[np.bool_]

# Loads are shown to agents as g / (_LOAD_SCALE + |g|), stiffnesses and distances from a fold likewise: smooth, bounded.
_LOAD_SCALE = 10.0
_STIFFNESS_SCALE = 20.0
_DISTANCE_SCALE = 0.1

# A step that is refused is halved, down to this part of it, before it is tracked alone.
_LEAST_PART = 0.25

# Rows of the verdicts on states, one column per environment.
MORSE_INDEX, STABILITY_MARGIN, SINGULARITY_MARGIN, RESIDUAL, EVENT, FRACTION, LOST = range(7)
VERDICT_ROWS = 7
# Rows of the costs of steps.
UNSTABLE, SINGULAR, LIMIT, SOLVER = range(4)
COST_ROWS = 4

# Features of a state that every mechanism has once, and those that each leg has.
STABILITY_FEATURES, ROD_FEATURES = 3, 5


class States(NamedTuple):
    """The dynamic state of a batch, one row per environment; everything else follows from it."""

    x: Array  # (n, size)
    inputs: Array  # (n, legs)
    load: Array  # (n, d)


class Report(NamedTuple):
    """What is told about the states of a batch after a step."""

    verdicts: Array  # (7, n)
    costs: Array  # (4, n)
    features: Array  # (n, m)


@kernel
def step_batch(
    legs: Array,
    states: States,
    rows: Rows,
    actions: Array,
    stride: Array,
    behaviour: int,
    singular_margin: float,
    report: Report,
) -> None:
    """Move the inputs of some rows by their actions (n, legs), cut to [-1, 1], times `stride`, in place.

    Inputs beyond an actuator's limit are cut. Rows that would lose stability do as `behaviour` says, see `instability`.
    A solver failure leaves the state as it was. Fills `report` in these rows. What becomes of a row does not depend on
    which others are stepped with it.
    """
    block, target, seen = make_block(legs.shape[0]), np.empty(legs.shape[0]), _make_seen(report)
    is_cut, refused, refused_count = np.empty(LANES, np.bool_), np.empty(rows.shape[0], np.int64), 0
    for first in range(0, rows.shape[0], LANES):
        count = min(LANES, rows.shape[0] - first)
        for lane in range(count):
            row = rows[first + lane]
            is_cut[lane] = _set_target(legs, states.inputs[row], actions[row], stride, target)
            load_lane(states, row, target, block, lane)
        computed = step_block(legs, block, count, states.load.shape[1])
        _see_block(legs, block, count, computed, states.load.shape[1], seen)
        for lane in range(count):
            row = rows[first + lane]
            if block.common[lanes.IS_SOUND + lane] == 0.0:
                refused[refused_count] = row
                refused_count += 1
                continue
            _store_lane(states, row, block, lane)
            _report_lane(row, block, lane, seen, is_cut[lane], behaviour, singular_margin, report)
    if refused_count > 0:
        _step_refused(legs, states, refused[:refused_count], actions, stride, behaviour, singular_margin, report, block)


@kernel
def _step_refused(
    legs: Array,
    states: States,
    rows: Rows,
    actions: Array,
    stride: Array,
    behaviour: int,
    singular_margin: float,
    report: Report,
    block: Block,
) -> None:
    """Do what `step_batch` does in rows whose step over the whole way is refused: by parts of it, or else alone."""
    count = rows.shape[0]
    targets, is_cut = np.empty((count, legs.shape[0])), np.empty(count, np.bool_)
    for k in range(count):
        is_cut[k] = _set_target(legs, states.inputs[rows[k]], actions[rows[k]], stride, targets[k])
    has_arrived = _step_in_parts(legs, states, rows, targets, block)
    _tell(legs, states, rows[has_arrived], is_cut[has_arrived], behaviour, singular_margin, report, block)
    step_alone(legs, states, rows[~has_arrived], actions, stride, behaviour, singular_margin, report)


@kernel
def _step_in_parts(legs: Array, states: States, rows: Rows, targets: Array, block: Block) -> Mask:
    """Move rows to the inputs `targets` (m, legs), one each, in lock-step but by parts of the way, halved and doubled.

    Parts are chosen as `track` chooses them, down to `_LEAST_PART`. Return which rows have arrived; the others are as
    they were.
    """
    count = rows.shape[0]
    own = States(states.x[rows], states.inputs[rows], states.load[rows])
    goal, done, part = np.empty(legs.shape[0]), np.zeros(count), np.full(count, 0.5)
    going, going_count = np.arange(count), count
    while going_count > 0:
        left = 0
        for first in range(0, going_count, LANES):
            here = min(LANES, going_count - first)
            for lane in range(here):
                k = going[first + lane]
                _set_way_point(states.inputs[rows[k]], targets[k], done[k] + part[k], goal)
                load_lane(own, k, goal, block, lane)
            step_block(legs, block, here, states.load.shape[1])
            for lane in range(here):
                k = going[first + lane]
                if block.common[lanes.IS_SOUND + lane] == 0.0:
                    part[k] *= 0.5
                else:
                    _store_lane(own, k, block, lane)
                    done[k] += part[k]
                    part[k] = min(2.0 * part[k], 1.0 - done[k])
                if done[k] < 1.0 and part[k] >= _LEAST_PART:
                    going[left] = k
                    left += 1
        going_count = left
    for k in range(count):
        if done[k] == 1.0:
            states.x[rows[k]], states.inputs[rows[k]] = own.x[k], own.inputs[k]
    has_arrived: Mask = done == 1.0
    return has_arrived


@kernel
def _set_way_point(start: Array, target: Array, fraction: float, point: Array) -> None:
    for i in range(start.shape[0]):
        point[i] = target[i] if fraction == 1.0 else start[i] + fraction * (target[i] - start[i])


@kernel
def step_alone(
    legs: Array,
    states: States,
    rows: Rows,
    actions: Array,
    stride: Array,
    behaviour: int,
    singular_margin: float,
    report: Report,
) -> None:
    """Do what `step_batch` does, row by row, with all that `track` can do."""
    size = states.x.shape[1]
    line, work = make_line(legs.shape[0], size), make_workspace(legs.shape[0], size)
    x_start, inputs_start, target = np.empty(size), np.empty(legs.shape[0]), np.empty(legs.shape[0])
    for row in rows:
        x, inputs, load = states.x[row], states.inputs[row], states.load[row]
        x_start[:], inputs_start[:] = x, inputs
        is_cut = _set_target(legs, inputs, actions[row], stride, target)
        tracked = advance(legs, x, inputs, load, target, behaviour, line, work)
        if tracked.event == SOLVER_FAILURE or (behaviour == HOLD and is_instability(tracked.event)):
            x[:], inputs[:] = x_start, inputs_start
            set_inputs(legs, inputs, work)
            evaluate_rods(legs, x, work)
            tracked = judge(legs, x, load, tracked.event, 0.0, work)
        set_features(legs, x, inputs, work, report.features[row])
        _report(row, tracked, singularity_margin(legs, x, work), is_cut, behaviour, singular_margin, report)


@kernel
def describe_batch(legs: Array, states: States, rows: Rows, report: Report) -> None:
    """Fill `report` in some rows, for states at rest: no costs, no event."""
    is_cut = np.zeros(rows.shape[0], np.bool_)
    _tell(legs, states, rows, is_cut, TERMINATE, 0.0, report, make_block(legs.shape[0]))
    for row in rows:
        report.costs[:, row] = 0.0


@kernel
def _tell(
    legs: Array,
    states: States,
    rows: Rows,
    is_cut: Mask,
    behaviour: int,
    singular_margin: float,
    report: Report,
    block: Block,
) -> None:
    """Fill `report` in rows that have gone the whole way to where they are."""
    seen, work = _make_seen(report), make_workspace(legs.shape[0], states.x.shape[1])
    for first in range(0, rows.shape[0], LANES):
        count = min(LANES, rows.shape[0] - first)
        for lane in range(count):
            row = rows[first + lane]
            load_lane(states, row, states.inputs[row], block, lane)
        computed = rest_block(legs, block, count, states.load.shape[1])
        _see_block(legs, block, count, computed, states.load.shape[1], seen)
        for lane in range(count):
            row, is_here_cut = rows[first + lane], is_cut[first + lane]
            if block.common[lanes.IS_SOUND + lane] == 0.0:
                x, inputs = states.x[row], states.inputs[row]
                set_inputs(legs, inputs, work)
                evaluate_rods(legs, x, work)
                tracked = judge(legs, x, states.load[row], NONE, 1.0, work)
                set_features(legs, x, inputs, work, report.features[row])
                margin = singularity_margin(legs, x, work)
                _report(row, tracked, margin, is_here_cut, behaviour, singular_margin, report)
            else:
                _report_lane(row, block, lane, seen, is_here_cut, behaviour, singular_margin, report)


@kernel
def _set_target(legs: Array, inputs: Array, action: Array, stride: Array, target: Array) -> bool:
    is_cut = False
    for i in range(legs.shape[0]):
        wish = inputs[i] + min(max(action[i], -1.0), 1.0) * stride[i]
        target[i] = min(max(wish, legs[i, LOWER]), legs[i, UPPER])
        is_cut = is_cut or target[i] != wish
    return is_cut


@kernel
def load_lane(states: States, row: int, target: Array, block: Block, lane: int) -> None:
    """Put the state of a row, and the inputs that it is to move to, into a lane."""
    common, leg_count, dof = block.common, block.legs.shape[0], states.load.shape[1]
    for i in range(leg_count):
        leg = block.legs[i]
        leg[lanes.G_X + lane], leg[lanes.G_Y + lane] = states.x[row, 2 * i], states.x[row, 2 * i + 1]
        leg[lanes.INPUT + lane], leg[lanes.TARGET + lane] = states.inputs[row, i], target[i]
    for d in range(3):
        common[lanes.X + d * LANES + lane] = states.x[row, 2 * leg_count + d] if d < dof else 0.0
        common[lanes.LOAD_X + d * LANES + lane] = states.load[row, d] if d < dof else 0.0


@kernel
def _store_lane(states: States, row: int, block: Block, lane: int) -> None:
    """Put the state that a lane has come to into its row."""
    common, leg_count = block.common, block.legs.shape[0]
    for i in range(leg_count):
        leg = block.legs[i]
        states.x[row, 2 * i], states.x[row, 2 * i + 1] = leg[lanes.G_X + lane], leg[lanes.G_Y + lane]
        states.inputs[row, i] = leg[lanes.TARGET + lane]
    for d in range(states.load.shape[1]):
        states.x[row, 2 * leg_count + d] = common[lanes.X + d * LANES + lane]


@formula
def _verdict(common: Array, lane: int) -> Tracked:
    """Return the verdict on a lane that has gone the whole way."""
    return Tracked(
        NONE,
        1.0,
        int(common[lanes.INDEX + lane]),
        common[lanes.STABILITY_MARGIN + lane],
        residual(common, lane),
    )


@kernel
def _make_seen(report: Report) -> Array:
    """Return an array for the features of a block, (m, lanes)."""
    return np.empty((report.features.shape[1], LANES))


@kernel
def _report_lane(
    row: int,
    block: Block,
    lane: int,
    seen: Array,
    is_cut: bool,
    behaviour: int,
    singular_margin: float,
    report: Report,
) -> None:
    """Fill `report` in the row of a lane that has gone the whole way, with what is seen of its block."""
    for n in range(seen.shape[0]):
        report.features[row, n] = seen[n, lane]
    margin = block.common[lanes.SINGULARITY_MARGIN + lane]
    _report(row, _verdict(block.common, lane), margin, is_cut, behaviour, singular_margin, report)


@kernel
def _report(
    row: int,
    tracked: Tracked,
    margin: float,
    is_cut: bool,
    behaviour: int,
    singular_margin: float,
    report: Report,
) -> None:
    """Fill verdict and costs of a row, and the features that tell of its stability."""
    verdicts, costs, features = report.verdicts, report.costs, report.features[row]
    is_unstable = tracked.morse_index > 0
    costs[UNSTABLE, row] = 1.0 if is_unstable or is_instability(tracked.event) else 0.0
    costs[SINGULAR, row] = 1.0 if margin < singular_margin else 0.0
    costs[LIMIT, row] = 1.0 if is_cut else 0.0
    costs[SOLVER, row] = 1.0 if tracked.event == SOLVER_FAILURE else 0.0
    verdicts[MORSE_INDEX, row] = tracked.morse_index
    verdicts[STABILITY_MARGIN, row] = tracked.stability_margin
    verdicts[SINGULARITY_MARGIN, row] = margin
    verdicts[RESIDUAL, row] = tracked.residual
    verdicts[EVENT, row] = ACTUATOR_LIMIT if is_cut and tracked.event == NONE else tracked.event
    verdicts[FRACTION, row] = tracked.fraction
    verdicts[LOST, row] = 1.0 if _ends(tracked.event, behaviour) else 0.0
    n = features.shape[0] - STABILITY_FEATURES
    features[n] = 0.0 if is_unstable or verdicts[LOST, row] > 0.0 else 1.0
    features[n + 1] = tracked.stability_margin / (_STIFFNESS_SCALE + abs(tracked.stability_margin))
    features[n + 2] = margin / (_DISTANCE_SCALE + margin)


@formula
def _ends(event: int, behaviour: int) -> bool:
    """Return whether the event ends the episode: the mechanism would leave the state, and is not followed further."""
    return ((behaviour == TERMINATE) & is_instability(event)) | ((behaviour == CONTINUE) & (event == FOLD))


@kernel
def set_features(legs: Array, x: Array, inputs: Array, work: Workspace, out: Array) -> None:
    """Fill `out` with the features of a state at the rod table, but for its stability: pose, inputs, rods."""
    pose, n = 2 * legs.shape[0], 2
    out[0], out[1] = x[pose], x[pose + 1]
    if x.shape[0] - pose == 3:
        out[2], out[3] = math.cos(x[pose + 2]), math.sin(x[pose + 2])
        n = 4
    for i in range(legs.shape[0]):
        out[n] = _input_feature(inputs[i], legs[i, LOWER], legs[i, UPPER])
        n += 1
        if legs[i, TURN] != 0.0:
            out[n], out[n + 1] = work.clamps[i, 2], work.clamps[i, 3]
            n += 2
    for i in range(legs.shape[0]):
        rod, clamp = work.rods[i], work.clamps[i]
        force = (rod[FORCE_X], rod[FORCE_Y])
        features = _rod_features(
            x[2 * i], x[2 * i + 1], force, clamp[2], clamp[3], _force_unit(legs, i), rod[HALF_PERIODS]
        )
        for k in range(ROD_FEATURES):
            out[n + k] = features[k]
        n += ROD_FEATURES


@kernel
def _see_block(legs: Array, block: Block, count: int, computed: int, dof: int, out: Array) -> None:
    """Fill the margins of lanes that are evaluated and judged, and `out` (m, lanes) as `set_features` does."""
    set_margins(legs, block, computed, dof)
    common, n = block.common, 2
    out[0], out[1] = common[lanes.X : lanes.X + LANES], common[lanes.Y : lanes.Y + LANES]
    if dof == 3:
        out[2] = common[lanes.TURN_C : lanes.TURN_C + LANES]
        out[3] = common[lanes.TURN_S : lanes.TURN_S + LANES]
        n = 4
    for i in range(legs.shape[0]):
        leg, lower, upper = block.legs[i], legs[i, LOWER], legs[i, UPPER]
        for lane in range(count):
            out[n, lane] = _input_feature(leg[lanes.TARGET + lane], lower, upper)
        n += 1
        if legs[i, TURN] != 0.0:
            out[n] = leg[lanes.CLAMP_C : lanes.CLAMP_C + LANES]
            out[n + 1] = leg[lanes.CLAMP_S : lanes.CLAMP_S + LANES]
            n += 2
    for i in range(legs.shape[0]):
        _see_rod(block.legs[i], count, _force_unit(legs, i), out[n : n + ROD_FEATURES].reshape(-1))
        n += ROD_FEATURES


@kernel
def _see_rod(leg: Array, count: int, force_unit: float, out: Array) -> None:
    for lane in range(count):
        g_x, g_y = leg[lanes.G_X + lane], leg[lanes.G_Y + lane]
        force, half_periods = (leg[lanes.FORCE_X + lane], leg[lanes.FORCE_Y + lane]), leg[lanes.HALF_PERIODS + lane]
        clamp_c, clamp_s = leg[lanes.CLAMP_C + lane], leg[lanes.CLAMP_S + lane]
        features = _rod_features(g_x, g_y, force, clamp_c, clamp_s, force_unit, half_periods)
        out[lane] = features[0]
        out[LANES + lane] = features[1]
        out[2 * LANES + lane] = features[2]
        out[3 * LANES + lane] = features[3]
        out[4 * LANES + lane] = features[4]


@formula
def _input_feature(value: float, lower: float, upper: float) -> float:
    return (2.0 * value - lower - upper) / (upper - lower)


@formula
def _force_unit(legs: Array, leg: int) -> float:
    """Return the factor that makes the force on a rod dimensionless."""
    length, stiffness = float(legs[leg, LENGTH]), float(legs[leg, STIFFNESS])
    return length * length / stiffness


@formula
def _rod_features(
    g_x: float,
    g_y: float,
    force: tuple[float, float],
    clamp_c: float,
    clamp_s: float,
    force_unit: float,
    half_periods: float,
) -> tuple[float, float, float, float, float]:
    scale = 1.0 / (_LOAD_SCALE + math.sqrt(g_x * g_x + g_y * g_y))
    along, across = clamp_c * force[0] + clamp_s * force[1], clamp_c * force[1] - clamp_s * force[0]
    force_scale = scale * force_unit
    return scale * g_x, scale * g_y, force_scale * along, force_scale * across, half_periods / (1.0 + half_periods)


@kernel
def wander(legs: Array, states: States, targets: Array, stride: Array, steps: Rows, least_margin: float) -> None:
    """Walk in every row towards the inputs `targets` (n, legs) in increments of at most `stride`, in place.

    A walk ends at its target, after `steps` (n,) steps, or before the first one that, made in quarters, would leave
    the stable branch or come nearer to a fold than `least_margin`. So whoever repeats the walk meets neither.
    """
    all_count, size = states.x.shape
    line, work, block = make_line(legs.shape[0], size), make_workspace(legs.shape[0], size), make_block(legs.shape[0])
    goal, part, left = np.empty(legs.shape[0]), np.ones(all_count), steps.astype(np.float64)
    rows = np.arange(all_count)
    count = _keep_walking(states, targets, left, rows, all_count)
    while count > 0:
        for first in range(0, count, LANES):
            here = min(LANES, count - first)
            for lane in range(here):
                row = rows[first + lane]
                _set_goal(states.inputs[row], targets[row], stride, min(part[row], left[row]), goal)
                load_lane(states, row, goal, block, lane)
            computed = step_block(legs, block, here, states.load.shape[1])
            set_margins(legs, block, computed, states.load.shape[1])
            for lane in range(here):
                row = rows[first + lane]
                is_refused = block.common[lanes.IS_SOUND + lane] == 0.0
                if is_refused and part[row] > _LEAST_PART:
                    part[row] *= 0.5
                    continue
                made = min(part[row], left[row])
                if is_refused:
                    _set_goal(states.inputs[row], targets[row], stride, made, goal)
                    is_kept = _wander_alone(legs, states, row, goal, least_margin, line, work)
                else:
                    is_kept = _is_kept(block.common, lane, least_margin)
                    if is_kept:
                        _store_lane(states, row, block, lane)
                left[row] = left[row] - made if is_kept else 0.0
        count = _keep_walking(states, targets, left, rows, count)


@formula
def _is_kept(common: Array, lane: int, least_margin: float) -> bool:
    is_far: bool = common[lanes.SINGULARITY_MARGIN + lane] >= least_margin
    return is_far and common[lanes.INDEX + lane] == 0.0


@kernel
def _set_goal(inputs: Array, target: Array, stride: Array, part: float, goal: Array) -> None:
    """Set the inputs after the next step towards `target`, of at most a part of the stride."""
    ratio = 1.0
    for i in range(inputs.shape[0]):
        ratio = max(ratio, abs(target[i] - inputs[i]) / (part * stride[i]))
    for i in range(inputs.shape[0]):
        goal[i] = inputs[i] + (target[i] - inputs[i]) / ratio


@kernel
def _wander_alone(
    legs: Array, states: States, row: int, goal: Array, least_margin: float, line: Line, work: Workspace
) -> bool:
    """Make one step of a walk outside the block, or leave the row as it was; return whether it was made."""
    x, inputs, load = states.x[row].copy(), states.inputs[row].copy(), states.load[row]
    tracked = track_in_one_step(legs, x, inputs, load, goal, line, work)
    if tracked.event != NONE or tracked.morse_index > 0 or singularity_margin(legs, x, work) < least_margin:
        return False
    states.x[row], states.inputs[row] = x, inputs
    return True


@kernel
def _keep_walking(states: States, targets: Array, left: Array, rows: Rows, count: int) -> int:
    """Move the rows that have further to walk to the front; return how many they are."""
    kept = 0
    for k in range(count):
        row, is_there = rows[k], True
        for i in range(targets.shape[1]):
            is_there = is_there and states.inputs[row, i] == targets[row, i]
        if left[row] > 0.0 and not is_there:
            rows[kept] = row
            kept += 1
    return kept
