"""The training: ``python -m agents.train CONFIG.yaml``."""

import typer

from agents.commands.train import train

if __name__ == "__main__":
    typer.run(train)
