"""The command that puts the best agents of a benchmark into the package."""

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from agents.commands.errors import errors_in_words

console = Console()


def ship(
    config: Annotated[Path, typer.Argument(metavar="CONFIG", help="YAML file that describes the benchmark.")],
    runs_dir: Annotated[Path, typer.Option(help="Folder that holds the training runs.")] = Path("runs"),
) -> None:
    """Write the best, the safest and the smallest agent of every tier as the policies that come with the package.

    They are chosen by episodes of the training's part; what their cards say comes from the test's part.
    """
    with errors_in_words(console):
        from agents.benchmarking.config import load_benchmark  # loaded here because it loads numba and torch
        from agents.benchmarking.shipping import ship
        from pcm_gym.policies.shipped import FOLDER

        benchmark = load_benchmark(config)
        count = ship(benchmark, runs_dir / benchmark.name, FOLDER, console.print)
        console.print(f"{count} policies: {FOLDER}", markup=False, soft_wrap=True)
