"""What is reported of a batch after a step: costs, verdicts and features, one row per environment."""

from typing import NamedTuple, TypedDict

import numpy as np

from pcm_gym.arrays import Array, Records
from pcm_gym.kernels.branches.continuation import ACTUATOR_LIMIT, FOLD, NONE, SOLVER_FAILURE, Tracked
from pcm_gym.kernels.lockstep.layout import LANES, CommonLanes
from pcm_gym.kernels.numerics.compilation import formula, kernel
from pcm_gym.kernels.snaps.instability import CONTINUE, TERMINATE, is_instability
from pcm_gym.kernels.stepping.features import STABILITY_FEATURES, stability_features


class Costs(TypedDict):
    """What a step costs, 0 or 1 each; the names are those of the infos."""

    cost_unstable: float  # stability was lost on the way, or the state is unstable
    cost_singular: float  # the singularity margin is below that of the rules
    cost_solver: float  # the solver failed


class Verdict(Costs):
    """What a step has cost and led to; the first names, up to `at_limit`, and the last three are those of the infos."""

    index: int  # Morse index of the state
    stability_margin: float
    singularity_margin: float
    residual: float
    event: int  # why the step ended, see `continuation`
    at_limit: bool  # whether an increment was cut at an actuator's limit
    losses: int  # of stability on the way: events
    is_dwelling: bool  # whether the state is nearly singular, or unstable
    energy_released: float  # in falls on the way
    fraction: float  # of the way that was gone
    is_lost: bool  # whether a loss of stability ends the episode
    is_stable: bool  # whether the state is stable, and is not left by a loss of stability
    # Whether a limit of the structure is broken, 0 or 1 each: told where it is asked for.
    cost_stress: float
    cost_torque: float
    cost_contact: float


# A verdict as the kernels write it: an element of an array.
VERDICT_TYPE = np.dtype(list(Verdict.__annotations__.items()), align=True)


class Moves(NamedTuple):
    """Where the rows are to go: their inputs change by the actions, cut to [-1, 1], times the stride."""

    actions: Array  # (n, legs)
    stride: Array  # (legs,): increment of each input for an action of 1


class StepRules(NamedTuple):
    """What comes of a step. Numbers alone: a record with arrays costs at every call that is not inlined."""

    behaviour: int  # where stability is lost, see `instability`
    singular_margin: float  # states with a smaller singularity margin cost `cost_singular`


class Report(NamedTuple):
    """What is reported of the states of a batch after a step."""

    verdicts: Records  # (n,) of `VERDICT_TYPE`
    features: Array  # (n, m)


def empty_report(count: int, feature_count: int) -> Report:
    """Return a report for so many rows, to be filled."""
    # zeros, because bytes between fields count too where reports are compared to the last bit
    return Report(np.zeros(count, VERDICT_TYPE), np.empty((count, feature_count)))


@kernel
def make_seen(report: Report) -> Array:
    """Return an array for the features of a block, (m, lanes)."""
    return np.empty((report.features.shape[1], LANES))


@formula
def _verdict(common: CommonLanes, lane: int) -> Tracked:
    """Return the verdict on a lane that has gone the whole way."""
    return Tracked(NONE, 1.0, int(common.index[lane]), common.stability_margin[lane], common.error[lane])


@formula
def report_lane(
    row: int,
    common: CommonLanes,
    lane: int,
    seen: Array,
    is_cut: bool,
    rules: StepRules,
    report: Report,
) -> None:
    """Fill `report` in the row of a lane that has gone the whole way, with what is seen of its block."""
    for n in range(seen.shape[0]):
        report.features[row, n] = seen[n, lane]
    report_row(row, _verdict(common, lane), common.singularity_margin[lane], is_cut, rules, report)


@formula
def report_row(
    row: int,
    tracked: Tracked,
    margin: float,
    is_cut: bool,
    rules: StepRules,
    report: Report,
) -> None:
    """Fill costs and verdict of a row, and the features that tell of its stability."""
    verdict, is_unstable = report.verdicts[row], tracked.morse_index > 0
    is_lost = _ends(tracked.event, rules.behaviour)
    is_stable = not (is_unstable | is_lost)
    verdict["cost_unstable"] = 1.0 if is_unstable or is_instability(tracked.event) else 0.0
    verdict["cost_singular"] = 1.0 if margin < rules.singular_margin else 0.0
    verdict["cost_solver"] = 1.0 if tracked.event == SOLVER_FAILURE else 0.0
    verdict["index"] = tracked.morse_index
    verdict["stability_margin"] = tracked.stability_margin
    verdict["singularity_margin"] = margin
    verdict["residual"] = tracked.residual
    verdict["event"] = ACTUATOR_LIMIT if is_cut and tracked.event == NONE else tracked.event
    verdict["at_limit"] = is_cut
    verdict["losses"] = 1 if is_instability(tracked.event) else 0
    verdict["is_dwelling"] = is_unstable | (margin < rules.singular_margin)
    verdict["energy_released"] = 0.0
    verdict["fraction"] = tracked.fraction
    verdict["is_lost"] = is_lost
    verdict["is_stable"] = is_stable
    features = report.features
    n = features.shape[1] - STABILITY_FEATURES
    shown = stability_features(is_stable, tracked.stability_margin, margin)
    features[row, n], features[row, n + 1], features[row, n + 2] = shown


@formula
def _ends(event: int, behaviour: int) -> bool:
    """Return whether the event ends the episode: the mechanism would leave the state, and is not followed further."""
    return ((behaviour == TERMINATE) & is_instability(event)) | ((behaviour == CONTINUE) & (event == FOLD))
