"""The atlas against complete solution sets, tracked paths, the mechanisms' symmetry, and itself at other pitches."""

import math
from collections import deque
from dataclasses import fields, replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from scipy.stats import chisquare, kstest

from pcm_gym.mechanism import Leg, Mechanism, Prismatic, Revolute, Rod, get_mechanism
from pcm_gym.solving import (
    Atlas,
    BranchTracker,
    Equilibrium,
    Event,
    RasterStates,
    build_atlas,
    home_equilibrium,
    load_atlas,
    solve_forward,
    solve_inverse,
)

RHO_MAX = 9.0


def mixed_mechanism() -> Mechanism:
    """Return a motor and a slider with unequal rods."""
    return Mechanism(
        "mixed",
        (
            Leg(Revolute((-0.3, 0.1), clamp_angle=0.4, limits=(-1.0, 2.5)), Rod(1.1, 1.0)),
            Leg(Prismatic((0.3, 0.0), axis_angle=1.3, clamp_angle=1.8, limits=(-0.4, 0.5)), Rod(0.8, 1.7)),
        ),
    )


def make_atlas(name: str) -> Atlas:
    if name == "mixed":
        return build_atlas(mixed_mechanism(), (1.5, -2.0), pitch=0.02, input_cells=40, seed_nodes=5, progress=False)
    return build_atlas(get_mechanism(f"{name}-paper"), pitch=0.025, input_cells=48, seed_nodes=6, progress=False)


@pytest.fixture(scope="module", params=["2RFR", "2PFR", "mixed"])
def atlas(request: pytest.FixtureRequest) -> Atlas:
    return make_atlas(request.param)


@pytest.fixture(scope="module")
def motors() -> Atlas:
    return make_atlas("2RFR")


@pytest.fixture(scope="module")
def slice_of_platform() -> Atlas:
    """3PFR at the angle of its home, at a pitch that is coarse for the whole but fine for this thin region."""
    return build_atlas(
        get_mechanism("3PFR-paper"),
        pitch=0.02,
        input_cells=10,
        seed_nodes=1,
        orientation=0.161919,
        progress=False,
    )


def stored(atlas: Atlas, sheets: RasterStates, row: int) -> Equilibrium:
    """Return an equilibrium as it is stored, in single precision."""
    units = atlas.mechanism.units
    state = np.concatenate([sheets.rods[row], sheets.poses[row] / units.pose])
    return Equilibrium(atlas.mechanism, state, sheets.inputs[row].astype(float), atlas.load)


def even_cells(sheets: RasterStates, rng: np.random.Generator, count: int) -> np.ndarray:
    """Return random cells whose neighbours, corner to corner, have as many equilibria as they: away from borders."""
    counts = sheets.counts
    windows = np.lib.stride_tricks.sliding_window_view(np.pad(counts, 2, constant_values=-1), (5, 5))
    return rng.choice(np.flatnonzero((windows == counts[..., None, None]).all(axis=(2, 3))), count, replace=False)


def inverse_within_limits(mechanism: Mechanism, pose: np.ndarray, load: np.ndarray) -> list[Equilibrium]:
    """Return the stable solutions within the limits, angles turned into the limits."""
    turns = np.array([2.0 * math.pi * isinstance(leg.actuator, Revolute) for leg in mechanism.legs])
    lower, found = mechanism.lower_limits, []
    for solution in solve_inverse(mechanism, pose, load, RHO_MAX).stable:
        behind = np.divide(lower - solution.inputs, turns, out=np.zeros(len(lower)), where=turns > 0.0)
        turned = Equilibrium(mechanism, solution.state, solution.inputs + turns * np.ceil(behind), load)
        if turned.within_limits:
            found.append(turned)
    return found


# What is stored


def test_every_stored_equilibrium_holds_in_single_precision(atlas):
    for sheets in (atlas.over_inputs, atlas.over_poses):
        for row in range(0, len(sheets), 7):
            found = stored(atlas, sheets, row)
            assert found.residual < 2e-5
            assert found.is_stable
            assert sheets.margins[row] == pytest.approx(found.stability_margin, rel=1e-3, abs=1e-2)
            assert sheets.energies[row] == pytest.approx(found.energy, rel=1e-4, abs=1e-6)
            assert max(rod.rho for rod in found.rods) <= RHO_MAX * (1.0 + 1e-6)
        lower, upper = atlas.mechanism.lower_limits, atlas.mechanism.upper_limits
        assert ((lower - 1e-6 <= sheets.inputs) & (sheets.inputs <= upper + 1e-6)).all()


def test_equilibria_lie_at_the_nodes_of_their_cells(atlas):
    assert atlas.over_inputs.inputs == pytest.approx(atlas.over_inputs.raster.nodes(atlas.over_inputs.cells), abs=1e-6)
    assert atlas.over_poses.poses == pytest.approx(atlas.over_poses.raster.nodes(atlas.over_poses.cells), abs=1e-6)


def test_no_equilibrium_is_stored_twice(atlas):
    for sheets in (atlas.over_inputs, atlas.over_poses):
        for cell in np.flatnonzero(sheets.counts.reshape(-1) > 1)[::5]:
            rows = sheets.rows(np.array([cell]))
            states = np.concatenate([sheets.inputs[rows], sheets.poses[rows], sheets.rods[rows]], axis=1)
            gaps = np.abs(states[:, None] - states[None]).max(axis=2) + np.eye(len(rows))
            assert gaps.min() > 1e-4


# Completeness


def test_counts_over_the_inputs_are_those_of_all_solutions(atlas):
    rng = np.random.default_rng(1)
    for cell in even_cells(atlas.over_inputs, rng, 25):
        (node,) = atlas.over_inputs.raster.nodes([cell])
        inputs = node + rng.uniform(-0.5, 0.5, 2) * atlas.over_inputs.raster.pitch
        expected = solve_forward(atlas.mechanism, inputs, atlas.load, RHO_MAX).stable
        assert len(expected) == atlas.over_inputs.counts.reshape(-1)[cell]
        found = atlas.at_inputs(inputs)
        assert [each.energy for each in found] == pytest.approx([each.energy for each in expected], rel=1e-9)
        assert found.poses == pytest.approx(np.array([each.pose for each in expected]), abs=1e-9)


def test_counts_over_the_poses_are_those_of_all_solutions(atlas):
    rng = np.random.default_rng(2)
    for cell in even_cells(atlas.over_poses, rng, 25):
        (node,) = atlas.over_poses.raster.nodes([cell])
        pose = node + rng.uniform(-0.5, 0.5, 2) * atlas.over_poses.raster.pitch
        expected = inverse_within_limits(atlas.mechanism, pose, atlas.load)
        assert len(expected) == atlas.over_poses.counts.reshape(-1)[cell]
        found = atlas.at_pose(pose)
        assert [each.energy for each in found] == pytest.approx([each.energy for each in expected], rel=1e-9)
        for each in found:
            assert each.residual < 1e-10
            assert each.is_stable
            assert each.within_limits
            assert each.pose == pytest.approx(pose, abs=1e-12)


def test_the_atlas_of_a_mirrored_mechanism_is_mirrored(motors):
    counts = motors.over_poses.counts
    assert (counts != counts[::-1]).mean() < 1e-3
    inputs = motors.over_inputs.counts  # mirrored, the motors change places and turn the other way
    assert (inputs != inputs[::-1, ::-1].T).mean() < 1e-3


def test_denser_seeds_find_the_same_branches():
    mechanism = get_mechanism("2PFR-paper")
    few, many = (
        build_atlas(mechanism, pitch=0.05, input_cells=30, seed_nodes=count, progress=False) for count in (4, 8)
    )
    assert [len(part.over_poses) for part in (few, many)] == [len(few.over_poses)] * 2
    assert [branch.input_region.area for branch in few.branches] == [b.input_region.area for b in many.branches]


# Branches


def explore(atlas: Atlas, start: Equilibrium) -> dict[tuple[int, int], tuple[tuple[int, int] | None, Equilibrium]]:
    """Follow the branch from node to node of the inputs; return for each row reached where it was reached from.

    A key is the cell and the place of the pose on a fine grid: two states over a cell have different ones.
    """
    sheets, raster = atlas.over_inputs, atlas.over_inputs.raster

    def key(found: Equilibrium) -> tuple[int, int]:
        cell = int(raster.cells_of(found.inputs[None])[0])
        rows = sheets.rows(np.array([cell]))
        gaps = np.abs(sheets.poses[rows] - found.pose).max(axis=1)
        assert gaps.min() < 1e-5
        return cell, int(rows[gaps.argmin()])

    reached: dict[tuple[int, int], tuple[tuple[int, int] | None, Equilibrium]] = {key(start): (None, start)}
    queue = deque(reached)
    while queue:
        place = queue.popleft()
        here = reached[place][1]
        for axis in range(2):
            for side in (-1.0, 1.0):
                target = here.inputs.copy()
                target[axis] += side * raster.pitch[axis]
                if raster.cells_of(target[None])[0] < 0:
                    continue
                step = BranchTracker(atlas.mechanism, here).step(target)
                if step.event == Event.NONE and key(step.equilibrium) not in reached:
                    reached[key(step.equilibrium)] = place, step.equilibrium
                    queue.append(key(step.equilibrium))
    return reached


def test_a_branch_is_what_tracking_reaches_and_its_ends_are_joined_by_a_stable_path(motors):
    sheets = motors.over_inputs
    sizes = np.bincount(sheets.branches)
    smallest = min(np.flatnonzero(sizes > 10), key=lambda number: sizes[number])
    rows = np.flatnonzero(sheets.branches == smallest)
    start, end = (
        next(found for found in motors.at_inputs(node) if found.pose == pytest.approx(sheets.poses[row], abs=1e-5))
        for row, node in zip(rows[[0, -1]], sheets.raster.nodes(sheets.cells[rows[[0, -1]]]), strict=True)
    )
    reached = explore(motors, start)
    assert {row for _, row in reached} <= set(rows.tolist())
    assert len(reached) >= 0.98 * len(rows)  # at the border a node may be reached over the poses alone

    path = [(int(sheets.cells[rows[-1]]), int(rows[-1]))]
    while (before := reached[path[-1]][0]) is not None:
        path.append(before)
    tracker = BranchTracker(motors.mechanism, start)
    for one, other in pairwise(reversed(path)):
        for part in np.linspace(0.0, 1.0, 5)[1:]:
            ends = sheets.raster.nodes([one[0], other[0]])
            step = tracker.step(ends[0] + part * (ends[1] - ends[0]))
            assert step.event == Event.NONE
            assert step.equilibrium.is_stable
    assert tracker.equilibrium.pose == pytest.approx(end.pose, abs=1e-9)


def test_home_is_on_the_home_branch(atlas):
    home = home_equilibrium(atlas.mechanism, atlas.load)
    assert atlas.branch_of(home) == atlas.home_branch
    assert [branch.number for branch in atlas.branches if branch.contains_home] == [atlas.home_branch]


def test_random_equilibria_are_on_the_branch_that_they_are_said_to_be(atlas):
    samples = atlas.sample(np.random.default_rng(3), 60)
    assert [atlas.branch_of(found) for found in samples] == samples.branches.tolist()


def test_branch_of_is_none_off_the_stable_sheets(motors):
    mechanism = motors.mechanism
    all_found = solve_forward(mechanism, mechanism.home_inputs)
    unstable = next(found for found in all_found if not found.is_stable)
    assert motors.branch_of(unstable) is None
    home = home_equilibrium(mechanism)
    turned = Equilibrium(mechanism, home.state, home.inputs + 2.0 * math.pi, home.load)
    assert turned.is_stable
    assert motors.branch_of(turned) is None


def test_branches_are_numbered_by_the_poses_they_cover(atlas):
    counts = np.bincount(atlas.over_poses.branches, minlength=len(atlas.branches))
    assert (np.diff(counts) <= 0).all()
    for branch in atlas.branches:
        assert branch.workspace.area <= atlas.workspace().area
        assert branch.largest_rho < RHO_MAX
    covered = np.any([branch.workspace.mask for branch in atlas.branches], axis=0)
    assert np.array_equal(covered, atlas.workspace().mask)
    assert np.array_equal(covered, atlas.over_poses.counts > 0)


# Areas and samples


def test_the_area_converges_with_the_pitch():
    mechanism = get_mechanism("2PFR-paper")
    regions = [
        build_atlas(mechanism, pitch=pitch, input_cells=24, seed_nodes=3, progress=False).workspace()
        for pitch in (0.04, 0.02, 0.005)
    ]
    for coarse in regions[:2]:
        assert abs(coarse.area - regions[2].area) < 1.5 * (coarse.area_error + regions[2].area_error)


@pytest.mark.parametrize("over", ["poses", "inputs"])
def test_samples_are_exact_and_uniform(motors, over):
    samples = motors.sample(np.random.default_rng(4), 20_000, branch=motors.home_branch, over=over)
    assert len(samples) == 20_000
    assert (samples.branches == motors.home_branch).all()
    for found in samples[::200]:
        assert found.residual < 1e-10
        assert found.is_stable
        assert found.within_limits

    # where as many sheets are all around a cell, every part of it is met alike
    sheets = motors.over_poses if over == "poses" else motors.over_inputs
    points = samples.poses if over == "poses" else samples.inputs
    own = np.bincount(sheets.cells[sheets.branches == motors.home_branch], minlength=sheets.raster.size)
    own = own.reshape(sheets.raster.shape)
    windows = np.lib.stride_tricks.sliding_window_view(np.pad(own, 1), (3, 3))
    inner = np.flatnonzero((windows == own[..., None, None]).all(axis=(2, 3)) & (own > 0))
    cells = sheets.raster.cells_of(points)
    is_inner = np.isin(cells, inner)
    offsets = (points[is_inner] - sheets.raster.nodes(cells[is_inner])) / sheets.raster.pitch + 0.5
    for axis in range(2):
        assert kstest(offsets[:, axis], "uniform").pvalue > 1e-3
    blocks = np.array_split(inner, 40)
    met = np.array([np.isin(cells, block).sum() for block in blocks])
    expected = np.array([own.reshape(-1)[block].sum() for block in blocks], dtype=float)
    assert chisquare(met, expected * met.sum() / expected.sum()).pvalue > 1e-3


def test_samples_of_all_branches_follow_their_areas(motors):
    samples = motors.sample(np.random.default_rng(5), 5000)
    expected = np.bincount(motors.over_poses.branches) / len(motors.over_poses)
    met = np.bincount(samples.branches, minlength=len(expected)) / len(samples)
    assert met == pytest.approx(expected, abs=0.03)


def test_samples_repeat_with_the_generator(motors):
    one, other = (motors.sample(np.random.default_rng(6), 50) for _ in range(2))
    assert np.array_equal(one.states, other.states)
    assert np.array_equal(one.inputs, other.inputs)
    assert len(motors.sample(np.random.default_rng(6), 0)) == 0


# Files


def assert_equal_atlases(one: Atlas, other: Atlas) -> None:
    assert one.mechanism == other.mechanism
    assert np.array_equal(one.load, other.load)
    assert (one.rho_max, one.home_branch) == (other.rho_max, other.home_branch)
    for name in ("over_inputs", "over_poses"):
        for field in fields(RasterStates):
            if field.name != "raster":
                first, second = (getattr(getattr(part, name), field.name) for part in (one, other))
                assert first.dtype == second.dtype
                assert np.array_equal(first, second)
        for axis, other_axis in zip(getattr(one, name).raster.axes, getattr(other, name).raster.axes, strict=True):
            assert np.array_equal(axis, other_axis)
        assert getattr(one, name).raster.is_closed == getattr(other, name).raster.is_closed


def test_an_atlas_comes_back_from_its_file_exactly(atlas, tmp_path):
    atlas.save(tmp_path / "any.name")
    again = load_atlas(tmp_path / "any.name")
    assert_equal_atlases(atlas, again)
    samples = [each.sample(np.random.default_rng(7), 20) for each in (atlas, again)]
    assert np.array_equal(samples[0].states, samples[1].states)


def test_an_atlas_built_twice_is_the_same(motors):
    assert_equal_atlases(motors, make_atlas("2RFR"))


def damaged(motors: Atlas, path, **changes: np.ndarray | None) -> None:
    motors.save(path)
    with np.load(path) as archive:
        arrays = {**archive, **changes}
    with path.open("wb") as file:
        np.savez(file, **{name: array for name, array in arrays.items() if array is not None})


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"version": np.array(99)}, "version 99"),
        ({"version": None}, "version -1"),
        ({"format": None}, "not an atlas"),
        ({"mechanism": np.array("{}")}, "does not describe a mechanism"),
        ({"over_poses.rods": None}, "over_poses.rods"),
        ({"over_poses.rods": np.zeros((3, 4), np.float32)}, "rods must have shape"),
        ({"over_inputs.branches": np.array([{}], dtype=object)}, "not an atlas"),
        ({"load": np.array([np.nan, 0.0])}, "load must be finite"),
    ],
)
def test_a_damaged_file_is_refused_with_the_reason(motors, tmp_path, changes, message):
    damaged(motors, tmp_path / "atlas.npz", **changes)
    with pytest.raises(ValueError, match=message):
        load_atlas(tmp_path / "atlas.npz")


def test_other_files_are_refused(tmp_path):
    with pytest.raises(FileNotFoundError):
        load_atlas(tmp_path / "none.npz")
    (tmp_path / "text.npz").write_text("no archive")
    np.save(tmp_path / "array.npy", np.zeros(3))
    for name in ("text.npz", "array.npy"):
        with pytest.raises(ValueError, match="not an atlas"):
            load_atlas(tmp_path / name)


# A platform


def test_a_slice_of_a_platform_is_what_the_inverse_problem_says(slice_of_platform):
    atlas = slice_of_platform
    region = atlas.workspace(orientation=0.161919)
    home = atlas.workspace(atlas.home_branch)
    assert home.contains(home_equilibrium(atlas.mechanism).pose[None, :2]).all()
    assert region.area >= home.area > 0.0
    assert region.boundaries
    rng = np.random.default_rng(8)
    for cell in rng.choice(np.flatnonzero(region.mask), 5, replace=False):
        pose = [*region.raster.nodes([cell])[0], 0.161919]
        known = inverse_within_limits(atlas.mechanism, np.array(pose), atlas.load)
        found = atlas.at_pose(pose)
        for each in found:
            assert min(np.abs(each.inputs - other.inputs).max() for other in known) < 1e-9


def test_a_platform_has_the_reachable_workspace_and_its_slices():
    mechanism = get_mechanism("3PFR-paper")
    atlas = build_atlas(mechanism, pitch=0.05, input_cells=8, seed_nodes=1, progress=False)
    reachable = atlas.workspace()
    slices = [atlas.workspace(orientation=angle) for angle in atlas.over_poses.raster.axes[2]]
    assert np.array_equal(reachable.mask, np.any([part.mask for part in slices], axis=0))
    assert np.array_equal(atlas.workspace(orientation=7.0).mask, atlas.workspace(orientation=7.0 - 2 * math.pi).mask)
    assert ((-math.pi < atlas.over_inputs.poses[:, 2]) & (atlas.over_inputs.poses[:, 2] <= math.pi + 1e-6)).all()


# Misuse


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"pitch": 0.0}, "pitch must be greater than 0"),
        ({"rho_max": -1.0}, "rho_max must be greater than 0"),
        ({"rho_max": 31.0}, "rho_max must be at most"),
        ({"input_cells": 0}, "input_cells must be at least 1"),
        ({"seed_nodes": -1}, "seed_nodes must be at least 1"),
        ({"orientation": 0.0}, "orientation must be None"),
        ({"load": (1.0, math.nan)}, "load must be finite"),
        ({"load": (1.0, 2.0, 3.0)}, "load must have shape"),
    ],
)
def test_wrong_arguments_of_build_atlas_are_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        build_atlas(get_mechanism("2PFR-paper"), progress=False, **arguments)


def test_a_number_of_cells_that_is_not_whole_is_refused():
    wrong: Any = 2.5
    with pytest.raises(TypeError, match="seed_nodes must be a whole number"):
        build_atlas(get_mechanism("2PFR-paper"), progress=False, seed_nodes=wrong)


def test_a_mechanism_without_stable_equilibria_is_refused():
    far = Mechanism("far", (Leg(Revolute((-2.0, 0.0)), Rod()), Leg(Revolute((2.0, 0.0)), Rod())))
    with pytest.raises(ValueError, match="no point that all can reach"):
        build_atlas(far, progress=False)


def test_an_atlas_says_what_it_holds(motors):
    lines = repr(motors).splitlines()
    assert len(lines) == 1 + len(motors.branches)
    assert "2RFR" in lines[0]
    assert [line.endswith("home") for line in lines[1:]] == [branch.contains_home for branch in motors.branches]


def test_wrong_arguments_of_look_ups_are_refused(motors):
    rng = np.random.default_rng(9)
    with pytest.raises(ValueError, match="branch must be at most"):
        motors.sample(rng, 1, branch=99)
    with pytest.raises(ValueError, match="branch must be at least 0, got -1"):
        motors.workspace(-1)
    with pytest.raises(ValueError, match="over must be one of"):
        motors.sample(rng, 1, over="states")
    with pytest.raises(ValueError, match="count must be at least 0"):
        motors.sample(rng, -1)
    with pytest.raises(TypeError, match="count must be a whole number"):
        motors.sample(rng, 1.5)
    with pytest.raises(ValueError, match="orientation must be None"):
        motors.workspace(orientation=0.0)
    with pytest.raises(ValueError, match="within the limits"):
        motors.at_inputs([10.0, 0.0])
    with pytest.raises(ValueError, match="pose must have shape"):
        motors.at_pose([0.0, 0.0, 0.0])
    assert len(motors.at_pose([5.0, 5.0])) == 0
    with pytest.raises(ValueError, match="atlas's mechanism"):
        motors.branch_of(home_equilibrium(get_mechanism("2PFR-paper")))
    with pytest.raises(ValueError, match="atlas's load"):
        motors.branch_of(replace(home_equilibrium(motors.mechanism), load=np.array([1.0, 0.0])))


def test_an_orientation_beside_the_slice_is_refused(slice_of_platform):
    with pytest.raises(ValueError, match="orientation must be near"):
        slice_of_platform.workspace(orientation=1.0)


def test_progress_is_shown_only_when_asked_for(capsys):
    for progress in (False, True):
        build_atlas(get_mechanism("2PFR-paper"), pitch=0.2, input_cells=4, seed_nodes=1, progress=progress)
        shown = capsys.readouterr()
        assert shown.out == ""
        assert ("seeds" in shown.err) == progress


def test_every_node_gives_back_what_is_stored_there(atlas):
    """Stored numbers are rounded, and no step from them is so short that the rounding looks like another branch."""
    for sheets, look_up in ((atlas.over_inputs, atlas.at_inputs), (atlas.over_poses, atlas.at_pose)):
        for row in np.random.default_rng(0).choice(len(sheets), 60, replace=False).tolist():
            found = look_up(sheets.raster.nodes(sheets.cells[[row]])[0])
            poses = np.array([own.pose for own in found]).reshape(len(found), -1)
            inputs = np.array([own.inputs for own in found]).reshape(len(found), -1)
            apart = np.abs(np.concatenate([poses - sheets.poses[row], inputs - sheets.inputs[row]], axis=1)).max(axis=1)
            assert apart.min() < 1e-4
