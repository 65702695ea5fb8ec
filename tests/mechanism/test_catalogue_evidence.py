"""The catalogued mechanisms could be built and are worth controlling: the page's evidence again, with fewer moves."""

import math

import numpy as np
import pytest

from benchmarks.evidence import HomeSheets, Moves, random_moves, reach_anywhere
from pcm_gym.mechanism import get_mechanism, mechanism_names

MOVES = 1000
EPISODES = 200


def chance(share: float, count: int) -> float:
    """Three standard deviations of a share that is seen among so many."""
    return 3.0 * math.sqrt(share * (1.0 - share) / count)


NAMES = [name for name in mechanism_names() if not name.endswith("-paper")]


@pytest.fixture(scope="module", params=NAMES)
def sheets(request) -> HomeSheets:
    return HomeSheets.of(get_mechanism(request.param))


def test_no_rod_yields_and_none_crosses_what_it_must_not_wherever_stable_ways_lead(sheets: HomeSheets) -> None:
    assert sheets.strength.stress.max() < 0.7
    assert not sheets.strength.has_contact.any()


def test_the_home_sheets_cover_most_inputs_and_many_of_them_again(sheets: HomeSheets) -> None:
    assert sheets.covered > 0.85
    assert sheets.covered_again > 0.3


def test_the_workspace_spans_half_a_rod(sheets: HomeSheets) -> None:
    assert (sheets.span[:2] > 0.5).all()


def assert_bearable(moves: Moves) -> None:
    assert moves.given_up == 0.0
    assert moves.greatest_stress < 0.7
    assert moves.contacts == 0
    assert moves.on_roadmap > 0.9


def test_random_moves_from_home_meet_folds_but_neither_yield_nor_contact(sheets: HomeSheets) -> None:
    moves = random_moves(sheets, sheets.at_home(MOVES), np.random.default_rng(1))
    assert 0.1 - chance(0.1, MOVES) <= moves.lost <= 0.4 + chance(0.4, MOVES)
    assert_bearable(moves)


def test_random_moves_from_where_tasks_start_meet_neither_yield_nor_contact_nor_straight_rods(
    sheets: HomeSheets,
) -> None:
    generator = np.random.default_rng(1)
    states = sheets.starts(MOVES, generator)
    for _ in range(2):  # the second goes on from where the first ended
        assert_bearable(random_moves(sheets, states, generator))


def test_heading_straight_for_the_goal_fails_often(sheets: HomeSheets) -> None:
    safe = reach_anywhere(sheets.roadmap.mechanism, "resolved rate", EPISODES).safe
    assert safe <= 0.6 + chance(0.6, EPISODES)


def test_random_actions_hardly_ever_succeed(sheets: HomeSheets) -> None:
    safe = reach_anywhere(sheets.roadmap.mechanism, "random", EPISODES).safe
    assert safe <= 0.05 + chance(0.05, EPISODES)


@pytest.mark.parametrize("name", [f"{name}-paper" for name in NAMES])
def test_the_papers_geometries_have_names_of_their_own(name: str) -> None:
    assert get_mechanism(name).name == name
    assert get_mechanism(name) != get_mechanism(name.removesuffix("-paper"))


def test_home_of_the_platform_is_at_the_centre_and_not_turned(sheets: HomeSheets) -> None:
    assert abs(sheets.home.pose[0]) < 1e-9
    assert (np.abs(sheets.home.pose[2:]) < 1e-6).all()


def test_the_papers_wires_would_yield() -> None:
    """The home of the 3PFR bends its wires to 12.7 per metre, where a wire of 1 mm yields at 5 per metre."""
    stress = HomeSheets.of(get_mechanism("3PFR-paper")).strength.stress
    assert stress.max() > 2.0
