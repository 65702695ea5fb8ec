"""The command line: ``python -m docs.mechanisms``."""

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.progress import Progress

from benchmarks.evidence import Evidence
from benchmarks.problems import MECHANISMS
from docs.figures import style
from docs.mechanisms.page import image_name, page
from docs.mechanisms.picture import draw
from pcm_gym import get_mechanism


def main(
    moves: Annotated[int, typer.Option(min=1, help="Random moves of each mechanism.")] = 10_000,
    episodes: Annotated[int, typer.Option(min=1, help="Episodes of each reference.")] = 1000,
    out: Annotated[Path, typer.Option(help="Folder for the page, and beside it for images.")] = Path(__file__).parent,
) -> None:
    """Gather the evidence for every catalogued mechanism, and write it to the page; some minutes."""
    images = out.parent / "images" / "mechanisms"
    for folder in (out, images):
        folder.mkdir(parents=True, exist_ok=True)
    console, found = Console(), {}
    with Progress(console=console, transient=True) as progress, style.settings():
        for name in progress.track(MECHANISMS, description="mechanisms"):
            found[name] = Evidence.of(get_mechanism(name), moves, episodes)
            style.save_png(draw(found[name].sheets), images / image_name(name))
    (out / "README.md").write_text(page(found), encoding="utf-8")
    console.print(f"Page written to {out / 'README.md'}", highlight=False)


if __name__ == "__main__":
    typer.run(main)
