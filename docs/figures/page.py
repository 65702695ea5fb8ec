"""The page that shows the figures: its tables stand between marks and are written by the command."""

import re
from collections.abc import Mapping
from pathlib import Path

from docs.figures.plate import Plate

PAGE = Path(__file__).parents[1] / "paper_figures.md"


def image_name(number: int) -> str:
    """File name of a figure's picture."""
    return f"figure-{number:02d}.png"


def with_tables(text: str, plates: Mapping[int, Plate]) -> str:
    """Return the page with the tables of these figures put between their marks.

    Raises
    ------
    ValueError
        If the page has no place for one of them.
    """
    for number, plate in plates.items():
        place = re.compile(rf"(<!-- numbers of figure {number} -->\n).*?(<!-- end -->)", re.DOTALL)
        found = place.search(text)
        if found is None:
            raise ValueError(f"the page has no place for the numbers of figure {number}")
        text = f"{text[: found.end(1)]}\n{plate.markdown}\n\n{text[found.start(2) :]}"
    return text
