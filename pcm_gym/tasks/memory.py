"""What has been worked out for scenes, kept within a bounded part of the memory for whoever asks again."""

import pickle
from collections.abc import Callable
from functools import partial
from threading import RLock
from typing import Any, TypeVar

from cachetools import LRUCache, cached
from cachetools.keys import hashkey

# All that is kept, in bytes: 1 GiB; what is unused for longest goes first. A scene's roadmap counts for up to 4 MB,
# its paths for 5 MB, all else for less.
CACHE_BYTES = 1 << 30
# An entry counts for its data twice, as roadmaps work out as much again later, and for the objects around them.
_DATA_COUNT, _OBJECTS = 2, 1 << 14

Function = TypeVar("Function", bound=Callable[..., Any])


def make_cache(size: int) -> LRUCache[Any, Any]:
    """Return a cache for values of together at most `size` bytes, each of which counts as `byte_count` tells."""
    return LRUCache(size, byte_count)


def byte_count(value: Any) -> int:
    """Return for how many bytes a value counts: for no fewer than it takes."""
    return _OBJECTS + _DATA_COUNT * len(pickle.dumps(value, pickle.HIGHEST_PROTOCOL))


_kept, _lock = make_cache(CACHE_BYTES), RLock()


def remembered(function: Function, cache: LRUCache[Any, Any] = _kept) -> Function:
    """Return the function with a memory: equal arguments give the same result again, as long as there is room for it.

    All functions of a cache share its room.
    """
    return cached(cache, key=partial(hashkey, function), lock=_lock)(function)  # type: ignore[return-value]
