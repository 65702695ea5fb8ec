"""The command line: ``python -m docs.ideas``."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Annotated

import typer
from matplotlib.figure import Figure

from docs.figures import style
from docs.ideas import branches, fall, folds, gradients

IMAGES = Path(__file__).parents[1] / "images" / "ideas"
PICTURES: Mapping[str, Callable[[], Figure]] = {
    "branches": branches.draw,
    "folds": folds.draw,
    "fall": fall.draw,
    "gradients": gradients.draw,
}


def main(out: Annotated[Path, typer.Option(help="Folder for the pictures.")] = IMAGES) -> None:
    """Draw the pictures of the pages on ideas; some minutes."""
    out.mkdir(parents=True, exist_ok=True)
    for name, draw in PICTURES.items():
        with style.settings():
            style.save_png(draw(), out / f"{name}.png")
        typer.echo(f"{out / name}.png")


if __name__ == "__main__":
    typer.run(main)
