"""The table of environments."""

import gymnasium
import pytest

import pcm_gym


def test_every_mechanism_has_every_task() -> None:
    ids = pcm_gym.environment_ids()
    assert len(ids) == len(set(ids))
    assert {f"PCM/{name}-Reach-v0" for name in pcm_gym.mechanism_names()} <= set(ids)
    assert set(ids) <= set(gymnasium.registry)


def test_registering_twice_changes_nothing() -> None:
    before = dict(gymnasium.registry)
    pcm_gym.register_environments()
    assert dict(gymnasium.registry) == before
    assert all(gymnasium.registry[key] is spec for key, spec in before.items())


@pytest.mark.parametrize("environment_id", pcm_gym.environment_ids())
def test_entry_points_are_strings(environment_id: str) -> None:
    spec = gymnasium.spec(environment_id)
    assert isinstance(spec.entry_point, str)
    assert isinstance(spec.vector_entry_point, str)
    assert not spec.nondeterministic
