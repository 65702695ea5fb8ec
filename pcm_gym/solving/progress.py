"""Progress bars of long computations."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.progress import Progress


def progress_bars(title: str, is_shown: bool) -> "Progress":
    """Return bars on standard error, each described by `title` and its own words; none if not `is_shown`."""
    from rich.console import Console  # loaded only when something long is computed
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    return Progress(
        TextColumn(title + ": {task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        console=Console(stderr=True),
        disable=not is_shown,
    )
