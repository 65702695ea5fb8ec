"""From the runs of a benchmark to the policies that come with the package."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import torch
from rich.console import Console

from agents.benchmarking.cells import Cell, ResultsFolder
from agents.benchmarking.config import BenchmarkConfig
from agents.benchmarking.tiers import Tier
from agents.controllers.table import TRAINED
from agents.controllers.trained import TrainedController
from agents.evaluation import comparison, tables
from agents.evaluation.rollouts import make_evaluation_batch
from agents.evaluation.summaries import PolicySummary
from agents.experiments.config import ExperimentConfig, load_config, parse_config
from agents.experiments.export import exported
from agents.experiments.runs import RunFolder, TrainedFiles, find_trained
from agents.learners.exported import ExportedPolicy
from agents.learners.settings import UsageError
from pcm_gym.policies import Policy
from pcm_gym.policies.shipped import KINDS, PolicyKey

# Who is shipped is chosen by episodes of the training's part, which nobody has learnt from; what the card says comes
# from the test's part, of which the choice knows nothing.
_VALIDATION_SEED = 2_000_000
_SIDE_BY_SIDE = 250

_QUIET = Console(quiet=True)


@dataclass(frozen=True)
class Candidate:
    """A trained agent that may be shipped.

    Attributes
    ----------
    files : TrainedFiles
    config : ExperimentConfig
    policy : Policy
    validation : PolicySummary
    """

    files: TrainedFiles
    config: ExperimentConfig
    policy: Policy
    validation: PolicySummary

    @property
    def safe_success(self) -> float:
        """Part of the validation's episodes that end in success without any cost."""
        return self.validation.safe_success_rate.estimate

    @property
    def losses(self) -> float:
        """Part of the validation's episodes that lose stability."""
        return self.validation.violation_rate.estimate


def ship(benchmark: BenchmarkConfig, runs: Path, folder: Path, told: Callable[[str], None]) -> int:
    """Write the best, the safest and the smallest policy of every tier into a folder; return how many files there are.

    Parameters
    ----------
    benchmark
        Whose cells are chosen from: those that have their result and whose training run is there.
    runs
        Folder of the training runs.
    folder
        Gets the files, named by `PolicyKey`. Those of tiers without an agent stay.
    told
        Gets a line on every file.

    Raises
    ------
    UsageError
        If there is no agent at all.
    """
    torch.set_num_threads(1)
    folder.mkdir(parents=True, exist_ok=True)
    written = 0
    for cells in _trained(benchmark, runs).values():
        candidates = [_candidate(runs / cell.name, benchmark.episodes) for cell in cells]
        judged: dict[str, Policy] = {}  # whoever is the best and the safest is judged once
        for key, chosen in _chosen(cells[0].tier, candidates):
            name = chosen.config.name
            if name not in judged:
                judged[name] = _judged(chosen)
            judged[name].save(folder / key.file_name)
            told(f"{key.file_name}: {name}")
            written += 1
    if not written:
        raise UsageError(f"{runs}: no agent of benchmark {benchmark.name!r} has been trained there")
    return written


def _trained(benchmark: BenchmarkConfig, runs: Path) -> Mapping[tuple[str, str], Sequence[Cell]]:
    """Return the cells with a trained agent, by id and tier."""
    results = ResultsFolder(benchmark.folder)
    found: dict[tuple[str, str], list[Cell]] = {}
    for cell in benchmark.cells():
        if cell.total_steps and results.is_done(cell, benchmark.episodes) and RunFolder(runs / cell.name).snapshots():
            found.setdefault((cell.tier.id, cell.tier.name), []).append(cell)
    return found


def _candidate(run: Path, episodes: int) -> Candidate:
    files = find_trained(RunFolder(run).snapshots()[-1])
    config, policy = load_config(files.config), exported(files)
    own = {"episodes": episodes, "seed": _VALIDATION_SEED, "controllers": [TRAINED]}
    validation = parse_config(config.model_dump() | {"evaluation": own})
    return Candidate(files, config, policy, _evaluation(validation, policy, "train").summaries[0])


def _chosen(tier: Tier, candidates: Sequence[Candidate]) -> Iterator[tuple[PolicyKey, Candidate]]:
    best = max(candidates, key=lambda own: (own.safe_success, -own.losses))
    safest = min(candidates, key=lambda own: (own.losses, -own.safe_success))
    smallest = min(candidates, key=lambda own: (own.policy.size, -own.safe_success))
    for kind, chosen in zip(KINDS, (best, safest, smallest), strict=True):
        yield PolicyKey(tier.id, None if tier.is_default else tier.name, kind), chosen


def _judged(chosen: Candidate) -> Policy:
    """Return the policy with the results of the test's episodes on its card."""
    tables.write_evaluation(_evaluation(chosen.config, chosen.policy, "test"), chosen.files.folder)
    return exported(chosen.files)


def _evaluation(config: ExperimentConfig, policy: Policy, split: str) -> comparison.Evaluation:
    env = make_evaluation_batch(config.environment, min(config.evaluation.episodes, _SIDE_BY_SIDE), split)
    acting = ExportedPolicy(policy)
    return comparison.evaluate(config, acting, {TRAINED: TrainedController(acting)}, env, _QUIET)
