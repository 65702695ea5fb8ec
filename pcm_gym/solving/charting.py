"""Building the atlas of a mechanism."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypedDict, Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pcm_gym.arrays import Array, Integers, Mask
from pcm_gym.kernels.charts import flood
from pcm_gym.mechanism import Mechanism
from pcm_gym.mechanism.validation import finite_number, instance_of, positive_number, shown, truth_value, whole_number
from pcm_gym.solving.atlas import Atlas, flat_rasters
from pcm_gym.solving.enumeration import solve_forward
from pcm_gym.solving.equilibrium import Equilibrium
from pcm_gym.solving.home import home_equilibrium
from pcm_gym.solving.limits import LimitName, StructuralLimits, limits_of
from pcm_gym.solving.progress import progress_bars
from pcm_gym.solving.raster import Raster
from pcm_gym.solving.raster_states import RasterStates

_FIRST_CAPACITY = 1 << 16
_EXPANDED_AT_ONCE = 256
_MOST_CELLS = 50_000_000


@dataclass(frozen=True)
class _Defaults:
    """Default resolution of an atlas."""

    pitch: float  # of the poses, in mean rod lengths
    input_cells: int  # along each input
    seed_nodes: int  # inputs along each axis at which equilibria are sought to start from


_POINT = _Defaults(pitch=1.0 / 200.0, input_cells=160, seed_nodes=12)
_PLATFORM = _Defaults(pitch=1.0 / 100.0, input_cells=24, seed_nodes=3)
# Cells of a platform's full turn.
_ANGLE_CELLS = 120


class Resolution(TypedDict, total=False):
    """How finely an atlas is made, and of which angle; `build_atlas` tells the defaults."""

    pitch: float | None
    input_cells: int | None
    seed_nodes: int | None
    orientation: float | None


def build_atlas(
    mechanism: Mechanism,
    load: ArrayLike | None = None,
    rho_max: float = 9.0,
    *,
    progress: bool = True,
    limits: Sequence[LimitName] = (),
    **resolution: Unpack[Resolution],
) -> Atlas:
    """Return the atlas of a mechanism: its stable equilibria over inputs and poses, branch by branch.

    Parameters
    ----------
    mechanism : Mechanism
    load : array_like (d,), optional
        Load on the end-effector, N and N m; none by default.
    rho_max : float
        Largest dimensionless load ``L sqrt(|f| / EI)`` of any rod, up to 30.
    progress : bool
        Whether to show progress on standard error.
    limits : sequence of "stress", "torque" or "contact"
        Equilibria that break a limit of the structure are left out, see `StructuralLimits`: what remains is the usable
        workspace. Branches are those of all stable equilibria.
    pitch : float, optional
        Pitch of the raster of positions, m: by default 1/200 of the mean rod length, for a platform 1/100. A platform's
        angle has cells of 3 degrees.
    input_cells : int, optional
        Cells of the raster of inputs along each axis; by default 160, for a platform 24.
    seed_nodes : int, optional
        Inputs along each axis, evenly spaced, at which equilibria are sought to start from; by default 12, for a
        platform 3. A branch that covers none of these inputs is missed, unless a motor with a full turn leads to it
        from one limit to the other.
    orientation : float, optional
        Only this angle of a platform, rad: its constant-orientation workspace at less cost. The angle's cell remains
        3 degrees wide.

    Returns
    -------
    Atlas

    Raises
    ------
    TypeError, ValueError
        If an argument has the wrong shape, kind or range, or no stable equilibrium is found.

    Notes
    -----
    From all stable equilibria at the seeds (`solve_forward`) a flood fill moves from node to node. About 25
    microseconds for each equilibrium, and for each seed a few ms, for a platform up to a second: 15 s for the 2RFR of
    the catalogue.
    """
    over_inputs, over_poses, seeds = _rasters(instance_of("mechanism", mechanism, Mechanism), **resolution)
    truth_value("progress", progress)
    load = mechanism.check_load(load)
    chart = _Chart(mechanism, load, positive_number("rho_max", rho_max), over_inputs, over_poses)
    structure = limits_of(mechanism, limits)
    with progress_bars("atlas", progress) as bars:
        home = chart.plant(_home(chart))
        for inputs in bars.track(seeds.all_nodes, description="seeds"):
            chart.plant(solve_forward(mechanism, inputs, chart.load, chart.rho_max).stable)
        filled = bars.add_task("equilibria")
        while chart.is_growing:
            chart.flood(_EXPANDED_AT_ONCE)
            bars.update(filled, total=int(chart.pool.counts[0]), completed=int(chart.pool.counts[1]))
    return chart.atlas(home, structure)


class _Chart:
    """The flood fill of one mechanism, dimensionless inside."""

    def __init__(
        self, mechanism: Mechanism, load: Array, rho_max: float, over_inputs: Raster, over_poses: Raster
    ) -> None:
        self.mechanism, self.load, self.rho_max = mechanism, load, rho_max
        self.over_inputs, self.over_poses = over_inputs, over_poses
        rasters = flat_rasters(over_inputs, over_poses, mechanism)
        self.charted = flood.Charted(mechanism.leg_table, mechanism.units.kernel_from_load(load), rho_max, rasters)
        self.pool = _make_pool(mechanism, over_inputs.size + over_poses.size)

    @property
    def is_growing(self) -> bool:
        """Whether states wait to be expanded."""
        return bool(self.pool.counts[1] < self.pool.counts[0])

    def plant(self, equilibria: Sequence[Equilibrium]) -> int:
        """Enter stable equilibria; return the state of the last one, -1 if it is at no node."""
        self._make_room(2 * len(equilibria))
        planted = -1
        for found in equilibria:
            state, inputs, _ = found.kernel_values()
            planted = flood.plant(self.charted, self.pool, state, inputs)
        return planted

    def flood(self, most: int) -> None:
        """Expand up to `most` states."""
        self._make_room((2 * self.mechanism.dof + 1) * most)
        flood.flood(self.charted, self.pool, most)

    def _make_room(self, count: int) -> None:
        capacity = len(self.pool.cell)
        if self.pool.counts[0] + count > capacity:
            rows = self.pool._asdict()
            shared = {name: rows.pop(name) for name in ("first", "counts")}
            grown = {name: np.resize(row, (2 * capacity + count, *row.shape[1:])) for name, row in rows.items()}
            self.pool = flood.Pool(**grown, **shared)

    def atlas(self, home: int, structure: StructuralLimits) -> Atlas:
        """Return what was found and keeps the limits; `home` is a state of the home branch, or -1."""
        count = int(self.pool.counts[0])
        is_kept = structure.are_kept(self.pool.x[:count], self.pool.inputs[:count])
        if not is_kept.any():
            within = f" within the limits {structure.names}" if structure else ""
            raise ValueError(
                f"mechanism {self.mechanism.name!r} has no stable equilibrium with every rho <= {self.rho_max:g}"
                f"{within} at any of the inputs where one was sought"
            )
        energies = flood.settle(self.charted.legs, self.charted.load, self.pool) * self.mechanism.units.energy
        is_input = self.pool.cell[:count] < self.over_inputs.size
        branches = _numbered(self.pool.parent[:count], is_input, is_kept)
        return Atlas(
            self.mechanism,
            self.load,
            self.rho_max,
            None if home < 0 or branches[home] < 0 else int(branches[home]),
            self._sheets(self.over_inputs, np.flatnonzero(is_input & is_kept), 0, branches, energies),
            self._sheets(
                self.over_poses, np.flatnonzero(~is_input & is_kept), self.over_inputs.size, branches, energies
            ),
            structure.names,
        )

    def _sheets(
        self, raster: Raster, rows: Integers, offset: int, branches: NDArray[np.int32], energies: Array
    ) -> RasterStates:
        pool, units, rods = self.pool, self.mechanism.units, 2 * self.mechanism.leg_count
        rows = rows[np.lexsort((energies[rows], pool.cell[rows]))]
        poses = units.pose_from_kernel(pool.x[rows, rods:])
        poses[:, 2:] = math.pi - np.remainder(math.pi - poses[:, 2:], 2.0 * math.pi)
        counts = np.bincount(pool.cell[rows] - offset, minlength=raster.size)
        return RasterStates(
            raster,
            np.concatenate([[0], np.cumsum(counts)]),
            branches[rows],
            units.inputs_from_kernel(pool.inputs[rows]).astype(np.float32),
            poses.astype(np.float32),
            pool.x[rows, :rods].astype(np.float32),
            pool.margin[rows].astype(np.float32),
            energies[rows].astype(np.float32),
        )


def _make_pool(mechanism: Mechanism, cells: int) -> flood.Pool:
    return flood.Pool(
        x=np.empty((_FIRST_CAPACITY, mechanism.state_size)),
        inputs=np.empty((_FIRST_CAPACITY, mechanism.leg_count)),
        margin=np.empty(_FIRST_CAPACITY),
        cell=np.empty(_FIRST_CAPACITY, dtype=np.int64),
        next=np.empty(_FIRST_CAPACITY, dtype=np.int64),
        parent=np.empty(_FIRST_CAPACITY, dtype=np.int64),
        arrived=np.empty(_FIRST_CAPACITY, dtype=np.uint8),
        first=np.full(cells, -1, dtype=np.int64),
        counts=np.zeros(2, dtype=np.int64),
    )


def _numbered(roots: Integers, is_input: Mask, is_kept: Mask) -> NDArray[np.int32]:
    """Return branch numbers from representatives: the most poses first, then the most inputs; -1 for none that is kept.

    Those that are not kept count for nothing.
    """
    kinds, members = np.unique(roots, return_inverse=True)
    pose_counts = np.bincount(members[~is_input & is_kept], minlength=len(kinds))
    input_counts = np.bincount(members[is_input & is_kept], minlength=len(kinds))
    ranks = np.empty(len(kinds), dtype=np.int32)
    ranks[np.lexsort((-input_counts, -pose_counts))] = np.arange(len(kinds))
    ranks[pose_counts + input_counts == 0] = -1
    return ranks[members]


def _rasters(
    mechanism: Mechanism,
    pitch: float | None = None,
    input_cells: int | None = None,
    seed_nodes: int | None = None,
    orientation: float | None = None,
) -> tuple[Raster, Raster, Raster]:
    """Return the rasters of inputs and of poses, and the one whose nodes are the seeds' inputs; see `build_atlas`."""
    defaults = _POINT if mechanism.dof == 2 else _PLATFORM
    step = positive_number("pitch", defaults.pitch * mechanism.units.length if pitch is None else pitch)
    nodes = whole_number("seed_nodes", defaults.seed_nodes if seed_nodes is None else seed_nodes, least=1)
    cells = whole_number("input_cells", defaults.input_cells if input_cells is None else input_cells, least=1)
    for name, count in (("seed_nodes", nodes), ("input_cells", cells)):
        if count**mechanism.dof > _MOST_CELLS:
            raise ValueError(f"{name} must be fewer: at most {_MOST_CELLS} cells over all inputs, got {shown(count)}")
    over_poses = _pose_raster(mechanism, step, orientation)
    return _input_raster(mechanism, cells), over_poses, _input_raster(mechanism, nodes)


def _input_raster(mechanism: Mechanism, count: int) -> Raster:
    dof = mechanism.dof
    return Raster.over(mechanism.lower_limits, mechanism.upper_limits, (count,) * dof, (False,) * dof)


def _pose_raster(mechanism: Mechanism, pitch: float, orientation: float | None) -> Raster:
    """Return the raster of all positions that every rod might reach, and of a platform's angles."""
    lower, upper = np.full(2, -math.inf), np.full(2, math.inf)
    for leg in mechanism.legs:
        clamps = np.array([leg.actuator.clamp_point(limit) for limit in leg.actuator.limits])
        reach = leg.rod.length + math.hypot(*leg.attachment)
        lower, upper = np.maximum(lower, clamps.min(axis=0) - reach), np.minimum(upper, clamps.max(axis=0) + reach)
    if (upper <= lower).any():
        raise ValueError(f"the legs of mechanism {mechanism.name!r} have no point that all can reach")
    cells = np.maximum(np.ceil((upper - lower) / max(pitch, 1e-300) - 1e-9), 1.0)
    angles = 1.0 if mechanism.dof == 2 or orientation is not None else float(_ANGLE_CELLS)
    if not cells[0] * cells[1] * angles <= _MOST_CELLS:
        raise ValueError(f"pitch must leave at most {_MOST_CELLS} cells over the poses, got {pitch:g}")
    counts = cells.astype(int)
    middle, half = 0.5 * (lower + upper), 0.5 * counts * pitch
    lower, upper, shape = middle - half, middle + half, tuple(counts.tolist())
    if mechanism.dof == 2:
        if orientation is not None:
            raise ValueError(f"orientation must be None for a point end-effector, got {shown(orientation)}")
        return Raster.over(lower, upper, shape, (False, False))
    if orientation is None:
        return Raster.over([*lower, -math.pi], [*upper, math.pi], (*shape, _ANGLE_CELLS), (False, False, True))
    angle, half_cell = finite_number("orientation", orientation), math.pi / _ANGLE_CELLS
    ends = [*lower, angle - half_cell], [*upper, angle + half_cell]
    return Raster.over(*ends, (*shape, 1), (False, False, False))


def _home(chart: _Chart) -> list[Equilibrium]:
    """Return the home equilibrium, if there is one within the loads."""
    try:
        home = home_equilibrium(chart.mechanism, chart.load)
    except ValueError:
        return []
    return [home] if max(rod.rho for rod in home.rods) <= chart.rho_max else []
