"""Frames: an array of pixels that shows what it should."""

import pickle

import numpy as np
import pytest

from pcm_gym.mechanism import Mechanism, get_mechanism, mechanism_names
from pcm_gym.rendering import FrameRenderer, Style
from pcm_gym.rendering.style import Colour
from pcm_gym.solving import Equilibrium

STYLE = Style()


def count_pixels(frame: np.ndarray, colour: Colour, tolerance: int = 25) -> int:
    return int(np.count_nonzero(np.all(np.abs(frame.astype(int) - colour) <= tolerance, axis=-1)))


@pytest.fixture
def renderer(mechanism: Mechanism) -> FrameRenderer:
    return FrameRenderer(mechanism)


@pytest.mark.parametrize("size", [(480, 480), (640, 360), (64, 64)])
def test_shape_and_type(mechanism: Mechanism, stable: Equilibrium, size: tuple[int, int]) -> None:
    frame = FrameRenderer(mechanism, size).draw(stable, goal=stable.pose, caption="step 1")
    assert frame.shape == (size[1], size[0], 3)
    assert frame.dtype == np.uint8
    assert frame.flags.writeable


def test_equal_arguments_give_equal_frames(renderer: FrameRenderer, mechanism: Mechanism, stable: Equilibrium) -> None:
    trail = np.linspace(0.0, 0.5, 20).reshape(10, 2)
    frames = [
        maker.draw(stable, goal=stable.pose, success_distance=0.1, trail=trail, caption="a")
        for maker in (renderer, renderer, FrameRenderer(mechanism))
    ]
    np.testing.assert_array_equal(frames[0], frames[1])
    np.testing.assert_array_equal(frames[0], frames[2])


def test_frames_share_no_memory(renderer: FrameRenderer, stable: Equilibrium) -> None:
    first = renderer.draw(stable)
    kept = first.copy()
    first[:] = 0
    second = renderer.draw(stable)
    assert not np.shares_memory(first, second)
    np.testing.assert_array_equal(second, kept)


def test_a_frame_depends_on_nothing_drawn_before(
    renderer: FrameRenderer, stable: Equilibrium, unstable: Equilibrium
) -> None:
    before = renderer.draw(stable)
    renderer.draw(unstable, goal=stable.pose, stability_lost=True, caption="other")
    np.testing.assert_array_equal(renderer.draw(stable), before)


def test_arguments_are_left_alone(renderer: FrameRenderer, stable: Equilibrium) -> None:
    goal, trail = np.array(stable.pose), np.zeros((5, 2))
    renderer.draw(stable, goal=goal, trail=trail)
    np.testing.assert_array_equal(goal, stable.pose)
    np.testing.assert_array_equal(trail, 0.0)


def test_every_equilibrium_can_be_drawn(renderer: FrameRenderer, equilibria: list[Equilibrium]) -> None:
    for equilibrium in equilibria:
        assert renderer.draw(equilibrium).std() > 0.0


def test_red_is_kept_for_lost_stability(renderer: FrameRenderer, stable: Equilibrium, unstable: Equilibrium) -> None:
    calm = renderer.draw(stable, goal=stable.pose, success_distance=0.1, trail=np.zeros((3, 2)), caption="calm")
    assert count_pixels(calm, STYLE.alarm) == 0
    for frame in (renderer.draw(unstable), renderer.draw(stable, stability_lost=True)):
        assert count_pixels(frame, STYLE.alarm) > 10_000  # the border
        assert count_pixels(frame[30:-10, 10:-10], STYLE.alarm) > 300  # the rods
        edge = np.concatenate([frame[0], frame[-1], frame[:, 0], frame[:, -1]])
        assert np.all(edge == STYLE.alarm)


def test_labels_differ(renderer: FrameRenderer, unstable: Equilibrium) -> None:
    unstable_frame, lost_frame = renderer.draw(unstable), renderer.draw(unstable, stability_lost=True)
    assert np.any(unstable_frame[:40] != lost_frame[:40])
    np.testing.assert_array_equal(unstable_frame[40:], lost_frame[40:])


def test_goal_is_where_it_should_be(renderer: FrameRenderer, mechanism: Mechanism, stable: Equilibrium) -> None:
    goal = np.zeros(mechanism.dof)
    goal[:2] = 0.5, -0.9  # away from the mechanism
    without, with_goal = renderer.draw(stable), renderer.draw(stable, goal=goal, success_distance=0.05)
    rows, columns = np.nonzero(np.any(without != with_goal, axis=-1))
    column, row = renderer.camera.pixels(goal[:2])
    radius = 0.05 * renderer.camera.scale
    if mechanism.dof == 2:
        reach = max(radius, STYLE.goal_arm) + 2.0
        assert np.all(np.abs(columns + 0.5 - column) <= reach)
        assert np.all(np.abs(rows + 0.5 - row) <= reach)
    assert count_pixels(with_goal, STYLE.goal, 40) > 15
    assert count_pixels(without, STYLE.goal, 40) == 0


def test_a_platforms_goal_shows_its_angle(renderer: FrameRenderer, mechanism: Mechanism, stable: Equilibrium) -> None:
    if mechanism.dof == 2:
        return
    goals = [np.array([0.3, -0.9, angle]) for angle in (0.0, 0.5, 2.0 * np.pi / 3.0)]
    frames = [renderer.draw(stable, goal=goal) for goal in goals]
    assert np.any(frames[0] != frames[1])
    assert np.any(frames[0] != frames[2])  # a third of a turn, though the outline is the same


def test_trail_fades(renderer: FrameRenderer, stable: Equilibrium) -> None:
    x = np.linspace(-0.6, 0.6, 50)
    trail = np.stack([x, np.full(50, -0.95)], axis=1)
    frame = renderer.draw(stable, trail=trail).astype(int)
    contrast = [
        abs(frame[int(row) - 2 : int(row) + 3, int(column)] - STYLE.background).sum()
        for column, row in renderer.camera.pixels(trail[[2, 25, -3]])
    ]
    assert contrast[0] < contrast[1] < contrast[2]


def test_caption_is_written_at_the_lower_left(renderer: FrameRenderer, stable: Equilibrium) -> None:
    changed = np.any(renderer.draw(stable) != renderer.draw(stable, caption="step 12"), axis=-1)
    rows, columns = np.nonzero(changed)
    assert len(rows) > 50
    assert rows.min() > 440
    assert columns.max() < 200


@pytest.mark.parametrize("trail", [np.zeros((0, 2)), np.zeros((1, 2)), np.zeros((4, 2))])
def test_short_and_resting_trails(renderer: FrameRenderer, stable: Equilibrium, trail: np.ndarray) -> None:
    assert renderer.draw(stable, trail=trail).shape == (480, 480, 3)


def test_goals_far_outside_do_no_harm(renderer: FrameRenderer, mechanism: Mechanism, stable: Equilibrium) -> None:
    goal = np.zeros(mechanism.dof)
    goal[0] = 1e3
    np.testing.assert_array_equal(renderer.draw(stable, goal=goal), renderer.draw(stable))


def test_pickled_renderer_draws_the_same(renderer: FrameRenderer, stable: Equilibrium) -> None:
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(renderer)).draw(stable), renderer.draw(stable))


def test_colours_tell_the_sign_and_are_symmetric_in_strength() -> None:
    table = np.array(STYLE.moment_colours(), dtype=float)
    middle = len(table) // 2
    assert tuple(table[middle]) == STYLE.moment_zero
    blue_less_red = table[:, 2] - table[:, 0]
    assert np.all(np.diff(blue_less_red) <= 0.0)
    assert blue_less_red[0] > 100 > -100 > blue_less_red[-1]


def test_misuse_is_refused(renderer: FrameRenderer, mechanism: Mechanism, stable: Equilibrium) -> None:
    with pytest.raises(ValueError, match="pose"):
        renderer.draw(stable, goal=np.zeros(mechanism.dof + 1))
    with pytest.raises(ValueError, match="trail"):
        renderer.draw(stable, trail=np.zeros((5, 3)))
    with pytest.raises(ValueError, match="trail"):
        renderer.draw(stable, trail=np.full((5, 2), np.nan))
    with pytest.raises(ValueError, match="size"):
        FrameRenderer(mechanism, (480, 10))
    other = get_mechanism(next(name for name in mechanism_names() if name != mechanism.name))
    with pytest.raises(ValueError, match="equilibrium"):
        FrameRenderer(other).draw(stable)


def test_unknown_surroundings_are_refused(stable: Equilibrium) -> None:
    with pytest.raises(TypeError, match="shadows"):
        FrameRenderer(stable.mechanism).draw(stable, shadows=[stable])  # type: ignore[call-arg]
