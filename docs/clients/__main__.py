"""The command line: ``python -m docs.clients``."""

from typing import Annotated

import typer
from rich.console import Console

from docs.clients.page import PAGE, page
from docs.clients.running import read_record, run, write_record
from docs.clients.table import CLIENTS


def main(
    only: Annotated[list[str] | None, typer.Option(help="Name of an example; may be given several times.")] = None,
) -> None:
    """Run the examples of all clients that are installed, and write the page; the others keep their last run."""
    unknown = sorted(set(only or ()) - set(CLIENTS))
    if unknown:
        raise typer.BadParameter(f"must be one of {list(CLIENTS)}, got {unknown}", param_hint="--only")
    console, runs = Console(), read_record()
    for name in only or CLIENTS:
        if missing := CLIENTS[name].missing():
            console.print(f"{name}: left out, without {', '.join(missing)}", highlight=False)
            continue
        try:
            runs[name] = run(name)
            console.print(f"{name}: {runs[name].steps} steps", highlight=False)
        except RuntimeError as error:
            runs.pop(name, None)
            console.print(str(error), style="red", highlight=False, markup=False)
        write_record(runs)
    PAGE.write_text(page(read_record()), encoding="utf-8")
    console.print(f"Page written to {PAGE}", highlight=False)


if __name__ == "__main__":
    typer.run(main)
