"""Running examples, and the record of what came of it."""

import json
import platform
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

from docs.clients.table import CLIENTS, EXAMPLES

RECORD = Path(__file__).parent / "record.json"
LEAST_STEPS = 1000


@dataclass(frozen=True)
class Run:
    """A run of an example that went well.

    Attributes
    ----------
    steps : int
        Steps of environments that it made.
    python : str
    versions : dict
        Of what it imported.
    """

    steps: int
    python: str
    versions: Mapping[str, str]


def run(name: str) -> Run:
    """Run an example in a process of its own.

    Raises
    ------
    RuntimeError
        If it fails, or makes fewer steps than `LEAST_STEPS`; the message holds the end of what it printed.
    """
    command = [sys.executable, str(EXAMPLES / f"{name}.py")]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    lines = done.stdout.split()
    if done.returncode != 0 or not lines or int(lines[-1]) < LEAST_STEPS:
        raise RuntimeError(f"{name} failed ({done.returncode}):\n{done.stdout[-500:]}\n{done.stderr[-3000:]}")
    return Run(int(lines[-1]), platform.python_version(), CLIENTS[name].versions())


def read_record(path: Path = RECORD) -> dict[str, Run]:
    """Return the last run of each example that has run."""
    if not path.is_file():
        return {}
    return {name: Run(**entries) for name, entries in json.loads(path.read_text(encoding="utf-8")).items()}


def write_record(runs: Mapping[str, Run], path: Path = RECORD) -> None:
    """Write the runs, in the order of the table."""
    content = {name: asdict(runs[name]) for name in CLIENTS if name in runs}
    path.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")
