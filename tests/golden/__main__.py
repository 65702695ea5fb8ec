"""Golden scenarios: what they come to, kept so that a change of the code can be shown to change nothing else.

From the repository's root:

    python -m tests.golden make                    # the values in the repository again, checked on every processor
    python -m tests.golden digests --write FOLDER  # every bit, before a change, on this machine
    python -m tests.golden digests --compare FOLDER  # and after it: what differs, and by how much

The folder gets `digests.json` and, so that differences can be told in numbers, `raw.npz` with all values (some 100 MB).
"""

import argparse
import json
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tests.golden.records import Record, digests, kept, largest_differences
from tests.golden.scenarios import PATH, PORTABLE, SCENARIOS


def run(name: str) -> Record:
    start = time.perf_counter()
    record = SCENARIOS[name]()
    print(f"{time.perf_counter() - start:7.2f} s  {name}", file=sys.stderr, flush=True)
    return record


def make(_: argparse.Namespace) -> int:
    """Write the values in the repository."""
    arrays: dict[str, Any] = {f"{name}/{layer}": array for name in PORTABLE for layer, array in kept(run(name)).items()}
    np.savez_compressed(PATH, **arrays)
    print(f"{len(PORTABLE)} scenarios, {PATH.stat().st_size / 1e6:.2f} MB in {PATH}")
    return 0


def write_digests(folder: Path, names: list[str]) -> int:
    folder.mkdir(parents=True, exist_ok=True)
    records = {name: run(name) for name in names}
    found = {name: digests(record) for name, record in records.items()}
    (folder / "digests.json").write_text(json.dumps(found, indent=1, sort_keys=True) + "\n")
    raw: dict[str, Any] = {
        f"{name}/{key}": array for name, record in records.items() for key, array in record.fields.items()
    }
    np.savez_compressed(folder / "raw.npz", **raw)
    print(f"digests of {len(names)} scenarios in {folder}")
    return 0


def compare_digests(folder: Path, names: list[str]) -> int:
    """Print what differs, scenario by scenario and field by field; return 1 if anything does."""
    expected: dict[str, dict[str, str]] = json.loads((folder / "digests.json").read_text())
    raw_path, differing = folder / "raw.npz", 0
    raw = np.load(raw_path) if raw_path.exists() else {}
    for name in names:
        if name not in expected:
            print(f"{name}: not there before")
            continue
        record = run(name)
        lines = _differing(name, record, expected[name], raw)
        differing += bool(lines)
        print("\n  ".join([f"{name}: differs", *lines]) if lines else f"{name}: the same")
    for name in expected.keys() - set(SCENARIOS):
        print(f"{name}: no more there")
    print(f"{differing} of {len(names)} scenarios differ")
    return int(differing > 0)


def _differing(name: str, record: Record, expected: dict[str, str], raw: Any) -> list[str]:
    found, fields, lines = digests(record), record.fields, []
    for key in sorted(found.keys() | expected.keys()):
        if key not in expected or key not in found:
            lines.append(f"{key}: only {'now' if key in found else 'before'}")
        elif found[key] != expected[key]:
            before: NDArray[Any] | None = raw.get(f"{name}/{key}")
            how = "other bits" if before is None else largest_differences(before, fields[key])
            lines.append(f"{key}: {how}")
    return lines


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.golden", description=(__doc__ or "").split("\n")[0])
    commands = parser.add_subparsers(required=True)
    commands.add_parser("make", help="write the values in the repository again").set_defaults(command=make)
    digests_parser = commands.add_parser("digests", help="write or compare digests of every bit, on one machine")
    ways = digests_parser.add_mutually_exclusive_group(required=True)
    ways.add_argument("--write", type=Path, metavar="FOLDER")
    ways.add_argument("--compare", type=Path, metavar="FOLDER")
    digests_parser.add_argument("--only", default="", help="only scenarios whose name holds this text")

    def digests_command(arguments: argparse.Namespace) -> int:
        names = [name for name in SCENARIOS if arguments.only in name]
        if arguments.write is not None:
            return write_digests(arguments.write, names)
        return compare_digests(arguments.compare, names)

    digests_parser.set_defaults(command=digests_command)
    arguments = parser.parse_args()
    result: int = arguments.command(arguments)
    return result


if __name__ == "__main__":
    sys.exit(main())
