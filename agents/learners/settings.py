"""What a learner is told: sections of an experiment's configuration, checked before anything heavy is imported."""

from collections.abc import Callable, Mapping
from typing import Annotated, Any, Literal, Protocol

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from agents.learners.algorithms import ALGORITHMS

Count = Annotated[int, Field(ge=1)]


class UsageError(ValueError):
    """What was asked for cannot be done; the message says why, for whoever asked."""


class ConfigError(UsageError):
    """A configuration that cannot be used; the message names every offending entry."""


class ModelError(UsageError):
    """Files of a trained model that cannot be read."""


class Section(BaseModel):
    """A part of the configuration: unknown keys are errors, values do not change."""

    model_config = ConfigDict(extra="forbid", frozen=True)


def name_in(table: Callable[[], Mapping[str, object]]) -> AfterValidator:
    """Validator of a name that must be in the table; its error lists the names there are."""

    def checked(name: str) -> str:
        if name not in table():
            *others, last = map(repr, table())
            raise ValueError(f"Input should be {', '.join(others)} or {last}")
        return name

    return AfterValidator(checked)


AlgorithmName = Annotated[str, name_in(lambda: ALGORITHMS)]


class EnvironmentConfig(Section):
    """Which environment, and the keyword arguments it is made with."""

    id: str
    kwargs: dict[str, Any] = Field(default_factory=dict)


class NormalisationConfig(Section):
    """Running normalisation of what the learner sees."""

    observation: bool = True
    reward: bool = True
    clip: Annotated[float, Field(gt=0)] = 10.0


class HindsightConfig(Section):
    """Hindsight experience replay: goals replaced by what was reached later."""

    goals_per_transition: Count = 4
    strategy: Literal["future", "final", "episode"] = "future"


class LagrangianConfig(Section):
    """Weight of the cost that a controller turns until the mean cost of an episode is at a limit.

    Attributes
    ----------
    cost_limit
        Mean cost of an episode that is allowed.
    proportional, integral, derivative
        Gains of the controller: weight per cost, per cost and rollout, and per rise of the cost in a rollout.
    """

    cost_limit: Annotated[float, Field(ge=0)] = 0.0
    proportional: Annotated[float, Field(ge=0)] = 0.5
    integral: Annotated[float, Field(ge=0)] = 0.1
    derivative: Annotated[float, Field(ge=0)] = 0.5


class ImitationConfig(Section):
    """Cloning of a reference before the learning proper.

    Attributes
    ----------
    reference
        Name in `pcm_gym.references.REFERENCES`.
    rounds, steps
        How often steps are taken and learnt from, and how many each time. In the first round the reference acts: one
        round is behaviour cloning, several are DAgger.
    longest_share
        Steps of an episode that the policy takes at most, in the other rounds, before the reference takes over.
    epochs, batch_size, learning_rate
        How a round is learnt from.
    critic_rollouts
        Rollouts of the policy from which the critic alone learns, at the end.
    """

    reference: str = "planner"
    rounds: Count = 10
    steps: Count = 100_000
    longest_share: Count = 60
    epochs: Count = 4
    batch_size: Count = 1024
    learning_rate: Annotated[float, Field(gt=0)] = 1e-3
    critic_rollouts: Annotated[int, Field(ge=0)] = 10


class LearnerSettings(Protocol):
    """All that a learner is told; `agents.experiments.config.ExperimentConfig` says what each entry means."""

    environment: EnvironmentConfig
    algorithm: AlgorithmName
    hyperparameters: dict[str, Any]
    hindsight: HindsightConfig | None
    cost_weight: float
    lagrangian: LagrangianConfig | None
    imitation: ImitationConfig | None
    shield: bool
    num_envs: int
    seed: int
    normalisation: NormalisationConfig
