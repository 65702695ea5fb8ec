"""What a batch is and what a step of it comes to: one row per environment."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, TypedDict

import numpy as np
from gymnasium.utils import seeding
from numpy.typing import NDArray

from pcm_gym.arrays import Array, Integers, Mask, Records
from pcm_gym.kernels.statics.states import States
from pcm_gym.kernels.stepping.goals import GoalProgress
from pcm_gym.kernels.stepping.report import Costs, Verdict
from pcm_gym.mechanism.validation import finite_array, mapping, shown, truth_array, whole_array
from pcm_gym.solving.limits import LimitName
from pcm_gym.tasks import Progress


class Info(TypedDict):
    """What `info` holds after each step and each reset, beside the metrics that a task from outside may have.

    With `limits` also `cost_stress`, `cost_torque` or `cost_contact`, float: 1 where the state breaks that limit.

    Attributes
    ----------
    is_success : bool
        Whether the state is stable and at its goal, for `hold_steps` states in a row.
    cost : float
        Sum of the three costs that follow, which tell danger, and of those of the `limits`. Each is 0 or 1, and 0 at
        reset. It adds what happens once to what may go on for long: as a budget take `losses`, or the steps of
        `is_dwelling`.
    cost_unstable : float
        1 where stability was lost on the way, or the state is unstable.
    cost_singular : float
        1 where the singularity margin is below `singular_margin`.
    cost_solver : float
        1 where the solver failed.
    index : int
        Morse index of the present equilibrium: number of unstable directions of its energy, 0 where it is stable.
    stability_margin : float
        Least eigenvalue of the dimensionless stiffness (EI = L = 1). Of an unstable state it proves nothing.
    singularity_margin : float
        Estimated distance of the nearest fold in the space of the inputs, in rad and mean rod lengths, at most 10.
    residual : float
        Largest error of closure, in mean rod lengths, or of equilibrium, relative to 1 + force.
    event : int
        Number of a `pcm_gym.Event`, the first loss of stability on the way: 1, a fold, where the branch ends, or 2, a
        change of the index, with which it goes on; else 4, a failure of the solver, 3, an actuator's limit, or 0, none.
    at_limit : bool
        Whether an increment was cut at an actuator's limit.
    losses : int
        How often stability was lost on the way: events. More than once where falls follow each other.
    is_dwelling : bool
        Whether the state is nearly singular or unstable: steps spent in danger.
    energy_released : float
        By the falls on the way, with `on_instability="snap"`, in N m.
    """

    is_success: bool
    cost: float
    cost_unstable: float
    cost_singular: float
    cost_solver: float
    index: int
    stability_margin: float
    singularity_margin: float
    residual: float
    event: int
    at_limit: bool
    losses: int
    is_dwelling: bool
    energy_released: float


# An info tells a verdict field by field, after whether it is a success and the sum of the costs.
_KEYS = tuple(Info.__annotations__)
_TOLD = _KEYS[2:]
_COSTS = tuple(Costs.__annotations__)
assert tuple(Verdict.__annotations__)[: len(_TOLD)] == _TOLD


class Rows(NamedTuple):
    """Everything that the future of a batch depends on, one row per environment, dimensionless as in the kernels."""

    x: Array  # (n, 2 legs + d)
    inputs: Array  # (n, legs)
    load: Array  # (n, d)
    scene: Integers  # (n,): which one the episode takes place in
    goals: Array  # (n, p, g): the goals of successive steps, over and over
    witness: Array  # (n, legs + 2 legs + d): inputs and state that meet the first goal, not a number if none is known
    elapsed: Integers  # (n,): steps since the reset
    held: Integers  # (n,): states that are at their goal: in a row up to the present one, or of all steps
    fewest_falls: Integers  # (n,): without which nothing leads to the goal
    potential: Array  # (n,): of the present state, where a potential shapes the rewards
    lost: Mask  # (n,): whether a loss of stability has ended the episode
    commands: Array  # (n, legs): what the actuators have been told
    drives: Array  # (n, legs): where their drives are

    @property
    def states(self) -> States:
        """The dynamic states."""
        return States(self.x, self.inputs, self.load)

    def gone(self, rows: Integers) -> Progress:
        """Return how the episodes of some rows have gone so far."""
        return Progress(self.held[rows], self.elapsed[rows], self.fewest_falls[rows])

    @property
    def progress(self) -> GoalProgress:
        """The goals and what has been made of them."""
        return GoalProgress(self.goals, self.elapsed, self.held)

    def checked(self, saved: Any, scene_count: int) -> "Rows":
        """Return saved rows as new arrays like these; raise if they are not such."""
        given = saved_parts("state['rows']", saved, self._fields)
        found: dict[str, NDArray[Any]] = {}
        for name, own in self._asdict().items():
            value, what = given[name], f"state['rows'][{name!r}]"
            if own.dtype == np.bool_:
                found[name] = truth_array(what, value, own.shape)
            elif own.dtype == np.int64:
                found[name] = whole_array(what, value, own.shape, 0, scene_count - 1 if name == "scene" else 1 << 62)
            elif (
                name == "witness"
                and isinstance(value, np.ndarray)
                and (value.dtype, value.shape)
                == (
                    own.dtype,
                    own.shape,
                )
            ):
                is_known = ~np.isnan(value)
                finite_array(what, value[is_known], ("n",))
                found[name] = np.array(value, order="C")
            else:
                found[name] = finite_array(what, value, own.shape)
        return Rows(**found)

    def goals_ahead(self, rows: Integers | int, steps: int = 0) -> Array:
        """Return the goals (m, g) of some rows, or that of one, (g,), so many steps after the present one."""
        ahead: Array = self.goals[rows, (self.elapsed[rows] + steps) % self.goals.shape[1]]
        return ahead


def total_cost(verdicts: Records, limits: Sequence[LimitName] = ()) -> Array:
    """Return the sum of the costs of steps, in the shape of their verdicts; also of the limits that are watched."""
    total: Array = np.add.reduce([verdicts[name] for name in (*_COSTS, *limit_costs(limits))])
    return total


def limit_costs(limits: Sequence[LimitName]) -> list[str]:
    """Return the names of the costs of limits of the structure."""
    return [f"cost_{name}" for name in limits]


def saved_parts(name: str, state: Any, names: Sequence[str]) -> Mapping[str, Any]:
    """Return the parts of a saved state; raise unless it has those of these names."""
    parts = mapping(name, state)
    missing = [part for part in names if part not in parts]
    if missing:
        raise ValueError(f"{name} must be what save_state() of such an environment returns, got one without {missing}")
    return parts


def generator_of(name: str, state: Any) -> np.random.Generator:
    """Return a generator in a saved state; raise if it is none."""
    generator, _ = seeding.np_random(0)
    try:
        generator.bit_generator.state = state
    except Exception:  # whatever NumPy makes of it
        raise ValueError(f"{name} must be the state of a generator of random numbers, got {shown(state)}") from None
    return generator


class Outcome(NamedTuple):
    """What one step, or a reset, of some rows came to; every array is new."""

    observation: dict[str, Array]
    reward: Array  # (n,)
    terminated: Mask  # (n,): stability was lost, and what comes of it is not followed
    failed: Mask  # (n,): the solver failed
    success: Mask  # (n,)
    verdicts: Records  # (n,) of `VERDICT_TYPE`
    metrics: dict[str, Array]  # (n,) each: what else the task tells
    limits: tuple[LimitName, ...]  # of the structure, that are watched

    def row_info(self, row: int) -> dict[str, Any]:
        """Return the info of one row, an `Info` in Python's own types, and the task's metrics."""
        verdict = self.verdicts.item(row)
        info = dict(zip(_KEYS, (bool(self.success[row]), sum(verdict[: len(_COSTS)]), *verdict), strict=False))
        for name in limit_costs(self.limits):
            info[name] = float(self.verdicts[name][row])
            info["cost"] += info[name]
        return {name: values.item(row) for name, values in self.metrics.items()} | info if self.metrics else info

    def infos(self) -> dict[str, NDArray[Any]]:
        """Return the infos of all rows, one array per key; those of numbers are parts of this outcome."""
        verdicts = self.verdicts
        told = {name: verdicts[name] for name in (*_TOLD, *limit_costs(self.limits))}
        return self.metrics | {"is_success": self.success, "cost": total_cost(verdicts, self.limits), **told}
