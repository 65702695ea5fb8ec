"""The benchmark: ``python -m agents.benchmark CONFIG.yaml``."""

import typer

from agents.commands.benchmark import benchmark

if __name__ == "__main__":
    typer.run(benchmark)
