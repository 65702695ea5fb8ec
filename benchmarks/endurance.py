"""Random and adversarial steps by the million: is every event explained, and how often does the solver fail?

Every row of a batch has its driver. What the environment says of a step is held against the state before it, the action
and the behaviour where stability is lost; what does not fit together is a contradiction. Contradictions and solver
failures are kept with all that it takes to repeat them.
"""

import json
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode

from pcm_gym.arrays import Array, Mask
from pcm_gym.environments.batch import MechanismVectorEnv
from pcm_gym.environments.simulation import Simulation
from pcm_gym.kernels.snaps.instability import TERMINATE
from pcm_gym.kernels.statics.states import States
from pcm_gym.mechanism import get_mechanism
from pcm_gym.solving import Equilibrium, Event, solve_forward
from pcm_gym.tasks import default_max_action

# Who chooses the actions of a row: chance; chance that keeps a direction for a while; one corner for the whole episode,
# into the limits; one corner and the opposite one in turn; or whatever takes the margin down, towards a fold.
DRIVERS = ("random", "walk", "limits", "alternating", "folds")
_ROWS, _EPISODE_STEPS, _WALK_STEPS = 500, 100, 12
# The default 2PFR is stable wherever its sliders can go; under this load, in N, it folds.
_LOADS = {"2PFR": (2.0, -1.0)}
# Share of resets that begin with an unstable equilibrium where that is allowed, and its largest rho.
_UNSTABLE_SHARE, _RHO_MAX = 0.5, 6.5
# The part of the largest increment by which the drivers towards folds look ahead.
_LOOK_AHEAD = 0.5
_LARGEST_RESIDUAL, _INPUT_TOLERANCE = 1e-9, 1e-12
_MOST_CASES = 1000


@dataclass(frozen=True)
class Case:
    """A step that was kept, with all that it takes to repeat it; states and inputs as in the kernels."""

    reason: str
    environment_id: str
    on_instability: str
    step_size: float
    seed: int
    driver: str
    x: list[float]
    inputs: list[float]
    load: list[float]
    action: list[float]

    def repeat(self) -> dict[str, Any]:
        """Make the step again; return its info."""
        env = make_batch(self.environment_id, self.on_instability, self.step_size, 1)
        env.reset(seed=self.seed)
        for array, values in zip(env._simulation.rows.states, (self.x, self.inputs, self.load), strict=True):
            array[0] = values
        infos = env.step(np.array([self.action]))[4]
        return {key: values.tolist()[0] for key, values in infos.items() if not key.startswith("_")}


@dataclass
class Tally:
    """What happened in an environment with one behaviour."""

    environment_id: str
    on_instability: str
    steps: int = 0
    episodes: int = 0
    unstable_steps: int = 0
    events: Counter[str] = field(default_factory=Counter)
    contradictions: Counter[str] = field(default_factory=Counter)
    cases: list[Case] = field(default_factory=list)

    def per_100_000(self, event: Event) -> float:
        return 1e5 * self.events[str(event)] / max(self.steps, 1)

    def as_dict(self) -> dict[str, Any]:
        """Return the figures, as JSON takes them."""
        return {
            **vars(self),
            "events": dict(self.events),
            "contradictions": dict(self.contradictions),
            "cases": len(self.cases),
        }


def make_batch(environment_id: str, on_instability: str, step_size: float, num_envs: int) -> MechanismVectorEnv:
    """Return a native batch whose rows are reset by hand; `step_size` is in terms of the default increments."""
    name = gymnasium.spec(environment_id).kwargs["mechanism"]
    env: Any = gymnasium.make_vec(
        environment_id,
        num_envs=num_envs,
        vectorization_mode="vector_entry_point",
        on_instability=on_instability,
        load=_LOADS.get(name),
        max_action=step_size * default_max_action(get_mechanism(name)),
        max_episode_steps=_EPISODE_STEPS,
        autoreset_mode=AutoresetMode.DISABLED,
    )
    return env  # type: ignore[no-any-return]  # of a batch that is registered


def endure(
    environment_id: str, on_instability: str, steps: int, step_size: float, seed: int, advance: Callable[[int], None]
) -> Tally:
    """Make at least `steps` steps; `advance` is told how many have just been made."""
    env, tally = make_batch(environment_id, on_instability, step_size, _ROWS), Tally(environment_id, on_instability)
    simulation, drivers = env._simulation, _Drivers(env, seed)
    starts = _unstable_equilibria(simulation) if on_instability == "continue" else []
    env.reset(seed=seed)
    tally.episodes = _ROWS
    while tally.steps < steps:
        before, actions = States(*(array.copy() for array in simulation.rows.states)), drivers.actions()
        _, _, terminated, truncated, infos = outcome = env.step(actions.astype(np.float32))
        tally.steps += _ROWS
        tally.unstable_steps += int((infos["index"] > 0).sum())
        tally.events.update(map(str, map(Event, infos["event"].tolist())))
        found = dict(contradictions(env, on_instability, before, actions, outcome))
        tally.contradictions.update({reason: int(rows.sum()) for reason, rows in found.items()})
        for reason, rows in (found | {"solver failure": infos["cost_solver"] > 0.0}).items():
            for row in np.flatnonzero(rows)[: _MOST_CASES - len(tally.cases)].tolist():
                origin = (reason, environment_id, on_instability, step_size, seed, drivers.name_of(row))
                tally.cases.append(Case(*origin, *(array[row].tolist() for array in (*before, actions))))
        ended = terminated | truncated
        if ended.any():
            options: dict[str, Any] = {"reset_mask": ended}
            if starts and drivers.generator.random() < _UNSTABLE_SHARE:
                options["equilibrium"] = starts[drivers.generator.integers(len(starts))]
            env.reset(options=options)
            drivers.begin(ended)
            tally.episodes += int(ended.sum())
        advance(_ROWS)
    return tally


def _unstable_equilibria(simulation: Simulation) -> list[Equilibrium]:
    home = simulation.equilibrium(0)
    found = solve_forward(home.mechanism, home.inputs, home.load, _RHO_MAX)
    return [member for member in found if not member.is_stable]


class _Drivers:
    """The drivers of a batch, in turn over its rows."""

    def __init__(self, env: MechanismVectorEnv, seed: int) -> None:
        self.generator = np.random.default_rng(seed)
        self._simulation = env._simulation
        self._shape = (env.num_envs, len(env.max_action))
        self._driver = np.arange(env.num_envs) % len(DRIVERS)
        self._walk, self._corner = np.zeros(self._shape), np.zeros(self._shape)
        self._age = np.zeros(env.num_envs, dtype=np.int64)
        self.begin(np.ones(env.num_envs, dtype=np.bool_))

    def name_of(self, row: int) -> str:
        return DRIVERS[self._driver[row]]

    def begin(self, rows: Mask) -> None:
        """Begin new episodes in some rows."""
        self._age[rows] = 0
        self._corner[rows] = self.generator.choice([-1.0, 1.0], self._shape)[rows]

    def actions(self) -> Array:
        """Return the next actions, rounded as an agent's are."""
        turns = self._age % _WALK_STEPS == 0
        self._walk[turns] = np.clip(2.0 * self.generator.normal(size=self._shape), -1.0, 1.0)[turns]
        sign = np.where(self._age % 2 == 0, 1.0, -1.0)[:, None]
        self._age += 1
        random = self.generator.uniform(-1.0, 1.0, self._shape)
        offers = (random, self._walk, self._corner, sign * self._corner, self._towards_folds())
        return np.choose(self._driver[:, None], offers).astype(np.float32).astype(np.float64)

    def _towards_folds(self) -> Array:
        """Return the corner that the margin falls towards most steeply; a way that loses stability counts as margin 0.

        For the rows whose driver wants to know; the others' corners are returned as they are.
        """
        simulation, rows = self._simulation, np.flatnonzero(self._driver == DRIVERS.index("folds"))
        result, rules = self._corner.copy(), simulation.settings.rules._replace(behaviour=TERMINATE)
        for leg in range(result.shape[1]):
            margins = []
            for sign in (1.0, -1.0):
                ahead = np.zeros((len(rows), result.shape[1]))
                ahead[:, leg] = sign * _LOOK_AHEAD
                found = simulation.foresee(simulation.motion.copied(rows), ahead, rules).verdicts
                margins.append(np.where(found["cost_unstable"] > 0.0, 0.0, found["singularity_margin"]))
            slope = margins[0] - margins[1]
            result[rows, leg] = np.where(slope == 0.0, result[rows, leg], -np.sign(slope))
        return result


def contradictions(
    env: MechanismVectorEnv, on_instability: str, before: States, actions: Array, outcome: tuple[Any, ...]
) -> Iterator[tuple[str, Mask]]:
    """Yield what does not fit together in a step of a batch, and in which rows."""
    for reason, is_right in _rules(env, on_instability, before, actions, outcome):
        if not is_right.all():
            yield reason, ~is_right


def _rules(
    env: MechanismVectorEnv, on_instability: str, before: States, actions: Array, outcome: tuple[Any, ...]
) -> Iterator[tuple[str, Mask]]:
    observation, reward, terminated, truncated, infos = outcome
    simulation = env._simulation
    spaces: Any = env.single_observation_space
    for key, space in spaces.items():
        values = observation[key]
        is_inside = np.isfinite(values) & (values >= space.low) & (values <= space.high)
        yield f"{key} in its space", is_inside.all(axis=1)
    yield "reward finite and not negative", np.isfinite(reward) & (reward >= 0.0)
    event, index = infos["event"], infos["index"]
    costs = np.stack([infos[f"cost_{kind}"] for kind in ("unstable", "singular", "solver")])
    yield "costs 0 or 1", np.all(np.isin(costs, (0.0, 1.0)), axis=0)
    yield "cost their sum", infos["cost"] == costs.sum(axis=0)
    numbers = np.stack([infos[key] for key in ("stability_margin", "singularity_margin", "residual")])
    yield "info finite", np.isfinite(numbers).all(axis=0)
    yield "residual small", infos["residual"] < _LARGEST_RESIDUAL

    is_lost, is_failure = np.isin(event, (Event.FOLD, Event.INDEX_CHANGE)), event == Event.SOLVER_FAILURE
    is_stable = (observation["observation"][:, simulation.sensors.layout["is_stable"]] == 1.0).all(axis=1)
    yield "unstable is paid", infos["cost_unstable"] == (is_lost | (index > 0))
    yield "solver failure is paid", infos["cost_solver"] == is_failure
    yield "solver failure truncates", truncated | ~is_failure
    yield "no success without stability", is_stable | ~infos["is_success"]

    model = simulation.settings.mechanism
    lower, upper = model.kernel_limits
    wish = before.inputs + np.clip(actions, -1.0, 1.0) * simulation._stride
    target = np.clip(wish, lower, upper)
    states = simulation.rows.states
    yield "cut is told", infos["at_limit"] == (wish != target).any(axis=1)
    is_there = (np.abs(states.inputs - target) <= _INPUT_TOLERANCE).all(axis=1)
    is_back = (states.inputs == before.inputs).all(axis=1) & (states.x == before.x).all(axis=1)
    yield "solver failure is rolled back", is_back | ~is_failure
    yield "inputs at the target", is_there | is_lost | is_failure
    apart = np.minimum(before.inputs, target) - states.inputs, states.inputs - np.maximum(before.inputs, target)
    yield "inputs on the way", np.all(np.maximum(*apart) <= _INPUT_TOLERANCE, axis=1)
    yield "load unchanged", (states.load == before.load).all(axis=1)
    ends, stays = {
        "terminate": (is_lost, ~is_lost),
        "hold": (np.zeros_like(is_lost), np.ones_like(is_lost)),
        "snap": (np.zeros_like(is_lost), np.ones_like(is_lost)),
        "continue": (event == Event.FOLD, (index == 0) & (event != Event.FOLD)),
    }[on_instability]
    yield "terminated by what ends it", terminated == ends
    yield "is_stable true", is_stable == stays
    if on_instability != "continue":
        yield "index 0", index == 0
    if on_instability == "hold":
        yield "held", is_back | ~is_lost
    if on_instability in ("snap", "continue"):
        yield "goes on after a change of index", is_there | (event != Event.INDEX_CHANGE)
    if on_instability == "snap":
        yield "goes on after a fold", is_there | (event != Event.FOLD)


def write_cases(path: Path, tallies: list[Tally]) -> int:
    """Write the cases of all tallies; return how many they are."""
    cases = [asdict(case) for tally in tallies for case in tally.cases]
    path.write_text(json.dumps(cases, indent=1) + "\n")
    return len(cases)


def read_cases(path: Path) -> list[Case]:
    return [Case(**fields) for fields in json.loads(path.read_text())]
