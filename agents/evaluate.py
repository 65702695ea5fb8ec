"""The evaluation: ``python -m agents.evaluate RUN_OR_MODEL``."""

import typer

from agents.commands.evaluate import evaluate

if __name__ == "__main__":
    typer.run(evaluate)
