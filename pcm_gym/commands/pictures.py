"""The command that draws: an equilibrium, a motion along a line of inputs, or an episode of an environment."""

from collections.abc import Iterable, Iterator
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pcm_gym.commands.arguments import (
    AsJson,
    Inputs,
    Load,
    Name,
    Number,
    Numbers,
    equilibrium_of,
    mechanism_of,
    numbers,
)
from pcm_gym.commands.catalogue import known_environment
from pcm_gym.commands.errors import RefusalError
from pcm_gym.commands.output import print_json

if TYPE_CHECKING:
    from pcm_gym import Equilibrium
    from pcm_gym.rendering.frame import Frame

_FRAMES_OF_A_MOTION, _STEPS_OF_AN_EPISODE = 60, 100
_MILLISECONDS = 50  # of a frame


class Actions(StrEnum):
    """What an episode's agent does."""

    RANDOM = "random"
    STILL = "still"


class Format(StrEnum):
    """What pictures are written as, by the ending of the file."""

    PNG = ".png"
    GIF = ".gif"
    SVG = ".svg"


def render(
    name: Name,
    out: Annotated[Path, typer.Option("--out", help="File to write: .png, .svg, or .gif for a motion.")],
    inputs: Inputs = None,
    number: Number = None,
    load: Load = None,
    to: Annotated[
        Numbers | None,
        typer.Option("--to", parser=numbers, metavar="NUMBERS", help="Inputs to move to: a motion, of a mechanism."),
    ] = None,
    ghosts: Annotated[bool, typer.Option("--ghosts", help="Show every other equilibrium at the same inputs.")] = False,
    size: Annotated[int, typer.Option(help="Width and height, pixels.", min=64, max=4096)] = 480,
    frames: Annotated[
        int | None, typer.Option(help="Pictures of a motion, or steps of an episode.", min=1, max=10_000)
    ] = None,
    seed: Annotated[int, typer.Option(help="Seed of an episode.", min=0)] = 0,
    actions: Annotated[Actions, typer.Option(help="What an episode's agent does.")] = Actions.RANDOM,
    as_json: AsJson = False,
) -> None:
    """Draw an equilibrium, a motion, or an episode of an environment."""
    kind = _format_of(out)
    is_environment = "/" in name and not name.endswith((".json", ".yaml", ".yml"))
    if is_environment:
        if any(given is not None for given in (inputs, number, load, to)):
            raise RefusalError("--inputs, --number, --load and --to are for mechanisms: episodes draw where they begin")
        steps = frames or (_STEPS_OF_AN_EPISODE if kind == Format.GIF else 1)
        _save(_episode(name, steps, seed, actions, ghosts), out, kind)
    else:
        start = equilibrium_of(mechanism_of(name), inputs, number, load)
        if kind == Format.SVG:
            if to is not None:
                raise RefusalError("a motion is written to a .gif, an equilibrium to a .svg")
            _save_svg(start, out, size, ghosts)
        else:
            places = [(start, False)] if to is None else list(_motion(start, to, frames or _FRAMES_OF_A_MOTION))
            _save(_frames(places, size, ghosts), out, kind)
    if as_json:
        print_json({"written": str(out)})
    else:
        typer.echo(f"written to {out}")


def _format_of(out: Path) -> Format:
    try:
        return Format(out.suffix.lower())
    except ValueError:
        raise RefusalError(f"{out} must end in {', '.join(Format)}: the ending tells the format") from None


def _motion(start: "Equilibrium", to: Numbers, count: int) -> Iterator[tuple["Equilibrium", bool]]:
    """Yield the equilibria of a motion, and whether stability has just been lost; from a fold the mechanism falls."""
    import numpy as np

    import pcm_gym

    tracker = pcm_gym.BranchTracker(start.mechanism, start)
    target = start.mechanism.check_inputs(to.values)
    yield start, False
    for part in np.linspace(0.0, 1.0, count + 1)[1:]:
        step = tracker.step(start.inputs + part * (target - start.inputs))
        yield step.equilibrium, step.event != pcm_gym.Event.NONE
        if step.event != pcm_gym.Event.NONE:
            return


def _frames(places: list[tuple["Equilibrium", bool]], size: int, ghosts: bool) -> Iterator["Frame"]:
    import pcm_gym
    from pcm_gym.rendering import FrameRenderer

    renderer = FrameRenderer(places[0][0].mechanism, (size, size))
    for equilibrium, is_lost in places:
        others = _others(equilibrium) if ghosts else ()
        yield renderer.draw(equilibrium, stability_lost=is_lost, ghosts=others)
    if places[-1][1]:  # where it falls from there
        fall = pcm_gym.snap(places[-1][0])
        if fall.is_landed:
            yield renderer.draw(fall.equilibrium, snapped=True)


def _others(equilibrium: "Equilibrium") -> list["Equilibrium"]:
    import pcm_gym

    return list(pcm_gym.solve_forward(equilibrium.mechanism, equilibrium.inputs, equilibrium.load))


def _episode(name: str, steps: int, seed: int, actions: Actions, ghosts: bool) -> Iterator["Frame"]:
    import gymnasium

    env: Any = gymnasium.make(known_environment(name), render_mode="rgb_array", render_ghosts=ghosts)
    env.reset(seed=seed)
    env.action_space.seed(seed)
    yield env.render()
    for _ in range(steps):
        action = env.action_space.sample()
        *_, terminated, truncated, _ = env.step(0.0 * action if actions == Actions.STILL else action)
        yield env.render()
        if terminated or truncated:
            return


def _save(frames: Iterator["Frame"], out: Path, kind: Format) -> None:
    """Write all frames as a .gif, or the last one as a .png."""
    if kind == Format.SVG:
        raise RefusalError("an episode is written to a .gif or a .png")
    from PIL import Image

    if kind == Format.GIF:
        save_animation(frames, out)
    else:
        *_, last = frames
        Image.fromarray(last).save(out)


def save_animation(frames: Iterable["Frame"], out: Path) -> None:
    """Write frames, one at least, as a .gif."""
    from PIL import Image

    first, *others = (Image.fromarray(frame) for frame in frames)
    first.save(out, save_all=True, append_images=others, duration=_MILLISECONDS, loop=0)


def _save_svg(equilibrium: "Equilibrium", out: Path, size: int, ghosts: bool) -> None:
    from pcm_gym.rendering.vector import equilibrium_svg

    out.write_text(equilibrium_svg(equilibrium, size, _others(equilibrium) if ghosts else ()), encoding="utf-8")
