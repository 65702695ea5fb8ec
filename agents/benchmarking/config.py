"""What a benchmark is: one YAML file, checked before anything is run."""

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Final, Literal, Self

from pydantic import Field, model_validator

import pcm_gym
from agents.benchmarking.cells import Cell
from agents.benchmarking.tiers import Tier, tiers
from agents.experiments.config import EvaluationConfig, Seed, read_yaml, validated
from agents.experiments.learners import learner_names
from agents.learners.settings import Count, Section, name_in
from pcm_gym.references import REFERENCES

_ALL: Final = "all"
# Training is on episodes of this split; the evaluation chooses the other one by itself.
_TRAINING = "train"


def _ids() -> dict[str, None]:
    return dict.fromkeys(pcm_gym.environment_ids())


def _tier_names() -> dict[str, None]:
    return dict.fromkeys(tier.name for tier in tiers(list(_ids()), _TRAINING))


def _learners() -> dict[str, None]:
    return dict.fromkeys(learner_names())


EnvironmentId = Annotated[str, name_in(_ids)]
TierName = Annotated[str, name_in(_tier_names)]
LearnerName = Annotated[str, name_in(_learners)]
ReferenceName = Annotated[str, name_in(lambda: REFERENCES)]


class BenchmarkConfig(Section):
    """Who learns what, how long and how often.

    Attributes
    ----------
    name
        Of the folder of training runs.
    folder
        Where the results go.
    environments, tiers
        By their names, or "all". An environment takes part in those of the tiers that its task has.
    references
        Controllers without learning. Nothing of them depends on a seed: each has one cell in a tier.
    learners
        Names of `configs/learners`, with the steps that each learns.
    seeds
        Of the training. Environment `i` of a batch begins with the seed plus `i`.
    episodes
        Of the evaluation, the same for all.
    """

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]*$")]
    folder: Path
    environments: Literal["all"] | Annotated[tuple[EnvironmentId, ...], Field(min_length=1)] = _ALL
    tiers: Literal["all"] | Annotated[tuple[TierName, ...], Field(min_length=1)] = _ALL
    references: tuple[ReferenceName, ...] = tuple(REFERENCES)
    learners: dict[LearnerName, Count] = Field(default_factory=dict)
    seeds: Annotated[tuple[Seed, ...], Field(min_length=1)]
    episodes: Count = EvaluationConfig().episodes

    @model_validator(mode="after")
    def _check_named_once(self) -> Self:
        lists = {"environments": self.environments, "tiers": self.tiers, "seeds": self.seeds}
        for name, given in {**lists, "controllers": (*self.references, *self.learners)}.items():
            if given != _ALL and len(set(given)) < len(given):
                raise ValueError(f"{name}: something is named more than once: {', '.join(map(str, given))}")
        return self

    @model_validator(mode="after")
    def _check_cells(self) -> Self:
        if not self.chosen_tiers():
            raise ValueError(f"none of the environments has one of the tiers {', '.join(self.tiers)}")
        if not (self.references or self.learners):
            raise ValueError("references and learners are both empty: nobody is left to act")
        return self

    def chosen_tiers(self) -> list[Tier]:
        """Tiers that take part, in the order of the environments."""
        ids = list(_ids()) if self.environments == _ALL else self.environments
        return [own for own in tiers(ids, _TRAINING) if self.tiers == _ALL or own.name in self.tiers]

    def cells(self) -> list[Cell]:
        """All cells, those first that take part in the comparison of everybody: the references."""
        return [*self._references(), *self._learners()]

    def _references(self) -> Iterator[Cell]:
        for tier in self.chosen_tiers():
            for name in self.references:
                yield Cell(tier, name, seed=0, total_steps=0)

    def _learners(self) -> Iterator[Cell]:
        for seed in self.seeds:  # one seed of all before the next one of any: an unfinished benchmark tells something
            for tier in self.chosen_tiers():
                for name, steps in self.learners.items():
                    yield Cell(tier, name, seed, steps)


def load_benchmark(path: Path) -> BenchmarkConfig:
    """Benchmark described by a YAML file.

    Raises
    ------
    ConfigError
        If the file is missing, is not YAML or does not describe a benchmark; every offending entry is named.
    """
    return validated(BenchmarkConfig, read_yaml(path), source=str(path))
