"""What references without learning make of every environment, tier by tier, on episodes that are the same for all."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode

from agents.benchmarking.tiers import Tier
from agents.evaluation.episodes import EpisodeResult
from agents.evaluation.first_successes import FirstSuccesses
from agents.evaluation.rollouts import run_episodes
from pcm_gym.environments.batch import MechanismVectorEnv
from pcm_gym.references import REFERENCES, new_reference

# Whom steps are counted against, and the part of the time limit that it may take.
PLANNER, PART_OF_LIMIT = "planner", 0.8
# Episodes side by side, and the seed of the first one.
_ROWS, _FIRST_SEED = 250, 1_000_000

Steps = dict[int, int]


@dataclass(frozen=True)
class Score:
    """What one reference makes of one tier.

    Attributes
    ----------
    id, tier, reference : str
    episodes : int
    success, safe_success, losses : float
        Parts of the episodes that end in success, do so without any cost, and lose stability.
    steps_to_success : float
        Median steps until an episode is first a success; nan if none is.
    in_time : float
        Part of the episodes that succeed within 0.8 of the time limit.
    against_planner : float
        Median of the steps to success over those of the planner, in episodes in which both succeed; nan if there are
        none, or the goal moves.
    """

    id: str
    tier: str
    reference: str
    episodes: int
    success: float
    safe_success: float
    losses: float
    steps_to_success: float
    in_time: float
    against_planner: float


@dataclass(frozen=True)
class Refusal:
    """Why a mechanism has no such tier."""

    id: str
    tier: str
    reason: str


def judge(
    tier: Tier, names: Sequence[str], episodes: int, advance: Callable[[], None]
) -> tuple[list[Score], Refusal | None]:
    """Return what references make of a tier, or why it is refused; `advance` is called for each episode that has ended.

    The planner is judged in any case: its steps are what those of the others are compared with.
    """
    rows = min(episodes, _ROWS)
    try:
        env = _make(tier, rows)
    except ValueError as error:
        return [], Refusal(tier.id, tier.name, str(error))
    found: dict[str, tuple[list[EpisodeResult], Steps]] = {}
    for name in dict.fromkeys((PLANNER, *names)):
        found[name] = _run(env, name, episodes, advance)
    return [_score(tier, name, found, env) for name in names], None


def _make(tier: Tier, rows: int) -> MechanismVectorEnv:
    env = gymnasium.make_vec(
        tier.id,
        num_envs=rows,
        vectorization_mode="vector_entry_point",
        autoreset_mode=AutoresetMode.DISABLED,
        **tier.arguments,
    )
    assert isinstance(env, MechanismVectorEnv)
    env.reset(seed=0)  # whether there are such episodes is known only then
    return env


def _run(
    env: MechanismVectorEnv, name: str, episodes: int, advance: Callable[[], None]
) -> tuple[list[EpisodeResult], Steps]:
    """Return what episodes come to, and after how many steps those that do are first a success, by their seeds."""
    first = FirstSuccesses()
    results = []
    seeds = range(_FIRST_SEED, _FIRST_SEED + episodes)
    for result in run_episodes(env, name, new_reference(name), seeds, first):
        results.append(result)
        advance()
    return results, first.steps


def _score(
    tier: Tier, name: str, found: Mapping[str, tuple[list[EpisodeResult], Steps]], env: MechanismVectorEnv
) -> Score:
    (results, first), (planned, planned_first) = found[name], found[PLANNER]
    limit = gymnasium.spec(tier.id).max_episode_steps
    succeeded, both = (
        {own.seed for own in results if own.is_success},
        {own.seed for own in planned if own.is_success},
    )
    steps = [first[seed] for seed in succeeded]
    in_time = sum(1 for own in steps if limit is None or own <= PART_OF_LIMIT * limit)
    ratios = [first[seed] / planned_first[seed] for seed in succeeded & both] if env.task.period == 1 else []
    return Score(
        id=tier.id,
        tier=tier.name,
        reference=name,
        episodes=len(results),
        success=float(np.mean([own.is_success for own in results])),
        safe_success=float(np.mean([own.is_safe_success for own in results])),
        losses=float(np.mean([own.is_violation for own in results])),
        steps_to_success=float(np.median(steps)) if steps else math.nan,
        in_time=in_time / len(results),
        against_planner=float(np.median(ratios)) if ratios else math.nan,
    )


def markdown(scores: Sequence[Score], refusals: Sequence[Refusal], conditions: str) -> str:
    """Return the page with the table."""
    lines = [
        "# References without learning",
        "",
        f"Written by `python -m benchmarks references`. {conditions}",
        "",
        "Success: the episode ends at its goal. Safe: it does so, and no step had a cost. Losses: episodes that lose "
        f"stability. In time: success within {PART_OF_LIMIT} of the time limit. Steps: median until success, and over "
        "those of the planner on the same episodes.",
        "",
        *(f"- **{name}**: {reference.remark}" for name, reference in REFERENCES.items()),
        "",
        "| environment | tier | reference | success | safe | losses | in time | steps | over the planner's |",
        "|---|---|---|---:|---:|---:|---:|---:|---:|",
    ]
    lines += [_line(score) for score in scores]
    if refusals:
        lines += ["", "Tiers that a mechanism does not have:", ""]
        lines += [f"- {own.id}, {own.tier}: {own.reason}" for own in refusals]
    return "\n".join(lines) + "\n"


def _line(score: Score) -> str:
    parts = [f"{100.0 * own:.1f}" for own in (score.success, score.safe_success, score.losses, score.in_time)]
    steps = "" if math.isnan(score.steps_to_success) else f"{score.steps_to_success:.0f}"
    ratio = "" if math.isnan(score.against_planner) else f"{score.against_planner:.2f}"
    return "| " + " | ".join([score.id, score.tier, score.reference, *parts, steps, ratio]) + " |"


def as_json(scores: Sequence[Score], refusals: Sequence[Refusal]) -> dict[str, Any]:
    """Return the table as plain data; what is no number is null."""
    rows = [
        {key: None if isinstance(value, float) and math.isnan(value) else value for key, value in asdict(own).items()}
        for own in scores
    ]
    return {"scores": rows, "refused": [asdict(own) for own in refusals]}
