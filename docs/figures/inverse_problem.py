"""Figures 10 to 12: the inverse problem of the 2RFR: each rod alone, the balance of both, the solutions."""

import math
from functools import lru_cache
from typing import Any

import numpy as np
from contourpy import LineType, contour_generator
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from docs.figures import style
from docs.figures.drawing import draw_equilibrium, draw_force, mark, stability_legend, verdict
from docs.figures.plate import Plate, fixed, listed
from docs.figures.rod_parameters import draw_feasible
from pcm_gym import EquilibriumSet, Leg, get_mechanism, solve_inverse
from pcm_gym.arrays import Array
from pcm_gym.kernels.rods.rod import rod, rod_parameters

POSE = (0.3, 0.35)  # m
# Columns of a family: one row per load with which the rod's tip is on the end-effector. Angles are in degrees, the
# clamp's and the force's in the world, and the force is in N.
MODULUS, PSI, MODE, CLAMP, FORCE, DIRECTION = range(6)
_NEWTON_STEPS = 8
_LINES: dict[int, tuple[Any, float]] = {1: ("-", 2.0), 2: ("-", 1.0), 3: ((0.0, (1.0, 1.2)), 1.2)}
_ARROW = 0.045  # m per N


@lru_cache(maxsize=4)
def solutions(rho_max: float) -> EquilibriumSet:
    """All solutions of the inverse problem."""
    return solve_inverse(get_mechanism("2RFR-paper"), POSE, rho_max=rho_max)


@lru_cache(maxsize=4)
def families(rho_max: float, samples: int) -> tuple[tuple[Array, ...], ...]:
    """Families of both rods: their equilibria with the tip on the end-effector, over all directions of the clamp."""
    return tuple(_family(leg, rho_max, samples) for leg in get_mechanism("2RFR-paper").legs)


def make_rods(rho_max: float = 9.0, samples: int = 300) -> Plate:
    """Make figure 10: what each rod alone may do."""
    figure = style.new_figure(8.0, 4.9)
    panels = figure.subplots(2, 2, sharex=True, sharey="row")
    rows = []
    for leg, (family, upper, lower) in enumerate(zip(families(rho_max, samples), *panels, strict=True)):
        draw_feasible(upper)
        for curve in family:
            _draw_curve(upper, curve, PSI, MODULUS, style.LEGS[leg])
            _draw_curve(lower, curve, PSI, CLAMP, style.LEGS[leg])
        for found in solutions(rho_max):
            own = found.rods[leg]
            mark(upper, math.degrees(own.psi), own.modulus, is_stable=found.is_stable)
            mark(lower, math.degrees(own.psi), _turn(math.degrees(found.inputs[leg])), is_stable=found.is_stable)
        upper.set(xlabel="", title=f"({'ab'[leg]}) leg {leg + 1}")
        lower.set(xlabel="ψ (°)", ylim=(-190, 190), yticks=range(-180, 181, 90), title=f"({'cd'[leg]}) leg {leg + 1}")
        joined = np.concatenate(family)
        modes = [str(int(mode)) for mode in np.unique(joined[:, MODE])]
        rows.append((str(leg + 1), str(len(family)), ", ".join(modes), fixed(joined[:, FORCE].min())))
    panels[0, 1].set_ylabel("")
    panels[1, 0].set_ylabel("clamp angle (°)")
    _add_legend(figure, legs=False)
    return Plate(figure, ("leg", "connected curves", "modes on them", "least force (N)"), tuple(rows))


def make_balance(rho_max: float = 9.0, samples: int = 300) -> Plate:
    """Make figure 11: where the forces of both rods cancel."""
    figure = style.new_figure(8.0, 3.9)
    panels = figure.subplots(1, 2, sharex=True, sharey=True)
    for only_first, axes in zip((True, False), panels, strict=True):
        for leg, family in enumerate(families(rho_max, samples)):
            for curve in family:
                shown = reversed_force(curve) if leg == 1 else curve
                _draw_curve(axes, shown, DIRECTION, FORCE, style.LEGS[leg], only_first=only_first)
        for found in solutions(rho_max):
            if not only_first or found.modes == (1, 1):
                force = found.rods[0].force
                direction = math.degrees(math.atan2(force[1], force[0]))
                mark(axes, direction, math.hypot(*force), is_stable=found.is_stable)
        axes.set(xlim=(-180, 180), xticks=range(-180, 181, 90), xlabel="direction of force 1, of force 2 + 180° (°)")
    panels[0].set(ylabel="force R (N)", title="(a) both rods in mode 1")
    panels[1].set(title=f"(b) all modes, ρ ≤ {rho_max:g}")
    panels[0].set_ylim(bottom=0.0)
    _add_legend(figure, legs=True)
    rows = []
    for found in solutions(rho_max):
        force = found.rods[0].force
        direction = math.degrees(math.atan2(force[1], force[0]))
        modes = ", ".join(map(str, found.modes))
        rows.append((modes, fixed(math.hypot(*force)), fixed(direction, 1), str(found.index)))
    return Plate(figure, ("modes", "R (N)", "direction of force 1 (°)", "index"), tuple(rows))


def make_solutions(rho_max: float = 9.0) -> Plate:
    """Make figure 12: the solutions, with the forces of the end-effector on the rods."""
    found = solutions(rho_max)
    figure = style.new_figure(8.0, 4.4)
    panels = figure.subplots(2, len(found) // 2 + 1, squeeze=False, sharex=True, sharey=True)
    rows = []
    for axes, own in zip(panels.flat, found, strict=False):
        draw_equilibrium(axes, own)
        for part, colour in zip(own.rods, style.LEGS, strict=True):
            draw_force(axes, own.pose, part.force, _ARROW, colour)
        modes = ", ".join(map(str, own.modes))
        axes.set_title(f"modes {modes}\n{fixed(own.energy)} J, {verdict(own)}")
        inputs = listed(np.degrees(own.inputs), 2)
        eigenvalues = listed(np.linalg.eigvalsh(own.stiffness), 2)
        rows.append((fixed(own.energy), modes, str(own.index), eigenvalues, inputs))
    panels[0, 0].set(xlim=(-0.42, 0.72), ylim=(-0.27, 0.7))
    for axes in panels.flat:
        style.label_metres(axes)
    for axes, above in zip(panels[1], panels[0], strict=True):
        if axes not in panels.flat[: len(found)]:
            axes.set_axis_off()
            above.tick_params(labelbottom=True)
            above.set_xlabel("x (m)")
    arrows = [Line2D([], [], color=own, label=f"force on rod {i + 1}") for i, own in enumerate(style.LEGS)]
    panels.flat[-1].legend(handles=[*stability_legend(), *arrows], loc="center left")
    return Plate(figure, ("energy (J)", "modes", "index", "eigenvalues of K (N/m)", "inputs (°)"), tuple(rows))


def reversed_force(curve: Array) -> Array:
    """Family with the direction of the force turned round."""
    turned = curve.copy()
    turned[:, DIRECTION] = np.where(curve[:, DIRECTION] < 0.0, 180.0, -180.0) + curve[:, DIRECTION]
    return turned


def _family(leg: Leg, rho_max: float, samples: int) -> tuple[Array, ...]:
    """Curves of equilibria of one rod with the distance from motor to end-effector: a level of a map over its loads."""
    span = np.array(POSE) - np.array(leg.actuator.base)
    distance = math.hypot(*span) / leg.rod.length
    rhos, slopes = np.linspace(1e-3, rho_max, samples), np.linspace(-1.0, 1.0, 2 * samples)
    levels = np.empty((slopes.size, rhos.size))
    for i, slope in enumerate(slopes):
        for j, rho in enumerate(rhos):
            point = rod(*_load(rho, slope))
            levels[i, j] = math.hypot(point.tip_x, point.tip_y) - distance
    lines = contour_generator(x=rhos, y=slopes, z=levels, line_type=LineType.Separate).lines(0.0)
    curves = []
    for line in lines:
        loads = [_polished(np.array(_load(rho, slope)), distance) for rho, slope in np.asarray(line)]
        curves.append(np.array([_row(load, leg, span) for load in loads]))
    return tuple(curves)


def _load(rho: float, slope: float) -> tuple[float, float]:
    """Load at the tip; equal steps of `slope` resolve the exponentially small tip angles of taut rods."""
    b = math.copysign(math.pi * math.expm1(rho * abs(slope)) / math.expm1(rho), slope)
    return rho**2 * math.cos(b), -(rho**2) * math.sin(b)


def _polished(load: Array, distance: float) -> Array:
    """Load near this one with the tip at the distance, by Newton's method along the gradient."""
    for _ in range(_NEWTON_STEPS):
        point = rod(load[0], load[1])
        miss = 0.5 * (point.tip_x**2 + point.tip_y**2 - distance**2)
        tip = np.array([point.tip_x, point.tip_y])
        gradient = tip @ np.array([[point.tip_x_gx, point.tip_x_gy], [point.tip_y_gx, point.tip_y_gy]])
        load = load - miss * gradient / (gradient @ gradient)
    return load


def _row(load: Array, leg: Leg, span: Array) -> list[float]:
    point, (modulus, psi, mode, rho) = rod(load[0], load[1]), rod_parameters(load[0], load[1])
    clamp = math.degrees(math.atan2(span[1], span[0]) - math.atan2(point.tip_y, point.tip_x))
    psi_deg = math.degrees(psi)
    force = rho**2 * leg.rod.bending_stiffness / leg.rod.length**2
    return [modulus, psi_deg, mode, _turn(clamp), force, _turn(clamp + psi_deg)]


def _turn(angle_deg: float) -> float:
    """Angle in [-180, 180)."""
    return (angle_deg + 180.0) % 360.0 - 180.0


def _draw_curve(axes: Axes, curve: Array, x: int, y: int, colour: str, *, only_first: bool = False) -> None:
    """Draw one coordinate of a family over another, mode by mode, broken where an angle jumps by a turn."""
    jumps = (np.abs(np.diff(curve[:, x])) > 180.0) | (np.abs(np.diff(curve[:, y])) > 180.0)
    jumps |= np.diff(np.sign(curve[:, MODULUS])) != 0.0
    for part in np.split(curve, np.flatnonzero(jumps | (np.diff(curve[:, MODE]) != 0.0)) + 1):
        mode = int(part[0, MODE])
        if mode == 1 or not only_first:
            line, width = _LINES[mode]
            axes.plot(part[:, x], part[:, y], color=colour, linestyle=line, linewidth=width, zorder=2)


def _add_legend(figure: Figure, *, legs: bool) -> None:
    colours = [Line2D([], [], color=own, linewidth=2.0, label=f"leg {i + 1}") for i, own in enumerate(style.LEGS)]
    modes = [
        Line2D([], [], color=style.METAL, linestyle=line, linewidth=width, label=f"mode {mode}")
        for mode, (line, width) in _LINES.items()
    ]
    handles = [*(colours if legs else []), *modes, *stability_legend(marks=True)]
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles))
