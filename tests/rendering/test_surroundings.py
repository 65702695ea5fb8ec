"""What is drawn around the present equilibrium lies where the solver says that it is, and nowhere else."""

import math
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from scipy import ndimage
from scipy.spatial import cKDTree

from pcm_gym.mechanism import Mechanism
from pcm_gym.rendering import Camera, FrameRenderer, Style
from pcm_gym.rendering.polylines import platform_points
from pcm_gym.rendering.style import Colour
from pcm_gym.solving import Equilibrium, Raster, Region

STYLE = Style()
LABEL_ROWS = 40


def free_place(mechanism: Mechanism) -> tuple[float, float]:
    """Where no part of a catalogued mechanism is at home; that of the 3PFR has parts all around."""
    return (-2.0, -1.3) if mechanism.name == "3PFR" else (0.1, -0.6)


@pytest.fixture
def renderer(mechanism: Mechanism) -> FrameRenderer:
    return FrameRenderer(mechanism)


@pytest.fixture
def others(equilibria: list[Equilibrium]) -> list[Equilibrium]:
    """Other equilibria at the same inputs than the first, stable and unstable."""
    stable = [found for found in equilibria[1:] if found.is_stable]
    unstable = [found for found in equilibria if not found.is_stable]
    assert stable
    assert unstable
    return [stable[0], unstable[0]]


def changed(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    return np.any(first != second, axis=-1)


def outline_pixels(camera: Camera, equilibrium: Equilibrium) -> np.ndarray:
    """Points less than a pixel apart on rods and platform, and the end-effector's origin, in pixels (n, 2)."""
    corners = platform_points(equilibrium.mechanism, equilibrium.pose)
    sides = [
        np.linspace(first, second, 300) for first, second in zip(corners, np.roll(corners, 1, axis=0), strict=True)
    ]
    return camera.pixels(np.vstack([*equilibrium.shape(600), *sides, equilibrium.pose[:2]]))


def distances(points: np.ndarray, places: np.ndarray) -> np.ndarray:
    return np.asarray(cKDTree(places).query(points)[0])


def centres(mask: np.ndarray) -> np.ndarray:
    """Centres (column, row) of the pixels of a mask, (n, 2)."""
    return np.argwhere(mask)[:, ::-1] + 0.5


def share_drawn(drawn: np.ndarray, places: np.ndarray) -> float:
    """Share of places (n, 2) whose pixels are drawn."""
    columns, rows = np.floor(places).astype(int).T
    return float(drawn[rows, columns].mean())


def is_of_hue(frame: np.ndarray, colour: Colour, least: int) -> np.ndarray:
    """Pixels that differ from the background towards `colour` and not just towards grey."""
    shift = STYLE.background - frame.astype(float)
    wanted = np.array(STYLE.background, dtype=float) - colour
    along = shift @ wanted / np.linalg.norm(wanted)
    beside = np.linalg.norm(shift - along[..., None] * wanted / np.linalg.norm(wanted), axis=-1)
    return (along > least) & (beside < 0.2 * along)


# Ghosts and target


def test_ghosts_lie_on_their_shapes_solid_where_stable_and_dashed_where_not(
    renderer: FrameRenderer, stable: Equilibrium, others: list[Equilibrium]
) -> None:
    plain = renderer.draw(stable)
    for ghost in others:
        drawn = changed(plain, renderer.draw(stable, ghosts=[ghost]))
        outline = outline_pixels(renderer.camera, ghost)
        assert distances(centres(drawn), outline).max() < STYLE.hinge_radius + 2.0
        is_free = distances(outline, outline_pixels(renderer.camera, stable)) > 10.0
        is_free &= distances(outline, renderer.camera.pixels(ghost.shape(2)[:, 0])) > 20.0  # actuators
        share = share_drawn(drawn, outline[is_free])
        if ghost.is_stable:
            assert share > 0.97
        else:
            assert 0.4 < share < 0.9


def test_ghosts_are_faint_and_never_red(
    renderer: FrameRenderer, stable: Equilibrium, equilibria: list[Equilibrium]
) -> None:
    plain, frame = renderer.draw(stable), renderer.draw(stable, ghosts=equilibria)
    strength = np.abs(frame.astype(int) - STYLE.background).max(axis=-1)[changed(plain, frame)]
    assert strength.mean() < 70
    assert not np.any(np.all(np.abs(frame.astype(int) - STYLE.alarm) < 60, axis=-1))


def test_a_ghost_of_the_present_equilibrium_is_hidden_by_it(renderer: FrameRenderer, stable: Equilibrium) -> None:
    np.testing.assert_array_equal(renderer.draw(stable, ghosts=[stable]), renderer.draw(stable))


def test_an_unstable_ghost_is_fainter_among_many(
    renderer: FrameRenderer, stable: Equilibrium, equilibria: list[Equilibrium]
) -> None:
    ghost, other = [found for found in equilibria if not found.is_stable][:2]
    plain = renderer.draw(stable).astype(int)
    alone, among = (
        np.abs(renderer.draw(stable, ghosts=[ghost, *[other] * count]) - plain).max(axis=-1) for count in (0, 30)
    )
    is_own = (alone > 0) & (distances(centres(alone >= 0), outline_pixels(renderer.camera, other)) > 8.0).reshape(
        alone.shape
    )
    assert is_own.sum() > 50
    assert among[is_own].mean() < 0.7 * alone[is_own].mean()


def test_target_lies_on_its_shape_in_the_colour_of_goals(
    renderer: FrameRenderer, stable: Equilibrium, others: list[Equilibrium]
) -> None:
    target = others[0]
    plain, frame = renderer.draw(stable), renderer.draw(stable, target=target)
    outline = outline_pixels(renderer.camera, target)
    is_free = distances(outline, outline_pixels(renderer.camera, stable)) > 10.0
    is_free &= distances(outline, renderer.camera.pixels(target.shape(2)[:, 0])) > 20.0
    is_free &= distances(outline, renderer.camera.pixels(target.shape(2)[:, -1])) > 7.0  # hinges
    green = is_of_hue(frame, STYLE.goal, 40) & changed(plain, frame)
    assert share_drawn(green, outline[is_free]) > 0.95
    if stable.mechanism.dof == 2:
        assert distances(centres(changed(plain, frame)), outline).max() < 0.5 * STYLE.target_band_width + 2.0
    ghost = renderer.draw(stable, ghosts=[target])
    assert share_drawn(is_of_hue(ghost, STYLE.goal, 40), outline[is_free]) < 0.05


# The workspace


def ring_region(camera: Camera, pitch: float = 0.01) -> Region:
    """A ring off the centre of the view, on a raster smaller than what the camera shows."""
    x, y = camera.centre
    raster = Raster.over(
        (x - 0.7, y - 0.5), (x + 0.5, y + 0.8), (round(1.2 / pitch), round(1.3 / pitch)), (False, False)
    )
    nodes = raster.all_nodes.reshape(*raster.shape, 2)
    radius = np.hypot(nodes[..., 0] - x + 0.15, nodes[..., 1] - y - 0.1)
    return Region(raster, (radius > 0.15) & (radius < 0.45))


@pytest.mark.parametrize("bounds", [None, (-0.2, 0.3, -0.1, 0.6)])
def test_the_tint_is_where_the_region_says(
    mechanism: Mechanism, stable: Equilibrium, bounds: tuple[float, float, float, float] | None
) -> None:
    bare = FrameRenderer(mechanism, bounds=bounds)
    region = ring_region(FrameRenderer(mechanism).camera)
    mapped = FrameRenderer(mechanism, bounds=bounds, workspace=region)
    assert mapped.camera == bare.camera
    plain, frame = bare.draw(stable), mapped.draw(stable)

    everywhere = np.ones(plain.shape[:2], dtype=bool)
    inside = region.contains(bare.camera.points(centres(everywhere))).reshape(everywhere.shape)
    border_width = STYLE.border_line_width + 0.01 * bare.camera.scale
    footprint = np.ones((2 * math.ceil(border_width) + 1,) * 2, dtype=bool)
    is_within = ndimage.binary_erosion(inside, footprint, border_value=1)
    is_beyond = ~ndimage.binary_dilation(inside, footprint)
    is_ground = np.all(plain == STYLE.background, axis=-1)
    is_ground[430:, 330:] = False  # the legend
    is_ground &= (distances(centres(everywhere), outline_pixels(bare.camera, stable)) > 25.0).reshape(is_ground.shape)
    assert (is_within & is_ground).sum() > 1000
    assert (is_beyond & is_ground).sum() > 2000

    np.testing.assert_array_equal(frame[is_beyond], plain[is_beyond])
    *colour, opacity = STYLE.workspace
    tint = np.array(STYLE.background) + (np.array(colour) - STYLE.background) * opacity / 255
    assert np.abs(frame[is_within & is_ground] - tint).max() <= 1.5
    is_border = ~is_within & ~is_beyond & is_ground
    assert (frame[is_border].min(axis=-1) < tint.min() - 10).any()


def test_the_map_stays_behind_the_mechanism(mechanism: Mechanism, stable: Equilibrium) -> None:
    bare = FrameRenderer(mechanism)
    mapped = FrameRenderer(mechanism, workspace=ring_region(bare.camera))
    places = np.floor(bare.camera.pixels(stable.shape(60)[:, 10:50]).reshape(-1, 2)).astype(int)
    plain, frame = (maker.draw(stable)[places[:, 1], places[:, 0]].astype(int) for maker in (bare, mapped))
    assert np.mean(np.abs(plain - frame).max(axis=-1) == 0) > 0.9


def test_an_empty_region_changes_nothing(mechanism: Mechanism, stable: Equilibrium) -> None:
    bare = FrameRenderer(mechanism)
    region = ring_region(bare.camera)
    empty = Region(region.raster, np.zeros_like(region.mask))
    np.testing.assert_array_equal(FrameRenderer(mechanism, workspace=empty).draw(stable), bare.draw(stable))


def test_the_region_is_left_alone(mechanism: Mechanism) -> None:
    region = ring_region(FrameRenderer(mechanism).camera)
    mask = region.mask.copy()
    FrameRenderer(mechanism, workspace=region)
    np.testing.assert_array_equal(region.mask, mask)


# The path


def poses_at(places: np.ndarray, mechanism: Mechanism, angle: float = 0.0) -> np.ndarray:
    """Poses at places (n, 2), for a platform all at one angle."""
    return places if mechanism.dof == 2 else np.column_stack([places, np.full(len(places), angle)])


def test_a_path_is_closed_only_if_it_ends_where_it_begins(
    renderer: FrameRenderer, mechanism: Mechanism, stable: Equilibrium
) -> None:
    square = np.array([(0.0, 0.0), (0.3, 0.0), (0.3, -0.3), (0.0, -0.3), (0.0, 0.0)]) + free_place(mechanism)
    plain = renderer.draw(stable)
    closed = changed(plain, renderer.draw(stable, path=poses_at(square, mechanism)))
    opened = changed(plain, renderer.draw(stable, path=poses_at(square[:-1], mechanism)))
    places = [renderer.camera.pixels(np.linspace(a, b, 50)) for a, b in pairwise(square)]
    assert [share_drawn(closed, side) for side in places] == [1.0] * 4
    assert [share_drawn(opened, side) for side in places[:3]] == [1.0] * 3
    assert share_drawn(opened, places[3][10:40]) < 0.3
    reach = STYLE.tick_length if mechanism.dof == 3 else 0.0
    assert distances(centres(closed), np.concatenate(places)).max() < reach + 3.0


def test_ticks_on_a_platforms_path_point_along_the_mark_on_it(stable: Equilibrium, mechanism: Mechanism) -> None:
    if mechanism.dof == 2:
        return
    renderer = FrameRenderer(mechanism)
    place = free_place(mechanism)
    line = np.linspace(place, np.add(place, (0.5, 0.0)), 30)
    x, y = mechanism.legs[0].attachment
    plain, (_, row) = renderer.draw(stable), renderer.camera.pixels(place)
    for angle, is_upward in ((0.5 * math.pi, True), (-0.5 * math.pi, False)):
        poses = poses_at(line, mechanism, angle - math.atan2(y, x))
        rows = centres(changed(plain, renderer.draw(stable, path=poses)))[:, 1]
        assert (row - rows.min() > STYLE.tick_length - 2.0) == is_upward
        assert (rows.max() - row > STYLE.tick_length - 2.0) != is_upward


@pytest.mark.parametrize("count", [0, 1, 2, 3])
def test_short_and_resting_paths(
    renderer: FrameRenderer, mechanism: Mechanism, stable: Equilibrium, count: int
) -> None:
    path = np.tile(stable.pose, (count, 1))
    assert renderer.draw(stable, path=path).shape == (480, 480, 3)


def test_paths_far_outside_do_no_harm(renderer: FrameRenderer, mechanism: Mechanism, stable: Equilibrium) -> None:
    for place in (1e3, 1e15):
        path = np.full((5, mechanism.dof), place) * (1.0 + np.arange(5)[:, None])
        np.testing.assert_array_equal(renderer.draw(stable, path=path), renderer.draw(stable))


# Loads


def load_on(equilibrium: Equilibrium, force: tuple[float, float], moment: float = 0.0) -> Equilibrium:
    """The same state said to bear a load, in units of EI / L^2 and EI / L."""
    units = equilibrium.mechanism.units.load
    load = np.array([*force, moment][: equilibrium.mechanism.dof]) * units
    return replace(equilibrium, load=load)


@pytest.mark.parametrize("angle", [0.3, 2.0, -1.2])
def test_the_force_arrow_points_along_the_force_and_grows_with_it(stable: Equilibrium, angle: float) -> None:
    x, y = stable.pose[:2]
    renderer = FrameRenderer(stable.mechanism, bounds=(x - 1.0, x + 1.0, y - 1.0, y + 1.0))
    direction = np.array([math.cos(angle), -math.sin(angle)])  # rows count downwards
    start, plain, lengths = renderer.camera.pixels(stable.pose[:2]), renderer.draw(stable), []
    for size in (1e-3, 0.1, 1.0, 10.0, 1e6):
        force = (size * math.cos(angle), size * math.sin(angle))
        arrow = centres(changed(plain, renderer.draw(load_on(stable, force)))) - start
        lengths.append(float((arrow @ direction).max()))
        assert np.abs(arrow[:, 0] * direction[1] - arrow[:, 1] * direction[0]).max() < 8.0
    assert np.all(np.diff(lengths) >= 0.0)
    weakest, strongest = STYLE.force_lengths
    assert lengths[0] == pytest.approx(weakest, abs=2.0)
    assert lengths[-1] == pytest.approx(strongest, abs=2.0)


def test_the_moment_arrow_turns_with_the_moment(renderer: FrameRenderer, stable: Equilibrium) -> None:
    if stable.mechanism.dof == 2:
        return
    middle, plain = renderer.camera.pixels(stable.pose[:2]), renderer.draw(stable)
    for moment in (0.3, -0.3):
        arrow = centres(changed(plain, renderer.draw(load_on(stable, (0.0, 0.0), moment)))) - middle
        radii, sides = np.hypot(*arrow.T), arrow[:, 0]
        assert np.all(np.abs(radii - STYLE.moment_radius) < 8.0)
        left, right = (float(np.ptp(radii[side])) for side in (sides < -8.0, sides > 8.0))
        assert (left > right + 1.0) == (moment > 0.0)  # counter-clockwise over the top, the broad head is to the left
        assert (right > left + 1.0) == (moment < 0.0)


def test_without_a_load_there_is_no_arrow(renderer: FrameRenderer, stable: Equilibrium) -> None:
    assert not stable.load.any()
    np.testing.assert_array_equal(renderer.draw(load_on(stable, (0.0, 0.0))), renderer.draw(stable))


# Labels


def test_a_snap_is_labelled_without_alarm(renderer: FrameRenderer, stable: Equilibrium) -> None:
    plain, snapped = renderer.draw(stable), renderer.draw(stable, snapped=True)
    rows = np.nonzero(changed(plain, snapped))[0]
    assert len(rows) > 500
    assert rows.max() < LABEL_ROWS
    assert not np.any(np.all(np.abs(snapped.astype(int) - STYLE.alarm) < 25, axis=-1))


def test_the_alarm_goes_before_the_label_of_a_snap(
    renderer: FrameRenderer, stable: Equilibrium, unstable: Equilibrium
) -> None:
    np.testing.assert_array_equal(renderer.draw(unstable, snapped=True), renderer.draw(unstable))
    lost = renderer.draw(stable, stability_lost=True)
    np.testing.assert_array_equal(renderer.draw(stable, stability_lost=True, snapped=True), lost)


def test_a_long_caption_ends_before_the_legend(renderer: FrameRenderer, stable: Equilibrium) -> None:
    plain, frame = renderer.draw(stable), renderer.draw(stable, caption="many words " * 40)
    columns = np.nonzero(changed(plain, frame))[1]
    legend_begin = 480 - STYLE.legend_width - 2.0 * 13.0
    assert 200 < columns.max() < legend_begin


@pytest.mark.parametrize("size", [(64, 64), (128, 128), (480, 480)])
def test_labels_fit_into_the_picture(mechanism: Mechanism, stable: Equilibrium, size: tuple[int, int]) -> None:
    renderer = FrameRenderer(mechanism, size)
    frame = renderer.draw(stable, stability_lost=True)
    border = max(2, round(STYLE.border_width * min(size) / 480))
    is_red = np.all(frame == STYLE.alarm, axis=-1)
    assert is_red[:, -border:].all()
    assert is_red[border, : size[0] // 4].all()  # the box of the label
    assert not is_red[border, -border - 1]  # it ends
    assert not np.array_equal(frame[: size[1] // 4], renderer.draw(stable)[: size[1] // 4])


# All of it


def test_equal_arguments_give_equal_frames_and_stay_as_they_are(
    mechanism: Mechanism, stable: Equilibrium, others: list[Equilibrium]
) -> None:
    region = ring_region(FrameRenderer(mechanism).camera)
    path = poses_at(np.random.default_rng(0).normal(size=(20, 2)), mechanism)
    kept, ghosts = path.copy(), list(others)
    arguments: dict[str, Any] = {"ghosts": ghosts, "target": others[0], "path": path, "snapped": True}
    frames = [FrameRenderer(mechanism, workspace=region).draw(stable, **arguments) for _ in range(2)]
    np.testing.assert_array_equal(frames[0], frames[1])
    np.testing.assert_array_equal(path, kept)
    assert ghosts == others


def test_misuse_is_refused(renderer: FrameRenderer, mechanism: Mechanism, stable: Equilibrium) -> None:
    stranger = replace(stable, mechanism=replace(mechanism, name="another"))
    with pytest.raises(ValueError, match="ghosts"):
        renderer.draw(stable, ghosts=[stable, stranger])
    with pytest.raises(ValueError, match="target"):
        renderer.draw(stable, target=stranger)
    with pytest.raises(ValueError, match="path"):
        renderer.draw(stable, path=np.zeros((5, mechanism.dof + 1)))
    with pytest.raises(ValueError, match="path"):
        renderer.draw(stable, path=np.full((5, mechanism.dof), np.inf))
    raster = Raster.over((0.0, 0.0, 0.0), (1.0, 1.0, 1.0), (2, 2, 2), (False, False, True))
    with pytest.raises(ValueError, match="workspace"):
        FrameRenderer(mechanism, workspace=Region(raster, np.ones((2, 2, 2), dtype=bool)))
