"""The command line: ``python -m docs.figures``."""

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from docs.figures import style
from docs.figures.catalogue import FIGURES
from docs.figures.page import PAGE, image_name, with_tables
from docs.figures.plate import Plate


def main(
    only: Annotated[list[int] | None, typer.Option(help="Number of a figure; may be given several times.")] = None,
    out: Annotated[Path, typer.Option(help="Folder for the page and, in images/, the pictures.")] = PAGE.parent,
) -> None:
    """Make the paper's figures, print their numbers, and write both to the page."""
    numbers = list(FIGURES) if only is None else only
    unknown = sorted(set(numbers) - set(FIGURES))
    if unknown:
        raise typer.BadParameter(f"must be one of {list(FIGURES)}, got {unknown}", param_hint="--only")
    images = out / "images"
    images.mkdir(parents=True, exist_ok=True)
    console, plates = Console(width=None if Console().is_terminal else 130), {}
    with Progress(console=console, transient=True) as progress, style.settings():
        for number in progress.track(numbers, description="figures"):
            plates[number] = FIGURES[number]()
            style.save_png(plates[number].figure, images / image_name(number))
    page = out / PAGE.name
    page.write_text(with_tables(PAGE.read_text(encoding="utf-8"), plates), encoding="utf-8")
    for number, plate in plates.items():
        _print(console, number, plate)
    console.print(f"Pictures written to {images}, their numbers to {page}", highlight=False)


def _print(console: Console, number: int, plate: Plate) -> None:
    table = Table(*plate.columns, title=f"Figure {number}", title_justify="left", title_style="bold")
    for row in plate.rows:
        table.add_row(*row)
    console.print(table)
    if plate.note:
        console.print(plate.note, highlight=False)


if __name__ == "__main__":
    typer.run(main)
