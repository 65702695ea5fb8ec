"""Figure 13: the energy about two unstable poses: a saddle that K shows, and a loss of stability that it does not."""

import math
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes

from docs.figures import style
from docs.figures.drawing import draw_equilibrium, mark
from docs.figures.held_rod import HeldRod, HeldShape
from docs.figures.plate import Plate, fixed, listed
from docs.figures.rods import held_index, load_for_tip
from pcm_gym import Equilibrium, get_mechanism, solve_forward
from pcm_gym.arrays import Array
from pcm_gym.kernels.rods.rod import rod, rod_energy

_MECHANISM = "2RFR-paper"
_MILLI = 1e3
_FARTHEST_ANGLE = 0.3  # rms over the buckling rod, rad
_LETTERS = ("abc", "def")


@dataclass(frozen=True)
class _Case:
    """An unstable equilibrium and how much is shown about it.

    Attributes
    ----------
    inputs_deg : tuple of float
    modes : tuple of int
    is_definite : bool
        Whether K is positive definite, and the instability hidden from it.
    reach : float
        Half the side of the square of poses, m.
    """

    inputs_deg: tuple[float, float]
    modes: tuple[int, int]
    is_definite: bool
    reach: float


_CASES = (_Case((120.0, -60.0), (1, 1), False, 0.12), _Case((60.0, 120.0), (1, 2), True, 0.03))


def make(samples: int = 41, inputs: int = 16) -> Plate:
    """Make the figure from the energy at so many poses along each axis, and the census at so many inputs of a motor."""
    figure = style.new_figure(8.0, 5.4)
    rows = []
    for case, line, letters in zip(_CASES, figure.subplots(2, 3), _LETTERS, strict=True):
        found = _equilibrium(case)
        _draw_pose(line[0], found)
        _draw_map(line[1], found, case.reach, samples)
        directions = _draw_sections(line[2], found, case.reach, samples)
        buckled = _draw_buckling(line[0], line[2], found)
        sign = "positive definite" if case.is_definite else "indefinite"
        titles = (f"K {sign}, index {found.index}", "energy over the pose (mJ)", "energy along directions")
        for axes, letter, title in zip(line, letters, titles, strict=True):
            axes.set_title(f"({letter}) {title}")
        rows.append(
            (
                f"({letters[0]})",
                listed(case.inputs_deg, 0),
                listed(found.pose),
                ", ".join(map(str, found.modes)),
                listed(directions, 2),
                str(found.index),
                fixed(_MILLI * min((shape.energy for shape in buckled), default=0.0), 1) if buckled else "none",
            )
        )
    headings = (
        "pose",
        "inputs (°)",
        "x, y (m)",
        "modes",
        "eigenvalues of K (N/m)",
        "index",
        "change inside a rod (mJ)",
    )
    return Plate(figure, headings, tuple(rows), _census(inputs))


def reduced_energy(found: Equilibrium, steps: Array) -> Array:
    """Energy, less that of the equilibrium, with the end-effector moved along a path from it at the same inputs.

    Parameters
    ----------
    steps : array (n, 2)
        Displacements along the path, m, small apart; the first is near zero.

    Returns
    -------
    array (n,)
        In J; nan from where a rod's branch ends.
    """
    mechanism, loads = found.mechanism, found.state[:4].reshape(2, 2).copy()
    energies = np.full(len(steps), np.nan)
    for n, step in enumerate(steps):
        energy = -found.energy
        for i, (leg, angle) in enumerate(zip(mechanism.legs, found.inputs, strict=True)):
            c, s = math.cos(leg.actuator.clamp_angle + angle), math.sin(leg.actuator.clamp_angle + angle)
            span = (found.pose + step - np.array(leg.actuator.base)) / leg.rod.length
            load = load_for_tip(np.array([c * span[0] + s * span[1], c * span[1] - s * span[0]]), loads[i])
            if load is None:
                return energies
            loads[i] = load
            energy += leg.rod.bending_stiffness / leg.rod.length * rod_energy(load[0], load[1])
        energies[n] = energy
    return energies


def _equilibrium(case: _Case) -> Equilibrium:
    found = solve_forward(get_mechanism(_MECHANISM), np.radians(case.inputs_deg), modes=case.modes)
    return next(own for own in found if not own.is_stable and (own.stability_margin > 0.0) == case.is_definite)


def _census(inputs: int) -> str:
    """How often K alone would be wrong, over a grid of inputs that avoids their symmetries."""
    mechanism = get_mechanism(_MECHANISM)
    angles = 2.0 * math.pi * (np.arange(inputs) + 0.3) / inputs
    found = [own for first in angles for second in angles for own in solve_forward(mechanism, (first, second))]
    unstable = [own for own in found if not own.is_stable]
    hidden = sum(own.stability_margin > 0.0 for own in unstable)
    return (
        f"At {inputs} × {inputs} inputs over a full turn of both motors (ρ ≤ 9): {len(found)} equilibria, "
        f"{len(found) - len(unstable)} of them stable. "
        f"K is positive definite at {hidden} of the {len(unstable)} unstable ones."
    )


def _draw_pose(axes: Axes, found: Equilibrium) -> None:
    draw_equilibrium(axes, found)
    axes.set(aspect="equal", xlabel="x (m)", ylabel="y (m)")


def _draw_map(axes: Axes, found: Equilibrium, reach: float, samples: int) -> None:
    side = np.linspace(-reach, reach, samples)
    middle = samples // 2
    energies = np.empty((samples, samples))
    for j, y in enumerate(side):
        for half in (slice(middle, None), slice(middle, None, -1)):  # outwards from the middle of each line
            steps = np.stack([side[half], np.full(side[half].size, y)], axis=1)
            approach = np.linspace([0.0, 0.0], steps[0], samples)
            energies[j, half] = reduced_energy(found, np.vstack([approach, steps]))[samples:]
    levels = 14
    x, y = (centre + side for centre in found.pose)
    axes.contourf(x, y, _MILLI * energies, levels, cmap=style.ENERGY)
    lines = axes.contour(x, y, _MILLI * energies, levels, colors=style.METAL, linewidths=0.5, linestyles="solid")
    axes.clabel(lines, list(lines.levels)[::2], fontsize=6.5, fmt="%g")
    mark(axes, found.pose[0], found.pose[1], is_stable=found.is_stable)
    axes.set(aspect="equal", xlabel="x (m)", ylabel="y (m)")


def _draw_sections(axes: Axes, found: Equilibrium, reach: float, samples: int) -> Array:
    """Draw the energy along the eigenvectors of K, and the parabolas that K makes of it; return the eigenvalues."""
    eigenvalues, eigenvectors = np.linalg.eigh(found.stiffness)
    parts = np.linspace(0.0, reach, samples)
    for value, vector, colour, name in zip(eigenvalues, eigenvectors.T, style.LEGS, ("soft", "stiff"), strict=True):
        ways = [reduced_energy(found, side * parts[:, None] * vector) for side in (-1.0, 1.0)]
        energies = np.concatenate([ways[0][:0:-1], ways[1]])
        places = np.concatenate([-parts[:0:-1], parts])
        axes.plot(_MILLI * places, _MILLI * energies, color=colour, linewidth=1.8, label=f"pose, {name} way")
        axes.plot(_MILLI * places, _MILLI * 0.5 * value * places**2, color=colour, linewidth=0.8, linestyle=":")
    axes.set(xlabel="displacement (mm)", ylabel="energy (mJ)")
    return eigenvalues


def _draw_buckling(plane: Axes, section: Axes, found: Equilibrium) -> list[HeldShape]:
    """Draw how a rod that is unstable with its tip held buckles, and how its energy falls; return the shapes."""
    shapes: list[HeldShape] = []
    for i, (leg, angle) in enumerate(zip(found.mechanism.legs, found.inputs, strict=True)):
        load = np.array(found.state[2 * i : 2 * i + 2])
        if held_index(rod(load[0], load[1])) == 0:
            continue
        shapes = list(HeldRod(load).descend(_FARTHEST_ANGLE, count=24))
        c, s = math.cos(leg.actuator.clamp_angle + angle), math.sin(leg.actuator.clamp_angle + angle)
        for shape in (shapes[0], shapes[-1]):
            line = np.array(leg.actuator.base) + leg.rod.length * shape.points @ np.array([[c, s], [-s, c]])
            plane.plot(*line.T, color=style.ACCENT, linewidth=1.0, zorder=2)
        scale = leg.rod.bending_stiffness / leg.rod.length
        shapes = [HeldShape(own.points, scale * own.energy, leg.rod.length * own.deflection) for own in shapes]
        section.plot(
            [_MILLI * own.deflection for own in shapes],
            [_MILLI * own.energy for own in shapes],
            color=style.ACCENT,
            linewidth=1.8,
            label=f"inside rod {i + 1}",
        )
    section.legend(loc="best")
    return shapes
