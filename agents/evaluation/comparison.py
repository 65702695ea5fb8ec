"""Controllers beside each other, on the same held-out episodes."""

from collections.abc import Mapping
from dataclasses import dataclass

from rich.console import Console
from rich.progress import track

from agents.evaluation.episodes import EpisodeResult
from agents.evaluation.rollouts import run_episodes
from agents.evaluation.summaries import PolicySummary, summarise
from agents.experiments.config import ExperimentConfig
from agents.learners.exported import ActingPolicy
from pcm_gym.environments.batch import MechanismVectorEnv
from pcm_gym.references import Controller


@dataclass(frozen=True)
class Evaluation:
    """All controllers on the same episodes.

    Attributes
    ----------
    environment, seed
        Episode `i` was ``reset(seed=seed + i)`` of this environment.
    training_steps
        Steps the policy had learnt for.
    is_deterministic
        Whether it acted without exploring.
    summaries
        One per controller, in the experiment's order: the first is judged.
    results
        Every episode of every controller, in the order of the summaries and of the seeds.
    """

    environment: str
    seed: int
    training_steps: int
    is_deterministic: bool
    summaries: tuple[PolicySummary, ...]
    results: tuple[EpisodeResult, ...]


def evaluate(
    config: ExperimentConfig,
    policy: ActingPolicy,
    controllers: Mapping[str, Controller],
    env: MechanismVectorEnv,
    console: Console,
) -> Evaluation:
    """Run every controller on the experiment's held-out episodes.

    Parameters
    ----------
    config
        Says how many episodes there are, and from which seed on.
    policy
        What has been learnt.
    controllers
        Who acts, by name; the first is judged.
    env
        Batch from `make_evaluation_batch`; as many episodes run side by side as it has rows.
    console
        Shows the progress.
    """
    seeds = [config.evaluation.seed + episode for episode in range(config.evaluation.episodes)]
    results: dict[str, list[EpisodeResult]] = {}
    for name, controller in controllers.items():
        episodes = track(run_episodes(env, name, controller, seeds), name, total=len(seeds), console=console)
        results[name] = sorted(episodes, key=lambda result: result.episode)
    return Evaluation(
        environment=config.environment.id,
        seed=config.evaluation.seed,
        training_steps=policy.training_steps,
        is_deterministic=policy.is_deterministic,
        summaries=tuple(summarise(episodes) for episodes in results.values()),
        results=tuple(episode for episodes in results.values() for episode in episodes),
    )
