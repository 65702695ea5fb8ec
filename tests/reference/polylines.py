"""Crossings of dense polylines, by orientation tests of their segments: the truth for crossings of rods and edges."""

import math

import numpy as np
from numba import njit

from pcm_gym.arrays import Array
from pcm_gym.solving import Equilibrium

_BLOCK = 16


def polyline_crossings(equilibrium: Equilibrium, points: int) -> list[tuple[int, int, float, float]]:
    """Return (part, other part, arc length, other arc length) of all crossings, sorted; parts as in `crossings`.

    Crossings within two segments of a hinge that both parts share are left out.
    """
    mechanism = equilibrium.mechanism
    lines = list(equilibrium.shape(points))
    lengths = [leg.rod.length for leg in mechanism.legs]
    legs = len(lines)
    if mechanism.dof == 3:
        hinges = [line[-1] for line in lines]
        for k in range(legs):
            first, second = hinges[k], hinges[(k + 1) % legs]
            lines.append(first + np.linspace(0.0, 1.0, points)[:, None] * (second - first))
            lengths.append(math.dist(first, second))
    steps, found = [length / (points - 1) for length in lengths], []
    for i in range(legs):
        for j in range(i, len(lines)):
            for own, other in _crossings(lines[i], lines[j], i == j):
                at_tip = own > points - 4
                shares_tip = (j < legs and i != j and mechanism.dof == 2) or (j >= legs and (j - legs + 1) % legs == i)
                if at_tip and shares_tip and other > points - 4:
                    continue
                if at_tip and j - legs == i and other < 3:
                    continue
                found.append((i, j, own * steps[i], other * steps[j]))
    return sorted(found)


def _crossings(first: Array, second: Array, is_same: bool) -> Array:
    found = np.empty((256, 2))
    return found[: _find(first, second, is_same, found)]


@njit(cache=False)
def _find(first, second, is_same, found):
    count, n, m = 0, len(first) - 1, len(second) - 1
    for i0 in range(0, n, _BLOCK):
        i1 = min(i0 + _BLOCK, n)
        low_x, high_x = first[i0 : i1 + 1, 0].min(), first[i0 : i1 + 1, 0].max()
        low_y, high_y = first[i0 : i1 + 1, 1].min(), first[i0 : i1 + 1, 1].max()
        for j0 in range(i0 if is_same else 0, m, _BLOCK):
            j1 = min(j0 + _BLOCK, m)
            if second[j0 : j1 + 1, 0].min() > high_x or second[j0 : j1 + 1, 0].max() < low_x:
                continue
            if second[j0 : j1 + 1, 1].min() > high_y or second[j0 : j1 + 1, 1].max() < low_y:
                continue
            for i in range(i0, i1):
                for j in range(max(j0, i + 2) if is_same else j0, j1):
                    a, b, c, d = first[i], first[i + 1], second[j], second[j + 1]
                    r, s, w = b - a, d - c, c - a
                    across = r[0] * s[1] - r[1] * s[0]
                    if across == 0.0:
                        continue
                    t = (w[0] * s[1] - w[1] * s[0]) / across
                    u = (w[0] * r[1] - w[1] * r[0]) / across
                    if 0.0 <= t < 1.0 and 0.0 <= u < 1.0 and count < len(found):
                        found[count, 0], found[count, 1] = i + t, j + u
                        count += 1
    return count
