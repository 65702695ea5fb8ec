"""What an experiment is: one YAML file, checked before anything heavy is imported."""

import re
from pathlib import Path
from typing import Annotated, Any, Self, TypeVar

import yaml
from pydantic import Field, ValidationError, field_validator, model_validator

from agents.controllers.table import remarks
from agents.experiments.files import write_whole
from agents.learners.algorithms import ALGORITHMS
from agents.learners.settings import (
    AlgorithmName,
    ConfigError,
    Count,
    EnvironmentConfig,
    HindsightConfig,
    ImitationConfig,
    LagrangianConfig,
    NormalisationConfig,
    Section,
    name_in,
)

MANAGED_HYPERPARAMETERS = frozenset(
    {"policy", "env", "seed", "device", "verbose", "tensorboard_log", "replay_buffer_class", "replay_buffer_kwargs"}
)

SectionType = TypeVar("SectionType", bound=Section)

Seed = Annotated[int, Field(ge=0, lt=2**31)]
ControllerName = Annotated[str, name_in(remarks)]


class EvaluationConfig(Section):
    """Held-out episodes: episode `i` starts from ``reset(seed=seed + i)``, whoever acts.

    Of the `controllers` the first is judged: beside the others, and above all beside the second.
    """

    episodes: Count = 500
    seed: Seed = 1_000_000
    controllers: Annotated[tuple[ControllerName, ...], Field(min_length=1)] = ("trained", "random", "resolved rate")

    @field_validator("controllers")
    @classmethod
    def _check_named_once(cls, names: tuple[str, ...]) -> tuple[str, ...]:
        repeated = sorted({name for name in names if names.count(name) > 1})
        if repeated:
            raise ValueError(f"named more than once: {', '.join(repeated)}")
        return names


class ExperimentConfig(Section):
    """One training run and its evaluation.

    `hyperparameters` go to the Stable-Baselines3 algorithm. Two spellings are added to its own: an activation
    function by name (``policy_kwargs: {activation_fn: tanh}``) and a schedule that falls linearly over the training
    (``learning_rate: {start: 3e-4, end: 1e-5}``). `cost_weight` is the reward that a cost of one takes away while
    learning, and `lagrangian` lets a controller choose it; `shield` lets the learner act through a
    `VectorSolverShield`. No evaluation knows of them. With `imitation` a reference is cloned first, in steps that are
    among the `total_steps`.
    """

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]*$")]
    environment: EnvironmentConfig
    algorithm: AlgorithmName = "PPO"
    hyperparameters: dict[str, Any] = Field(default_factory=dict)
    hindsight: HindsightConfig | None = None
    cost_weight: Annotated[float, Field(ge=0)] = 0.0
    lagrangian: LagrangianConfig | None = None
    imitation: ImitationConfig | None = None
    shield: bool = False
    num_envs: Count = 64
    total_steps: Count
    seed: Seed = 0
    torch_threads: Count = 1
    normalisation: NormalisationConfig = NormalisationConfig()
    checkpoint_every: Count = 100_000
    evaluation: EvaluationConfig = EvaluationConfig()

    @model_validator(mode="after")
    def _check_hindsight(self) -> Self:
        if self.hindsight is not None and not ALGORITHMS[self.algorithm].is_off_policy:
            raise ValueError(f"hindsight needs a replay buffer, which {self.algorithm} does not have")
        if self.hindsight is not None and self.cost_weight > 0.0:
            raise ValueError("hindsight computes rewards anew, from the goals alone: cost_weight must be 0")
        return self

    @model_validator(mode="after")
    def _check_on_policy(self) -> Self:
        if self.lagrangian is not None and ALGORITHMS[self.algorithm].is_off_policy:
            raise ValueError(f"lagrangian: rewards in the replay buffer of {self.algorithm} keep their earlier weight")
        if self.imitation is not None and ALGORITHMS[self.algorithm].is_off_policy:
            raise ValueError(f"imitation: {self.algorithm} has no policy that can be cloned into; PPO and A2C have")
        if self.lagrangian is not None and self.cost_weight > 0.0:
            raise ValueError("lagrangian chooses the weight of the cost: cost_weight must be 0")
        return self

    @model_validator(mode="after")
    def _check_hyperparameters(self) -> Self:
        managed = sorted(MANAGED_HYPERPARAMETERS & self.hyperparameters.keys())
        if managed:
            raise ValueError(f"hyperparameters that are set elsewhere in the configuration: {', '.join(managed)}")
        return self

    @model_validator(mode="after")
    def _check_held_out_seeds(self) -> Self:
        training = range(self.seed, self.seed + self.num_envs)
        held_out = range(self.evaluation.seed, self.evaluation.seed + self.evaluation.episodes)
        if training.start < held_out.stop and held_out.start < training.stop:
            raise ValueError(f"the seeds of the evaluation ({held_out}) include seeds of the training ({training})")
        return self


class _Loader(yaml.SafeLoader):
    """YAML's safe loader, which also reads ``3e-4`` as a number (YAML 1.1 takes it for text)."""


_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float", re.compile(r"^[-+]?[0-9][0-9_]*(\.[0-9_]*)?[eE][-+]?[0-9]+$"), list("-+0123456789")
)


def load_config(path: Path) -> ExperimentConfig:
    """Experiment described by a YAML file.

    Raises
    ------
    ConfigError
        If the file is missing, is not YAML or does not describe an experiment; every offending entry is listed.
    """
    return parse_config(read_yaml(path), source=str(path))


def read_yaml(path: Path) -> Any:
    """Plain data of a YAML file.

    Raises
    ------
    ConfigError
        If the file is missing or is not YAML.
    """
    try:
        return parse_yaml(path.read_text(encoding="utf-8"), source=str(path))
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise ConfigError(f"{path}: not text in UTF-8: {error}") from error


def parse_yaml(text: str, source: str) -> Any:
    """Plain data of YAML text; `source` names it in errors.

    Raises
    ------
    ConfigError
        If it is not YAML.
    """
    try:
        return yaml.load(text, Loader=_Loader)
    except RecursionError as error:
        raise ConfigError(f"{source}: nested too deeply") from error
    except (yaml.YAMLError, ValueError, OverflowError) as error:  # dates and numbers that there are not, for some
        raise ConfigError(f"{source}: not valid YAML: {error}") from error


def parse_config(content: object, source: str = "configuration") -> ExperimentConfig:
    """Experiment described by plain data; `source` names it in errors.

    Raises
    ------
    ConfigError
        If an entry is missing, unknown or out of range.
    """
    return validated(ExperimentConfig, content, source)


def validated(kind: type[SectionType], content: object, source: str) -> SectionType:
    """Section of that kind, of plain data; `source` names it in errors.

    Raises
    ------
    ConfigError
        If an entry is missing, unknown or out of range; every one is named.
    """
    try:
        return kind.model_validate(content)
    except ValidationError as error:
        raise ConfigError(_describe(error, source)) from error


def save_config(config: ExperimentConfig, path: Path) -> None:
    """Write the experiment, defaults included, as YAML that `load_config` reads back to an equal value."""
    write_whole(path, yaml.safe_dump(config.model_dump(mode="json"), sort_keys=False))


def _describe(error: ValidationError, source: str) -> str:
    problems = []
    for problem in error.errors(include_url=False):
        entry = ".".join(str(part) for part in problem["loc"]) or "the whole"
        problems.append(f"{entry}: {problem['msg'].removeprefix('Value error, ')}")
    if len(problems) == 1:
        return f"{source}: {problems[0]}"
    return "\n  ".join([f"{source}: {len(problems)} problems", *problems])
