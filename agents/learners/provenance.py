"""Whether a snapshot was written here: models are pickles, and a pickle of someone else's can run any code.

A snapshot has a file with a message authentication code of each of its files, by a key that only this user has and that
never leaves the machine. Whoever changes a file, or brings one along, cannot write its code.
"""

import hashlib
import hmac
import json
import secrets
from collections.abc import Iterable
from pathlib import Path

from platformdirs import user_data_path

MARKS = "written_here.json"


def mark(folder: Path) -> None:
    """Write the codes of all files in a folder beside them; without a place for a key there are none."""
    try:
        _key()
    except OSError:
        return
    codes = {path.name: _code(path) for path in sorted(folder.iterdir()) if path.is_file()}
    (folder / MARKS).write_text(json.dumps(codes, indent=2) + "\n", encoding="utf-8")


def foreign(paths: Iterable[Path]) -> list[Path]:
    """Those of some files that were not written here, or have been changed since."""
    return [path for path in paths if path.exists() and not _is_own(path)]


def _is_own(path: Path) -> bool:
    try:
        codes = json.loads((path.parent / MARKS).read_text(encoding="utf-8"))
        return hmac.compare_digest(str(codes[path.name]), _code(path))
    except (OSError, ValueError, TypeError, KeyError, RecursionError):  # no such file, or not as it should be
        return False


def _code(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, lambda: hmac.new(_key(), digestmod="sha256")).hexdigest()


def _key() -> bytes:
    """Return this user's key, made when it is first asked for."""
    path = user_data_path("pcm_gym") / "snapshots.key"
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        new = path.with_suffix(f".{secrets.token_hex(8)}")
        new.touch(mode=0o600)
        new.write_bytes(secrets.token_bytes(32))
        new.replace(path)
    return path.read_bytes()
