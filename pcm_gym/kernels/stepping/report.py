"""What is told about a batch after a step: verdicts, costs and features, one row per environment."""

from typing import NamedTuple

import numpy as np

from pcm_gym.arrays import Array
from pcm_gym.kernels.branches.continuation import ACTUATOR_LIMIT, FOLD, NONE, SOLVER_FAILURE, Tracked
from pcm_gym.kernels.lockstep.layout import LANES, CommonLanes
from pcm_gym.kernels.lockstep.verdicts import residual
from pcm_gym.kernels.numerics.compilation import formula, kernel
from pcm_gym.kernels.snaps.instability import CONTINUE, TERMINATE, is_instability
from pcm_gym.kernels.stepping.features import set_stability_features

# Rows of the verdicts on states, one column per environment.
MORSE_INDEX, STABILITY_MARGIN, SINGULARITY_MARGIN, RESIDUAL, EVENT, FRACTION, LOST = range(7)
VERDICT_ROWS = 7
# Rows of the costs of steps.
UNSTABLE, SINGULAR, LIMIT, SOLVER = range(4)
COST_ROWS = 4


class StepRules(NamedTuple):
    """What the agent's actions mean, and what comes of a step."""

    stride: Array  # (legs,): increment of each input for an action of 1
    behaviour: int  # where stability is lost, see `instability`
    singular_margin: float  # states with a smaller singularity margin cost `SINGULAR`


class Report(NamedTuple):
    """What is told about the states of a batch after a step."""

    verdicts: Array  # (7, n)
    costs: Array  # (4, n)
    features: Array  # (n, m)


@kernel
def make_seen(report: Report) -> Array:
    """Return an array for the features of a block, (m, lanes)."""
    return np.empty((report.features.shape[1], LANES))


@formula
def _verdict(common: CommonLanes, lane: int) -> Tracked:
    """Return the verdict on a lane that has gone the whole way."""
    return Tracked(NONE, 1.0, int(common.index[lane]), common.stability_margin[lane], residual(common, lane))


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
    """Fill verdict and costs of a row, and the features that tell of its stability."""
    verdicts, costs = report.verdicts, report.costs
    is_unstable = tracked.morse_index > 0
    costs[UNSTABLE, row] = 1.0 if is_unstable or is_instability(tracked.event) else 0.0
    costs[SINGULAR, row] = 1.0 if margin < rules.singular_margin else 0.0
    costs[LIMIT, row] = 1.0 if is_cut else 0.0
    costs[SOLVER, row] = 1.0 if tracked.event == SOLVER_FAILURE else 0.0
    verdicts[MORSE_INDEX, row] = tracked.morse_index
    verdicts[STABILITY_MARGIN, row] = tracked.stability_margin
    verdicts[SINGULARITY_MARGIN, row] = margin
    verdicts[RESIDUAL, row] = tracked.residual
    verdicts[EVENT, row] = ACTUATOR_LIMIT if is_cut and tracked.event == NONE else tracked.event
    verdicts[FRACTION, row] = tracked.fraction
    verdicts[LOST, row] = 1.0 if _ends(tracked.event, rules.behaviour) else 0.0
    is_stable = not (is_unstable or verdicts[LOST, row] > 0.0)
    set_stability_features(report.features, row, is_stable, tracked.stability_margin, margin)


@formula
def _ends(event: int, behaviour: int) -> bool:
    """Return whether the event ends the episode: the mechanism would leave the state, and is not followed further."""
    return ((behaviour == TERMINATE) & is_instability(event)) | ((behaviour == CONTINUE) & (event == FOLD))
