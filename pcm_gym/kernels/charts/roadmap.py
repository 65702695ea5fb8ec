"""A roadmap of stable equilibria: nodes on a raster of inputs, and the steps that lead from one to the next.

A node is an equilibrium at the inputs of one cell; a cell has as many nodes as stable sheets lie over it. From each
node a straight step of the inputs leads to each neighbouring cell, or does not: where stability or the margin would be
lost. A step that can be gone one way can be gone back.
"""

from typing import NamedTuple

import numpy as np

from pcm_gym.arrays import Array, Integers, Mask
from pcm_gym.kernels.branches.continuation import NONE, make_line, track
from pcm_gym.kernels.branches.tracer import Tracer
from pcm_gym.kernels.lockstep.lanes import step_block
from pcm_gym.kernels.lockstep.layout import LANES, Block, make_block
from pcm_gym.kernels.lockstep.rows import load_lane, store_state
from pcm_gym.kernels.numerics.compilation import kernel
from pcm_gym.kernels.numerics.linear import determinant
from pcm_gym.kernels.numerics.rasters import INPUTS, NOWHERE, Rasters, nearest_cell, neighbour, set_node
from pcm_gym.kernels.numerics.slices import slices
from pcm_gym.kernels.snaps.instability import advance, is_instability, make_falls
from pcm_gym.kernels.statics.closure import Workspace, make_workspace, place
from pcm_gym.kernels.statics.equilibrium import set_forward_jacobian
from pcm_gym.kernels.statics.margin import singularity_margin
from pcm_gym.kernels.statics.states import Point, States, are_same

# A way that nobody has tried yet.
UNKNOWN = -2
# Part of the margin of the nodes that the middle of a step between them keeps.
_PART_BETWEEN = 2.0 / 3.0
# States that are moved in one call of compiled code, where each may snap, and nodes that are described in one.
_MOVED_AT_ONCE, _DESCRIBED_AT_ONCE = 32, 1 << 13


class Nodes(NamedTuple):
    """The nodes found so far: the first `counts[0]` rows hold them, the first `counts[1]` have been expanded."""

    states: States  # (capacity, ...)
    cell: Integers  # (capacity,)
    next: Integers  # (capacity,): another node of the same cell
    ways: Integers  # (capacity, 2 legs): node to which the step along an axis leads, down (even) or up; or NOWHERE
    first: Integers  # (cells,): a node of the cell
    counts: Integers  # (2,)


class Steps(NamedTuple):
    """Steps that wait in the lanes of a block, and scratch space."""

    block: Block
    is_kept: Mask  # (lanes,)
    is_clear: Mask  # (lanes,): whether the middle of the step keeps the margin
    origin: Integers  # (lanes,)
    way: Integers  # (lanes,)
    cell: Integers  # (lanes,)
    line: Tracer
    work: Workspace
    x: Array  # (size,)
    inputs: Array  # (legs,)
    target: Array  # (legs,)


@kernel
def _make_steps(leg_count: int, size: int) -> Steps:
    return Steps(
        make_block(leg_count),
        np.empty(LANES, np.bool_),
        np.empty(LANES, np.bool_),
        np.empty(LANES, np.int64),
        np.empty(LANES, np.int64),
        np.empty(LANES, np.int64),
        make_line(leg_count, size),
        make_workspace(leg_count, size),
        np.empty(size),
        np.empty(leg_count),
        np.empty(leg_count),
    )


@kernel
def grow(
    legs: Array, rasters: Rasters, nodes: Nodes, seeds: States, least_margin: float, most: int, planted: Integers
) -> None:
    """Enter stable equilibria at the nodes of their cells, then expand up to `most` nodes.

    Fills `planted` with the nodes of the seeds, -1 for each from which no safe step leads there. There must be room for
    one node from each seed, and for 2 legs new ones from each node that is expanded.
    """
    steps = _make_steps(legs.shape[0], nodes.states.x.shape[1])
    for n in range(seeds.x.shape[0]):
        planted[n] = _plant(
            legs, rasters, nodes, least_margin, Point(seeds.x[n], seeds.inputs[n], seeds.load[n]), steps
        )
    waiting, end = 0, min(nodes.counts[0], nodes.counts[1] + most)
    for node in range(nodes.counts[1], end):
        for way in range(2 * legs.shape[0]):
            if nodes.ways[node, way] != UNKNOWN:
                continue
            cell = neighbour(rasters, INPUTS, nodes.cell[node], way // 2, way % 2)
            if cell == NOWHERE:
                nodes.ways[node, way] = NOWHERE
                continue
            set_node(rasters, INPUTS, cell, steps.target)
            load_lane(nodes.states, node, steps.target, steps.block, waiting)
            steps.origin[waiting], steps.way[waiting], steps.cell[waiting] = node, way, cell
            waiting += 1
            if waiting == LANES:
                _go(legs, rasters, nodes, least_margin, steps, waiting)
                waiting = 0
    if waiting > 0:
        _go(legs, rasters, nodes, least_margin, steps, waiting)
    nodes.counts[1] = end


@kernel
def _plant(legs: Array, rasters: Rasters, nodes: Nodes, least_margin: float, seed: Point, steps: Steps) -> int:
    """Enter a stable equilibrium at the node of its cell; return the node, or -1 where no safe step leads there."""
    cell = nearest_cell(rasters, INPUTS, seed.inputs)
    if cell == NOWHERE:
        return NOWHERE
    set_node(rasters, INPUTS, cell, steps.target)
    steps.x[:], steps.inputs[:] = seed.x, seed.inputs
    if not _go_alone(legs, seed.load, least_margin, steps):
        return NOWHERE
    return _place(nodes, cell, steps.x, steps.target, seed.load)


@kernel
def _go(legs: Array, rasters: Rasters, nodes: Nodes, least_margin: float, steps: Steps, count: int) -> None:
    """Go the steps that wait, in two halves, and enter where they lead."""
    common, load = steps.block.common[0], nodes.states.load
    _aim_half_way(nodes, steps, count)
    step_block(legs, steps.block, count, load.shape[1])
    for lane in range(count):
        steps.is_kept[lane] = common.is_sound[lane] > 0.0
        steps.is_clear[lane] = common.singularity_margin[lane] >= _PART_BETWEEN * least_margin
    _aim_at_nodes(rasters, steps, count)
    step_block(legs, steps.block, count, load.shape[1])
    for lane in range(count):
        origin, way, cell = steps.origin[lane], steps.way[lane], steps.cell[lane]
        set_node(rasters, INPUTS, cell, steps.target)
        if steps.is_kept[lane] and common.is_sound[lane] > 0.0:
            store_state(steps.block, lane, steps.x)
            is_kept = steps.is_clear[lane] and common.singularity_margin[lane] >= least_margin
        else:
            is_kept = _go_halves_alone(legs, nodes, origin, least_margin, steps)
        if is_kept:
            node = _place(nodes, cell, steps.x, steps.target, load[origin])
            nodes.ways[origin, way], nodes.ways[node, way ^ 1] = node, origin
        else:
            nodes.ways[origin, way] = NOWHERE


@kernel
def _aim_half_way(nodes: Nodes, steps: Steps, count: int) -> None:
    for lane in range(count):
        for i in range(steps.block.legs.shape[0]):
            leg, start = steps.block.legs[i], nodes.states.inputs[steps.origin[lane], i]
            leg.target[lane] = 0.5 * (start + leg.target[lane])


@kernel
def _aim_at_nodes(rasters: Rasters, steps: Steps, count: int) -> None:
    """Let the lanes begin where they are and go to the nodes of their cells."""
    for lane in range(count):
        set_node(rasters, INPUTS, steps.cell[lane], steps.target)
        for i in range(steps.block.legs.shape[0]):
            leg = steps.block.legs[i]
            leg.input[lane], leg.target[lane] = leg.target[lane], steps.target[i]


@kernel
def _go_halves_alone(legs: Array, nodes: Nodes, origin: int, least_margin: float, steps: Steps) -> bool:
    """Track a node to the target in `steps`, row by row; return whether it arrives with the margins."""
    start, load, end = nodes.states.inputs[origin], nodes.states.load[origin], steps.target.copy()
    steps.x[:], steps.inputs[:] = nodes.states.x[origin], start
    steps.target[:] = 0.5 * (start + end)
    is_kept = _go_alone(legs, load, _PART_BETWEEN * least_margin, steps)
    steps.target[:] = end
    return is_kept and _go_alone(legs, load, least_margin, steps)


@kernel
def _go_alone(legs: Array, load: Array, least_margin: float, steps: Steps) -> bool:
    """Track the state in `steps` to its target; return whether it arrives, stable and with the margin."""
    point = Point(steps.x, steps.inputs, load)
    tracked = track(legs, point, steps.target, load, False, steps.line, steps.work)
    if tracked.event != NONE or tracked.morse_index > 0:
        return False
    return singularity_margin(legs, steps.x, steps.work) >= least_margin


@kernel
def _place(nodes: Nodes, cell: int, x: Array, inputs: Array, load: Array) -> int:
    """Return the node of the cell with this state, a new one if need be."""
    node = find(nodes, cell, x)
    if node != NOWHERE:
        return node
    node = int(nodes.counts[0])
    nodes.counts[0] += 1
    nodes.states.x[node], nodes.states.inputs[node], nodes.states.load[node] = x, inputs, load
    nodes.cell[node], nodes.next[node], nodes.ways[node] = cell, nodes.first[cell], UNKNOWN
    nodes.first[cell] = node
    return node


@kernel
def find(nodes: Nodes, cell: int, x: Array) -> int:
    """Return the node of the cell with this state, or -1."""
    node = nodes.first[cell]
    while node != NOWHERE:
        if are_same(x, nodes.states.x[node], nodes.states.inputs.shape[1]):
            return int(node)
        node = nodes.next[node]
    return NOWHERE


def pose_densities(legs: Array, x: Array, inputs: Array) -> Array:
    """Return |det d pose / d inputs| of states (n, size) at inputs (n, legs); 0 where it does not exist."""
    found = np.zeros(len(x))
    for first, last in slices(len(x), _DESCRIBED_AT_ONCE):
        _set_densities(legs, x[first:last], inputs[first:last], found[first:last])
    return found


@kernel
def _set_densities(legs: Array, x: Array, inputs: Array, found: Array) -> None:
    leg_count, size = inputs.shape[1], x.shape[1]
    work, jacobian = make_workspace(leg_count, size), np.empty((size - 2 * leg_count, leg_count))
    for n in range(x.shape[0]):
        place(legs, x[n], inputs[n], work)
        if set_forward_jacobian(legs, x[n], work, jacobian):
            found[n] = abs(determinant(jacobian, leg_count))


def move_rows(legs: Array, states: States, targets: Array, behaviour: int) -> tuple[Mask, Mask]:
    """Move states to inputs (n, legs), in place, with a behaviour of `instability` where stability is lost.

    Returns which rows get there and are stable, and which lose stability on the way.
    """
    has_arrived, was_lost = np.zeros(len(targets), np.bool_), np.zeros(len(targets), np.bool_)
    for first, last in slices(len(targets), _MOVED_AT_ONCE):
        some = States(*(array[first:last] for array in states))
        rows = slice(first, last)
        _move_some(legs, some, targets[rows], behaviour, has_arrived[rows], was_lost[rows])
    return has_arrived, was_lost


@kernel
def _move_some(legs: Array, states: States, targets: Array, behaviour: int, has_arrived: Mask, was_lost: Mask) -> None:
    count, leg_count = targets.shape
    line, work = make_line(leg_count, states.x.shape[1]), make_workspace(leg_count, states.x.shape[1])
    falls = make_falls()
    for n in range(count):
        point = Point(states.x[n], states.inputs[n], states.load[n])
        tracked = advance(legs, point, targets[n], behaviour, falls, line, work)
        has_arrived[n] = tracked.fraction == 1.0 and tracked.morse_index == 0
        was_lost[n] = is_instability(tracked.event)
