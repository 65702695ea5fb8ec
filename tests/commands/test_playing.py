"""The game runs in a window that is not shown: keys drive the inputs, the score is told, Escape ends it."""

import itertools
import threading
import time

import numpy as np
import pytest

from pcm_gym.commands.playing import keys_to_action
from tests.commands.calls import Shell

pygame = pytest.importorskip("pygame")


def test_every_combination_of_keys_drives_the_inputs_its_own_way() -> None:
    for legs in (2, 3):
        actions = keys_to_action(legs)
        assert len(actions) == 3**legs - 1
        assert {tuple(action) for action in actions.values()} == set(itertools.product((-1, 0, 1), repeat=legs)) - {
            (0,) * legs
        }
        for keys, action in actions.items():
            assert len(set(keys)) == np.abs(action).sum()


def test_keys_drive_the_mechanism_and_escape_ends_the_game(shell: Shell, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")

    def press() -> None:
        while not (pygame.display.get_init() and pygame.display.get_surface()):
            time.sleep(0.01)
        pygame.event.post(pygame.event.Event(pygame.KEYDOWN, key=ord("q")))
        time.sleep(1.0)
        pygame.event.post(pygame.event.Event(pygame.KEYDOWN, key=pygame.K_ESCAPE))

    player = threading.Thread(target=press, daemon=True)
    player.start()
    ended = shell("play", "PCM/2RFR-Reach-v0", "--fps", "60", "--size", "200")
    player.join()
    assert ended.code == 0
    assert "Q and A, W and S drive" in ended.output
    assert "episode 1: step 5" in ended.output


def test_what_cannot_be_played_is_refused(shell: Shell) -> None:
    assert "did you mean" in shell("play", "PCM/2RFR-Reech-v0").errors
    refused = shell("play", "PCM/2RFR-Reach-v0", "--difficulty", "easy")
    assert refused.code == 1
    assert "difficulty must be one of" in refused.errors
