"""How commands tell what they found: as JSON for scripts, or as lines and tables."""

import json
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import typer

from pcm_gym.plain import plain

if TYPE_CHECKING:
    from rich.table import Table

    from pcm_gym import Equilibrium


def print_json(content: Any) -> None:
    """Print data as JSON: arrays as lists, and null for what is no finite number."""
    typer.echo(json.dumps(plain(content), indent=2, allow_nan=False))


def print_lines(entries: Mapping[str, Any]) -> None:
    """Print entries as lines, "name  value"."""
    width = max(map(len, entries), default=0)
    for name, value in entries.items():
        typer.echo(f"{name:<{width}}  {shown(value)}")


def print_table(columns: Sequence[str], rows: Iterable[Sequence[Any]], title: str = "") -> None:
    """Print a table; no cell is cut where the output is no terminal."""
    from rich.console import Console

    console = Console()
    console = console if console.is_terminal else Console(width=10_000)
    console.print(_table(columns, rows, title))


def _table(columns: Sequence[str], rows: Iterable[Sequence[Any]], title: str) -> "Table":
    from rich import box
    from rich.table import Table
    from rich.text import Text

    table = Table(*columns, title=title or None, title_justify="left", box=box.SIMPLE_HEAD)
    for row in rows:
        table.add_row(*(Text(shown(value)) for value in row))
    return table


def shown(value: Any) -> str:
    """Return a value as lines and tables show it."""
    value = value.tolist() if hasattr(value, "tolist") else value
    if isinstance(value, list | tuple):
        return ", ".join(map(shown, value))
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.6g}" if isinstance(value, float) else "-" if value is None else str(value)


# What `equilibrium_rows` has in its rows.
EQUILIBRIUM_COLUMNS = ("number", "pose", "inputs", "modes", "index", "energy", "largest rho", "singularity margin")


def equilibrium_rows(equilibria: Iterable["Equilibrium"]) -> list[tuple[Any, ...]]:
    """Return a row for each equilibrium."""
    return [
        (
            number,
            each.pose,
            each.inputs,
            each.modes,
            "0, stable" if each.is_stable else each.index,
            each.energy,
            max(rod.rho for rod in each.rods),
            each.singularity_margin,
        )
        for number, each in enumerate(equilibria)
    ]


def equilibrium_data(equilibrium: "Equilibrium") -> dict[str, Any]:
    """Return what is known of an equilibrium as data: SI units and radians."""
    return {
        "inputs": equilibrium.inputs,
        "pose": equilibrium.pose,
        "load": equilibrium.load,
        "energy": equilibrium.energy,
        "index": equilibrium.index,
        "is_stable": equilibrium.is_stable,
        "stability_margin": equilibrium.stability_margin,
        "singularity_margin": equilibrium.singularity_margin,
        "residual": equilibrium.residual,
        "within_limits": equilibrium.within_limits,
        "rods": [
            {"modulus": rod.modulus, "psi": rod.psi, "mode": rod.mode, "rho": rod.rho, "force": rod.force}
            for rod in equilibrium.rods
        ],
    }
