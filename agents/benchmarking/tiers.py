"""Tiers: every environment in each of the difficulties that its task has."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, get_args, get_type_hints

import pcm_gym
from pcm_gym.environments.arguments import DEFAULTS
from pcm_gym.environments.registration import ENVIRONMENTS, Registered
from pcm_gym.tasks import Goals, task_type


@dataclass(frozen=True)
class Tier:
    """An environment in one of its tiers.

    Attributes
    ----------
    id : str
    name : str
        The difficulty; empty for a task without tiers.
    is_default : bool
        Whether an environment is in it when nothing is said.
    arguments : dict
        What `gymnasium.make_vec` is given.
    """

    id: str
    name: str
    is_default: bool
    arguments: Mapping[str, Any]


def tiers(ids: Sequence[str], split: str) -> list[Tier]:
    """Return every tier of some environments: as many as the difficulties that their tasks have."""
    entries = [entry for entry in ENVIRONMENTS if entry.id in ids]
    return [tier for entry in entries for tier in _tiers_of(entry, split)]


def _tiers_of(entry: Registered, split: str) -> Iterator[Tier]:
    kind, mechanism = task_type(entry.task), pcm_gym.get_mechanism(entry.mechanism)
    default = getattr(kind, "difficulty", "")
    for name in get_args(get_type_hints(kind).get("difficulty")) or ("",):
        own = {"difficulty": name} if name else {}
        allowed = kind(Goals(mechanism, with_inputs=kind.with_inputs), **own).behaviours
        if DEFAULTS["on_instability"] not in allowed:
            own["on_instability"] = allowed[0]
        yield Tier(entry.id, name, name == default, {"split": split, **own})
