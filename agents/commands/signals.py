"""Requests to end."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager

# What a shell expects of a command that was interrupted.
INTERRUPTED = 130


@contextmanager
def termination_as_interruption() -> Iterator[None]:
    """Let a request to terminate end what goes on as one from the keyboard does: with all that is to be kept."""
    earlier = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, earlier)
