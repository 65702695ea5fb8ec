"""Rollouts of environments as plain records, and their exact comparison."""

import copy
import hashlib
import importlib
import os
from collections.abc import Iterator
from typing import Any

import gymnasium
import numpy as np
from gymnasium.envs.registration import EnvSpec
from numpy.typing import NDArray

import pcm_gym
from pcm_gym.environments.registration import ENVIRONMENTS
from pcm_gym.tasks import Switch

# The mechanisms that have environments.
MECHANISMS = list(dict.fromkeys(own.mechanism for own in ENVIRONMENTS))

INFO_TYPES = pcm_gym.Info.__annotations__
METRICS: dict[str, dict[str, Any]] = {
    "Track": {"share_at_goal": float, "error": float},
    "Switch": {"fewest_falls": int},
}
COSTS = tuple(name for name in INFO_TYPES if name.startswith("cost_"))


def chosen_ids() -> list[str]:
    """Those of the package, or of the files that a variable names: ``PCM_ENVIRONMENTS=file:id,file:id``."""
    named = os.environ.get("PCM_ENVIRONMENTS")
    if named is None:
        return pcm_gym.environment_ids()
    files, ids = zip(*(each.split(":") for each in named.split(",")), strict=True)
    for name in files:
        importlib.import_module(name)
    return list(ids)


def info_types(env: Any) -> dict[str, Any]:
    """What infos hold of an environment or a batch of the package, and of what types."""
    task = env.unwrapped.task
    name, is_told = type(task).__name__, not isinstance(task, Switch) or task.difficulty == "fall"
    return {**INFO_TYPES, **(METRICS.get(name, {}) if is_told else {})}


def mechanism_of(environment_id: str) -> str:
    return environment_id.rpartition("/")[2].split("-")[0]


def make(environment_id: str, **keywords: Any) -> Any:
    """The single environment as it is registered, with Gymnasium's wrappers."""
    return gymnasium.make(environment_id, **keywords)


def make_bare(environment_id: str | EnvSpec, **keywords: Any) -> Any:
    """The single environment without any wrapper."""
    return gymnasium.make(environment_id, **keywords).unwrapped


def make_native(environment_id: str, num_envs: int, **keywords: Any) -> Any:
    return gymnasium.make_vec(
        environment_id, num_envs=num_envs, vectorization_mode="vector_entry_point", **keywords
    ).unwrapped


def sweeping_actions(steps: int, shape: tuple[int, ...], seed: int, hold: int = 10) -> NDArray[np.float32]:
    """Actions (steps, *shape) that keep a direction for a while, most at full size: they meet folds and limits."""
    generator = np.random.default_rng(seed)
    drawn = np.clip(3.0 * generator.normal(size=(-(-steps // hold), *shape)), -1.0, 1.0)
    return np.repeat(drawn, hold, axis=0)[:steps].astype(np.float32)


def roll_single(env: Any, seed: int, steps: int, *, spoil: bool = False) -> list[Any]:
    """Everything that reset and step return; a reset follows the end of an episode and every 40th step.

    With `spoil` what the environment returned is overwritten, once it has been copied.
    """
    actions = sweeping_actions(steps, env.action_space.shape, seed)
    records = [_kept(env.reset(seed=seed), spoil)]
    for n, action in enumerate(actions, start=1):
        records.append(_kept(env.step(action), spoil))
        if records[-1][2] or records[-1][3] or n % 40 == 0:
            records.append(_kept(env.reset(), spoil))
    return records


def roll_batch(env: Any, seed: int, steps: int, *, spoil: bool = False) -> list[Any]:
    actions = sweeping_actions(steps, env.action_space.shape, seed)
    return [_kept(env.reset(seed=seed), spoil), *(_kept(env.step(action), spoil) for action in actions)]


def _kept(result: Any, spoil: bool) -> Any:
    kept = copy.deepcopy(result)
    if spoil:
        for _, leaf in leaves(result):
            if isinstance(leaf, np.ndarray):
                leaf[...] = None if leaf.dtype == object else 1
    return kept


def leaves(data: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """Paths and values of all that is no container."""
    if isinstance(data, dict):
        items: Any = data.items()
    elif isinstance(data, list | tuple) or (isinstance(data, np.ndarray) and data.dtype == object):
        items = enumerate(data)
        if isinstance(data, np.ndarray):
            yield path, data
    else:
        yield path, data
        return
    for key, value in items:
        yield from leaves(value, f"{path}/{key}")


def assert_same(first: Any, second: Any) -> None:
    """Same containers, types, shapes and bits (a missing key, 0 and -0, or int for float are differences)."""
    first_leaves, second_leaves = dict(leaves(first)), dict(leaves(second))
    assert first_leaves.keys() == second_leaves.keys(), first_leaves.keys() ^ second_leaves.keys()
    for path, value in first_leaves.items():
        other = second_leaves[path]
        assert type(value) is type(other), (path, type(value), type(other))
        if isinstance(value, np.ndarray):
            assert (value.dtype, value.shape) == (other.dtype, other.shape), path
            if value.dtype != object:  # the elements of those are leaves of their own
                assert value.tobytes() == other.tobytes(), (path, value, other)
        else:
            assert value == other, (path, value, other)


def digest(records: Any) -> str:
    """Hexadecimal digest of every bit of the records."""
    result = hashlib.sha256()
    for path, value in leaves(records):
        result.update(path.encode())
        if isinstance(value, np.ndarray):
            result.update(b"" if value.dtype == object else value.tobytes())
        else:
            result.update(repr(value).encode())
    return result.hexdigest()


def digests_of_all() -> dict[str, list[str]]:
    """Digests of a rollout of every registered environment, single and batched."""
    return {
        environment_id: [
            digest(roll_single(make_bare(environment_id), seed=5, steps=60)),
            digest(roll_batch(make_native(environment_id, 3), seed=5, steps=60)),
        ]
        for environment_id in chosen_ids()
    }
