"""The export: ``python -m agents.export RUN_OR_MODEL``."""

import typer

from agents.commands.export import export

if __name__ == "__main__":
    typer.run(export)
