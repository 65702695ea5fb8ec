"""The command line: ``python -m docs.environments``."""

from pathlib import Path
from typing import Annotated

import gymnasium
import typer
from rich.console import Console
from rich.progress import Progress

import pcm_gym
from docs.environments.page import FOLDER, IMAGES, environment_page, image_name, index_page, page_name, spec_of
from docs.environments.picture import picture
from pcm_gym.environments.single import MechanismEnv


def main(
    out: Annotated[Path, typer.Option(help="Folder for the pages.")] = FOLDER,
    images: Annotated[Path, typer.Option(help="Folder for the pictures.")] = IMAGES,
) -> None:
    """Write the page of each environment, with its picture, and the index."""
    for folder in (out, images):
        folder.mkdir(parents=True, exist_ok=True)
    console, envs = Console(), []
    with Progress(console=console, transient=True) as progress:
        for environment_id in progress.track(pcm_gym.environment_ids(), description="environments"):
            env = gymnasium.make(environment_id, render_mode="rgb_array").unwrapped
            assert isinstance(env, MechanismEnv)
            spec = spec_of(env)
            (out / page_name(spec)).write_text(environment_page(env), encoding="utf-8")
            picture(env).save(images / image_name(spec), optimize=True)
            envs.append(env)
    (out / "README.md").write_text(index_page(envs), encoding="utf-8")
    console.print(f"Pages written to {out}, pictures to {images}", highlight=False)


if __name__ == "__main__":
    typer.run(main)
