"""Policies that come with the package do, on the exact solver, what their cards say."""

import pytest

import pcm_gym
from agents.commands.evaluate import evaluate
from pcm_gym.policies.shipped import FOLDER, PolicyKey


def distinct() -> list[PolicyKey]:
    """Return the keys of the policies that differ: the best of a tier may be the safest too."""
    return list({(key.environment_id, pcm_gym.load_policy(*key).card["digest"]): key for key in shipped()}.values())


def shipped() -> list[PolicyKey]:
    return pcm_gym.shipped_policies()


@pytest.mark.parametrize("key", distinct(), ids=lambda key: key.file_name)
def test_a_shipped_policy_comes_to_what_its_card_says(key: PolicyKey) -> None:
    evaluate(FOLDER / key.file_name)  # on every episode of the card; ends with exit code 1 outside the interval


def test_all_of_them_are_small() -> None:
    assert sum((FOLDER / key.file_name).stat().st_size for key in shipped()) < 10e6
