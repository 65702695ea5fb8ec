"""Adversarial steps behind the shields: does anything lead to a loss of stability, or below the margin?

The adversary asks for the corner of the action space after which the margin would be least, losing stability least of
all, as the environment itself previews it. Some rows ask anew in every step; others keep on for a while, so that
commands run far ahead of clamps that follow late.
"""

import itertools
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import SyncVectorEnv
from numpy.typing import NDArray

from pcm_gym.arrays import Array, Mask
from pcm_gym.environments.batch import MechanismVectorEnv
from pcm_gym.wrappers import SolverShield, VectorSolverShield

Actions = NDArray[np.float32]

# How the environments are stepped: one by one, or together.
KINDS = ("single", "vector")
# What keeps clamps from following, what keeps mechanisms from being known, and all of it.
DIFFICULTIES: dict[str, dict[str, Any]] = {
    "ideal": {},
    "lag": {"actuator_lag": 2.0},
    "rate limit": {"rate_limit": 0.02},
    "backlash": {"backlash": 0.02},
    "all": {
        "actuator_lag": 2.0,
        "rate_limit": 0.02,
        "backlash": 0.02,
        "observation_noise": 0.05,
        "randomisation": {"stiffness": 0.2, "length": 0.05, "base": 0.02},
    },
}
# The default 2PFR is stable wherever its sliders can go; under this load, in N, it folds.
_LOADS = {"2PFR": (2.0, -1.0)}
_ROWS = 50
# Steps for which the rows keep on, in turn.
_PERSISTENCE = (1, 1, 5, 20, 50)
# The drives may creep on at rest by a tiny part of an action.
_MARGIN_TOLERANCE = 1e-6


@dataclass
class Defence:
    """What came of adversarial steps."""

    name: str
    steps: int = 0
    losses: int = 0  # of stability
    failures: int = 0  # of the solver
    below: int = 0  # states whose margin is below the one to be kept
    least_margin: float = np.inf
    replaced: int = 0

    def count(self, infos: dict[str, Any], terminated: Mask, has_stepped: Mask, margin_to_keep: float) -> None:
        """Count one step of the rows that have stepped."""
        margins = infos["singularity_margin"][has_stepped]
        self.steps += int(has_stepped.sum())
        self.losses += int(((infos["cost_unstable"] > 0.0) | terminated)[has_stepped].sum())
        self.failures += int((infos["cost_solver"] > 0.0)[has_stepped].sum())
        self.below += int((margins < (1.0 - _MARGIN_TOLERANCE) * margin_to_keep).sum())
        self.least_margin = min(self.least_margin, float(margins.min(initial=np.inf)))
        if "shielded" in infos:
            self.replaced += int(infos["shielded"][has_stepped].sum())


def defend(
    mechanism: str, difficulty: str, on_instability: str, kind: str, steps: int, advance: Callable[[int], None]
) -> Iterator[Defence]:
    """Yield what comes of at least `steps` steps with the shield, and of as many in a native batch without it."""
    keywords = {"on_instability": on_instability, "load": _LOADS.get(mechanism), **DIFFICULTIES[difficulty]}
    environment_id, name = f"PCM/{mechanism}-Reach-v0", f"{mechanism}, {difficulty}, {on_instability}"
    batch: Any = gymnasium.make_vec(environment_id, num_envs=_ROWS, vectorization_mode="vector_entry_point", **keywords)
    margin = batch.unwrapped._simulation.settings.singular_margin
    shielded: Any = VectorSolverShield(batch)
    if kind == "single":
        shielded = gymnasium.make_vec(
            environment_id, num_envs=_ROWS, vectorization_mode="sync", wrappers=[SolverShield], **keywords
        )
    yield _attack(shielded, Defence(f"{name}, {kind}"), steps, margin, advance)
    yield _attack(batch, Defence(f"{name}, without"), steps, margin, advance)


def _attack(env: Any, defence: Defence, steps: int, margin: float, advance: Callable[[int], None]) -> Defence:
    adversary, has_ended = _Adversary(env.action_space.shape), np.zeros(env.num_envs, dtype=np.bool_)
    env.reset(seed=0)
    while defence.steps < steps:
        _, _, terminated, truncated, infos = env.step(adversary.actions(env))
        before = defence.steps
        defence.count(infos, terminated, ~has_ended, margin)
        has_ended = terminated | truncated
        advance(defence.steps - before)
    return defence


class _Adversary:
    """Asks every row for what takes its margin down, some for as many steps as they keep on."""

    def __init__(self, shape: tuple[int, int]) -> None:
        rows, legs = shape
        self._corners = np.array(list(itertools.product((-1.0, 1.0), repeat=legs)), dtype=np.float32)
        self._persistence = np.array(_PERSISTENCE)[np.arange(rows) % len(_PERSISTENCE)]
        self._actions, self._age = np.zeros(shape, dtype=np.float32), np.zeros(rows, dtype=np.int64)

    def actions(self, env: Any) -> Actions:
        """Return the next actions."""
        asks = self._age % self._persistence == 0
        worst = _margins(env, self._corners).argmin(axis=1)
        self._actions[asks] = self._corners[worst[asks]]
        self._age += 1
        return self._actions.copy()


def _margins(env: Any, corners: Actions) -> Array:
    """Return the margins after each of some actions (k, legs), for every row, (n, k); negative where it is lost."""
    batch = env.unwrapped
    if isinstance(batch, MechanismVectorEnv):
        told = [batch.preview(np.tile(corners, (batch.num_envs, 1, 1)))]
    elif isinstance(batch, SyncVectorEnv):
        singles: list[Any] = [own.unwrapped for own in batch.envs]
        told = [own.preview(corners) for own in singles]
    lost = np.concatenate([np.atleast_2d(own.cost_unstable) > 0.0 for own in told])
    return np.where(lost, -1.0, np.concatenate([np.atleast_2d(own.singularity_margin) for own in told]))
