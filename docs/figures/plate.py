"""What every figure's function returns: the picture and the numbers that go with it."""

from collections.abc import Iterable
from dataclasses import dataclass

from matplotlib.figure import Figure


@dataclass(frozen=True)
class Plate:
    """A picture with the table of its numbers.

    Attributes
    ----------
    figure : Figure
    columns : tuple of str
        Headings of the table.
    rows : tuple of tuples of str
        Its rows, as they are printed.
    note : str
        What there is to say in numbers beside the table.
    """

    figure: Figure
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    note: str = ""

    @property
    def markdown(self) -> str:
        """The table and the note as Markdown."""
        lines = (self.columns, ("---",) * len(self.columns), *self.rows)
        table = "\n".join("| " + " | ".join(line) + " |" for line in lines)
        return f"{table}\n\n{self.note}" if self.note else table


def fixed(value: float, digits: int = 3) -> str:
    """Number with so many decimals, never a negative zero."""
    return f"{round(float(value), digits) + 0.0:.{digits}f}"


def listed(values: Iterable[float], digits: int = 3) -> str:
    """Numbers in one cell of a table."""
    return ", ".join(fixed(value, digits) for value in values)
