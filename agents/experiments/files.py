"""Files that are there whole or not at all, whenever the process that writes them is killed."""

from pathlib import Path

# How the name ends of what is not complete.
PARTIAL = ".partial"


def write_whole(path: Path, text: str) -> None:
    """Write a text file under another name, and give it its own, in place of an earlier one, when it is complete."""
    partial = path.with_name(f"{path.name}{PARTIAL}")
    partial.write_text(text, encoding="utf-8")
    partial.replace(path)
