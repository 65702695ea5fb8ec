"""The pictures of the ideas: they can be drawn, and the branch that they follow ends where its stability does."""

from collections.abc import Callable

import numpy as np
import pytest

pytest.importorskip("matplotlib")

from matplotlib.figure import Figure

import pcm_gym
from docs.figures import style
from docs.ideas import branches, fall, folds, gradients, line
from docs.ideas.__main__ import IMAGES, PICTURES

SMALL: dict[str, Callable[[], Figure]] = {
    "branches": lambda: branches.draw(places=3),
    "folds": lambda: folds.draw(grid=2),
    "fall": fall.draw,
    "gradients": lambda: gradients.draw(rays=4),
}


@pytest.mark.parametrize("name", PICTURES)
def test_picture_can_be_drawn_and_is_there(name: str) -> None:
    with style.settings():
        assert SMALL[name]().axes
    assert (IMAGES / f"{name}.png").is_file()


def test_branch_ends_in_a_fold_beyond_which_its_equilibria_are_missing() -> None:
    """The sets on both sides, enumerated without following anything, differ by the pair that meets there."""
    ended = fall.end_of_branch()
    assert ended.event is pcm_gym.Event.FOLD
    degrees = float(np.degrees(ended.equilibrium.inputs[1]))
    before, after = (line.all_at(degrees + side) for side in (-1.0, 1.0))
    assert len(before.stable) - len(after.stable) == 1
    assert sum(own.index == 1 for own in before) - sum(own.index == 1 for own in after) == 1


def test_gradients_grow_like_one_over_the_square_root_of_the_distance_from_a_fold() -> None:
    margins, norms = gradients.along_rays(8)
    near = margins < 1e-3
    assert np.count_nonzero(near) > 20
    slope, _ = np.polyfit(np.log(margins[near]), np.log(norms[near]), 1)
    assert abs(slope + 0.5) < 0.1
