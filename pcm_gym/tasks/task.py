"""What every task has: goals, the way they move, how episodes are drawn, and what reaching a goal is worth."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import Any, ClassVar, Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pcm_gym.arrays import Array, Integers, Mask
from pcm_gym.kernels.numerics.threads import MOST_THREADS
from pcm_gym.kernels.statics.states import States
from pcm_gym.kernels.stepping.goals import GoalProgress, Scale, count_held, next_goals, update_goals
from pcm_gym.mechanism import Mechanism
from pcm_gym.mechanism.validation import finite_array, instance_of, sequence_of, shown, whole_array, whole_number
from pcm_gym.solving import Roadmap
from pcm_gym.tasks.goals import Goals
from pcm_gym.tasks.scene import Scene

Generators = Sequence[np.random.Generator]
# What may come of a loss of stability.
OnInstability = Literal["terminate", "snap", "hold", "continue"]
# Episodes that do not fit are drawn again so many times.
_ATTEMPTS = 1000


@dataclass(frozen=True)
class Episodes:
    """Starts and goals, dimensionless as in the kernels, one row per episode."""

    states: States  # (n, ...)
    goals: Array  # (n, p, g): the goal of each step, over and over
    witness: States | None = None  # (n, ...): where the first goal is met; None where that is not known
    fewest_falls: Integers | None = None  # (n,): falls without which nothing leads to the goal; None for none

    def __post_init__(self) -> None:
        instance_of("states", self.states, States)
        if self.witness is not None:
            instance_of("witness", self.witness, States)
        object.__setattr__(self, "goals", finite_array("goals", self.goals, (len(self.states.x), "p", "g")))
        count = len(self.goals)
        falls = np.zeros(count, dtype=np.int64) if self.fewest_falls is None else self.fewest_falls
        object.__setattr__(self, "fewest_falls", whole_array("fewest_falls", falls, (count,), 0, 1 << 30))

    def _put(self, rows: Integers, others: "Episodes", taken: Mask) -> None:
        """Put those of other episodes that are taken, (len(rows),), in the place of some rows, in place."""
        for own, other in zip(self._arrays(), others._arrays(), strict=True):
            own[rows[taken]] = other[taken]

    def _arrays(self) -> list[NDArray[Any]]:
        return [*self.states, self.goals, *(self.witness or ()), self.fewest_falls]


class Progress(NamedTuple):
    """How episodes have gone so far, one row each."""

    held: Integers  # (n,): states that are at their goal: in a row up to the present one, or of all steps
    elapsed: Integers  # (n,): steps since the reset
    fewest_falls: Integers  # (n,): without which nothing leads to the goal


@dataclass(frozen=True)
class Task(ABC):
    """A task is what its goals are, how episodes are drawn, and what reaching a goal is worth.

    A subclass is a frozen dataclass. Its fields are arguments of the environment, which it validates itself. It draws
    its episodes, `sample`, and may `score` in its own way, refuse behaviours and tell `metrics`.

    Starts and goals
    ----------------
    Starts and goals that are drawn are stable equilibria, with a singularity margin of at least one and a half times
    `singular_margin`. `witness` is an equilibrium that meets the first goal; it is not observed. Same generator, same
    episode. What stable ways reach is charted when episodes are first drawn, which takes up to some seconds.

    Attributes
    ----------
    goals : Goals
    """

    # Whether goals are whole equilibria, the steps after which they begin again, how many steps ahead the agent sees
    # the goal beside the present one, whether all states at their goal count for success, not those in a row, and
    # whether training and test draw episodes of different places: those of a task that draws few must not.
    with_inputs: ClassVar[bool] = False
    period: ClassVar[int] = 1
    look_ahead: ClassVar[tuple[int, ...]] = ()
    counts_all: ClassVar[bool] = False
    has_split: ClassVar[bool] = False

    goals: Goals = field(repr=False)

    def __post_init__(self) -> None:
        instance_of("goals", self.goals, Goals)

    @classmethod
    def argument_names(cls) -> tuple[str, ...]:
        """Return the names of the arguments that the task has of its own."""
        return tuple(own.name for own in fields(cls) if own.name != "goals")

    @abstractmethod
    def sample(self, scene: Scene, generators: Generators, threads: int = 1) -> Episodes:
        """Return a new episode for each generator, which decides it alone: same scene, same numbers, same episode.

        Raises
        ------
        ValueError
            If the scene has no such episodes.
        """

    def roadmap(self, scene: Scene) -> Roadmap:
        """Return what the ways from starts to goals are on."""
        return instance_of("scene", scene, Scene).roadmap

    @property
    def behaviours(self) -> tuple[OnInstability, ...]:
        """What may come of a loss of stability in this task: values of `on_instability`."""
        return get_args(OnInstability)

    def score(self, achieved: Array, desired: Array) -> tuple[Array, Mask]:
        """Return rewards, and whether goals are reached, (n,) each, for achieved and desired goals (n, g).

        By default both follow from their distance, see `Goals`. What a task puts in its place must judge each row by
        itself; whatever its numbers are, rewards are floats.
        """
        return self.goals.score(achieved, desired)

    def metrics(self, achieved: Array, desired: Array) -> dict[str, Array]:
        """Return what else the infos tell of achieved and desired goals (n, g), (n,) each; nothing by default.

        The names of `Info` are taken.
        """
        return {}

    def succeeded(self, progress: Progress, hold_steps: int) -> Mask:
        """Return which episodes (n,) are a success so far."""
        return progress.held >= hold_steps

    def progress_metrics(self, progress: Progress) -> dict[str, NDArray[Any]]:
        """Return what else the infos tell of how episodes have gone so far, (n,) each; nothing by default."""
        return {}

    def compute_reward(self, achieved_goal: ArrayLike, desired_goal: ArrayLike) -> float | Array:
        """Return the rewards (...) of achieved for desired goals (..., g), a float for one of each.

        Many of one kind go with one of the other, as NumPy's rules of broadcasting have it.

        Raises
        ------
        TypeError, ValueError
            If they are no finite numbers, or their shapes do not fit.
        """
        size = self.goals.size
        achieved = finite_array("achieved_goal", achieved_goal, ("...", size))
        desired = finite_array("desired_goal", desired_goal, ("...", size))
        try:
            shape = np.broadcast_shapes(achieved.shape, desired.shape)
        except ValueError:
            raise ValueError(
                f"desired_goal must have a shape that fits that of achieved_goal, {achieved.shape}, got {desired.shape}"
            ) from None
        achieved, desired = (np.broadcast_to(goals, shape).reshape(-1, size) for goals in (achieved, desired))
        rewards, _ = self._scored(achieved, desired)
        return float(rewards[0]) if len(shape) == 1 else rewards.reshape(shape[:-1])

    def _scored(self, achieved: Array, desired: Array) -> tuple[Array, Mask]:
        """Return what `score` does, as float and bool arrays; raise if a task's own one returns something else."""
        rewards, is_reached = self.score(achieved, desired)
        count = len(achieved)
        rewards = finite_array("rewards of score()", np.asarray(rewards, dtype=np.float64), (count,))
        is_reached = np.array(is_reached)
        if is_reached.dtype != np.bool_ or is_reached.shape != (count,):
            raise ValueError(f"score() must tell what is reached as a bool array ({count},), got {shown(is_reached)}")
        return rewards, is_reached

    def _update_goals(
        self, achieved: Array, rows: Integers, has_stepped: Mask, is_stable: Mask, progress: GoalProgress
    ) -> tuple[Array, Array]:
        """Return the present goals (m, g) of some rows and the rewards (m,); see the kernel of the same name."""
        if type(self).score is Task.score:  # in compiled code as a whole
            return update_goals(achieved, rows, has_stepped, is_stable, progress, self._scale)
        desired = next_goals(rows, has_stepped, progress)
        rewards, is_reached = self._scored(achieved, desired)
        count_held(rows, has_stepped, is_reached & is_stable, self.counts_all, progress)
        return desired, rewards

    @cached_property
    def _scale(self) -> Scale:
        return self.goals.scale._replace(counts_all=self.counts_all)


def check_sampling(scene: Scene, generators: Generators, threads: int) -> None:
    """Raise unless the arguments of `Task.sample` are such."""
    instance_of("scene", scene, Scene)
    sequence_of("generators", generators, np.random.Generator)
    whole_number("threads", threads, least=1, most=MOST_THREADS)


def draw(generators: Generators, count: int) -> Array:
    """Return `count` numbers from [0, 1) of each generator, (n, count)."""
    return np.array([generator.random(count) for generator in generators]).reshape(-1, count)


def draw_until(drawn: Callable[[Generators], tuple[Episodes, Mask]], generators: Generators, rule: str) -> Episodes:
    """Return an episode for each generator: the first that fits of those that it draws, one after the other.

    Parameters
    ----------
    drawn : callable
        Returns an episode for each of some generators, and which of them fit.
    generators : sequence of numpy.random.Generator
    rule : str
        What the arguments must do, for the error.

    Raises
    ------
    ValueError
        If 1,000 in a row do not fit.
    """
    episodes, is_fit = drawn(generators)
    rows = np.flatnonzero(~is_fit)
    for _ in range(_ATTEMPTS):
        if not len(rows):
            return episodes
        others, is_fit = drawn([generators[row] for row in rows.tolist()])
        episodes._put(rows, others, is_fit)
        rows = rows[~is_fit]
    raise ValueError(f"{rule}, got none in {_ATTEMPTS} draws")


def starts_of(scene: Scene, generators: Generators, threads: int) -> States:
    """Return the starts of episodes: the scene's origin, or states drawn evenly."""
    if scene.origin is not None:
        return scene.at_equilibrium(scene.origin, len(generators))
    return scene.starts(draw(generators, 1 + scene.mechanism.leg_count), threads)


def default_max_action(mechanism: Mechanism) -> Array:
    """Return the increment of each input for an action of 1: 0.1 rad, or 0.03 of the mean rod length."""
    return mechanism.units.inputs_from_kernel(np.array([leg.actuator.default_step for leg in mechanism.legs]))
