"""Gradients of the pose by the inputs, against how far the nearest fold is."""

import itertools
import math

import numpy as np
from matplotlib.figure import Figure

from docs.figures import style
from docs.ideas import line
from pcm_gym import BranchTracker, Event
from pcm_gym.arrays import Array

# Angles of motor 2 from which rays lead, degrees, and how far, rad.
_STARTS, _REACH = (0.0, 60.0, 120.0, 180.0), 2.5
# States on a ray, and how far before the fold they are, rad.
_ON_A_RAY, _NEAREST, _FARTHEST = 8, 1e-5, 1.0
# Margins below which the law of folds is drawn.
_NEAR = 0.05


def draw(rays: int = 24) -> Figure:
    """Draw the largest gradient of the pose beside the margin, on rays of the inputs to folds."""
    margins, gradients = along_rays(rays)
    figure = style.new_figure(5.0, 3.2)
    axes = figure.subplots()
    axes.plot(margins, gradients, ".", color=style.STABLE, markersize=2.0)
    ends = np.array([margins.min(), _NEAR])
    level = np.median((gradients * np.sqrt(margins))[margins < _NEAR])
    axes.plot(ends, level / np.sqrt(ends), color=style.ACCENT, linewidth=1.2, label="1 / √margin")
    axes.set(xscale="log", yscale="log", xlabel="singularity margin (rad)", ylabel="norm of the gradient (m/rad)")
    axes.legend()
    return figure


def along_rays(rays: int) -> tuple[Array, Array]:
    """Return margins and norms of the pose's Jacobian of states before folds, on so many rays from each start."""
    starts = [own for degrees in _STARTS for own in line.all_at(degrees).stable]
    angles, found = np.linspace(0.0, 2.0 * math.pi, rays, endpoint=False), []
    for home, angle in itertools.product(starts, angles.tolist()):
        ray = _REACH * np.array([math.cos(angle), math.sin(angle)])
        ended = BranchTracker(home.mechanism, home).step(home.inputs + ray)
        if ended.event is not Event.FOLD:
            continue
        for back in np.geomspace(_NEAREST, min(_FARTHEST, ended.fraction * _REACH), _ON_A_RAY):
            step = BranchTracker(home.mechanism, home).step(home.inputs + (ended.fraction - back / _REACH) * ray)
            if step.event is Event.NONE:
                own = step.equilibrium
                found.append((own.singularity_margin, np.linalg.norm(own.forward_jacobian, 2)))
    margins, gradients = np.array(found).T
    return margins, gradients
