"""The command that shows who acts: a policy that comes with the package, one from a file, or a reference."""

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer

from pcm_gym.commands.arguments import AsJson
from pcm_gym.commands.catalogue import known_environment
from pcm_gym.commands.errors import RefusalError
from pcm_gym.commands.output import print_json
from pcm_gym.commands.pictures import save_animation

_POLICY_FILE = ".npz"


def enjoy(
    name: Annotated[str, typer.Argument(metavar="ID", help="An environment's id.")] = "PCM/2RFR-Reach-v0",
    who: Annotated[
        str,
        typer.Option(
            "--who", help="best, safest or smallest: a policy of the package; a policy's file, .npz; or a reference."
        ),
    ] = "best",
    difficulty: Annotated[str | None, typer.Option(help="Tier of the task; its default by default.")] = None,
    episodes: Annotated[int, typer.Option(help="How many episodes.", min=1)] = 3,
    seed: Annotated[int, typer.Option(help="Seed of the first one.", min=0)] = 0,
    out: Annotated[Path | None, typer.Option("--out", help="A .gif to write, in place of a window.")] = None,
    as_json: AsJson = False,
) -> None:
    """Watch a policy or a reference act on episodes of the test, in a window or as a .gif."""
    import gymnasium

    if out is not None and out.suffix.lower() != ".gif":
        raise RefusalError(f"{out} must end in .gif")
    tier: dict[str, Any] = {} if difficulty is None else {"difficulty": difficulty}
    mode = "human" if out is None else "rgb_array"
    env: Any = gymnasium.make(known_environment(name), render_mode=mode, split="test", **tier)
    act = _actor(who, name, difficulty, env)
    frames, outcomes = [], []
    for episode in range(episodes):
        observation, _ = env.reset(seed=seed + episode)
        has_ended, steps, info = False, 0, {}
        while not has_ended:
            if out is not None:
                frames.append(env.render())
            observation, _, terminated, truncated, info = env.step(act(observation))
            has_ended, steps = terminated or truncated, steps + 1
        outcomes.append({"seed": seed + episode, "is_success": bool(info["is_success"]), "steps": steps})
        if not as_json:
            outcome = "at the goal" if info["is_success"] else "not at the goal"
            typer.echo(f"episode {episode + 1}, seed {seed + episode}: {outcome} after {steps} steps")
    env.close()
    if out is not None:
        save_animation(frames, out)
    if as_json:
        print_json({"episodes": outcomes, "written": None if out is None else str(out)})
    elif out is not None:
        typer.echo(f"written to {out}")


def _actor(who: str, name: str, difficulty: str | None, env: Any) -> Callable[[Any], Any]:
    import pcm_gym
    from pcm_gym.policies.shipped import KINDS
    from pcm_gym.references import REFERENCES, ReferencePolicy

    if who in REFERENCES:
        return ReferencePolicy(who, env)
    if who in KINDS:
        return pcm_gym.load_policy(name, difficulty, who)
    if who.endswith(_POLICY_FILE):
        return pcm_gym.load_policy(who)
    known = ", ".join((*KINDS, f"a file that ends in {_POLICY_FILE}", *REFERENCES))
    raise RefusalError(f"--who must be one of {known}, got {who!r}")
