"""Singular curves: against singular values, finite differences, complete sets of solutions, and geometry."""

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from functools import lru_cache

import numpy as np
import pytest

from pcm_gym.arrays import Array
from pcm_gym.kernels.branches.singularity import FORWARD, INVERSE, set_normal, set_unknowns
from pcm_gym.kernels.statics.closure import make_workspace, set_inverse_matrix, set_matrix, set_residual
from pcm_gym.mechanism import Leg, Mechanism, Prismatic, Revolute, Rod, get_mechanism
from pcm_gym.solving import (
    CurveEnd,
    Equilibrium,
    SingularCurve,
    build_atlas,
    find_crossings,
    forward_singularities,
    inverse_singularities,
    solve_forward,
    solve_inverse,
)

RHO_MAX = 9.0


@lru_cache(maxsize=8)
def folds(name: str, grid: int = 6) -> tuple[SingularCurve, ...]:
    return forward_singularities(get_mechanism(f"{name}-paper"), grid=grid, progress=False)


@lru_cache(maxsize=8)
def inverse_curves(name: str, grid: int = 6) -> tuple[SingularCurve, ...]:
    return inverse_singularities(get_mechanism(f"{name}-paper"), grid=grid, progress=False)


def scaled(matrix: Array) -> Array:
    """Return the matrix with its columns, then its rows, of unit length: what singular means has no units."""
    matrix = matrix / np.linalg.norm(matrix, axis=0)
    return matrix / np.linalg.norm(matrix, axis=1)[:, None]


def jacobian(equilibrium: Equilibrium, *, is_forward: bool) -> Array:
    mechanism = equilibrium.mechanism
    size = mechanism.state_size
    work = make_workspace(mechanism.leg_count, size)
    unknowns = np.concatenate([equilibrium.state, equilibrium.inputs / mechanism.units.inputs])
    set_unknowns(mechanism.leg_table, unknowns, work)
    (set_matrix if is_forward else set_inverse_matrix)(mechanism.leg_table, np.array(equilibrium.state), work)
    return work.matrix[:size, :size].copy()


def jacobian_by_differences(equilibrium: Equilibrium, *, is_forward: bool) -> Array:
    """Return central differences of the residual alone; the columns are steps of tips, forces, pose or inputs."""
    mechanism = equilibrium.mechanism
    size, pose = mechanism.state_size, 2 * mechanism.leg_count
    work = make_workspace(mechanism.leg_count, size)
    centre = np.concatenate([equilibrium.state, equilibrium.inputs / mechanism.units.inputs])
    exact = jacobian(equilibrium, is_forward=is_forward)
    moved = [*range(pose), *(range(pose, size) if is_forward else range(size, len(centre)))]
    columns = []
    for column, k in enumerate(moved):
        step = 1e-5 / max(1.0, float(np.linalg.norm(exact[:, column])))
        residuals = []
        for side in (1.0, -1.0):
            unknowns = centre.copy()
            unknowns[k] += side * step
            set_unknowns(mechanism.leg_table, unknowns, work)
            set_residual(mechanism.leg_table, unknowns[:size], equilibrium.load / mechanism.units.load, work)
            residuals.append(work.residual.copy())
        columns.append((residuals[0] - residuals[1]) / (2.0 * step))
    return np.column_stack(columns)


def sample(curves: tuple[SingularCurve, ...], count: int, seed: int) -> list[tuple[SingularCurve, int]]:
    """Return random vertices, spread over all curves by their number of vertices."""
    rng = np.random.default_rng(seed)
    places = [(curve, k) for curve in curves for k in range(len(curve))]
    return [places[n] for n in rng.choice(len(places), count, replace=False)]


def largest_rho(equilibrium: Equilibrium) -> float:
    return max(rod.rho for rod in equilibrium.rods)


class TestSingular:
    CASES = (("2RFR", True), ("2PFR", True), ("2RFR", False), ("2PFR", False))

    @pytest.mark.parametrize(("name", "is_forward"), CASES)
    def test_the_vertices_are_singular_equilibria(self, name: str, is_forward: bool) -> None:
        curves = folds(name) if is_forward else inverse_curves(name)
        for curve in curves:
            for k in {*range(0, len(curve), 3), len(curve) - 1, *curve.cusps}:
                equilibrium = curve.equilibrium(k)
                assert equilibrium.residual < 1e-11
                least = np.linalg.svd(scaled(jacobian(equilibrium, is_forward=is_forward)), compute_uv=False)[-1]
                assert least < 1e-9, (curve, k)

    @pytest.mark.parametrize(("name", "is_forward"), CASES)
    def test_so_say_differences_of_the_residual(self, name: str, is_forward: bool) -> None:
        for curve, k in sample(folds(name) if is_forward else inverse_curves(name), 60, 1):
            matrix = jacobian_by_differences(curve.equilibrium(k), is_forward=is_forward)
            # central differences err by 1e-10 of the third derivatives
            assert np.linalg.svd(scaled(matrix), compute_uv=False)[-1] < 1e-6, (curve, k)

    def test_vertices_are_close_and_ends_are_where_they_say(self) -> None:
        for curve in folds("2RFR"):
            assert np.abs(np.diff(curve.inputs, axis=0)).max() < 0.15
            largest = max(largest_rho(curve.equilibrium(k)) for k in (0, -1))
            if curve.is_closed:
                turns = (curve.inputs[-1] - curve.inputs[0]) / (2.0 * math.pi)
                np.testing.assert_allclose(turns, np.round(turns), atol=1e-6)
                np.testing.assert_allclose(curve.poses[-1], curve.poses[0], atol=1e-6)
            else:
                assert curve.ends == (CurveEnd.LARGEST_LOAD, CurveEnd.LARGEST_LOAD)
                assert largest == pytest.approx(RHO_MAX, abs=1e-6)


def length(curve: SingularCurve) -> float:
    """Return the length of the projected curve; vertices lie differently on every run, which changes it a little."""
    return float(curve.arc_length[-1])


class TestComplete:
    @pytest.mark.slow
    @pytest.mark.parametrize("name", ["2RFR", "2PFR"])
    def test_halving_the_grid_finds_the_same_folds(self, name: str) -> None:
        coarse, fine = folds(name), folds(name, 12)
        assert [curve.indices for curve in coarse] == [curve.indices for curve in fine]
        assert [len(curve.cusps) for curve in coarse] == [len(curve.cusps) for curve in fine]
        np.testing.assert_allclose([length(c) for c in coarse], [length(c) for c in fine], rtol=1e-3)

    def test_halving_the_grid_finds_the_same_inverse_singularities(self) -> None:
        coarse, fine = inverse_curves("2RFR"), inverse_curves("2RFR", 12)
        assert len(coarse) == len(fine)
        np.testing.assert_allclose([length(c) for c in coarse], [length(c) for c in fine], rtol=1e-3, atol=1e-6)

    def test_the_limits_of_stability_are_those_among_all_folds(self) -> None:
        alone = forward_singularities(get_mechanism("2RFR-paper"), index=0, grid=6, progress=False)
        among_all = [curve for curve in folds("2RFR") if curve.is_stability_limit]
        assert [len(curve.cusps) for curve in alone] == [len(curve.cusps) for curve in among_all]
        np.testing.assert_allclose([length(c) for c in alone], [length(c) for c in among_all], rtol=1e-3)

    def test_mirror_images_are_there(self) -> None:
        """The 2RFR is symmetric left-right and up-down, and so is the set of the numbers of each kind of fold."""
        images = [sorted(round(length(c), 2) for c in folds("2RFR") if c.indices == (i, i + 1)) for i in range(3)]
        assert all(len(lengths) % 2 == 0 for lengths in images)
        for lengths in images:
            np.testing.assert_allclose(lengths[::2], lengths[1::2], rtol=2e-3)


def normal(equilibrium: Equilibrium, *, is_forward: bool) -> Array:
    mechanism = equilibrium.mechanism
    work, found = make_workspace(mechanism.leg_count, mechanism.state_size), np.empty(2)
    unknowns = np.concatenate([equilibrium.state, equilibrium.inputs / mechanism.units.inputs])
    set_unknowns(mechanism.leg_table, unknowns, work)
    set_normal(mechanism.leg_table, unknowns, FORWARD if is_forward else INVERSE, work, found)
    return found


def distance_to_segments(points: Array, point: Array, period: float) -> Array:
    """Return the distance of a point from each segment of a polygon, full turns aside."""
    start = points[:-1] - point
    start -= period * np.round(start / period) if period else 0.0
    way = np.diff(points, axis=0)
    part = np.clip(-(start * way).sum(axis=1) / np.maximum((way * way).sum(axis=1), 1e-300), 0.0, 1.0)
    return np.linalg.norm(start + part[:, None] * way, axis=1)


def clearance(curves: tuple[SingularCurve, ...], curve: SingularCurve, k: int, *, period: float) -> float:
    """Return how far, in its plane, vertex k is from other curves, other parts of its own, and cusps."""
    least = math.inf
    for other in curves:
        distance = distance_to_segments(other.points, curve.points[k], period)
        if other is curve:
            away = np.minimum(np.abs(np.arange(len(distance)) - k), np.abs(np.arange(len(distance)) + 1 - k))
            away = np.minimum(away, len(distance) - away) if curve.is_closed else away
            distance = np.append(
                distance[away > 1], np.linalg.norm(curve.points[[*curve.cusps]] - curve.points[k], axis=1)
            )
        least = min(least, float(distance.min(initial=math.inf)))
    return least


class TestSolutionsOnBothSides:
    """Across a singular curve two solutions meet and vanish.

    Left out are vertices nearer than four steps to another curve or a cusp, where the step may cross a second curve,
    and those at which some solution has a rod so near the largest load that the step may carry it across.
    """

    STEP, CLEARANCE = 2e-4, 8e-4
    NEAR_LARGEST, NEAR_LARGEST_PAIR = 0.01, 0.2  # of one equilibrium; of a pair, which parts like the root of the step

    def places(
        self, curves: tuple[SingularCurve, ...], count: int, period: float
    ) -> Iterator[tuple[SingularCurve, int, list[Sequence[Equilibrium]]]]:
        """Yield vertices, with the solutions on their two sides."""
        left = count
        for curve, k in sample(curves, min(8 * count, sum(map(len, curves))), 2):
            if left == 0:
                return
            is_clear = clearance(curves, curve, k, period=period) > self.CLEARANCE
            if not is_clear or largest_rho(curve.equilibrium(k)) > RHO_MAX - self.NEAR_LARGEST_PAIR:
                continue
            away = self.STEP * normal(curve.equilibrium(k), is_forward=curve.is_forward)
            solve, centre = (solve_forward, curve.inputs) if curve.is_forward else (solve_inverse, curve.poses)
            sides = [solve(curve.mechanism, centre[k] + way * away, rho_max=RHO_MAX + 0.1) for way in (1.0, -1.0)]
            beyond = [largest_rho(found) - RHO_MAX for found in itertools.chain(*sides)]
            if min(map(abs, beyond), default=math.inf) > self.NEAR_LARGEST:
                left -= 1
                yield curve, k, [[found for found in side if largest_rho(found) < RHO_MAX] for side in sides]

    @pytest.mark.slow
    @pytest.mark.parametrize(("name", "count"), [("2RFR", 200), ("2PFR", 40)])
    def test_counts_of_equilibria_differ_by_two_of_neighbouring_index(self, name: str, count: int) -> None:
        places = list(self.places(folds(name), count, 2.0 * math.pi if name == "2RFR" else 0.0))
        assert len(places) == count
        for curve, k, sides in places:
            fewer, more = sorted(sides, key=len)
            assert len(more) - len(fewer) == 2, (curve, k)
            indices = sorted(found.index for found in more)
            for found in fewer:
                indices.remove(found.index)
            assert tuple(indices) == curve.indices, (curve, k)

    @pytest.mark.parametrize("step", [2e-4, 1e-8])
    @pytest.mark.parametrize("name", ["2RFR", "2PFR"])
    def test_counts_of_inputs_differ_by_two(self, name: str, step: float) -> None:
        self.STEP = step
        places = list(self.places(inverse_curves(name), 60, 0.0))
        assert len(places) > 20
        for curve, k, sides in places:
            assert abs(len(sides[0]) - len(sides[1])) == 2, (curve, k, [len(side) for side in sides])


class TestGeometry:
    def test_where_a_rod_is_straight_the_workspace_ends_on_its_circle(self) -> None:
        """An inverse singularity with a straight rod has the tip one rod length from the motor."""
        mechanism, straight = get_mechanism("2RFR-paper"), 0
        for curve in inverse_curves("2RFR"):
            for leg in range(2):
                if np.abs(curve.states[:, 2 * leg + 1]).max() > 1e-7:  # bent somewhere
                    continue
                straight += 1
                base = np.array(mechanism.legs[leg].actuator.base)
                np.testing.assert_allclose(np.linalg.norm(curve.poses - base, axis=1), 1.0, atol=1e-12)
        assert straight == 4

    def test_the_projected_curve_stands_still_at_a_cusp(self) -> None:
        """The tangent has no part in the inputs there, and has the opposite one after it."""
        for curve in folds("2RFR"):
            for k in curve.cusps:
                velocity = curve.tangents[:, -2:]
                assert np.abs(velocity[k]).max() < 1e-6 * np.abs(velocity).max()
                if 0 < k < len(curve) - 1:
                    assert velocity[k - 1] @ velocity[k + 1] < 0.0

    def test_parallel_rails_make_straight_folds(self) -> None:
        """Both sliders moved alike carry the whole 2PFR along: a fold is a line of constant difference of inputs."""
        for curve in folds("2PFR"):
            difference = curve.inputs[:, 0] - curve.inputs[:, 1]
            np.testing.assert_allclose(difference, difference[0], atol=1e-9)
            assert curve.ends == (CurveEnd.BOUNDS, CurveEnd.BOUNDS)

    def test_curves_end_at_given_bounds(self) -> None:
        bounds = [(0.0, 2.0), (0.5, 2.5)]
        curves = forward_singularities(get_mechanism("2RFR-paper"), rho_max=6.0, bounds=bounds, grid=3, progress=False)
        assert curves
        for curve in curves:
            assert (curve.inputs >= np.array(bounds)[:, 0] - 1e-8).all()
            assert (curve.inputs <= np.array(bounds)[:, 1] + 1e-8).all()


class TestCrossings:
    def test_crossings_are_two_singular_equilibria_at_the_same_inputs(self) -> None:
        limits = [curve for curve in folds("2RFR") if curve.is_stability_limit]
        crossings = find_crossings(limits)
        assert crossings
        for crossing in crossings:
            first, second = crossing.equilibria
            turns = (first.inputs - second.inputs) / (2.0 * math.pi)
            np.testing.assert_allclose(turns, np.round(turns), atol=1e-9)
            assert np.abs(first.state - second.state).max() > 1e-3
            for equilibrium in crossing.equilibria:
                assert equilibrium.residual < 1e-10
                assert np.linalg.svd(scaled(jacobian(equilibrium, is_forward=True)), compute_uv=False)[-1] < 1e-9

    def test_closed_curves_cross_an_even_number_of_times(self) -> None:
        """Two closed curves on the torus of angles that wind round it not at all."""
        limits = [
            curve
            for curve in folds("2RFR")
            if curve.is_closed and np.abs(curve.inputs[-1] - curve.inputs[0]).max() < 1.0
        ]
        crossings = find_crossings(limits)
        for i in range(len(limits)):
            for j in range(i):
                assert sum(crossing.curves == (j, i) for crossing in crossings) % 2 == 0

    def test_curves_of_different_kinds_are_refused(self) -> None:
        with pytest.raises(ValueError, match="curves must be of one mechanism and kind"):
            find_crossings([folds("2RFR")[0], inverse_curves("2RFR")[0]])


class TestOtherMechanisms:
    def test_unequal_rods_a_load_and_mixed_actuators(self) -> None:
        mechanism = Mechanism(
            "mixed",
            (
                Leg(Revolute((-0.3, 0.0), limits=(0.2, 2.8)), Rod(0.9, 1.4)),
                Leg(Prismatic((0.3, 0.1), 1.2, 1.5, (-0.4, 0.4)), Rod(1.2, 0.8)),
            ),
        )
        load = np.array([1.0, -2.0])
        curves = forward_singularities(mechanism, load, 6.0, grid=4, progress=False)
        assert curves
        for curve in curves:
            for k in range(0, len(curve), 5):
                equilibrium = curve.equilibrium(k)
                assert equilibrium.residual < 1e-11
                assert np.linalg.svd(scaled(jacobian(equilibrium, is_forward=True)), compute_uv=False)[-1] < 1e-9

    def test_a_platform_on_a_slice_of_poses(self) -> None:
        mechanism = get_mechanism("3PFR-paper")
        curves = inverse_singularities(mechanism, rho_max=5.0, held={2: 0.1}, grid=3, progress=False)
        assert curves
        for curve in curves:
            np.testing.assert_allclose(curve.poses[:, 2], 0.1, atol=1e-9)
            for k in range(0, len(curve), 7):
                assert (
                    np.linalg.svd(scaled(jacobian(curve.equilibrium(k), is_forward=False)), compute_uv=False)[-1] < 1e-9
                )

    @pytest.mark.parametrize(
        ("arguments", "message"),
        [
            ({"held": {0: 0.1}}, "held must leave two"),
            ({"grid": 0}, "grid must be"),
            ({"bounds": [(0.0, 1.0)]}, "bounds must have one"),
            ({"rho_max": -1.0}, "rho_max must be"),
        ],
    )
    def test_wrong_arguments_are_named(self, arguments: dict[str, object], message: str) -> None:
        with pytest.raises(ValueError, match=message):
            forward_singularities(get_mechanism("2RFR-paper"), progress=False, **arguments)  # type: ignore[arg-type]


@pytest.mark.parametrize("solve", [forward_singularities, inverse_singularities, build_atlas])
def test_unknown_keywords_are_refused(solve: Callable[..., object]) -> None:
    with pytest.raises(TypeError, match="cells"):
        solve(get_mechanism("2RFR-paper"), progress=False, cells=8)
