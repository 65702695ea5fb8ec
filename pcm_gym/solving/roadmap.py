"""Roadmaps: where a mechanism can go without losing stability, as a graph."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import sparse
from scipy.sparse import csgraph

from pcm_gym.kernels import roadmap
from pcm_gym.kernels.rasters import NOWHERE, Rasters
from pcm_gym.kernels.transition import States
from pcm_gym.mechanism import Mechanism
from pcm_gym.mechanism.validation import finite_vector
from pcm_gym.solving.equilibrium import Equilibrium
from pcm_gym.solving.raster import Raster

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

_FIRST_CAPACITY = 1 << 14
_EXPANDED_AT_ONCE = 1024
# Most cells along each input, for two legs and for three.
_MOST_CELLS = {2: 64, 3: 24}


@dataclass(frozen=True, eq=False)
class Roadmap:
    """Stable equilibria on a raster of inputs, and the straight steps of the inputs that join them.

    Nodes that are joined, directly or through others, can be brought to each other without losing stability.
    `build_roadmap` makes it.

    Attributes
    ----------
    mechanism : Mechanism
    load : array (d,)
        Load on the end-effector, N and N m.
    least_margin : float
        Every node has at least this singularity margin.
    raster : Raster
        Cells of the inputs, rad or m.
    states : array (n, 2 legs + d)
        The kernels' dimensionless states of the nodes.
    inputs : array (n, legs)
        Their inputs, rad or m: the middle of their cell.
    cells : array (n,)
        Their cells; a cell has a node for every stable sheet over it.
    ways : array (n, 2 legs)
        Node to which the step along an axis leads, in column 2 axis to lower values, in the next one to higher; -1
        where there is none.
    seeds : tuple of int
        Nodes of the equilibria that the roadmap was grown from; -1 where one has none.
    """

    mechanism: Mechanism
    load: Array
    least_margin: float
    raster: Raster
    states: Array
    inputs: Array
    cells: Integers
    ways: Integers
    seeds: tuple[int, ...]

    def __len__(self) -> int:
        """Return the number of nodes."""
        return len(self.cells)

    @cached_property
    def _graph(self) -> sparse.csr_array:
        starts, columns = np.nonzero(self.ways >= 0)
        ends = self.ways[starts, columns]
        return sparse.csr_array((np.ones(len(starts)), (starts, ends)), shape=(len(self), len(self)))

    @cached_property
    def components(self) -> Integers:
        """Component of each node, (n,), the largest first: nodes of one are joined by stable paths."""
        _, labels = csgraph.connected_components(self._graph, directed=False)
        sizes = np.bincount(labels)
        ranks = np.empty(len(sizes), dtype=np.int64)
        ranks[np.argsort(-sizes, kind="stable")] = np.arange(len(sizes))
        components: Integers = ranks[labels]
        return components

    @cached_property
    def pose_densities(self) -> Array:
        """Size of the set of poses that a node's cell is mapped to, per size of the cell, dimensionless, (n,)."""
        units = self.mechanism.units
        return roadmap.pose_densities(self.mechanism.leg_table, self.states, self.inputs / units.inputs)

    def step_counts(self, nodes: Sequence[int] | Integers) -> Array:
        """Return the number of steps of the shortest way from each of the `nodes` to every node, (len(nodes), n).

        Infinite where no way leads.
        """
        return np.asarray(
            csgraph.dijkstra(self._graph, indices=np.asarray(nodes, dtype=np.int64), unweighted=True), dtype=np.float64
        )

    def way(self, start: int, goal: int) -> Integers:
        """Return the nodes of a shortest way from `start` to `goal`, both included; empty where there is none."""
        _, before = csgraph.dijkstra(self._graph, indices=start, unweighted=True, return_predecessors=True)
        if start != goal and before[goal] < 0:
            return np.empty(0, dtype=np.int64)
        nodes = [goal]
        while nodes[-1] != start:
            nodes.append(int(before[nodes[-1]]))
        return np.array(nodes[::-1], dtype=np.int64)

    def equilibrium(self, node: int) -> Equilibrium:
        """Return the equilibrium of a node."""
        return Equilibrium(self.mechanism, self.states[node], self.inputs[node], self.load)


def build_roadmap(
    mechanism: Mechanism,
    seeds: Sequence[Equilibrium],
    *,
    step: ArrayLike | None = None,
    least_margin: float = 0.0,
) -> Roadmap:
    """Return the roadmap of all that stable paths reach from some equilibria, within the actuators' limits.

    Parameters
    ----------
    mechanism : Mechanism
    seeds : sequence of Equilibrium
        Stable equilibria under one load to start from.
    step : array_like (legs,), optional
        Largest step along each input, rad or m. By default, and at least, 1/64 of its range, for three legs 1/24.
    least_margin : float
        Singularity margin that every node keeps, in rad and mean rod lengths. Half way between two nodes it is at least
        two thirds of that.

    Returns
    -------
    Roadmap
        Without nodes where no seed keeps the margin.

    Raises
    ------
    ValueError
        If a seed is not stable, of another mechanism or under another load, or an argument has the wrong shape.

    Notes
    -----
    About 2 microseconds for each way between two nodes: 0.1 s for the 2RFR of the catalogue.
    """
    load = _load_of(mechanism, seeds)
    raster = roadmap_raster(mechanism, None if step is None else finite_vector("step", step, mechanism.leg_count))
    units = mechanism.units
    legs, load_scaled = mechanism.leg_table, load / units.load
    rasters = Rasters(
        np.array([raster.shape]),
        np.array([raster.first_node]) / units.inputs,
        np.array([raster.pitch]) / units.inputs,
        np.zeros((1, mechanism.leg_count), dtype=np.bool_),
    )
    nodes = _with_room(_make_nodes(mechanism, raster.size), len(seeds))
    planted = []
    for seed in seeds:
        x, inputs = np.array(seed.state), seed.inputs / units.inputs
        planted.append(roadmap.plant(legs, rasters, nodes, least_margin, x, inputs, load_scaled))
    while nodes.counts[1] < nodes.counts[0]:
        nodes = _with_room(nodes, 2 * mechanism.leg_count * _EXPANDED_AT_ONCE)
        roadmap.grow(legs, rasters, nodes, least_margin, _EXPANDED_AT_ONCE)
    count = int(nodes.counts[0])
    return Roadmap(
        mechanism,
        load,
        least_margin,
        raster,
        nodes.states.x[:count].copy(),
        nodes.states.inputs[:count] * units.inputs,
        nodes.cell[:count].copy(),
        nodes.ways[:count].copy(),
        tuple(node if node != NOWHERE else -1 for node in planted),
    )


def _load_of(mechanism: Mechanism, seeds: Sequence[Equilibrium]) -> Array:
    if not seeds:
        raise ValueError("seeds must hold at least one equilibrium")
    for seed in seeds:
        if seed.mechanism != mechanism:
            raise ValueError(
                f"seeds must belong to the mechanism {mechanism.name!r}, got one of {seed.mechanism.name!r}"
            )
        if not np.array_equal(seed.load, seeds[0].load):
            raise ValueError(f"seeds must bear one load, got {seeds[0].load.tolist()} and {seed.load.tolist()}")
        if not seed.is_stable:
            raise ValueError(f"seeds must be stable, got one with index {seed.index}")
    return seeds[0].load


def roadmap_raster(mechanism: Mechanism, step: Array | None = None) -> Raster:
    """Return the raster of inputs of a roadmap with steps of at most `step` (legs,), as far as that is not too fine."""
    lower, upper, most = mechanism.lower_limits, mechanism.upper_limits, _MOST_CELLS[mechanism.leg_count]
    least = (upper - lower) / most
    if step is not None and not (step > 0.0).all():
        raise ValueError(f"step must be greater than 0, got {step.tolist()}")
    pitch = least if step is None else np.maximum(step, least)
    shape = np.maximum(np.ceil((upper - lower) / pitch - 1e-9), 1.0).astype(int)
    return Raster.over(lower, upper, tuple(shape.tolist()), (False,) * mechanism.leg_count)


def _make_nodes(mechanism: Mechanism, cells: int) -> roadmap.Nodes:
    legs, capacity = mechanism.leg_count, _FIRST_CAPACITY
    return roadmap.Nodes(
        States(
            np.empty((capacity, mechanism.state_size)), np.empty((capacity, legs)), np.empty((capacity, mechanism.dof))
        ),
        np.empty(capacity, dtype=np.int64),
        np.empty(capacity, dtype=np.int64),
        np.empty((capacity, 2 * legs), dtype=np.int64),
        np.full(cells, NOWHERE, dtype=np.int64),
        np.zeros(2, dtype=np.int64),
    )


def _with_room(nodes: roadmap.Nodes, count: int) -> roadmap.Nodes:
    """Return the nodes, with room for `count` more."""
    wanted = int(nodes.counts[0]) + count
    if wanted <= len(nodes.cell):
        return nodes

    def grown(array: NDArray[Any]) -> NDArray[Any]:
        return np.concatenate([array, np.empty((wanted, *array.shape[1:]), dtype=array.dtype)])

    return nodes._replace(
        states=States(*map(grown, nodes.states)),
        cell=grown(nodes.cell),
        next=grown(nodes.next),
        ways=grown(nodes.ways),
    )
