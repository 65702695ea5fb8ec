"""Training, evaluation, export and the benchmark under one name."""

import typer

from agents.commands.benchmark import benchmark
from agents.commands.evaluate import evaluate
from agents.commands.export import export
from agents.commands.train import train

app = typer.Typer(no_args_is_help=True, help="Learn to move planar parallel continuum mechanisms.")
app.command()(train)
app.command()(evaluate)
app.command()(export)
app.command()(benchmark)
