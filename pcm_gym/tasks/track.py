"""Track: follow a goal that moves along a smooth closed path inside the stable workspace."""

import math
from dataclasses import dataclass
from functools import partial
from typing import ClassVar, Literal, NamedTuple

import numpy as np

from pcm_gym.arrays import Array
from pcm_gym.kernels.charts.paths import follow_path
from pcm_gym.kernels.numerics.threads import default_thread_count, run_all
from pcm_gym.kernels.statics.states import States
from pcm_gym.kernels.stepping.goals import poses_seen
from pcm_gym.mechanism.validation import one_of
from pcm_gym.tasks.memory import remembered
from pcm_gym.tasks.scene import Scene
from pcm_gym.tasks.task import Episodes, Generators, Task, check_sampling, draw, starts_of

Path = Literal["circle", "eight", "spline", "any"]

_PERIOD = 100
_SHAPES = ("circle", "eight", "spline")
# Paths that a scene offers, of each shape.
_PATHS = 128
# Sizes with which a path is tried: the first is drawn from this range, in mean rod lengths, the next ones are smaller.
_SIZES, _SHRINKING, _TRIALS = (0.1, 0.4), 0.7, 5
# Harmonics of a spline, and how far it turns a platform, rad per mean rod length of its size.
_HARMONICS, _TURN = 3, 1.0
# Part of the agent's largest step that following a path takes: what is left is for catching up.
_PACE = 0.7


@dataclass(frozen=True)
class Track(Task):
    """Follow a goal that moves along a closed path, once around in 100 steps.

    The observation also tells where the goal will be in 1, 2, 4 and 8 steps.

    Starts and goals
    ----------------
    An episode begins at its goal, anywhere on a path that is drawn evenly from up to 128 of each shape; it is followed
    in either sense. The paths go through poses spread evenly over those that stable paths from home reach, and up to
    0.4 mean rod lengths away from them. Each can be followed without any cost, with steps of at most 0.7 of the
    agent's.

    Attributes
    ----------
    goals : Goals
    path : "circle", "eight", "spline" or "any"
        Shape of the paths: circles, figures of eight (both keep a platform's angle), closed random curves of three
        harmonics, or all of them.
    """

    period: ClassVar[int] = _PERIOD
    look_ahead: ClassVar[tuple[int, ...]] = (1, 2, 4, 8)

    path: Path = "any"

    def __post_init__(self) -> None:
        super().__post_init__()
        one_of("path", self.path, (*_SHAPES, "any"))

    def sample(self, scene: Scene, generators: Generators, threads: int = 1) -> Episodes:
        """Return episodes that begin at their goal, anywhere on its path, which is followed in either sense.

        Every path can be followed without any cost, with steps of at most 0.7 of the agent's.
        """
        check_sampling(scene, generators, threads)
        shapes = _SHAPES if self.path == "any" else (self.path,)
        library = paths(scene, shapes)
        numbers = draw(generators, 3)
        chosen = (numbers[:, 0] * len(library.x)).astype(np.int64)
        first = np.zeros(len(chosen), dtype=np.int64)
        if scene.origin is None:
            first = (numbers[:, 1] * _PERIOD).astype(np.int64)
        sense = np.where(numbers[:, 2] < 0.5, -1, 1)
        order = (first[:, None] + sense[:, None] * np.arange(_PERIOD)) % _PERIOD
        start = scene.states(library.x[chosen, first], library.inputs[chosen, first])
        return Episodes(start, library.goals[chosen[:, None], order], start)


class Paths(NamedTuple):
    """Closed paths of stable equilibria."""

    x: Array  # (n, period, size)
    inputs: Array  # (n, period, legs)
    goals: Array  # (n, period, g)


@remembered
def paths(scene: Scene, shapes: tuple[str, ...]) -> Paths:
    """Return the paths that a scene offers, of each shape as many.

    Raises
    ------
    ValueError
        If there are none.
    """
    found = [path for shape in shapes for path in _paths_of(scene, shape)]
    if not found:
        raise ValueError(f"mechanism {scene.mechanism.name!r} has no path that the agent's steps can follow")
    x, inputs = np.stack([x for x, _ in found]), np.stack([inputs for _, inputs in found])
    goals = poses_seen(x.reshape(-1, x.shape[2]), scene.mechanism.leg_count).reshape(len(x), _PERIOD, -1)
    return Paths(x, inputs, goals)


def _paths_of(scene: Scene, shape: str) -> list[tuple[Array, Array]]:
    numbers, threads = np.random.default_rng(_SHAPES.index(shape)), default_thread_count()
    starts = starts_of(scene, [numbers] * _PATHS, threads)
    dof = starts.load.shape[1]
    curves = np.stack([_curve(shape, dof, numbers) for _ in range(_PATHS)])
    sizes = numbers.uniform(*_SIZES, _PATHS)
    found: list[tuple[Array, Array] | None] = [None] * _PATHS

    def follow(n: int) -> None:
        found[n] = _followed(scene, starts, n, curves[n], float(sizes[n]))

    run_all([partial(follow, n) for n in range(_PATHS)], threads)
    return [path for path in found if path is not None]


def _followed(scene: Scene, starts: States, n: int, curve: Array, size: float) -> tuple[Array, Array] | None:
    """Return states and inputs along the largest path of this curve that can be followed; None if none can."""
    legs = scene.mechanism.leg_table
    x, inputs = np.empty((_PERIOD + 1, starts.x.shape[1])), np.empty((_PERIOD + 1, starts.inputs.shape[1]))
    pose = starts.x[n, 2 * inputs.shape[1] :]
    largest = _PACE * np.array(scene.stride)
    for _ in range(_TRIALS):
        x[0], inputs[0] = starts.x[n], starts.inputs[n]
        reached = follow_path(legs, starts.load[n], pose + size * curve, largest, scene.reserve, x, inputs)
        if reached == len(curve) and np.allclose(inputs[-1], inputs[0], rtol=0.0, atol=1e-8):
            return x[:-1].copy(), inputs[:-1].copy()
        size *= _SHRINKING
    return None


def _curve(shape: str, dof: int, numbers: np.random.Generator) -> Array:
    """Return a closed curve of size one that begins at zero, (period + 1, d); its last point is its first one."""
    t = 2.0 * math.pi * np.arange(_PERIOD + 1, dtype=np.float64) / _PERIOD
    curve = np.zeros((_PERIOD + 1, dof))
    if shape == "spline":
        for harmonic in range(1, _HARMONICS + 1):
            scale = numbers.normal(size=(2, dof)) / harmonic**2
            curve += scale[0] * (np.cos(harmonic * t) - 1.0)[:, None] + scale[1] * np.sin(harmonic * t)[:, None]
        curve[:, :2] /= np.hypot(curve[:, 0], curve[:, 1]).max()
        curve[:, 2:] *= _TURN / max(np.abs(curve[:, 2:]).max(initial=0.0), 1e-300)
    else:
        first, second = (
            (np.sin(t), 0.5 * np.sin(2.0 * t)) if shape == "eight" else (0.5 * (1.0 - np.cos(t)), 0.5 * np.sin(t))
        )
        angle = 2.0 * math.pi * numbers.random()
        curve[:, 0] = math.cos(angle) * first - math.sin(angle) * second
        curve[:, 1] = math.sin(angle) * first + math.cos(angle) * second
    curve[-1] = curve[0]
    return curve
