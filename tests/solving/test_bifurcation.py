"""Bifurcation diagrams against shooting with a bordered system, and against complete sets at random places."""

from functools import cache
from typing import Any

import numpy as np
import pytest

import pcm_gym
from pcm_gym.arrays import Array
from pcm_gym.solving.diagram import SpecialKind, Way
from tests.reference.shooting_folds import TwoRods, residual, singular_place

RNG = np.random.default_rng(20)
EI = pcm_gym.get_mechanism("2RFR").legs[0].rod.bending_stiffness  # with lengths of 1 m: the unit of loads, N
SAME = 1e-5


def ways() -> dict[str, tuple[str, dict[str, Any]]]:
    """Return mechanisms and lines, symmetric and not, of inputs, of load and of both."""
    start = np.radians([120.0, 60.0])
    return {
        "inputs": ("2RFR", {"inputs": (start, start + np.array([1.5, 0.7]))}),
        "symmetric inputs": ("2RFR", {"inputs": (start, start + np.array([2.0, -2.0]))}),
        "load": ("2RFR", {"inputs": start, "load": ((0.0, 0.0), (3.0 * EI, -20.0 * EI))}),
        "inputs and load": ("2RFR", {"inputs": (start, start + 0.4), "load": ((0.0, 0.0), (0.0, -20.0 * EI))}),
        "symmetric load": ("2PFR", {"load": ((0.0, 20.0 * EI), (0.0, -20.0 * EI))}),
    }


@cache
def diagram(name: str) -> pcm_gym.BifurcationDiagram:
    mechanism, along = ways()[name]
    return pcm_gym.bifurcation_diagram(pcm_gym.get_mechanism(mechanism), along)


def as_shooting(way: Way) -> TwoRods:
    """Return the way as shooting takes it."""
    legs = way.mechanism.legs

    def clamps(s: Any) -> Any:
        inputs = way.inputs[0] + np.multiply.outer(s, way.inputs[1] - way.inputs[0])
        base = np.array([leg.actuator.base for leg in legs])
        angle = np.array([leg.actuator.clamp_angle for leg in legs]) + 0.0 * inputs
        if legs[0].actuator.is_angle:
            return base[:, 0] + 0.0 * inputs, base[:, 1] + 0.0 * inputs, angle + inputs
        axis = np.array([leg.actuator.axis for leg in legs])
        return base[:, 0] + axis[:, 0] * inputs, base[:, 1] + axis[:, 1] * inputs, angle

    def load(s: Any) -> Any:
        full = way.loads[0] + np.multiply.outer(s, way.loads[1] - way.loads[0])
        return full[..., 0], full[..., 1]

    lengths = np.array([leg.rod.length for leg in legs])
    return TwoRods(lengths, np.array([leg.rod.bending_stiffness for leg in legs]), clamps, load)


def shooting_unknowns(equilibrium: pcm_gym.Equilibrium) -> Array:
    """Return each rod's curvature at its clamp and the force on its tip."""
    shapes, unknowns = equilibrium.shape(2), []
    for leg, rod, shape in zip(equilibrium.mechanism.legs, equilibrium.rods, shapes, strict=True):
        lever, force = shape[1] - shape[0], rod.force
        unknowns += [(lever[0] * force[1] - lever[1] * force[0]) / leg.rod.bending_stiffness, *force]
    return np.array(unknowns)


@pytest.mark.slow
@pytest.mark.parametrize("name", ways())
def test_special_points_agree_with_shooting(name: str) -> None:
    own = diagram(name)
    rods = as_shooting(own.way)
    assert own.points
    for point in own.points:
        guess = shooting_unknowns(point.equilibrium)
        assert (
            np.abs(residual(rods, guess[None].astype(np.complex128), np.array([point.fraction], np.complex128))).max()
            < 1e-6
        )
        fraction, unknowns, size = singular_place(rods, guess * (1.0 + 1e-4), point.fraction + 1e-4)
        assert size < 1e-8
        assert fraction == pytest.approx(point.fraction, abs=1e-8)
        np.testing.assert_allclose(unknowns, guess, atol=1e-4 * np.abs(guess).max())


@pytest.mark.parametrize("name", ways())
def test_no_branch_is_missing_at_random_slices(name: str) -> None:
    own = diagram(name)
    for fraction in RNG.random(40):
        wanted = pcm_gym.solve_forward(own.mechanism, own.way.inputs_at(fraction), own.way.load_at(fraction))
        found = [each for _, each in own.at(fraction)]
        assert len(found) == len(wanted)
        for mine, theirs in zip(found, wanted, strict=True):
            assert mine.residual < 1e-9
            assert min(np.abs(mine.state - each.state).max() for each in wanted) < SAME * (
                1.0 + np.abs(mine.state).max()
            )
            assert min(np.abs(theirs.state - each.state).max() for each in found) < SAME * (
                1.0 + np.abs(theirs.state).max()
            )


@pytest.mark.parametrize("name", ways())
def test_indices_change_at_special_points_alone(name: str) -> None:
    own = diagram(name)
    assert not any(each.unfollowed for each in own.slices)
    met = {vertex for point in own.points for vertex in point.branches}
    for number, branch in enumerate(own.branches):
        assert {(number, k) for k in branch.special} <= met
        for first, last in branch.pieces():
            inside = range(first + 1, last)
            assert {branch.equilibrium(k).index for k in inside} <= {branch.index_of((first, last))}
        turns = np.flatnonzero(np.diff(np.sign(np.diff(branch.fractions)))) + 1
        assert set(turns.tolist()) <= set(branch.special)


def test_what_vertices_tell_is_what_equilibria_tell() -> None:
    for branch in diagram("symmetric load").branches:
        for k in range(1, len(branch), 7):
            if k in branch.special:
                continue
            there = branch.equilibrium(k)
            assert there.residual < 1e-9
            assert branch.energies[k] == pytest.approx(there.energy, rel=1e-12, abs=1e-14)
            assert branch.indices[k] == there.index
            assert branch.is_stable[k] == there.is_stable
            assert branch.stability_margins[k] == pytest.approx(there.stability_margin, rel=1e-9)
            assert branch.singularity_margins[k] == pytest.approx(there.singularity_margin, rel=1e-6)
            assert branch.largest_rhos[k] == pytest.approx(max(rod.rho for rod in there.rods), rel=1e-12)
            np.testing.assert_allclose(branch.poses[k], there.pose, atol=1e-14)


def test_kinds_are_told_apart_by_symmetry() -> None:
    """A pitchfork is on the axis of symmetry, with a pair of branches beside it, and is gone without the symmetry."""
    own = diagram("symmetric load")
    pitchforks = [point for point in own.points if point.kind is SpecialKind.PITCHFORK]
    assert pitchforks
    for point in pitchforks:
        assert abs(point.equilibrium.pose[0]) < 1e-5
        assert len(point.branches) == 2
        through, turning = (own.branches[number] for number, _ in point.branches)
        k = point.branches[1][1]
        assert np.abs(through.poses[:, 0]).max() < 1e-5 < np.abs(turning.poses[:, 0]).max()
        assert (turning.fractions[k + 3] - turning.fractions[k]) * (turning.fractions[k - 3] - turning.fractions[k]) > 0
        assert abs(point.indices[1] - point.indices[0]) == 1
    tilted = {"load": ((0.2 * EI, 20.0 * EI), (0.2 * EI, -20.0 * EI))}
    others = pcm_gym.bifurcation_diagram(own.mechanism, tilted)
    assert {point.kind for point in others.points} == {SpecialKind.FOLD}
    assert not any(point.kind is not SpecialKind.FOLD for point in diagram("inputs").points)


def test_slices_are_proved_where_that_is_asked_for() -> None:
    mechanism, along = ways()["inputs"]
    own = pcm_gym.bifurcation_diagram(pcm_gym.get_mechanism(mechanism), along, 6.0, slices=3, certify=True)
    assert all(each.is_proved for each in own.slices)
    assert [each.found for each in own.slices] == [len(own.at(each.fraction)) for each in own.slices]


def test_a_platform_has_a_diagram() -> None:
    mechanism = pcm_gym.get_mechanism("3PFR")
    home = np.array(mechanism.home_inputs)
    own = pcm_gym.bifurcation_diagram(mechanism, {"inputs": (home, home + np.array([0.2, 0.0, 0.0]))}, 5.0, slices=2)
    wanted = pcm_gym.solve_forward(mechanism, own.way.inputs_at(0.6), rho_max=5.0)
    assert sorted(each.index for _, each in own.at(0.6)) == sorted(each.index for each in wanted)


@pytest.mark.parametrize(
    ("along", "message"),
    [
        ({}, "along must lead"),
        ({"inputs": (1.0, 1.0)}, "along must lead"),
        ({"pose": ((0.0, 0.0), (1.0, 0.0))}, "along key"),
        ({"inputs": ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0))}, "along\\['inputs'\\]"),
        ({"load": ((0.0, 0.0), (np.inf, 0.0))}, "along\\['load'\\]"),
    ],
)
def test_lines_that_are_none_are_refused(along: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        pcm_gym.bifurcation_diagram(pcm_gym.get_mechanism("2RFR"), along)


def test_the_budget_of_a_search_holds_for_each_slice() -> None:
    mechanism, along = ways()["inputs"]
    with pcm_gym.search_budget(10.0), pytest.raises(pcm_gym.SearchBudgetError):
        pcm_gym.bifurcation_diagram(pcm_gym.get_mechanism(mechanism), along)


def test_places_beyond_the_line_are_refused() -> None:
    with pytest.raises(ValueError, match="fraction must be"):
        diagram("inputs").at(1.5)
