"""Roadmaps: their ways are those that the tracker goes, their sheets those that enumeration finds."""

from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import pcm_gym
from pcm_gym.solving import Roadmap

MARGIN, STEP = 0.05, 0.2


@pytest.fixture(scope="module")
def roadmap() -> Roadmap:
    mechanism = pcm_gym.get_mechanism("2RFR-paper")
    home = pcm_gym.home_equilibrium(mechanism)
    seeds = list(pcm_gym.solve_forward(mechanism, home.inputs).stable)
    return pcm_gym.build_roadmap(mechanism, seeds, step=[STEP, STEP], least_margin=MARGIN)


def chosen(count: int, of: int) -> NDArray[np.int64]:
    return np.random.default_rng(0).choice(of, count, replace=False)


def test_nodes_are_stable_equilibria_in_the_middle_of_their_cells_with_the_margin(roadmap: Roadmap) -> None:
    assert len(roadmap) > 1000
    for node in chosen(60, len(roadmap)).tolist():
        found = roadmap.equilibrium(node)
        assert (found.is_stable, found.within_limits, found.residual < 1e-10) == (True, True, True)
        assert found.singularity_margin >= MARGIN * (1.0 - 1e-6)
        np.testing.assert_allclose(found.inputs, roadmap.raster.nodes([roadmap.cells[node]])[0], atol=1e-12)


def test_every_way_is_one_that_the_tracker_goes_there_and_back(roadmap: Roadmap) -> None:
    for node in chosen(60, len(roadmap)).tolist():
        for column, other in enumerate(roadmap.ways[node].tolist()):
            if other < 0:
                continue
            assert roadmap.ways[other, column ^ 1] == node
            step = pcm_gym.BranchTracker(roadmap.mechanism, roadmap.equilibrium(node)).step(roadmap.inputs[other])
            assert step.event is pcm_gym.Event.NONE
            np.testing.assert_allclose(step.equilibrium.state, roadmap.states[other], rtol=0.0, atol=1e-7)


def test_where_no_way_leads_stability_or_margin_would_be_lost_or_a_limit_is(roadmap: Roadmap) -> None:
    reasons = set()
    for node in chosen(400, len(roadmap)).tolist():
        for column in np.flatnonzero(roadmap.ways[node] < 0).tolist():
            target = roadmap.inputs[node].copy()
            target[column // 2] += (2 * (column % 2) - 1) * roadmap.raster.pitch[column // 2]
            step = pcm_gym.BranchTracker(roadmap.mechanism, roadmap.equilibrium(node)).step(target)
            if step.event is not pcm_gym.Event.NONE:
                reasons.add(step.event)
                continue
            half = pcm_gym.BranchTracker(roadmap.mechanism, roadmap.equilibrium(node))
            middle = half.step(0.5 * (target + roadmap.inputs[node])).equilibrium.singularity_margin
            end = step.equilibrium.singularity_margin
            assert end < MARGIN * (1.0 + 1e-6) or middle < MARGIN * 2.0 / 3.0 * (1.0 + 1e-6)
    assert {pcm_gym.Event.FOLD, pcm_gym.Event.ACTUATOR_LIMIT} <= reasons


def test_sheets_over_a_cell_are_among_the_stable_equilibria_there(roadmap: Roadmap) -> None:
    counts = np.bincount(roadmap.cells)
    for cell in np.flatnonzero(counts > 1)[::40].tolist():
        nodes = np.flatnonzero(roadmap.cells == cell)
        stable = pcm_gym.solve_forward(roadmap.mechanism, roadmap.inputs[nodes[0]], rho_max=12.0).stable
        assert len(stable) >= len(nodes)
        for node in nodes:
            gaps = [np.abs(found.state - roadmap.states[node]).max() for found in stable]
            assert min(gaps) < 1e-6


def test_shortest_ways_are_as_long_as_their_count_says(roadmap: Roadmap) -> None:
    start = roadmap.seeds[0]
    steps, falls = roadmap.step_counts([start])
    assert (falls[0][np.isfinite(steps[0])] == 0.0).all()
    for goal in chosen(40, len(roadmap)).tolist():
        way = roadmap.way(start, goal)
        if not np.isfinite(steps[0, goal]):
            assert roadmap.components[goal] != roadmap.components[start]
            assert len(way) == 0
            continue
        assert (way[0], way[-1], len(way) - 1) == (start, goal, steps[0, goal])
        assert all(second in roadmap.ways[first] for first, second in pairwise(way.tolist()))
    assert roadmap.way(start, start).tolist() == [start]


def test_components_agree_with_the_branches_of_the_atlas(roadmap: Roadmap) -> None:
    """Two nodes of one component are on one branch of an atlas; the roadmap may have more, cut by its margin."""
    atlas = pcm_gym.build_atlas(roadmap.mechanism, pitch=0.1, input_cells=48, seed_nodes=4, progress=False)
    nodes = chosen(40, len(roadmap)).tolist()
    branches: dict[int, set[Any]] = {}
    for node in nodes:
        branch = atlas.branch_of(roadmap.equilibrium(node))
        if branch is not None:
            branches.setdefault(int(roadmap.components[node]), set()).add(branch)
    assert len(branches) >= 2
    assert all(len(found) == 1 for found in branches.values())


def test_falls_land_where_snaps_do(roadmap: Roadmap) -> None:
    falls = pcm_gym.find_falls(roadmap, most=20)
    assert len(falls) > 5
    agreed = 0
    for start, landing in falls[:20].tolist():
        step = pcm_gym.BranchTracker(roadmap.mechanism, roadmap.equilibrium(start)).step(roadmap.inputs[landing])
        assert step.event in (pcm_gym.Event.FOLD, pcm_gym.Event.INDEX_CHANGE)
        fallen = pcm_gym.snap(step.equilibrium)
        end = pcm_gym.BranchTracker(roadmap.mechanism, fallen.equilibrium).step(roadmap.inputs[landing])
        if end.event is pcm_gym.Event.NONE:  # else it falls again
            np.testing.assert_allclose(end.equilibrium.state, roadmap.states[landing], rtol=0.0, atol=1e-6)
            agreed += 1
    assert agreed > 5


def test_a_seed_without_the_margin_has_no_node() -> None:
    mechanism = pcm_gym.get_mechanism("2RFR-paper")
    home = pcm_gym.home_equilibrium(mechanism)
    empty = pcm_gym.build_roadmap(mechanism, [home], least_margin=9.0)
    assert (len(empty), empty.seeds) == (0, (-1,))
    assert pcm_gym.find_falls(empty).shape == (0, 2)


def test_bad_arguments_are_named() -> None:
    mechanism, other = pcm_gym.get_mechanism("2RFR-paper"), pcm_gym.get_mechanism("2PFR-paper")
    home = pcm_gym.home_equilibrium(mechanism)
    unstable = next(found for found in pcm_gym.solve_forward(mechanism, home.inputs) if not found.is_stable)
    loaded = pcm_gym.home_equilibrium(mechanism, load=(0.0, 0.01))
    cases: list[tuple[str, Any]] = [
        ("at least one", []),
        ("'2RFR-paper'", [pcm_gym.home_equilibrium(other)]),
        ("stable", [unstable]),
        ("one load", [home, loaded]),
    ]
    for message, seeds in cases:
        with pytest.raises(ValueError, match=message):
            pcm_gym.build_roadmap(mechanism, seeds)
    for step in ([0.1], [0.1, -0.1], [0.1, np.nan]):
        with pytest.raises(ValueError, match="step"):
            pcm_gym.build_roadmap(mechanism, [home], step=step)
