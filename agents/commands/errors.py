"""What goes wrong for reasons that a user can mend, said in a sentence."""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

import typer
from rich.console import Console

from agents.learners.provenance import foreign
from agents.learners.settings import ConfigError, UsageError


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


@contextmanager
def errors_from(source: str) -> Iterator[None]:
    """Name where a configuration is from that turns out to be wrong only when it is used."""
    try:
        yield
    except ConfigError as error:
        raise ConfigError(f"{source}: {error}") from error


def warn_of_foreign(console: Console, pickles: Iterable[Path]) -> None:
    """Warn of files that can run code when they are read, and were not written here."""
    for path in foreign(pickles):
        console.print(
            f"Warning: {path} was not written here by you. It is a pickle, which can run any code as it is read: go on "
            "only with files that you trust. Policies of `agents.export` hold none.",
            style="yellow",
            markup=False,
            soft_wrap=True,
        )


def _say(console: Console, sentence: str) -> None:
    console.print(sentence, style="red", markup=False, soft_wrap=True)
