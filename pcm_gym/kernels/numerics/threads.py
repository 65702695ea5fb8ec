"""Several threads for kernels: each takes a job, then the next one, until none is left.

Kernels let go of Python's global lock, so plain threads are enough. They are kept from call to call, made anew after a
fork, and belong to no environment: what uses them can be copied and pickled.
"""

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from functools import cache, partial
from threading import Lock

import numba

from pcm_gym.kernels.numerics.slices import slices

# Rows that a thread takes at a time: few enough to share them evenly, many enough to be worth the call.
PIECE = 128
# With fewer rows than this the threads cost more than they save.
LEAST_ROWS = 256
# Rows that one thread alone takes at a time: few enough for an interruption to be noticed soon.
LARGEST_PIECE = 1 << 12
# More threads than these are a mistake.
MOST_THREADS = 256


def default_thread_count() -> int:
    """Return the number of processors that this process may use, or less if the usual variables say so.

    These are ``NUMBA_NUM_THREADS`` and ``OMP_NUM_THREADS``.
    """
    count = int(numba.config.NUMBA_NUM_THREADS)
    named = os.environ.get("OMP_NUM_THREADS", "").partition(",")[0].strip()
    return min(count, int(named)) if named.isdecimal() and int(named) > 0 else count


@cache
def _pool(workers: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(workers, thread_name_prefix="pcm_gym")


if hasattr(os, "register_at_fork"):  # the threads stay behind in the parent
    os.register_at_fork(after_in_child=_pool.cache_clear)


def pieces_of(function: Callable[[int, int], None], count: int, threads: int) -> list[Callable[[], None]]:
    """Return calls of ``function(first, last)`` that together cover the rows from 0 to `count`."""
    piece = PIECE if threads > 1 and count >= LEAST_ROWS else LARGEST_PIECE
    return [partial(function, first, last) for first, last in slices(count, piece)]


def run_all(jobs: Sequence[Callable[[], None]], threads: int) -> None:
    """Run the jobs, each once, on `threads` threads, the caller's own among them. A job may itself call this.

    Where one fails, or the caller is interrupted, those that have not begun are dropped, and the others waited for.
    """
    left = iter(jobs)
    turns = [Lock() for _ in range(min(threads, len(jobs)) - 1)]
    helpers: list[Future[None]] = []
    try:
        for turn in turns:
            helpers.append(_pool(threads - 1).submit(_work, left, turn))
        for job in left:
            job()
    finally:
        _drop_and_wait(left, turns)
    for helper in helpers:
        if not helper.cancel():  # one that has not begun has nothing left to do
            helper.result()


def _drop_and_wait(left: Iterator[Callable[[], None]], turns: Sequence[Lock]) -> None:
    """Drop the jobs that have not begun and wait for the others, also where the caller is interrupted meanwhile."""
    try:
        for _ in left:
            pass
        for turn in turns:
            with turn:
                pass
    except BaseException:
        _drop_and_wait(left, turns)
        raise


def _work(left: Iterator[Callable[[], None]], turn: Lock) -> None:
    with turn:
        for job in left:
            job()
