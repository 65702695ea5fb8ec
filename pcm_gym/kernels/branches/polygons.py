"""Where polygons through the vertices of curves cross."""

import numpy as np

from pcm_gym.arrays import Array, Integers
from pcm_gym.kernels.numerics.compilation import kernel

# Pairs of segments that are looked at in one call of compiled code.
_PAIRS_AT_ONCE = 1 << 24


@kernel
def crossing_segments(
    first: Array, second: Array, periods: Array, is_same: bool, start: int, pairs: Integers
) -> tuple[int, int]:
    """Find segments of two polylines (m, 2) in a plane, periodic where `periods` (2,) is not 0, that cross.

    Puts their numbers into `pairs` (k, 2) and returns how many there are, more than k if there is no room for all. A
    call looks at some segments of the first polyline, beginning with `start`, and returns also which is the next. Of
    one polyline with itself neighbouring segments are left out.
    """
    count, shift = 0, np.zeros(2)
    end = min(start + 1 + _PAIRS_AT_ONCE // second.shape[0], first.shape[0] - 1)
    for k in range(start, end):
        for n in range(k + 2 if is_same else 0, second.shape[0] - 1):
            is_near = True
            for d in range(2):
                gap = second[n, d] - first[k, d]
                shift[d] = periods[d] * round(gap / periods[d]) if periods[d] > 0.0 else 0.0
                reach = abs(first[k + 1, d] - first[k, d]) + abs(second[n + 1, d] - second[n, d])
                is_near = is_near and abs(gap - shift[d]) <= reach
            if is_near and _cross(first[k], first[k + 1], second[n] - shift, second[n + 1] - shift):
                if count < pairs.shape[0]:
                    pairs[count, 0], pairs[count, 1] = k, n
                count += 1
    return count, end


@kernel
def _cross(a: Array, b: Array, c: Array, d: Array) -> bool:
    return bool(_side(a, b, c) * _side(a, b, d) <= 0.0 and _side(c, d, a) * _side(c, d, b) <= 0.0)


@kernel
def _side(a: Array, b: Array, point: Array) -> float:
    return float((b[0] - a[0]) * (point[1] - a[1]) - (b[1] - a[1]) * (point[0] - a[0]))
