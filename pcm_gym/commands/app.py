"""The command ``pcm-gym``: what there is."""

from collections.abc import Callable, Sequence
from typing import Annotated, Any

import typer

import pcm_gym
from pcm_gym.commands import (
    catalogue,
    charts,
    checkout,
    doctor,
    enjoying,
    exploring,
    following,
    pictures,
    playing,
    solutions,
    upkeep,
)
from pcm_gym.commands.errors import end_with

_EPILOG = (
    "Exit codes: 0 done; 1 refused, or something is wrong, as a sentence on standard error says; 2 no such command or "
    "option, or a value that cannot be read; 70 a mistake of the package; 130 interrupted."
)

_COMMANDS: dict[str, dict[str, Callable[..., Any]]] = {
    "What there is": {"list": catalogue.list_all, "info": catalogue.info, "schema": catalogue.schema},
    "Mechanics": {
        "fk": solutions.fk,
        "ik": solutions.ik,
        "track": following.track,
        "plan": following.plan,
        "fold": following.fold,
        "snap": following.snap,
        "atlas": charts.atlas,
        "diagram": charts.diagram,
        "render": pictures.render,
        "explore": exploring.explore,
        "play": playing.play,
        "enjoy": enjoying.enjoy,
    },
    "Upkeep": {"warmup": upkeep.warmup, "cache": upkeep.cache, "doctor": doctor.doctor},
}


def _print_version(is_asked: bool) -> None:
    if is_asked:
        typer.echo(pcm_gym.__version__)
        raise typer.Exit


def _options(
    version: Annotated[
        bool, typer.Option("--version", help="Print the version.", callback=_print_version, is_eager=True)
    ] = False,
) -> None:
    """Planar parallel continuum mechanisms: every equilibrium, branches, folds, environments."""


def _make_app() -> typer.Typer:
    app = typer.Typer(
        no_args_is_help=True,
        pretty_exceptions_enable=False,
        context_settings={"help_option_names": ["-h", "--help"]},
        epilog=_EPILOG,
    )
    app.callback()(_options)
    for panel, commands in _COMMANDS.items():
        for name, command in commands.items():
            app.command(name, rich_help_panel=panel)(command)
    checkout.add_to(app)
    return app


app = _make_app()


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line, on the process's own arguments by default; whatever fails is said in a sentence."""
    try:
        app(arguments, prog_name="pcm-gym")
    except Exception as error:
        end_with(error)
