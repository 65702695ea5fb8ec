"""What the episodes of a controller come to, all together."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from agents.evaluation.episodes import EpisodeResult
from agents.evaluation.estimates import Interval, percentile_interval, wilson_interval


@dataclass(frozen=True)
class PolicySummary:
    """What a policy's episodes came to, all together; rates and medians with 95 % intervals.

    Attributes
    ----------
    policy, episodes
        Who acted, and how often.
    success_rate, safe_success_rate, violation_rate, solver_failure_rate
        See the attributes of the same names of `EpisodeResult`. A failure of the solver is not a violation.
    median_final_error, high_final_error
        Median and 95th percentile.
    median_stability_margin, smallest_stability_margin
        Median and smallest of the episodes' smallest margins.
    smallest_singularity_margin
        Smallest of all.
    mean_cost, longest_cost_run, mean_reward, mean_length
        Per episode; the longest run of steps with a cost is that of all episodes.
    """

    policy: str
    episodes: int
    success_rate: Interval
    safe_success_rate: Interval
    violation_rate: Interval
    solver_failure_rate: Interval
    median_final_error: Interval
    high_final_error: Interval
    median_stability_margin: float
    smallest_stability_margin: float
    smallest_singularity_margin: float
    mean_cost: float
    longest_cost_run: int
    mean_reward: float
    mean_length: float


def summarise(results: Sequence[EpisodeResult]) -> PolicySummary:
    """Summary of the episodes, at least one, of one policy."""
    count = len(results)
    errors = [result.final_error for result in results]
    return PolicySummary(
        policy=results[0].policy,
        episodes=count,
        success_rate=wilson_interval(sum(result.is_success for result in results), count),
        safe_success_rate=wilson_interval(sum(result.is_safe_success for result in results), count),
        violation_rate=wilson_interval(sum(result.is_violation for result in results), count),
        solver_failure_rate=wilson_interval(sum(result.is_solver_failure for result in results), count),
        median_final_error=percentile_interval(errors, 50),
        high_final_error=percentile_interval(errors, 95),
        median_stability_margin=float(np.nanmedian([result.smallest_stability_margin for result in results])),
        smallest_stability_margin=float(np.fmin.reduce([result.smallest_stability_margin for result in results])),
        smallest_singularity_margin=float(np.fmin.reduce([result.smallest_singularity_margin for result in results])),
        mean_cost=float(np.mean([result.cost for result in results])),
        longest_cost_run=max(result.longest_cost_run for result in results),
        mean_reward=float(np.mean([result.total_reward for result in results])),
        mean_length=float(np.mean([result.length for result in results])),
    )
