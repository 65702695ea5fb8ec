"""Several threads for one kernel: each takes a piece of the rows, then the next one, until none is left.

Kernels let go of Python's global lock, so plain threads are enough. They are kept from call to call, made anew after a
fork, and belong to no environment: what uses them can be copied and pickled.
"""

import os
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import cache

import numba

# Rows that a thread takes at a time: few enough to share them evenly, many enough to be worth the call.
PIECE = 128
# With fewer rows than this the threads cost more than they save.
LEAST_ROWS = 256


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


def over_rows(function: Callable[[int, int], None], count: int, threads: int) -> None:
    """Call ``function(first, last)`` for pieces that together cover the rows from 0 to `count`.

    The pieces are taken by `threads` threads, the caller's own among them, or all by that one where they are few.
    """
    if threads == 1 or count < LEAST_ROWS:
        function(0, count)
        return
    pieces = iter(range(0, count, PIECE))
    helpers = [_pool(threads - 1).submit(_work, function, count, pieces) for _ in range(threads - 1)]
    _work(function, count, pieces)
    for helper in helpers:
        helper.result()


def _work(function: Callable[[int, int], None], count: int, pieces: Iterator[int]) -> None:
    for first in pieces:
        function(first, min(first + PIECE, count))
