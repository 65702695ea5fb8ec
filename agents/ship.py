"""The policies that come with the package: ``python -m agents.ship CONFIG.yaml``."""

import typer

from agents.commands.ship import ship

if __name__ == "__main__":
    typer.run(ship)
