"""The atlas of a mechanism: its stable workspace, branch by branch, over the inputs and over the poses."""

import os
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from pcm_gym.arrays import Array, Integers
from pcm_gym.kernels.charts import flood, motions
from pcm_gym.kernels.numerics.rasters import INPUTS, POSES, Rasters
from pcm_gym.kernels.statics.states import States
from pcm_gym.mechanism import Mechanism
from pcm_gym.mechanism.validation import (
    check_kinds,
    file_path,
    finite_number,
    instance_of,
    one_of,
    positive_number,
    shown,
    whole_number,
)
from pcm_gym.solving.atlas_file import AtlasError, read_atlas, write_atlas
from pcm_gym.solving.equilibrium import Equilibrium
from pcm_gym.solving.limits import LimitName, limits_of
from pcm_gym.solving.raster import Raster, Region
from pcm_gym.solving.raster_states import RasterStates
from pcm_gym.solving.solutions import StableStates

Over = Literal["poses", "inputs"]

_SPACES = {"inputs": INPUTS, "poses": POSES}
_MOST_ROUNDS, _MOST_SAMPLES = 100, 10_000_000


@dataclass(frozen=True, eq=False)
class Branch:
    """A connected set of stable equilibria: between any two leads a path of stable equilibria within the limits.

    Attributes
    ----------
    number : int
        Its number in the atlas; branch 0 covers most of the poses.
    workspace : Region
        The poses that it covers, each counted once.
    input_region : Region
        The inputs that it covers, each counted once.
    contains_home : bool
    largest_rho : float
        Largest dimensionless load of a rod at the nodes; where it is near the atlas's `rho_max`, that limit cuts the
        branch.
    """

    number: int
    workspace: Region
    input_region: Region
    contains_home: bool
    largest_rho: float

    def __post_init__(self) -> None:
        check_kinds(self, number=int, workspace=Region, input_region=Region, contains_home=bool, largest_rho=float)


@dataclass(frozen=True, eq=False)
class Atlas:
    """The stable equilibria of a mechanism within its actuators' limits, charted by inputs and by poses.

    `build_atlas` makes it, `save` keeps it, `load_atlas` brings it back. Two stable equilibria are on the same branch
    where a path of stable equilibria within the limits joins them. A branch may cover a pose several times (working
    modes), and around a cusp also inputs. It holds what is met from its seeds: a branch that covers none of them, or is
    narrower than the pitch, may be missing. That some stable equilibrium is there at a pose says little, that a branch
    covers it says more: all branches of the 2RFR together cover just what both rods reach.

    Attributes
    ----------
    mechanism : Mechanism
    load : array (d,)
        Load on the end-effector, N and N m.
    rho_max : float
        Largest dimensionless load of any rod.
    home_branch : int or None
        Branch of the home equilibrium; None where there is none.
    over_inputs, over_poses : RasterStates
        All stable equilibria at the nodes of a raster of inputs, and of one of poses.
    limits : tuple of "stress", "torque" or "contact"
        Those of the structure that all of them keep: the usable workspace, see `StructuralLimits`. Two of one branch
        may be joined only through equilibria that are left out.
    """

    mechanism: Mechanism
    load: Array
    rho_max: float
    home_branch: int | None
    over_inputs: RasterStates
    over_poses: RasterStates
    limits: tuple[LimitName, ...] = ()

    def __post_init__(self) -> None:
        mechanism = instance_of("mechanism", self.mechanism, Mechanism)
        object.__setattr__(self, "load", mechanism.check_load(self.load))
        object.__setattr__(self, "rho_max", positive_number("rho_max", self.rho_max))
        object.__setattr__(self, "limits", limits_of(mechanism, self.limits).names)
        for name in ("over_inputs", "over_poses"):
            if len(instance_of(name, getattr(self, name), RasterStates).raster.shape) != mechanism.dof:
                raise ValueError(f"{name} must have {mechanism.dof} axes for mechanism {mechanism.name!r}")
        numbers = np.unique(np.concatenate([self.over_inputs.branches, self.over_poses.branches]))
        if not np.array_equal(numbers, np.arange(len(numbers))):
            raise ValueError(f"branches must be numbered from 0 on without a gap, got {shown(numbers)}")
        if self.home_branch is not None:
            whole_number("home_branch", self.home_branch, least=0, most=len(numbers) - 1)

    @cached_property
    def branches(self) -> tuple[Branch, ...]:
        """The branches, by their numbers."""
        sheets = (self.over_inputs, self.over_poses)
        count = 1 + max(int(part.branches.max(initial=-1)) for part in sheets)
        largest = np.zeros(count)
        for part in sheets:
            loads = np.hypot(part.rods[:, 0::2], part.rods[:, 1::2]).max(axis=1)
            np.maximum.at(largest, part.branches, np.sqrt(loads))
        return tuple(
            Branch(
                number,
                self.over_poses.covered(number),
                self.over_inputs.covered(number),
                number == self.home_branch,
                float(largest[number]),
            )
            for number in range(count)
        )

    def workspace(self, branch: int | None = None, orientation: float | None = None) -> Region:
        """Return the region of the plane that the end-effector reaches with a stable equilibrium.

        Parameters
        ----------
        branch : int, optional
            Of this branch alone; of all by default.
        orientation : float, optional
            Angle of a platform, rad: the region at the nearest angle of the raster (constant-orientation workspace).
            By default the points reached at any angle (reachable workspace).
        """
        region = self.over_poses.covered(None if branch is None else self._checked(branch))
        raster = region.raster
        if self.mechanism.dof == 2:
            if orientation is not None:
                raise ValueError(f"orientation must be None for a point end-effector, got {shown(orientation)}")
            return region
        plane = Raster(raster.shape[:2], raster.first_node[:2], raster.pitch[:2], raster.is_closed[:2])
        if orientation is None:
            return Region(plane, np.any(region.mask, axis=2))
        offset = finite_number("orientation", orientation) - raster.axes[2]
        gaps = np.abs(np.remainder(offset + np.pi, 2.0 * np.pi) - np.pi)
        if gaps.min() > 0.5 * raster.pitch[2] * (1.0 + 1e-9):
            raise ValueError(f"orientation must be near an angle of the raster, {raster.axes[2]}, got {orientation}")
        return Region(plane, region.mask[:, :, int(gaps.argmin())])

    def at_pose(self, pose: ArrayLike) -> StableStates:
        """Return the stable equilibria within the limits at a pose, by ascending energy.

        They are reached from the nodes around: one whose sheet ends before all of these is not found.
        """
        return self._at("poses", self.mechanism.check_pose(pose))

    def at_inputs(self, inputs: ArrayLike) -> StableStates:
        """Return the stable equilibria within the limits at some inputs, by ascending energy; see `at_pose`.

        Raises
        ------
        ValueError
            If the inputs are beyond an actuator's limits.
        """
        inputs = self.mechanism.check_inputs(inputs)
        lower, upper = self.mechanism.lower_limits, self.mechanism.upper_limits
        if not ((lower <= inputs) & (inputs <= upper)).all():
            raise ValueError(f"inputs must be within the limits {lower} to {upper}, got {inputs}")
        return self._at("inputs", inputs)

    def branch_of(self, equilibrium: Equilibrium) -> int | None:
        """Return the number of the branch on which an equilibrium is.

        None if it is not stable, not within the limits, or on no sheet that the rasters resolve.

        Raises
        ------
        ValueError
            If it belongs to another mechanism or bears another load.
        """
        if instance_of("equilibrium", equilibrium, Equilibrium).mechanism != self.mechanism:
            raise ValueError(f"equilibrium must belong to the atlas's mechanism, got one of {equilibrium.mechanism}")
        if not np.array_equal(equilibrium.load, self.load):
            raise ValueError(f"equilibrium must bear the atlas's load {self.load}, got {equilibrium.load}")
        inputs = equilibrium.inputs
        is_within = bool(np.all((self.mechanism.lower_limits <= inputs) & (inputs <= self.mechanism.upper_limits)))
        if not (equilibrium.is_stable and is_within):
            return None
        own = StableStates(
            self.mechanism, self.load, equilibrium.state[None], equilibrium.inputs[None], np.array([-1], np.int32)
        )
        near_inputs = self._matched("inputs", own, equilibrium.inputs)
        return near_inputs if near_inputs is not None else self._matched("poses", own, equilibrium.pose)

    def sample(
        self, rng: np.random.Generator, count: int, branch: int | None = None, over: Over = "poses"
    ) -> StableStates:
        """Return random stable equilibria, uniform over the area of the sheets, each sheet counted by itself.

        Parameters
        ----------
        rng : numpy.random.Generator
        count : int
        branch : int, optional
            Of this branch alone; of all by default.
        over : {"poses", "inputs"}
            Whether uniform over the poses or over the inputs.

        Raises
        ------
        ValueError
            If an argument is out of range, or the branch has no cell in which random points are met.

        Notes
        -----
        A node of a sheet is drawn, a random point in its cell, and the equilibrium there, exact to rounding; points
        beyond the border of the sheet are drawn again. Some tens of microseconds each.
        """
        sheets = self._sheets(over)
        instance_of("rng", rng, np.random.Generator)
        count = whole_number("count", count, least=0, most=_MOST_SAMPLES)
        rows = np.arange(len(sheets)) if branch is None else np.flatnonzero(sheets.branches == self._checked(branch))
        parts, missing = [self._stored(over, rows[:0])], count
        for _ in range(_MOST_ROUNDS if len(rows) else 0):
            drawn = rng.choice(rows, missing + missing // 8 + 8)
            shifts = rng.uniform(-0.5, 0.5, (len(drawn), self.mechanism.dof)) * sheets.raster.pitch
            targets = sheets.raster.nodes(sheets.cells[drawn]) + shifts
            parts.append(self._moved(over, self._stored(over, drawn), targets)[:missing])
            missing -= len(parts[-1])
            if missing == 0:
                break
        if missing > 0:
            raise ValueError(f"branch {branch} is too small to be sampled over the {over} at this pitch")
        return StableStates(
            self.mechanism,
            self.load,
            np.concatenate([part.states for part in parts]),
            np.concatenate([part.inputs for part in parts]),
            np.concatenate([part.branches for part in parts]),
        )

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the atlas to a file: a compressed NumPy archive (npz) with the mechanism as JSON inside."""
        write_atlas(file_path("path", path), {field.name: getattr(self, field.name) for field in fields(self)})

    def __repr__(self) -> str:
        """Return a line on the whole and one per branch."""
        header = f"Atlas of {self.mechanism.name}: {len(self.over_poses)} stable equilibria over poses, "
        lines = [header + f"{len(self.over_inputs)} over inputs, {len(self.branches)} branches"]
        for branch in self.branches:
            home = ", home" if branch.contains_home else ""
            lines.append(
                f"  {branch.number}: poses {branch.workspace.area:.4g} +- {branch.workspace.area_error:.1g}, "
                f"inputs {branch.input_region.area:.4g} +- {branch.input_region.area_error:.1g}{home}"
            )
        return "\n".join(lines)

    @cached_property
    def _charted(self) -> flood.Charted:
        rasters = flat_rasters(self.over_inputs.raster, self.over_poses.raster, self.mechanism)
        load = self.mechanism.units.kernel_from_load(self.load)
        return flood.Charted(self.mechanism.leg_table, load, self.rho_max, rasters)

    def _sheets(self, over: Over) -> RasterStates:
        one_of("over", over, list(_SPACES))
        return self.over_inputs if over == "inputs" else self.over_poses

    def _checked(self, branch: int) -> int:
        return whole_number("branch", branch, least=0, most=len(self.branches) - 1)

    def _stored(self, over: Over, rows: Integers) -> StableStates:
        """Return equilibria of the sheets, made exact again: they are stored in single precision."""
        sheets, units = self._sheets(over), self.mechanism.units
        load = np.tile(units.kernel_from_load(self.load), (len(rows), 1))
        stored = States(
            np.concatenate([sheets.rods[rows], units.kernel_from_pose(sheets.poses[rows].astype(np.float64))], axis=1),
            units.kernel_from_inputs(sheets.inputs[rows].astype(np.float64)),
            load,
        )
        exact = States(*(array.copy() for array in stored))
        correct = motions.settle if over == "inputs" else motions.meet_poses
        is_exact = correct(self.mechanism.leg_table, exact)[:, None]
        x, inputs = (np.where(is_exact, new, old) for new, old in zip(exact[:2], stored[:2], strict=True))
        return StableStates(self.mechanism, self.load, x, units.inputs_from_kernel(inputs), sheets.branches[rows])

    def _moved(self, over: Over, start: StableStates, targets: Array) -> StableStates:
        """Return the equilibria moved to inputs or poses (n, d), those left out that get lost on the way."""
        units, states = self.mechanism.units, start.states.copy()
        inputs = units.kernel_from_inputs(start.inputs)
        to_kernel = units.kernel_from_inputs if over == "inputs" else units.kernel_from_pose
        scaled = np.ascontiguousarray(to_kernel(targets))
        is_stable = flood.move_all(self._charted, _SPACES[over], states, inputs, scaled) >= 0.0
        moved = StableStates(self.mechanism, self.load, states, units.inputs_from_kernel(inputs), start.branches)
        return moved[is_stable]

    def _at(self, over: Over, point: Array) -> StableStates:
        sheets = self._sheets(over)
        near = self._stored(over, sheets.rows(sheets.raster.cells_around(point)))
        there = self._moved(over, near, np.tile(point, (len(near), 1)))
        there = there[flood.mark_first(there.states, self.mechanism.units.kernel_from_inputs(there.inputs))]
        return there[np.argsort([found.energy for found in there])]

    def _matched(self, over: Over, own: StableStates, point: Array) -> int | None:
        """Return the branch that one equilibrium meets at one of the nodes around it."""
        sheets = self._sheets(over)
        for cell in sheets.raster.cells_around(point):
            node = sheets.raster.nodes([cell])
            known = self._stored(over, sheets.rows(np.array([cell])))
            known = self._moved(over, known, np.repeat(node, len(known), axis=0))
            arrived = self._moved(over, own, node)
            for row in range(len(known) if len(arrived) else 0):
                pair = np.concatenate([arrived.states, known.states[row : row + 1]])
                pair_inputs = np.concatenate([arrived.inputs, known.inputs[row : row + 1]])
                if not flood.mark_first(pair, self.mechanism.units.kernel_from_inputs(pair_inputs))[1]:
                    return int(known.branches[row])
        return None


def load_atlas(path: str | os.PathLike[str]) -> Atlas:
    """Return the atlas in a file that `Atlas.save` wrote.

    Raises
    ------
    AtlasError
        If it is not an atlas, is of another version, or its arrays do not fit together; a `ValueError`. If there is no
        such file it is a `FileNotFoundError` as well.
    """
    checked = file_path("path", path)
    content = read_atlas(checked)
    try:
        return Atlas(**content)
    except (TypeError, ValueError) as error:
        raise AtlasError(f"{checked} is a damaged atlas: {error}") from error


def flat_rasters(inputs: Raster, poses: Raster, mechanism: Mechanism) -> Rasters:
    """Return both rasters as the kernels take them, dimensionless.

    For them the inputs of a motor are closed where its limits are a full turn apart.
    """
    units, spans = mechanism.units, inputs.pitch * inputs.shape
    periods = np.array([leg.actuator.period for leg in mechanism.legs])
    is_full_turn = (periods > 0.0) & np.isclose(spans, periods, rtol=1e-9) & (np.array(inputs.shape) > 3)
    return Rasters(
        np.array([inputs.shape, poses.shape]),
        np.array([units.kernel_from_inputs(inputs.first_node), units.kernel_from_pose(poses.first_node)]),
        np.array([units.kernel_from_inputs(inputs.pitch), units.kernel_from_pose(poses.pitch)]),
        np.array([is_full_turn, poses.is_closed]),
    )
