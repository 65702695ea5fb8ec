"""Track: follow a goal that moves along a smooth closed path inside the stable workspace."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, ClassVar, Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray

from pcm_gym.arrays import Array, Integers, Mask
from pcm_gym.kernels.charts.paths import follow_path, step_to_poses
from pcm_gym.kernels.numerics.threads import default_thread_count, run_all
from pcm_gym.kernels.statics.states import States
from pcm_gym.kernels.stepping.goals import poses_seen
from pcm_gym.mechanism.validation import one_of
from pcm_gym.tasks.memory import remembered
from pcm_gym.tasks.scene import Scene
from pcm_gym.tasks.task import Episodes, Generators, Progress, Task, check_sampling, draw, starts_of

Path = Literal["circle", "eight", "spline", "any"]
TrackDifficulty = Literal["inside", "edge", "rig"]

# Steps around a path: an episode, of 200, ends half way around.
_PERIOD = 80
_SHAPES = ("circle", "eight", "spline")
# Harmonics of a spline, and how far it turns a platform, rad per mean rod length of its size.
_HARMONICS, _TURN = 3, 1.0
# Sizes with which a curve is tried, in mean rod lengths: the first is drawn from this range, the next ones are smaller.
_SIZES, _SHRINKING, _TRIALS = (0.1, 0.4), 0.7, 5
# At the edge the greatest size is sought in this range, so many times halved.
_EDGE_SIZES, _HALVINGS = (0.04, 1.2), 6
# No path has a smaller diameter than so many distances that count as being at the goal: standing still is no success.
_LEAST_DIAMETER = 4.0
# Part of the states at their goal that makes a success.
_SHARE = 0.8
# Parts of the way from a known state of a path to where an episode is to begin: what is left of it where all of it, or
# the last part, is no safe step.
_NEARER = (0.5, 0.25, 0.125, 0.0)


class _Tier(NamedTuple):
    pace: float  # part of the agent's largest step that following a path may take; what is left is for catching up
    least_pace: float  # part of it that following a path takes at least, on average
    least: float  # part of a path's size that its smallest variants have
    is_largest: bool  # whether paths are as large as can be, or of a size that is drawn
    curves: int  # that are tried for each shape; a path is one of these, in a size from a range


# A rig is one of many, and each has paths of its own: fewer of them.
_TIERS: Mapping[TrackDifficulty, _Tier] = {
    "inside": _Tier(0.7, 0.0, 0.9, False, 128),
    "edge": _Tier(0.95, 0.0, 0.95, True, 128),
    "rig": _Tier(0.95, 0.4, 0.95, True, 24),
}


@dataclass(frozen=True)
class Track(Task):
    """Follow a goal that moves along a closed path, once around in 80 steps.

    The observation also tells where the goal will be in 1, 2, 4 and 8 steps.

    Success
    -------
    An episode is a success while at least 80 % of its steps, after once around, have led to a stable state at its goal;
    `hold_steps` has no part in it. The infos tell this part, `share_at_goal`, and the distance `error` in m.

    Starts and goals
    ----------------
    An episode begins at its goal, anywhere on a path; it is followed in either sense. Paths have a size from a range,
    a shape, and go through poses spread evenly over those that stable ways from home reach. Each can be followed
    without any cost.

    Attributes
    ----------
    goals : Goals
    path : "circle", "eight", "spline" or "any"
        Shape of the paths: circles, figures of eight (both keep a platform's angle), closed random curves of three
        harmonics, or all of them.
    difficulty : "inside", "edge" or "rig"
        Where the paths lead. Inside, the easy tier: anywhere, up to 0.4 mean rod lengths, at paces of at most 0.7 of
        the agent's steps. Edge: as far as stability, the actuators' limits or 0.95 of the agent's steps allow. Rig:
        at the edge, with what a real rig adds, see `pcm_gym.environments.rig`.
    """

    period: ClassVar[int] = _PERIOD
    look_ahead: ClassVar[tuple[int, ...]] = (1, 2, 4, 8)
    counts_all: ClassVar[bool] = True
    has_split: ClassVar[bool] = True

    path: Path = "any"
    difficulty: TrackDifficulty = "inside"

    def __post_init__(self) -> None:
        super().__post_init__()
        one_of("path", self.path, (*_SHAPES, "any"))
        one_of("difficulty", self.difficulty, get_args(TrackDifficulty))

    def sample(self, scene: Scene, generators: Generators, threads: int = 1) -> Episodes:
        """Return episodes that begin at their goal, anywhere on its path, which is followed in either sense."""
        check_sampling(scene, generators, threads)
        tier = _TIERS[self.difficulty]
        library = paths(scene, _SHAPES if self.path == "any" else (self.path,), tier, self.goals.tolerance)
        numbers = draw(generators, 4)
        chosen = (numbers[:, 0] * len(library.size)).astype(np.int64)
        sense = np.where(numbers[:, 1] < 0.5, -1.0, 1.0)
        first, part = numbers[:, 2] * _PERIOD, tier.least + numbers[:, 3] * (1.0 - tier.least)
        if scene.origin is not None:
            first[:] = 0.0
        start = _starts(scene, library, tier, chosen, first, part)
        phases = 2.0 * math.pi / _PERIOD * (first[:, None] + sense[:, None] * np.arange(_PERIOD))
        poses = library.pose[chosen, None] + (library.size[chosen] * part)[:, None, None] * _points(
            library.curve[chosen], phases
        )
        poses[:, 0] = start.x[:, 2 * scene.mechanism.leg_count :]
        goals = poses_seen(poses.reshape(-1, poses.shape[2]), 0).reshape(len(poses), _PERIOD, -1)
        return Episodes(start, goals, start)

    def succeeded(self, progress: Progress, hold_steps: int) -> Mask:
        """Return where enough of all steps have led to the goal, after once around."""
        return (progress.elapsed >= _PERIOD) & (progress.held >= _SHARE * progress.elapsed)

    def progress_metrics(self, progress: Progress) -> dict[str, NDArray[Any]]:
        """Return the part of the steps that have led to the goal; 0 before the first."""
        return {"share_at_goal": progress.held / np.maximum(progress.elapsed, 1)}

    def metrics(self, achieved: Array, desired: Array) -> dict[str, Array]:
        """Return the distances from the goal, m."""
        return {"error": self.goals.distance(achieved, desired)}


class Paths(NamedTuple):
    """Closed paths of stable equilibria, which can be followed in this size and down to a part of it."""

    curve: Array  # (n, harmonics, 2, d): factors of cos - 1 and of sin
    size: Array  # (n,)
    pose: Array  # (n, d): where they begin
    x: Array  # (n, period, size): in their full size
    inputs: Array  # (n, period, legs)


class _Followed(NamedTuple):
    curve: Array  # (harmonics, 2, d)
    size: float
    x: Array  # (period, size)
    inputs: Array  # (period, legs)


@remembered
def paths(scene: Scene, shapes: tuple[str, ...], tier: _Tier, tolerance: float) -> Paths:
    """Return the paths that a scene offers, of each shape as many.

    Raises
    ------
    ValueError
        If there are none.
    """
    found = [path for shape in shapes for path in _paths_of(scene, shape, tier, _LEAST_DIAMETER * tolerance)]
    if not found:
        raise ValueError(
            f"mechanism {scene.mechanism.name!r} has no path {' or '.join(shapes)!r} that the agent's steps can follow "
            f"and that has a diameter of at least {_LEAST_DIAMETER:g} success_distance"
        )
    legs = scene.mechanism.leg_count
    x = np.stack([path.x for path in found])
    return Paths(
        np.stack([path.curve for path in found]),
        np.array([path.size for path in found]),
        x[:, 0, 2 * legs :],
        x,
        np.stack([path.inputs for path in found]),
    )


def _paths_of(scene: Scene, shape: str, tier: _Tier, least: float) -> list[_Followed]:
    numbers, threads = np.random.default_rng(_SHAPES.index(shape)), default_thread_count()
    starts = starts_of(scene, [numbers] * tier.curves, threads)
    dof = starts.load.shape[1]
    curves = [_curve(shape, dof, numbers) for _ in range(tier.curves)]
    sizes = numbers.uniform(*_SIZES, tier.curves).tolist()
    found: list[_Followed | None] = [None] * tier.curves

    def follow(n: int) -> None:
        start, least_size = States(*(array[n] for array in starts)), least / _diameter(curves[n])
        if tier.is_largest:
            found[n] = _largest(scene, start, curves[n], tier, least_size)
        else:
            found[n] = _first_followed(scene, start, curves[n], tier, sizes[n], least_size)

    run_all([partial(follow, n) for n in range(tier.curves)], threads)
    return [path for path in found if path is not None and _pace(scene, path) >= tier.least_pace]


def _pace(scene: Scene, path: _Followed) -> float:
    """Return the part of the agent's largest step that following a path takes, on average."""
    moves = np.abs(path.inputs - np.roll(path.inputs, 1, axis=0)) / np.array(scene.stride)
    return float(moves.max(axis=1).mean())


def _first_followed(
    scene: Scene, start: States, curve: Array, tier: _Tier, size: float, least_size: float
) -> _Followed | None:
    """Return the first of smaller and smaller paths that can be followed; None if none can."""
    for _ in range(_TRIALS):
        if size * tier.least < least_size:
            return None
        path = _followed(scene, start, curve, size, tier)
        if path is not None:
            return path
        size *= _SHRINKING
    return None


def _largest(scene: Scene, start: States, curve: Array, tier: _Tier, least_size: float) -> _Followed | None:
    """Return a path about as large as can be followed; None if not even a small one can."""
    low, high = max(_EDGE_SIZES[0], least_size / tier.least), _EDGE_SIZES[1]
    best = _followed(scene, start, curve, low, tier)
    for _ in range(_HALVINGS if best is not None else 0):
        middle = 0.5 * (low + high)
        path = _followed(scene, start, curve, middle, tier)
        best = path or best
        low, high = (low, middle) if path is None else (middle, high)
    return best


def _followed(scene: Scene, start: States, curve: Array, size: float, tier: _Tier) -> _Followed | None:
    """Return the path of this size, if it and its smallest variant can be followed."""
    legs, largest = scene.mechanism.leg_table, tier.pace * np.array(scene.stride)
    x, inputs = np.empty((_PERIOD + 1, len(start.x))), np.empty((_PERIOD + 1, len(start.inputs)))
    pose = start.x[2 * len(start.inputs) :]
    points = _points(curve[None], 2.0 * math.pi / _PERIOD * np.arange(_PERIOD + 1, dtype=np.float64)[None])[0]
    for own_size in (tier.least * size, size):
        x[0], inputs[0] = start.x, start.inputs
        reached = follow_path(legs, start.load, pose + own_size * points, largest, scene.reserve, x, inputs)
        if reached <= _PERIOD or not np.allclose(inputs[-1], inputs[0], rtol=0.0, atol=1e-8):
            return None
        if not scene.structure.are_kept(x, inputs).all():
            return None
    return _Followed(curve, size, x[:-1], inputs[:-1])


def _diameter(curve: Array) -> float:
    """Return the greatest distance between two points of a curve, its turns left aside."""
    points = _points(curve[None], 2.0 * math.pi / _PERIOD * np.arange(_PERIOD, dtype=np.float64)[None])[0, :, :2]
    return float(np.linalg.norm(points[:, None] - points, axis=2).max())


def _starts(scene: Scene, library: Paths, tier: _Tier, chosen: Integers, first: Array, part: Array) -> States:
    """Return states on paths in parts (n,) of their sizes, at places (n,) in steps.

    `first` and `part` are brought nearer to those of the next known state where no safe step leads to them from there.
    """
    nearest = np.rint(first).astype(np.int64) % _PERIOD
    states = scene.states(library.x[chosen, nearest], library.inputs[chosen, nearest])
    if scene.origin is not None:
        return states
    away, smaller = (first - nearest + 0.5 * _PERIOD) % _PERIOD - 0.5 * _PERIOD, part - 1.0
    missing = np.arange(len(first))
    for share in _NEARER:
        known = States(*(array[missing] for array in states))
        points = _points(library.curve[chosen[missing]], 2.0 * math.pi / _PERIOD * first[missing, None])[:, 0]
        poses = library.pose[chosen[missing]] + (library.size[chosen[missing]] * part[missing])[:, None] * points
        arrived = _moved(scene, poses, known)
        for array, values in zip(states, known, strict=True):
            array[missing[arrived]] = values[arrived]
        missing = missing[~arrived]
        first[missing], part[missing] = nearest[missing] + share * away[missing], 1.0 + share * smaller[missing]
    return states


def _moved(scene: Scene, poses: Array, states: States) -> Mask:
    """Move states to poses (n, d), each in a step; return which of them (n,) have safely got there."""
    mechanism, most = scene.mechanism, np.full(scene.mechanism.leg_count, math.inf)
    arrived = np.empty(len(poses), dtype=np.bool_)
    step_to_poses(mechanism.leg_table, poses, most, scene.reserve, states, arrived)
    if scene.limits:
        arrived &= scene.structure.are_kept(states.x, states.inputs)
    return arrived


def _points(curves: Array, phases: Array) -> Array:
    """Return the points (n, p, d) of curves (n, harmonics, 2, d), which begin at zero, at phases (n, p)."""
    turns = phases[:, :, None] * np.arange(1, curves.shape[1] + 1)
    waves = np.stack([np.cos(turns) - 1.0, np.sin(turns)], axis=3)
    points: Array = np.einsum("nphw,nhwd->npd", waves, curves)
    return points


def _curve(shape: str, dof: int, numbers: np.random.Generator) -> Array:
    """Return a curve of size one, by its factors of cos - 1 and of sin, (harmonics, 2, d)."""
    curve = np.zeros((_HARMONICS, 2, dof))
    if shape == "spline":
        curve[:] = numbers.normal(size=curve.shape) / np.arange(1, _HARMONICS + 1)[:, None, None] ** 2
        points = _points(curve[None], 2.0 * math.pi / _PERIOD * np.arange(_PERIOD, dtype=np.float64)[None])[0]
        curve[:, :, :2] /= np.hypot(points[:, 0], points[:, 1]).max()
        curve[:, :, 2:] *= _TURN / max(np.abs(points[:, 2:]).max(initial=0.0), 1e-300)
        return curve
    angle = 2.0 * math.pi * numbers.random()
    along, across = np.zeros(dof), np.zeros(dof)
    along[:2], across[:2] = (math.cos(angle), math.sin(angle)), (-math.sin(angle), math.cos(angle))
    if shape == "eight":
        curve[0, 1], curve[1, 1] = along, 0.5 * across
    else:
        curve[0, 0], curve[0, 1] = -0.5 * along, 0.5 * across
    return curve
