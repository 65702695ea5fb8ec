"""The command that serves the explorer, a page to drive a mechanism by hand."""

import webbrowser
from typing import Annotated

import typer

from pcm_gym.commands.arguments import MechanismName, mechanism_of


def explore(
    mechanism: MechanismName = "2RFR",
    port: Annotated[int, typer.Option(help="Port on this machine; 0 for any that is free.", min=0, max=65535)] = 8642,
    browser: Annotated[bool, typer.Option(help="Open the page in a browser.")] = True,
) -> None:
    """Explore a mechanism by hand, on a page that this machine alone can reach."""
    from pcm_gym.explorer.server import run

    def started(address: str) -> None:
        typer.echo(f"the explorer is at {address} (Ctrl-C ends it)")
        if browser:
            webbrowser.open(address)

    run(mechanism_of(mechanism), port, started)
