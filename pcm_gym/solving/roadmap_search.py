"""Searching a roadmap for ways: from equilibria to the nodes beside them, to goals, and in between, in whole steps."""

import itertools
from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy import sparse
from scipy.sparse import csgraph
from scipy.spatial import KDTree

from pcm_gym.arrays import Array, Integers, Mask
from pcm_gym.kernels.charts.motions import meet_poses
from pcm_gym.solving.roadmap import Roadmap
from pcm_gym.solving.straight_ways import StraightWays, Way

# What a step counts beside the longest of its moves, in terms of all of them: of equal ways the straightest one.
_STRAIGHTNESS = 1e-3
# Nodes from which a pose is sought, and farthest away from them that its inputs may be, in cells.
_NODES_NEAR, _CELLS_NEAR = 64, 2.5
# Starts whose ways are sought at a time; bounds the memory.
_SEARCHED_AT_ONCE = 32
_NOWHERE = -1
# By so little a way may be longer than its number of steps.
_ROUNDING = 1e-9


class Targets(NamedTuple):
    """Equilibria that meet goals, dimensionless, each with the node from which it is reached; any number for a goal."""

    goal: Integers  # (m,): which of the goals it meets
    node: Integers  # (m,)
    way: Way  # (m, ...)


class RoadmapSearch:
    """Ways over the nodes of a roadmap.

    Nodes are joined by the roadmap's own steps, along one axis, and by those along several at once that follow it:
    where each order of single steps leads to the same node, and the straight way keeps stability and margin.

    Parameters
    ----------
    roadmap : Roadmap
    ways : StraightWays
        Of its mechanism, under its load.
    """

    def __init__(self, roadmap: Roadmap, ways: StraightWays) -> None:
        self.roadmap, self._ways = roadmap, ways
        units, raster = roadmap.mechanism.units, roadmap.raster
        self._inputs = units.kernel_from_inputs(roadmap.inputs)
        self._first, self._pitch = units.kernel_from_inputs(raster.first_node), units.kernel_from_inputs(raster.pitch)
        self._by_cell = np.argsort(roadmap.cells, kind="stable")
        self._cell_ends = np.searchsorted(roadmap.cells[self._by_cell], np.arange(raster.size + 1))

    def nodes(self, chosen: Integers) -> Way:
        """Return the equilibria of nodes."""
        return Way(self.roadmap.states[chosen], self._inputs[chosen])

    def nodes_beside(self, here: Way) -> Integers:
        """Return for each equilibrium a node to which a straight way leads, the nearest such; -1 where none is."""
        found = np.full(len(here.x), _NOWHERE)
        cells = self._cells_around(here.inputs)
        for turn in range(cells.shape[1]):
            rows = np.flatnonzero((found == _NOWHERE) & (self._count_in(cells[:, turn]) > 0))
            if not len(rows):
                continue
            firsts, counts = self._cell_ends[cells[rows, turn]], self._count_in(cells[rows, turn])
            x, arrives = self._ways.walked(here.x[rows], here.inputs[rows], self._inputs[self._by_cell[firsts]])
            for place in range(int(counts.max())):
                has_one = place < counts
                nodes = self._by_cell[np.where(has_one, firsts + place, 0)]
                is_same = has_one & arrives & self._ways.are_same(x, self.roadmap.states[nodes])
                found[rows[is_same]] = nodes[is_same]
        return found

    def at_poses(self, poses: Array) -> Targets:
        """Return equilibria at poses (n, d) that straight ways lead to from nodes."""
        count, legs = min(_NODES_NEAR, len(self.roadmap)), self.roadmap.mechanism.leg_count
        _, nodes = self._pose_tree.query(self._placed(poses), k=count)
        nodes = np.asarray(nodes).reshape(len(poses), count)
        goals = np.repeat(np.arange(len(poses)), count)
        nodes = nodes.ravel()
        states = self._ways.states(self.roadmap.states[nodes], self._inputs[nodes])
        turn = 2.0 * np.pi * np.round((states.x[:, 2 * legs + 2 :] - poses[goals, 2:]) / (2.0 * np.pi))
        states.x[:, 2 * legs :] = poses[goals]
        states.x[:, 2 * legs + 2 :] += turn
        is_met = meet_poses(self._ways.mechanism.leg_table, states)
        cells_away = (np.abs(states.inputs - self._inputs[nodes]) / self._pitch).max(axis=1)
        near = np.flatnonzero(is_met & (cells_away <= _CELLS_NEAR))
        near = near[np.lexsort((cells_away[near], goals[near]))]
        return self._checked(Targets(goals[near], nodes[near], Way(states.x[near], states.inputs[near])))

    def at_inputs(self, inputs: Array, poses: Sequence[Array | None]) -> Targets:
        """Return equilibria at inputs (n, legs) that straight ways lead to from nodes.

        Where a pose (d,) is given beside the inputs it is only the one of these that is nearest to it.
        """
        cells = self._cells_around(inputs)
        goals, nodes = [np.empty(0, dtype=np.int64)], [np.empty(0, dtype=np.int64)]
        for own, around in enumerate(cells.tolist()):
            for cell in around:
                beside = self._by_cell[self._cell_ends[cell] : self._cell_ends[cell + 1]] if cell >= 0 else nodes[0]
                goals.append(np.full(len(beside), own))
                nodes.append(beside)
        goal, node = np.concatenate(goals), np.concatenate(nodes)
        x, arrives = self._ways.walked(self.roadmap.states[node], self._inputs[node], inputs[goal])
        chosen = np.flatnonzero(arrives)
        found = Targets(goal[chosen], node[chosen], Way(x[chosen], inputs[goal[chosen]]))
        return self._nearest(self._distinct(found), poses)

    def at_equilibria(self, there: Way) -> Targets:
        """Return the equilibria themselves, each with a node that a straight way leads to, where there is one."""
        nodes = self.nodes_beside(there)
        goals = np.flatnonzero(nodes != _NOWHERE)
        return Targets(goals, nodes[goals], Way(there.x[goals], there.inputs[goals]))

    def joined(self, here: Way, nodes: Integers, targets: Targets) -> list[Way | None]:
        """Return for each start, with the node beside it, a shortest way to a target of its own goal, or None."""
        found: list[Way | None] = [None] * len(nodes)
        tails = self._ways.lengths(self._inputs[targets.node], targets.way.inputs)
        aimed = np.unique(targets.goal)
        rows = aimed[nodes[aimed] != _NOWHERE]
        starts = np.unique(nodes[rows])
        for first in range(0, len(starts), _SEARCHED_AT_ONCE):
            some = starts[first : first + _SEARCHED_AT_ONCE]
            lengths, before = csgraph.dijkstra(self._graph, indices=some, return_predecessors=True)
            for row in rows[np.isin(nodes[rows], some)].tolist():
                place, own = int(np.searchsorted(some, nodes[row])), np.flatnonzero(targets.goal == row)
                totals = lengths[place, targets.node[own]] + tails[own]
                if np.isfinite(totals.min()):
                    best = own[int(totals.argmin())]
                    between = self.nodes(_traced(before[place], int(nodes[row]), int(targets.node[best])))
                    found[row] = _spliced(here, row, between, targets.way, best)
        return found

    @cached_property
    def _graph(self) -> sparse.csr_array:
        starts, ends, is_own = self._steps()
        # in even steps, the same in both directions
        counts = np.maximum(np.ceil(self._pitch / self._ways.stride - _ROUNDING), 1.0)
        leads = replace(self._ways, stride=self._pitch / counts).lead(self.nodes(starts), self.nodes(ends))
        own = np.flatnonzero(is_own & ~leads)  # the tracker has gone them, if not with all of their margins
        leads[own] = self._ways.lead_surely(self.nodes(starts[own]), self.nodes(ends[own]))
        starts, ends = starts[leads], ends[leads]
        moves = np.abs(self._inputs[starts] - self._inputs[ends]) / self._ways.stride
        weights = moves.max(axis=1) + _STRAIGHTNESS * moves.sum(axis=1)
        shape = (len(self.roadmap), len(self.roadmap))
        # a way can be gone in both directions
        graph = sparse.csr_array((weights, (starts, ends)), shape=shape)
        return (graph + graph.T).tocsr()

    def _steps(self) -> tuple[Integers, Integers, Mask]:
        """Return pairs of nodes with steps between them, in one direction each, and which are along one axis."""
        ways, legs = self.roadmap.ways, self.roadmap.mechanism.leg_count
        starts, ends, is_own = [], [], []
        for signs in itertools.product((-1, 0, 1), repeat=legs):
            moved = [2 * axis + (sign > 0) for axis, sign in enumerate(signs) if sign]
            if signs <= (0,) * legs:
                continue
            reached = np.array([_followed(ways, order) for order in itertools.permutations(moved)])
            joined = np.flatnonzero((reached[0] >= 0) & (reached == reached[0]).all(axis=0))
            starts.append(joined)
            ends.append(reached[0, joined])
            is_own.append(np.full(len(joined), len(moved) == 1))
        return np.concatenate(starts), np.concatenate(ends), np.concatenate(is_own)

    @cached_property
    def _pose_tree(self) -> KDTree:
        return KDTree(self._placed(self.roadmap.states[:, 2 * self.roadmap.mechanism.leg_count :]))

    def _placed(self, poses: Array) -> Array:
        """Return dimensionless poses (n, d) as points; a turn of a platform counts as the way of its hinges."""
        arms = np.hypot(*np.array([leg.attachment for leg in self.roadmap.mechanism.legs]).T)
        arm = np.sqrt(np.mean(arms**2)) / self.roadmap.mechanism.units.length
        return np.concatenate([poses[:, :2], arm * np.cos(poses[:, 2:]), arm * np.sin(poses[:, 2:])], axis=1)

    def _cells_around(self, inputs: Array) -> Integers:
        """Return the cells around inputs (n, legs), the nearest first, (n, 3^legs); -1 for those beyond the raster."""
        places, shape = (inputs - self._first) / self._pitch, self.roadmap.raster.shape
        offsets = np.array(list(itertools.product((-1, 0, 1), repeat=len(shape))))
        cells = np.rint(places).astype(np.int64)[:, None] + offsets
        order = np.abs(cells - places[:, None]).max(axis=2).argsort(axis=1, kind="stable")
        cells = np.take_along_axis(cells, order[:, :, None], axis=1)
        is_within = np.asarray(((cells >= 0) & (cells < np.array(shape))).all(axis=2))
        flat = np.ravel_multi_index(tuple(np.moveaxis(np.where(is_within[..., None], cells, 0), 2, 0)), shape)
        return np.where(is_within, flat, _NOWHERE)

    def _count_in(self, cells: Integers) -> Integers:
        """Return how many nodes cells have; those beyond the raster have none."""
        return np.where(cells >= 0, self._cell_ends[cells + 1] - self._cell_ends[cells], 0)

    def _checked(self, targets: Targets) -> Targets:
        """Return those targets that straight ways lead to, each once."""
        targets = self._distinct(targets)
        leads = np.flatnonzero(self._ways.lead(self.nodes(targets.node), targets.way))
        return _chosen(targets, leads)

    def _nearest(self, targets: Targets, poses: Sequence[Array | None]) -> Targets:
        """Return of the targets whose goals have a pose the one nearest to it, and all others."""
        kept, own_poses = [], self._placed(targets.way.x[:, 2 * self.roadmap.mechanism.leg_count :])
        for goal in np.unique(targets.goal).tolist():
            rows, pose = np.flatnonzero(targets.goal == goal), poses[goal]
            if pose is not None:
                distances = np.linalg.norm(own_poses[rows] - self._placed(pose[None]), axis=1)
                rows = rows[[int(distances.argmin())]]
            kept += rows.tolist()
        return _chosen(targets, np.array(kept, dtype=np.int64))

    def _distinct(self, targets: Targets) -> Targets:
        """Return the targets without those that are the same as an earlier one of the same goal."""
        kept: list[int] = []
        for goal in np.unique(targets.goal).tolist():
            left = np.flatnonzero(targets.goal == goal)
            while len(left):
                kept.append(int(left[0]))
                x, inputs = targets.way.x[left], targets.way.inputs[left]
                near = self._ways.lengths(inputs, inputs[:1]) < 1e-4
                left = left[~(near & self._ways.are_same(x, np.broadcast_to(x[:1], x.shape)))]
        return _chosen(targets, np.array(kept, dtype=np.int64))


def _chosen(targets: Targets, rows: Integers) -> Targets:
    return Targets(targets.goal[rows], targets.node[rows], Way(targets.way.x[rows], targets.way.inputs[rows]))


def _followed(ways: Integers, order: Sequence[int]) -> Integers:
    """Return the nodes that steps in this order lead to from every node; -1 where one of them is missing."""
    nodes = np.arange(len(ways))
    for column in order:
        nodes = np.where(nodes >= 0, ways[nodes, column], _NOWHERE)
    return nodes


def _traced(before: Integers, start: int, end: int) -> Integers:
    """Return the nodes from `start` to `end`, both included, by the node before each."""
    nodes = [end]
    while nodes[-1] != start:
        nodes.append(int(before[nodes[-1]]))
    return np.array(nodes[::-1], dtype=np.int64)


def _spliced(here: Way, row: int, between: Way, there: Way, end: int) -> Way:
    """Return the way from a row of one, over another, to a row of the third."""
    x = np.concatenate([here.x[row : row + 1], between.x, there.x[end : end + 1]])
    return Way(x, np.concatenate([here.inputs[row : row + 1], between.inputs, there.inputs[end : end + 1]]))
