"""The command ``pcm-gym``, also as ``python -m agents.cli``."""

from agents.commands.app import app


def main() -> None:
    """Run the command line."""
    app()


if __name__ == "__main__":
    main()
