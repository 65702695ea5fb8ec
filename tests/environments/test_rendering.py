"""Pictures of environments: what they show, and Gymnasium's windows and videos of them."""

from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest

from pcm_gym import environment_ids
from pcm_gym.environments.batch import MechanismVectorEnv
from pcm_gym.environments.single import MechanismEnv
from pcm_gym.mechanism import get_mechanism
from pcm_gym.rendering import FrameRenderer
from pcm_gym.rendering.camera import reach_bounds
from pcm_gym.solving import Atlas, build_atlas, solve_forward

ENVIRONMENT_ID = environment_ids()[0]


@pytest.fixture(scope="module")
def atlas() -> Atlas:
    return build_atlas(get_mechanism("2PFR"), pitch=0.05, input_cells=24, seed_nodes=3, progress=False)


def walked(steps: int = 3, **arguments: Any) -> MechanismEnv:
    env = MechanismEnv("2PFR", render_mode="rgb_array", **arguments)
    env.reset(seed=0)
    for _ in range(steps):
        env.step(np.full(2, 0.1, dtype=np.float32))
    return env


def test_ghosts_are_all_equilibria_at_the_present_inputs() -> None:
    load = (0.05, -0.1)
    env = walked(render_ghosts=True, load=load)
    here = env.equilibrium
    ghosts = solve_forward(here.mechanism, here.inputs, load, rho_max=9.0)
    assert len(ghosts) > 5
    picture = env.render()
    expected = FrameRenderer(env.mechanism).draw(
        here, env.goal, env.success_distance, trail=np.array(env.save_state()["trail"]), ghosts=ghosts
    )
    np.testing.assert_array_equal(picture, expected)
    assert np.any(picture != walked(load=load).render())


def test_the_workspace_is_behind_every_picture(atlas: Atlas) -> None:
    env = walked(render_workspace=atlas)
    expected = FrameRenderer(env.mechanism, workspace=atlas.workspace()).draw(
        env.equilibrium, env.goal, env.success_distance, trail=np.array(env.save_state()["trail"])
    )
    np.testing.assert_array_equal(env.render(), expected)
    assert np.any(expected != walked().render())


def test_what_is_drawn_does_not_change_what_happens(atlas: Atlas) -> None:
    shown, bare = walked(render_ghosts=True, render_workspace=atlas), walked()
    shown.render()
    for env in (shown, bare):
        env.step(np.full(2, -0.3, dtype=np.float32))
    np.testing.assert_array_equal(shown.equilibrium.state, bare.equilibrium.state)


def test_a_batch_draws_what_its_rows_would_draw() -> None:
    arguments: dict[str, Any] = {"render_mode": "rgb_array"}
    batch = MechanismVectorEnv(3, mechanism="2PFR", **arguments)
    batch.reset(seed=4)
    pictures = batch.render()
    assert pictures is not None
    assert len(pictures) == 3
    for row, picture in enumerate(pictures):
        env = MechanismEnv("2PFR", **arguments)
        env.reset(seed=4 + row)
        np.testing.assert_array_equal(picture, env.render())


def test_variants_of_a_mechanism_are_drawn_as_they_are() -> None:
    env = MechanismEnv("2PFR", render_mode="rgb_array", randomisation={"base": 0.05}, variants=2)
    env.reset(seed=0)
    bounds = reach_bounds(env.mechanism)
    expected = FrameRenderer(env.equilibrium.mechanism, bounds=bounds).draw(
        env.equilibrium, env.goal, env.success_distance
    )
    np.testing.assert_array_equal(env.render(), expected)


def test_bad_arguments_are_named(atlas: Atlas) -> None:
    with pytest.raises(TypeError, match="render_ghosts must be True or False, got 'all'"):
        MechanismEnv("2PFR", render_ghosts="all")  # type: ignore[arg-type]
    with pytest.raises(FileNotFoundError, match=r"atlas\.npz"):
        MechanismEnv("2PFR", render_workspace="atlas.npz")
    with pytest.raises(TypeError, match="render_workspace"):
        MechanismEnv("2PFR", render_workspace=1)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match=r"render_workspace must be an atlas of '2RFR'.*got one of '2PFR'"):
        MechanismEnv("2RFR", render_workspace=atlas)
    with pytest.raises(ValueError, match="render_workspace"):
        MechanismEnv("2PFR", render_workspace=atlas, load=(0.0, -0.1))


# Gymnasium's wrappers


@pytest.fixture
def pygame(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Pygame drawing to no screen."""
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    monkeypatch.setenv("PYGAME_HIDE_SUPPORT_PROMPT", "1")
    return pytest.importorskip("pygame")


def assert_window_shows_the_picture(pygame: Any, env: gymnasium.Env[Any, Any]) -> None:
    env.reset(seed=0)
    for _ in range(2):
        env.step(env.action_space.sample())
        shown = pygame.surfarray.array3d(pygame.display.get_surface()).transpose(1, 0, 2)
        np.testing.assert_array_equal(shown, env.unwrapped.render())
    env.close()


def test_human_rendering_shows_the_pictures(pygame: Any) -> None:
    env = gymnasium.wrappers.HumanRendering(gymnasium.make(ENVIRONMENT_ID, render_mode="rgb_array"))
    assert_window_shows_the_picture(pygame, env)


def test_make_opens_a_window_for_human_rendering(pygame: Any) -> None:
    with pytest.warns(UserWarning, match="HumanRendering wrapper is being applied"):
        env = gymnasium.make(ENVIRONMENT_ID, render_mode="human")
    assert env.render_mode == "human"
    assert_window_shows_the_picture(pygame, env)


def test_make_collects_pictures_in_lists() -> None:
    env = gymnasium.make(ENVIRONMENT_ID, render_mode="rgb_array_list")
    env.reset(seed=0)
    for _ in range(3):
        env.step(env.action_space.sample())
    pictures: Any = env.render()
    assert isinstance(pictures, list)
    assert [picture.shape for picture in pictures] == [(480, 480, 3)] * 4


def test_videos_hold_a_picture_of_every_step(tmp_path: Path) -> None:
    pytest.importorskip("moviepy")
    from moviepy import VideoFileClip

    env = gymnasium.make(ENVIRONMENT_ID, render_mode="rgb_array")
    env = gymnasium.wrappers.RecordVideo(env, str(tmp_path / "videos"), episode_trigger=lambda number: number == 0)
    env.reset(seed=0)
    for _ in range(5):
        env.step(env.action_space.sample())
    env.close()
    (path,) = (tmp_path / "videos").glob("*.mp4")
    with VideoFileClip(str(path)) as clip:
        assert clip.size == [480, 480]
        assert clip.fps == env.metadata["render_fps"]
        assert clip.n_frames == 6
