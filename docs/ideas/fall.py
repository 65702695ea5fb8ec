"""A fall: from the end of a branch to where the rods come to rest."""

import numpy as np
from matplotlib.figure import Figure

from docs.figures import style
from docs.figures.drawing import draw_equilibrium, draw_rods
from docs.ideas import line
from docs.ideas.branches import PLACE
from pcm_gym import BranchTracker, Equilibrium, TrackedStep, snap

_SHAPES = 8


def draw() -> Figure:
    """Draw the way to a fold, what the mechanism falls to, and the energy on the way."""
    ended = end_of_branch()
    landing = snap(ended.equilibrium)
    figure = style.new_figure(8.0, 3.2)
    before, after, energies = figure.subplots(1, 3)
    for own in _way(ended):
        draw_rods(before, own, width=0.7, colour=style.METAL)
    draw_equilibrium(before, ended.equilibrium, colour=style.ACCENT)
    before.set_title("to the end of the branch")
    draw_rods(after, ended.equilibrium, width=0.7, colour=style.ACCENT)
    draw_equilibrium(after, landing.equilibrium)
    after.set_title("and down")
    for axes in (before, after):
        axes.set(xlim=(-0.75, 0.75), ylim=(-0.55, 0.95))
        style.label_metres(axes)
    energies.plot(landing.energies, color=style.STABLE)
    energies.set(xlabel="step of the fall", ylabel="energy (J)", title="energy on the way")
    return figure


def end_of_branch() -> TrackedStep:
    """Return the step that ends in a fold, on the line, from the stable equilibrium that has one ahead."""
    target = np.array(line.inputs_at(line.LAST))
    steps = [BranchTracker(line.mechanism(), own).step(target) for own in line.all_at(PLACE).stable]
    (ended,) = (step for step in steps if step.event)
    return ended


def _way(ended: TrackedStep) -> list[Equilibrium]:
    """Return equilibria of the branch from the place where the shapes are shown to its end."""
    target = ended.equilibrium
    tracker, back = BranchTracker(line.mechanism(), target), np.array(line.inputs_at(PLACE)) - target.inputs
    return [tracker.step(target.inputs + part * back).equilibrium for part in np.linspace(0.02, 1.0, _SHAPES)]
