"""Who is watched acts as it does elsewhere: episodes of the test, ended as the batch ends them."""

from pathlib import Path

import gymnasium
import pytest
from PIL import Image

from pcm_gym.references import ReferencePolicy
from tests.commands.calls import Shell

ID = "PCM/2RFR-Reach-v0"


def test_an_episode_that_is_watched_is_one_of_the_test(shell: Shell, tmp_path: Path) -> None:
    out = tmp_path / "episode.gif"
    ended = shell("enjoy", ID, "--who", "resolved rate", "--episodes", "2", "--seed", "7", "--out", str(out))
    assert ended.code == 0
    env = gymnasium.make(ID, split="test")
    policy, total = ReferencePolicy("resolved rate", env), 0
    for number, seed in enumerate((7, 8)):
        observation, _ = env.reset(seed=seed)
        steps, has_ended = 0, False
        while not has_ended:
            observation, _, terminated, truncated, info = env.step(policy(observation))
            has_ended, steps = terminated or truncated, steps + 1
        outcome = "at the goal" if info["is_success"] else "not at the goal"
        assert f"episode {number + 1}, seed {seed}: {outcome} after {steps} steps" in ended.output
        total += steps
    with Image.open(out) as image:
        assert 1 < getattr(image, "n_frames", 1) <= total  # frames in which nothing moves are one


def test_an_episode_is_watched_in_a_window(shell: Shell, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("pygame")
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    with pytest.warns(UserWarning, match="HumanRendering"):  # Gymnasium's own word on it
        ended = shell("enjoy", ID, "--who", "random", "--episodes", "1")
    assert ended.code == 0
    assert "after" in ended.output


def test_who_there_is_not_is_refused(shell: Shell, tmp_path: Path) -> None:
    out = str(tmp_path / "x.gif")
    refused = shell("enjoy", ID, "--who", "nobody", "--out", out)
    assert refused.code == 1
    assert "--who must be one of best, safest, smallest" in refused.errors
    assert "planner, got 'nobody'" in refused.errors
    assert "must end in .gif" in shell("enjoy", ID, "--out", str(tmp_path / "x.mp4")).errors
    assert "cannot be read" in shell("enjoy", ID, "--who", str(tmp_path / "none.npz"), "--out", out).errors
