"""How many steps lead from node to node of a roadmap, where a step changes all inputs at once."""

from itertools import combinations, product

import numpy as np
from numpy.typing import NDArray

from pcm_gym.arrays import Array, Integers
from pcm_gym.kernels.numerics.compilation import kernel
from pcm_gym.kernels.numerics.rasters import NOWHERE

Steps = NDArray[np.uint8]

# What stands for nodes to which nothing leads, and for those that are as many steps away or more.
FAR = 255


def all_neighbours(ways: Integers) -> Integers:
    """Return the nodes (n, 3^legs - 1) that one step along one or several axes leads to, or -1.

    A step along several axes leads to a node if those along one axis each lead there in every order: what is enclosed
    is without a fold.
    """
    reached: dict[tuple[int, ...], Integers] = {(): np.arange(len(ways))}
    for count in range(1, ways.shape[1] // 2 + 1):
        for axes in combinations(range(ways.shape[1] // 2), count):
            for sides in product((0, 1), repeat=count):
                steps = tuple(2 * axis + side for axis, side in zip(axes, sides, strict=True))
                ends = np.array([_next(ways, reached[_without(steps, step)], step) for step in steps])
                reached[steps] = np.where((ends == ends[0]).all(axis=0), ends[0], NOWHERE)
    del reached[()]
    return np.ascontiguousarray(np.column_stack(list(reached.values())))


def _without(steps: tuple[int, ...], step: int) -> tuple[int, ...]:
    return tuple(own for own in steps if own != step)


def _next(ways: Integers, nodes: Integers, step: int) -> Integers:
    ends: Integers = np.where(nodes != NOWHERE, ways[nodes, step], NOWHERE)
    return ends


@kernel
def spread(neighbours: Integers, node: int, steps: Steps) -> None:
    """Fill `steps` (n,) with how many steps lead from the node to each node, `FAR` where none do."""
    queue = np.empty(neighbours.shape[0], np.int64)
    steps[:] = FAR
    steps[node] = 0
    queue[0], first, last = node, 0, 1
    while first < last:
        here = queue[first]
        first += 1
        further = steps[here] + 1
        if further == FAR:
            return
        for k in range(neighbours.shape[1]):
            there = neighbours[here, k]
            if there != NOWHERE and steps[there] == FAR:
                steps[there] = further
                queue[last] = there
                last += 1


@kernel
def steps_nearby(
    neighbours: Integers, nodes: Integers, hubs: Integers, table: Steps, places: Array, own: Array, out: Array
) -> None:
    """Fill `out` (m,) with the steps from hubs (m,) to places (m, legs) beside nodes (m,).

    `table` (hubs, n) tells those to the nodes. A place is told in steps, as are those of the nodes, `own` (n, legs).
    The shortest way over the node or a neighbour of it counts; infinite where none leads.
    """
    for row in range(nodes.shape[0]):
        node = nodes[row]
        steps = table[hubs[row]]
        out[row] = _over(steps, node, places[row], own)
        for k in range(neighbours.shape[1]):
            if neighbours[node, k] != NOWHERE:
                out[row] = min(out[row], _over(steps, neighbours[node, k], places[row], own))


@kernel
def _over(steps: Steps, node: int, place: Array, own: Array) -> float:
    if steps[node] == FAR:
        return np.inf
    away = 0.0
    for i in range(place.shape[0]):
        away = max(away, abs(place[i] - own[node, i]))
    return float(steps[node]) + away


@kernel
def nearest_nodes(x: Array, cells: Integers, order: Integers, begins: Integers, states: Array, out: Integers) -> None:
    """Fill `out` (m,) with the nodes of cells (m, k) whose states (n, size) are nearest to `x` (m, size), or -1.

    `order` (n,) has the nodes cell by cell; those of a cell begin at `begins` (cells + 1,).
    """
    for row in range(cells.shape[0]):
        out[row], least = NOWHERE, np.inf
        for cell in cells[row]:
            if cell == NOWHERE:
                continue
            for k in range(begins[cell], begins[cell + 1]):
                squared = 0.0
                for j in range(x.shape[1]):
                    difference = x[row, j] - states[order[k], j]
                    squared += difference * difference
                if squared < least:
                    out[row], least = order[k], squared
