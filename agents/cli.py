"""The command ``pcm-gym``, also as ``python -m agents.cli``."""

import sys


def main() -> None:
    """Run the command line; say what to install where that is missing."""
    try:
        from agents.commands.app import app
    except ModuleNotFoundError as error:
        if error.name is None or error.name.partition(".")[0] in ("agents", "pcm_gym"):
            raise
        sys.exit(f"pcm-gym needs {error.name}, which is not installed: pip install 'pcm_gym[agents]'")
    app()


if __name__ == "__main__":
    main()
