"""Figure 15: singular poses of the 2RFR and the curves on which they lie."""

import math

import numpy as np
from matplotlib.axes import Axes

from docs.figures import style
from docs.figures.drawing import draw_equilibrium
from docs.figures.plate import Plate, fixed, listed
from pcm_gym import Equilibrium, SingularCurve, forward_singularities, get_mechanism, inverse_singularities
from pcm_gym.arrays import Array, Mask

_HEADINGS = ("pose", "singularity", "x, y (m)", "inputs (°)", "modes", "energy (J)")
_BAR = 0.18  # m
# Where on the outer border the mechanism is shown, from the middle between its motors.
_BORDER_DIRECTION = math.radians(50.0)


def make(forward_grid: int = 8, inverse_grid: int = 16, rho_max: float = 9.0) -> Plate:
    """Make the figure from curves sought with grids of so many cells along each axis."""
    mechanism = get_mechanism("2RFR-paper")
    inverse = inverse_singularities(mechanism, rho_max=rho_max, grid=inverse_grid, progress=False)
    folds = forward_singularities(mechanism, rho_max=rho_max, index=0, grid=forward_grid, progress=False)
    figure = style.new_figure(8.0, 3.0)
    border, poses, inputs = figure.subplots(1, 3)
    for curve in inverse:
        _draw_over_poses(border, curve)
    for curve in folds:
        poses.plot(*curve.poses.T, color=style.UNSTABLE, linewidth=0.9, zorder=2)
        _draw_over_inputs(inputs, curve)
    at_border, at_fold = _at_border(inverse), _at_fold(folds)
    for axes, found in ((border, at_border), (poses, at_fold)):
        draw_equilibrium(axes, found, colour=style.INK)
        axes.set(xlim=(-1.05, 1.05), ylim=(-1.05, 1.05))
        style.label_metres(axes)
    angles = np.degrees([mechanism.lower_limits, mechanism.upper_limits])
    inputs.plot(*_wrapped(np.degrees(at_fold.inputs), angles), "o", color=style.INK, markersize=5, zorder=4)
    inputs.set(aspect="equal", xlim=angles[:, 0], ylim=angles[:, 1], xlabel="input 1 (°)", ylabel="input 2 (°)")
    inputs.set(xticks=range(-90, 271, 90), yticks=range(-90, 271, 90))
    titles = ("inverse singularities", "limits of stability, poses", "limits of stability, inputs")
    for axes, letter, title in zip((border, poses, inputs), "abc", titles, strict=True):
        axes.set_title(f"({letter}) {title}")
    _draw_bar(border, at_border, np.linalg.svd(at_border.forward_jacobian)[0][:, 1])
    values, vectors = np.linalg.eigh(at_fold.stiffness)
    _draw_bar(poses, at_fold, vectors[:, np.abs(values).argmin()])
    rows = [_row("(a)", "inverse, stable", at_border), _row("(b), (c)", "fold, index 0 to 1", at_fold)]
    lengths = [curve.arc_length[-1] for curve in (*folds, *inverse)]
    note = (
        f"{len(folds)} curves of folds between index 0 and 1, {_closed(folds)} of them closed, with "
        f"{sum(len(own.cusps) for own in folds)} cusps and {fixed(sum(lengths[: len(folds)]), 1)} rad long; "
        f"{len(inverse)} curves of inverse singularities, {_closed(inverse)} of them closed, "
        f"{fixed(sum(lengths[len(folds) :]), 1)} m long."
    )
    return Plate(figure, _HEADINGS, tuple(rows), note)


def _closed(curves: tuple[SingularCurve, ...]) -> int:
    return sum(curve.is_closed for curve in curves)


def _at_border(curves: tuple[SingularCurve, ...]) -> Equilibrium:
    """The stable inverse singularity farthest out in a direction."""
    direction = np.array([math.cos(_BORDER_DIRECTION), math.sin(_BORDER_DIRECTION)])
    found = (curve.equilibrium(k) for curve in curves for k in np.flatnonzero(_is_stable(curve)).tolist())
    return max(found, key=lambda own: float(own.pose @ direction))


def _is_stable(curve: SingularCurve) -> Mask:
    """Which vertices are stable equilibria."""
    return np.array([curve.equilibrium(k).is_stable for k in range(len(curve))])


def _at_fold(curves: tuple[SingularCurve, ...]) -> Equilibrium:
    """The highest end-effector at a limit of stability."""
    found = (curve.equilibrium(int(curve.poses[:, 1].argmax())) for curve in curves)
    return max(found, key=lambda own: float(own.pose[1]))


def _draw_bar(axes: Axes, found: Equilibrium, direction: Array) -> None:
    ends = found.pose + _BAR * np.outer([-1.0, 1.0], direction)
    axes.plot(*ends.T, color=style.ACCENT, linewidth=2.0, zorder=4)


def _draw_over_poses(axes: Axes, curve: SingularCurve) -> None:
    """Draw a curve of inverse singularities: blue and thick where stable."""
    is_stable = _is_stable(curve)
    axes.plot(*curve.points.T, color=style.METAL, linewidth=0.5, zorder=2)
    shown = np.where(is_stable[:, None], curve.points, np.nan)
    axes.plot(*shown.T, color=style.STABLE, linewidth=1.4, zorder=2.5)


def _draw_over_inputs(axes: Axes, curve: SingularCurve) -> None:
    limits = np.degrees([curve.mechanism.lower_limits, curve.mechanism.upper_limits])
    points = _wrapped(np.degrees(curve.points), limits)
    jumps = np.flatnonzero((np.abs(np.diff(points, axis=0)) > 180.0).any(axis=1)) + 1
    for part in np.split(points, jumps):
        axes.plot(*part.T, color=style.UNSTABLE, linewidth=0.9, zorder=2)
    cusps = points[list(curve.cusps)]
    axes.plot(*cusps.T, ".", color=style.UNSTABLE, markersize=4, zorder=3)


def _wrapped(angles: Array, limits: Array) -> Array:
    """Angles within a full turn's limits, in degrees."""
    turned: Array = limits[0] + np.remainder(angles - limits[0], 360.0)
    return turned


def _row(name: str, kind: str, found: Equilibrium) -> tuple[str, ...]:
    modes = ", ".join(map(str, found.modes))
    inputs = listed((np.degrees(found.inputs) + 180.0) % 360.0 - 180.0, 2)
    return name, kind, listed(found.pose), inputs, modes, fixed(found.energy)
