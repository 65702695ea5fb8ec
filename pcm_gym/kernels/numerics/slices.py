"""Long work in slices, each a call of compiled code that takes some tenths of a second at most.

While compiled code runs, Python cannot answer: an interruption (Ctrl-C) is noticed when a call returns. So no kernel
that Python calls does all of a long computation: it does a slice, leaves in arrays where it stands, and is called
again.
"""

from collections.abc import Iterator


def slices(count: int, size: int) -> Iterator[tuple[int, int]]:
    """Return (first, last) of the slices, of at most `size` each, that together cover the numbers from 0 to `count`."""
    return ((first, min(first + size, count)) for first in range(0, count, size))
