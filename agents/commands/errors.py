"""What goes wrong for reasons that a user can mend, said in a sentence."""

from collections.abc import Iterator
from contextlib import contextmanager

import typer
from rich.console import Console

from agents.learners.settings import UsageError


@contextmanager
def errors_in_words(console: Console) -> Iterator[None]:
    """End the command with a sentence where what was asked for cannot be done, or a file not be written."""
    try:
        yield
    except UsageError as error:
        _say(console, str(error))
        raise typer.Exit(code=1) from error
    except OSError as error:
        where = f"{error.filename}: " if error.filename else ""
        _say(console, f"{where}{error.strerror or error}")
        raise typer.Exit(code=1) from error


def _say(console: Console, sentence: str) -> None:
    console.print(sentence, style="red", markup=False, soft_wrap=True)
