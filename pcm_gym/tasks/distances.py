"""How many steps a planner needs: distances on the roadmap of a scene, by way of some of its nodes."""

import itertools
import math
from typing import NamedTuple

import numpy as np

from pcm_gym.arrays import Array, Integers
from pcm_gym.kernels.charts.distances import FAR, Steps, all_neighbours, nearest_nodes, spread, steps_nearby
from pcm_gym.solving import Roadmap
from pcm_gym.tasks.memory import remembered
from pcm_gym.tasks.scene import Scene

# No node is farther than this from its hub, in ways of the roadmap.
_COVERED = 2


class Distances(NamedTuple):
    """Distances between nodes over hubs, nodes to which all others are near (landmarks, as in the search ALT).

    By the triangle inequality each distance is known up to twice that between a node and its hub. They are told in
    steps of the agent, which change all inputs at once.
    """

    steps_per_way: float
    neighbours: Integers  # (n, 3^legs - 1)
    hubs: Integers  # (n,): of each node
    table: Steps  # (hubs, n): ways from each hub to each node
    order: Integers  # (n,): the nodes, cell by cell
    begins: Integers  # (cells + 1,): where in that order a cell begins

    def most(self, starts: Integers, goals: Integers) -> Array:
        """Return a number of steps (m,) with which goals can be reached from starts, nodes (m,) each."""
        hubs = self.hubs[goals]
        there, back = self.table[hubs, starts].astype(np.int64), self.table[hubs, goals]
        most: Array = np.where(there == FAR, math.inf, self.steps_per_way * (there + back))
        return most


@remembered
def distances(scene: Scene) -> Distances:
    """Return the distances on a scene's roadmap."""
    return distances_on(scene.roadmap, steps_per_way(scene))


def distances_on(roadmap: Roadmap, steps: float) -> Distances:
    """Return the distances on a roadmap whose ways take so many steps each."""
    neighbours = all_neighbours(roadmap.ways)
    covered, rows = np.zeros(len(roadmap), dtype=np.bool_), []
    for node in np.random.default_rng(0).permutation(len(roadmap)).tolist():
        if not covered[node]:
            rows.append(ways_from(neighbours, node))
            covered |= rows[-1] <= _COVERED
    table, order = np.stack(rows), np.argsort(roadmap.cells, kind="stable")
    begins = np.searchsorted(roadmap.cells[order], np.arange(roadmap.raster.size + 1))
    return Distances(steps, neighbours, table.argmin(axis=0), table, order, begins)


def steps_per_way(scene: Scene) -> float:
    """Return how many of the agent's steps a way between neighbouring nodes takes."""
    return max(pitch / stride for pitch, stride in zip(scene.pitch, scene.stride, strict=True))


def ways_from(neighbours: Integers, node: int) -> Steps:
    """Return how many ways, along one or several axes, lead from a node to each one, (n,)."""
    steps = np.empty(len(neighbours), dtype=np.uint8)
    spread(neighbours, node, steps)
    return steps


class Potential:
    """How far states are from goals, on a roadmap: 1 at a goal, less with every step that leads there."""

    # Steps over which it falls by one.
    SCALE = 100.0

    def __init__(self, scene: Scene, roadmap: Roadmap) -> None:
        is_own = roadmap is scene.roadmap
        self._distances = distances(scene) if is_own else distances_on(roadmap, steps_per_way(scene))
        self._legs, self._roadmap, self._units = scene.mechanism.leg_count, roadmap, scene.mechanism.units
        self._pitch = np.array(scene.pitch)
        self._places = self._units.kernel_from_inputs(roadmap.inputs) / self._pitch
        self._around = np.array(list(itertools.product((-1.0, 0.0, 1.0), repeat=self._legs))) * roadmap.raster.pitch

    def __call__(self, x: Array, inputs: Array, goals: Array) -> Array:
        """Return the potentials (m,) of states (m, size) at inputs (m, legs) for goals (m, legs + size): inputs, state.

        0 where the roadmap knows no way, or not the goal: this is where episodes end that lose stability.
        """
        goal_inputs, goal_x = goals[:, : self._legs], goals[:, self._legs :]
        potentials = np.zeros(len(x))
        ends = self._nodes(goal_x, goal_inputs)
        nodes = self._nodes(x, inputs)
        rows = np.flatnonzero((ends >= 0) & (nodes >= 0))
        hubs = self._distances.hubs[ends[rows]]
        # by the triangle inequality no more than the distance, and near the goal no less than the straight way
        here, there = (self._from_hubs(hubs, own[rows], at[rows]) for own, at in ((nodes, inputs), (ends, goal_inputs)))
        straight = np.abs((inputs[rows] - goal_inputs[rows]) / self._pitch).max(axis=1, initial=0.0)
        ways = np.maximum(here - there, straight)
        is_joined = np.isfinite(ways)
        potentials[rows[is_joined]] = 1.0 - self._distances.steps_per_way / self.SCALE * ways[is_joined]
        return potentials

    def _from_hubs(self, hubs: Integers, nodes: Integers, inputs: Array) -> Array:
        ways, distances = np.empty(len(nodes)), self._distances
        steps_nearby(distances.neighbours, nodes, hubs, distances.table, inputs / self._pitch, self._places, ways)
        return ways

    def _nodes(self, x: Array, inputs: Array) -> Integers:
        """Return the nodes (m,) on the sheets of states, in their cells or beside them, -1 where there are none."""
        nodes, own = np.full(len(x), -1), self._distances
        known = np.flatnonzero(np.isfinite(x).all(axis=1))
        around = self._units.inputs_from_kernel(inputs[known])[:, None] + self._around
        cells = self._roadmap.raster.cells_of(around.reshape(-1, self._legs)).reshape(len(known), len(self._around))
        found = np.empty(len(known), dtype=np.int64)
        nearest_nodes(np.ascontiguousarray(x[known]), cells, own.order, own.begins, self._roadmap.states, found)
        nodes[known] = found
        return nodes
