"""Roadmaps: where a mechanism can go without losing stability, as a graph."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pcm_gym.arrays import Array, Integers, Mask
from pcm_gym.kernels.charts import roadmap as kernels
from pcm_gym.kernels.numerics.rasters import NOWHERE, Rasters
from pcm_gym.kernels.snaps.instability import SNAP
from pcm_gym.kernels.statics.states import States, are_same
from pcm_gym.mechanism import Mechanism
from pcm_gym.mechanism.validation import (
    finite_array,
    finite_vector,
    instance_of,
    limit_not_negative,
    number_not_negative,
    sequence_of,
    whole_array,
    whole_number,
)
from pcm_gym.solving.equilibrium import Equilibrium
from pcm_gym.solving.limits import LimitName, limits_of
from pcm_gym.solving.raster import Raster

if TYPE_CHECKING:  # to import it takes a fifth of an environment's start, and few need it
    from scipy import sparse

_FIRST_CAPACITY = 1 << 14
_EXPANDED_AT_ONCE = 1024
# What a fall counts beside a step, more than any way without one, and the most steps that lead over its edge.
_FALL, _FALL_STEPS = 1e6, 3
_MOST_FALLS = 8
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

    def __post_init__(self) -> None:
        mechanism = instance_of("mechanism", self.mechanism, Mechanism)
        cells = whole_array("cells", self.cells, ("n",), 0, instance_of("raster", self.raster, Raster).size - 1)
        count = len(cells)
        checked: dict[str, Any] = {
            "load": mechanism.check_load(self.load),
            "least_margin": number_not_negative("least_margin", self.least_margin),
            "states": finite_array("states", self.states, (count, mechanism.state_size)),
            "inputs": finite_array("inputs", self.inputs, (count, mechanism.leg_count)),
            "cells": cells,
            "ways": whole_array("ways", self.ways, (count, 2 * mechanism.leg_count), -1, count - 1),
            "seeds": tuple(whole_array("seeds", self.seeds, ("n",), -1, count - 1).tolist()),
        }
        self.__dict__.update(checked)

    def __len__(self) -> int:
        """Return the number of nodes."""
        return len(self.cells)

    @cached_property
    def _graph(self) -> "sparse.csr_array":
        from scipy import sparse

        starts, columns = np.nonzero(self.ways >= 0)
        ends = self.ways[starts, columns]
        return sparse.csr_array((np.ones(len(starts)), (starts, ends)), shape=(len(self), len(self)))

    @cached_property
    def components(self) -> Integers:
        """Component of each node, (n,), the largest first: nodes of one are joined by stable paths."""
        from scipy.sparse import csgraph

        _, labels = csgraph.connected_components(self._graph, directed=False)
        sizes = np.bincount(labels)
        ranks = np.empty(len(sizes), dtype=np.int64)
        ranks[np.argsort(-sizes, kind="stable")] = np.arange(len(sizes))
        components: Integers = ranks[labels]
        return components

    @cached_property
    def pose_densities(self) -> Array:
        """Size of the set of poses that a node's cell is mapped to, per size of the cell, dimensionless, (n,)."""
        inputs = self.mechanism.units.kernel_from_inputs(self.inputs)
        return kernels.pose_densities(self.mechanism.leg_table, self.states, inputs)

    @cached_property
    def pose_density_sums(self) -> Array:
        """Sums of the pose densities up to each node, (n,)."""
        sums: Array = np.cumsum(self.pose_densities)
        return sums

    def step_counts(
        self, nodes: Sequence[int] | Integers, falls: Integers | None = None, most: float = np.inf
    ) -> tuple[Array, Array]:
        """Return how many steps and falls the way from each of the `nodes` to every node takes, (len(nodes), n) each.

        It is the way with the fewest falls, up to 8, and of these the shortest one. Infinite where none leads.

        Parameters
        ----------
        nodes : sequence of int
        falls : array (m, 2), optional
            Falls from node to node, such as `find_falls` finds; none by default.
        most : float
            Ways of more steps count as none.
        """
        from scipy import sparse
        from scipy.sparse import csgraph

        graph, sources = self._graph, self.checked_nodes("nodes", nodes)
        falls = None if falls is None else whole_array("falls", falls, ("m", 2), 0, len(self) - 1)
        most = limit_not_negative("most", most)
        if not len(self):
            return np.empty((0, 0)), np.empty((0, 0))
        if falls is not None and len(falls):
            weights = np.full(len(falls), _FALL_STEPS + _FALL)
            graph = graph + sparse.csr_array((weights, (falls[:, 0], falls[:, 1])), shape=graph.shape)
        lengths = csgraph.dijkstra(graph, indices=sources, limit=_MOST_FALLS * _FALL + most)
        counts, steps = np.divmod(np.where(np.isfinite(lengths), lengths, -1.0), _FALL)
        leads_there = (counts >= 0.0) & (steps <= most)
        return np.where(leads_there, steps, np.inf), np.where(leads_there, counts, np.inf)

    def way(self, start: int, goal: int) -> Integers:
        """Return the nodes of a shortest way from `start` to `goal`, both included; empty where there is none."""
        from scipy.sparse import csgraph

        start, goal = self._checked("start", start), self._checked("goal", goal)
        _, before = csgraph.dijkstra(self._graph, indices=start, unweighted=True, return_predecessors=True)
        if start != goal and before[goal] < 0:
            return np.empty(0, dtype=np.int64)
        nodes = [goal]
        while nodes[-1] != start:
            nodes.append(int(before[nodes[-1]]))
        return np.array(nodes[::-1], dtype=np.int64)

    def equilibrium(self, node: int) -> Equilibrium:
        """Return the equilibrium of a node."""
        node = self._checked("node", node)
        return Equilibrium.unchecked(self.mechanism, self.states[node], self.inputs[node], self.load)

    def checked_nodes(self, name: str, nodes: ArrayLike) -> Integers:
        """Return nodes as a new array (n,); raise if one of them is none of the roadmap's."""
        return whole_array(name, nodes, ("n",), 0, len(self) - 1)

    def _checked(self, name: str, node: int) -> int:
        return whole_number(name, node, least=0, most=len(self) - 1)


def build_roadmap(
    mechanism: Mechanism,
    seeds: Sequence[Equilibrium],
    *,
    step: ArrayLike | None = None,
    least_margin: float = 0.0,
    limits: Sequence[LimitName] = (),
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
    limits : sequence of "stress", "torque" or "contact"
        Nodes that break a limit of the structure are left out, and those that are reached through such alone; see
        `StructuralLimits`.

    Returns
    -------
    Roadmap
        Without nodes where no seed keeps the margin and the limits.

    Raises
    ------
    ValueError
        If a seed is not stable, of another mechanism or under another load, an argument has the wrong shape, or the
        mechanism lacks what a limit takes.

    Notes
    -----
    About 2 microseconds for each way between two nodes: 0.1 s for the 2RFR of the catalogue.
    """
    sown, structure = _sown(mechanism, seeds, step, least_margin, limits), limits_of(mechanism, limits)
    nodes, units, legs = sown.nodes, mechanism.units, mechanism.leg_table
    none, nowhere = States(*(array[:0] for array in sown.nodes.states)), np.empty(0, dtype=np.int64)
    while nodes.counts[1] < nodes.counts[0]:
        nodes = _with_room(nodes, 2 * mechanism.leg_count * _EXPANDED_AT_ONCE)
        kernels.grow(legs, sown.rasters, nodes, none, sown.least_margin, _EXPANDED_AT_ONCE, nowhere)
    count = int(nodes.counts[0])
    grown = Roadmap(
        mechanism,
        sown.load,
        sown.least_margin,
        sown.raster,
        nodes.states.x[:count].copy(),
        units.inputs_from_kernel(nodes.states.inputs[:count]),
        nodes.cell[:count].copy(),
        nodes.ways[:count].copy(),
        tuple(sown.planted.tolist()),
    )
    return _reached_within(grown, structure.are_kept(grown.states, nodes.states.inputs[:count])) if structure else grown


def takes_root(
    mechanism: Mechanism,
    seeds: Sequence[Equilibrium],
    *,
    step: ArrayLike | None = None,
    least_margin: float = 0.0,
    limits: Sequence[LimitName] = (),
) -> bool:
    """Return whether the roadmap that `build_roadmap` would return has any nodes; it is not grown for that."""
    sown = _sown(mechanism, seeds, step, least_margin, limits)
    planted = sown.planted[sown.planted >= 0]
    states = sown.nodes.states
    return bool(limits_of(mechanism, limits).are_kept(states.x[planted], states.inputs[planted]).any())


class _Sown(NamedTuple):
    """Seeds on their raster, of which nothing has grown yet."""

    load: Array
    raster: Raster
    rasters: Rasters  # the same for the kernels
    nodes: kernels.Nodes
    planted: Integers  # (seeds,): their nodes, or -1
    least_margin: float


def _sown(
    mechanism: Mechanism,
    seeds: Sequence[Equilibrium],
    step: ArrayLike | None,
    least_margin: float,
    limits: Sequence[LimitName],
) -> _Sown:
    instance_of("mechanism", mechanism, Mechanism)
    seeds = sequence_of("seeds", seeds, Equilibrium)
    load, least_margin = _load_of(mechanism, seeds), number_not_negative("least_margin", least_margin)
    limits_of(mechanism, limits)
    raster = roadmap_raster(mechanism, None if step is None else finite_vector("step", step, mechanism.leg_count))
    units = mechanism.units
    rasters = Rasters(
        np.array([raster.shape]),
        units.kernel_from_inputs(np.array([raster.first_node])),
        units.kernel_from_inputs(np.array([raster.pitch])),
        np.zeros((1, mechanism.leg_count), dtype=np.bool_),
    )
    nodes = _with_room(_make_nodes(mechanism, raster.size), len(seeds))
    states = States(*map(np.array, zip(*(seed.kernel_values() for seed in seeds), strict=True)))
    planted = np.empty(len(seeds), dtype=np.int64)
    kernels.grow(mechanism.leg_table, rasters, nodes, states, least_margin, 0, planted)
    return _Sown(load, raster, rasters, nodes, planted, least_margin)


def _reached_within(roadmap: Roadmap, is_kept: Mask) -> Roadmap:
    """Return the part of a roadmap that its seeds reach through nodes (n,) that are kept."""

    def renumbered(chosen: Mask) -> tuple[Integers, Integers]:
        numbers = np.full(len(chosen) + 1, -1)  # the last one for no node, -1
        numbers[:-1][chosen] = np.arange(np.count_nonzero(chosen))
        return numbers[roadmap.ways[chosen]], numbers[np.array(roadmap.seeds, dtype=np.int64)]

    def part(chosen: Mask) -> Roadmap:
        ways, seeds = renumbered(chosen)
        states, inputs, cells = roadmap.states[chosen], roadmap.inputs[chosen], roadmap.cells[chosen]
        return replace(roadmap, states=states, inputs=inputs, cells=cells, ways=ways, seeds=tuple(seeds.tolist()))

    kept = part(is_kept)
    planted = [seed for seed in kept.seeds if seed >= 0]
    is_reached = is_kept.copy()
    is_reached[is_kept] = np.isin(kept.components, kept.components[planted]) if len(kept) else False
    return part(is_reached)


def find_falls(roadmap: Roadmap, most: int = 64) -> Integers:
    """Return where the mechanism falls from node to node: pairs (m, 2) of the one it leaves and the one it comes to.

    Parameters
    ----------
    roadmap : Roadmap
    most : int
        Borders of each component, evenly chosen among those steps that are no ways, from which falls are sought: by
        going on in the same direction for up to three steps.

    Notes
    -----
    A fall counts if it ends at a node. 1 to 5 ms for each border.
    """
    numbers, units = np.random.default_rng(0), instance_of("roadmap", roadmap, Roadmap).mechanism.units
    most = whole_number("most", most, least=0)
    if not len(roadmap):
        return np.empty((0, 2), dtype=np.int64)
    starts, columns = np.nonzero(roadmap.ways < 0)
    labels = roadmap.components[starts]
    borders = [np.flatnonzero(labels == label) for label in range(labels.max(initial=-1) + 1)]
    chosen = np.concatenate([starts[:0], *(numbers.permutation(own)[:most] for own in borders)])
    starts, axes, sides = starts[chosen], columns[chosen] // 2, 2.0 * (columns[chosen] % 2) - 1.0
    found = []
    for distance in range(1, _FALL_STEPS + 1):
        ends = roadmap.inputs[starts]
        ends[np.arange(len(starts)), axes] += distance * sides * roadmap.raster.pitch[axes]
        cells = roadmap.raster.cells_of(ends)
        targets = units.kernel_from_inputs(np.where(cells[:, None] >= 0, ends, roadmap.inputs[starts]))
        x, fell = _fallen(roadmap, starts, targets)
        for row in np.flatnonzero(fell).tolist():
            found.append((int(starts[row]), _node_with(roadmap, int(cells[row]), x[row])))
        goes_on = ~fell & (cells >= 0)
        starts, axes, sides = starts[goes_on], axes[goes_on], sides[goes_on]
    return np.array([pair for pair in found if pair[1] >= 0], dtype=np.int64).reshape(-1, 2)


def _fallen(roadmap: Roadmap, nodes: Integers, targets: Array) -> tuple[Array, Mask]:
    """Return where nodes (n,) get to on the way to dimensionless inputs (n, legs), and which of them fell to there."""
    units = roadmap.mechanism.units
    load = np.tile(units.kernel_from_load(roadmap.load), (len(nodes), 1))
    states = States(roadmap.states[nodes], units.kernel_from_inputs(roadmap.inputs[nodes]), load)
    has_arrived, was_lost = kernels.move_rows(roadmap.mechanism.leg_table, states, targets, SNAP)
    return states.x, has_arrived & was_lost


def _node_with(roadmap: Roadmap, cell: int, x: Array) -> int:
    """Return the node of a cell with this state, or -1."""
    for node in np.flatnonzero(roadmap.cells == cell).tolist():
        if are_same(x, roadmap.states[node], roadmap.mechanism.leg_count):
            return int(node)
    return -1


def _load_of(mechanism: Mechanism, seeds: Sequence[Equilibrium]) -> Array:
    if not seeds:
        raise ValueError("seeds must hold at least one equilibrium, got none")
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


def _make_nodes(mechanism: Mechanism, cells: int) -> kernels.Nodes:
    legs, capacity = mechanism.leg_count, _FIRST_CAPACITY
    return kernels.Nodes(
        States(
            np.empty((capacity, mechanism.state_size)), np.empty((capacity, legs)), np.empty((capacity, mechanism.dof))
        ),
        np.empty(capacity, dtype=np.int64),
        np.empty(capacity, dtype=np.int64),
        np.empty((capacity, 2 * legs), dtype=np.int64),
        np.full(cells, NOWHERE, dtype=np.int64),
        np.zeros(2, dtype=np.int64),
    )


def _with_room(nodes: kernels.Nodes, count: int) -> kernels.Nodes:
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
