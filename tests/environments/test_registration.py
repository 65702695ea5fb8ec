"""The table of environments."""

import itertools

import gymnasium
import pytest
from gymnasium.envs.registration import EnvSpec

import pcm_gym
from pcm_gym.environments.registration import ENVIRONMENTS, register_environments


def test_every_mechanism_has_every_task_under_the_name_of_both() -> None:
    pairs = list(itertools.product(["Reach", "Track", "Switch"], ["2RFR", "2PFR", "3PFR"]))
    assert [(own.task, own.mechanism) for own in ENVIRONMENTS] == pairs
    assert pcm_gym.environment_ids() == [f"PCM/{mechanism}-{task}-v0" for task, mechanism in pairs]
    assert set(pcm_gym.environment_ids()) <= set(gymnasium.registry)


def test_registering_twice_changes_nothing() -> None:
    before = dict(gymnasium.registry)
    register_environments()
    assert dict(gymnasium.registry) == before
    assert all(gymnasium.registry[key] is spec for key, spec in before.items())


@pytest.mark.parametrize("environment_id", pcm_gym.environment_ids())
def test_specifications_have_a_json(environment_id: str) -> None:
    spec = gymnasium.spec(environment_id)
    assert isinstance(spec.entry_point, str)
    assert isinstance(spec.vector_entry_point, str)
    assert not spec.nondeterministic
    assert EnvSpec.from_json(spec.to_json()) == spec
