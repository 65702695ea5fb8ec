"""One benchmark at a time in a folder."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from filelock import FileLock, Timeout

from agents.learners.settings import UsageError


@contextmanager
def alone(runs: Path) -> Iterator[None]:
    """Keep others out of a folder of training runs; the system gives it free when this process ends, however it ends.

    Raises
    ------
    UsageError
        If another process is in it.
    """
    runs.mkdir(parents=True, exist_ok=True)
    try:
        with FileLock(runs / ".lock", timeout=0):
            yield
    except Timeout as error:
        raise UsageError(f"{runs}: another process runs this benchmark") from error
