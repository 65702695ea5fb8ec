"""The command that lets one play: a window, the keyboard, and the score on the terminal."""

import itertools
from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pcm_gym.commands.catalogue import known_environment

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

# Keys that drive each input forwards and backwards.
_KEYS = ("qa", "ws", "ed", "rf", "tg", "yh")


class OnInstability(StrEnum):
    """What comes of a loss of stability."""

    SNAP = "snap"
    TERMINATE = "terminate"
    HOLD = "hold"


@dataclass
class _Score:
    """What the present episode has come to, told on the terminal after every step."""

    episode: int = 1
    steps: int = 0
    reward: float = 0.0
    losses: int = 0

    def tell(self, *step: Any) -> None:
        """Count a step: observations before and after it, action, reward, the two ends, and the infos."""
        *_, reward, terminated, truncated, info = step
        self.steps, self.reward, self.losses = self.steps + 1, self.reward + reward, self.losses + info["losses"]
        line = (
            f"episode {self.episode}: step {self.steps}, reward {self.reward:.1f}, losses of stability {self.losses}, "
            f"margin {info['singularity_margin']:.3f}{', at the goal' if info['is_success'] else ''}"
        )
        has_ended = terminated or truncated
        typer.echo(f"\r{line:<100}", nl=has_ended)
        if has_ended:
            self.episode, self.steps, self.reward, self.losses = self.episode + 1, 0, 0.0, 0


def play(
    name: Annotated[str, typer.Argument(metavar="ID", help="An environment's id.")] = "PCM/2RFR-Reach-v0",
    difficulty: Annotated[str | None, typer.Option(help="Tier of the task; its default by default.")] = None,
    on_instability: Annotated[OnInstability, typer.Option(help="What comes of a loss of stability.")] = (
        OnInstability.SNAP
    ),
    seed: Annotated[int, typer.Option(help="Seed of the episodes.", min=0)] = 0,
    fps: Annotated[int, typer.Option(help="Steps per second.", min=1, max=120)] = 15,
    size: Annotated[int, typer.Option(help="Width and height of the window, pixels.", min=128, max=4096)] = 640,
) -> None:
    """Play an environment in a window: Q and A drive the first input, W and S the second, E and D the third.

    Escape ends it. The green cross is the goal; the score is told here.
    """
    import gymnasium
    import pygame  # noqa: F401 (Gymnasium's own words on its absence name another package)
    from gymnasium.utils.play import play as play_in_window

    tier: dict[str, Any] = {} if difficulty is None else {"difficulty": difficulty}
    env: Any = gymnasium.make(
        known_environment(name), render_mode="rgb_array", on_instability=str(on_instability), **tier
    )
    env.reset(seed=seed)
    still = 0.0 * env.action_space.low
    keys = keys_to_action(len(still))
    listed = ", ".join(f"{pair[0].upper()} and {pair[1].upper()}" for pair in _KEYS[: len(still)])
    typer.echo(f"{name}: {listed} drive the inputs forwards and backwards, Escape ends the game")
    zoom = size / env.render().shape[0]
    play_in_window(env, fps=fps, zoom=zoom, callback=_Score().tell, keys_to_action=keys, noop=still)
    typer.echo("")
    env.close()


def keys_to_action(legs: int) -> dict[str, "NDArray[np.float32]"]:
    """Return the action for every combination of keys that drives inputs, one way each."""
    import numpy as np

    actions = {}
    for ways in itertools.product((0, 1, -1), repeat=legs):
        pressed = "".join(pair[0] if way > 0 else pair[1] for pair, way in zip(_KEYS, ways, strict=False) if way)
        if pressed:
            actions[pressed] = np.array(ways, dtype=np.float32)
    return actions
