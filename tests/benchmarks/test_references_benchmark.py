"""The table of references: every tier of every environment is judged or refused, and the planner bounds the others."""

import math
from dataclasses import replace

import pytest

import pcm_gym
from benchmarks.references import Score, as_json, judge, markdown, tiers
from pcm_gym.references import REFERENCES

EPISODES = 12
# The quickest of each kind of task.
JUDGED = ("PCM/2RFR-Reach-v0", "PCM/2RFR-Track-v0", "PCM/2PFR-Switch-v0")
QUICK = ("standing still", "random", "resolved rate", "planner")


@pytest.fixture(scope="module")
def scores() -> list[Score]:
    found = [judge(tier, QUICK, EPISODES, lambda: None) for tier in tiers(JUDGED, "train")]
    return [score for of_tier, _ in found for score in of_tier]


def test_every_environment_has_its_tiers() -> None:
    found = tiers(pcm_gym.environment_ids(), "train")
    assert {tier.id for tier in found} == set(pcm_gym.environment_ids())
    for tier in found:
        assert tier.arguments.get("difficulty", "") == tier.name
    assert len({(tier.id, tier.name) for tier in found}) == len(found) >= 2 * len(pcm_gym.environment_ids()) - 3


def test_whoever_knows_nothing_reaches_nothing_and_the_planner_nearly_all(scores: list[Score]) -> None:
    reach = [score for score in scores if "Reach" in score.id]
    assert {score.tier for score in reach} >= {"near", "anywhere"}
    for score in reach:
        assert 0.0 <= score.safe_success <= score.success <= 1.0
        if score.reference in ("standing still", "random"):
            assert score.success <= 0.1
            assert math.isnan(score.against_planner) or score.success > 0.0
        if score.reference == "planner":
            assert score.safe_success >= 0.9
            assert score.losses == 0.0
            assert score.against_planner == 1.0


def test_a_tier_that_a_mechanism_does_not_have_is_refused_in_words() -> None:
    (detour,) = (tier for tier in tiers(["PCM/2PFR-Reach-v0"], "train") if tier.name == "detour")
    detour = replace(detour, arguments={**detour.arguments, "mechanism": "2PFR-paper"})
    found, refusal = judge(detour, QUICK, 2, lambda: None)
    assert found == []
    assert refusal is not None
    assert "2PFR" in refusal.reason


def test_the_page_has_a_line_for_each_score(scores: list[Score]) -> None:
    page = markdown(scores, [], "Under test.")
    assert all(f"**{name}**" in page for name in REFERENCES)
    assert sum(line.startswith("| PCM/") for line in page.splitlines()) == len(scores)
    assert len(as_json(scores, [])["scores"]) == len(scores)
