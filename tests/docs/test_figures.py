"""The figures of the documentation: each is made on a small scale, and what they compute is right."""

from collections.abc import Callable

import numpy as np
import pytest

from pcm_gym.arrays import Array

pytest.importorskip("matplotlib")

from docs.figures import (
    energy_landscape,
    inverse_problem,
    rod_modes,
    rod_parameters,
    singular_poses,
    solution_sets,
    style,
    workspaces,
)
from docs.figures.catalogue import FIGURES
from docs.figures.held_rod import HeldRod
from docs.figures.page import PAGE, image_name, with_tables
from docs.figures.plate import Plate, fixed
from docs.figures.rods import held_index, load_from_parameters
from pcm_gym.kernels.rods.rod import rod
from pcm_gym.kernels.rods.rod import rod_parameters as parameters_of
from pcm_gym.mechanism import get_mechanism
from pcm_gym.solving import solve_forward

SMALL: dict[int, Callable[[], Plate]] = {
    3: lambda: rod_modes.make(modes=2),
    6: lambda: rod_parameters.make(samples=12, pixels=40),
    8: lambda: solution_sets.make_forward(rho_max=7.0),
    9: lambda: solution_sets.make_inverse(rho_max=7.0),
    10: lambda: inverse_problem.make_rods(samples=40),
    11: lambda: inverse_problem.make_balance(samples=40),
    12: inverse_problem.make_solutions,
    13: lambda: energy_landscape.make(samples=5, inputs=1),
    14: lambda: workspaces.make(pitch=0.1, input_cells=16),
    15: lambda: singular_poses.make(forward_grid=2, inverse_grid=3, rho_max=6.0),
}


def test_every_figure_is_tried() -> None:
    assert SMALL.keys() == FIGURES.keys()


@pytest.mark.parametrize("number", SMALL)
def test_figure_is_made_and_equal_twice(number: int, tmp_path) -> None:
    files = []
    for name in ("first.png", "second.png"):
        with style.settings():
            plate = SMALL[number]()
            style.save_png(plate.figure, tmp_path / name)
        files.append((tmp_path / name).read_bytes())
        assert plate.rows
        assert {len(row) for row in plate.rows} == {len(plate.columns)}
    assert files[0] == files[1]


@pytest.mark.parametrize("number", [3, 8, 9, 12])
def test_page_has_the_present_numbers(number: int) -> None:
    page = PAGE.read_text(encoding="utf-8")
    with style.settings():
        assert with_tables(page, {number: FIGURES[number]()}) == page


@pytest.mark.parametrize("number", FIGURES)
def test_page_shows_the_picture(number: int) -> None:
    assert f"](images/{image_name(number)})" in PAGE.read_text(encoding="utf-8")
    assert (PAGE.parent / "images" / image_name(number)).is_file()


def test_page_without_a_place_is_refused() -> None:
    with pytest.raises(ValueError, match="figure 99"):
        with_tables("", {99: SMALL[3]()})


def test_no_negative_zero() -> None:
    assert fixed(-1e-9, 2) == "0.00"


@pytest.mark.parametrize("modulus", [0.9, -0.9])
@pytest.mark.parametrize("mode", [1, 2, 3])
@pytest.mark.parametrize("psi", [1.2, 2.9, 4.4])
def test_load_from_parameters_is_the_inverse_of_the_kernel(modulus: float, psi: float, mode: int) -> None:
    found = parameters_of(*load_from_parameters(modulus, psi, mode))
    np.testing.assert_allclose(found[:3], (modulus, psi, mode), rtol=1e-12)


@pytest.mark.parametrize("load", [(-20.0, 15.0), (-45.0, 3.0), (-60.0, -30.0), (30.0, 20.0), (-5.0, 2.0)])
def test_held_rod_has_as_many_falling_directions_as_its_index(load: tuple[float, float]) -> None:
    curvatures, _ = HeldRod(np.array(load), segments=120).curvatures
    assert (curvatures < 0.0).sum() == held_index(rod(*load))


def test_energy_along_a_path_has_the_stiffness_as_its_curvature() -> None:
    found = solve_forward(get_mechanism("2RFR-paper"), (0.6, 2.2))[0]
    size = 1e-3
    for direction in np.eye(2):
        there, back = (energy_landscape.reduced_energy(found, side * size * direction[None])[0] for side in (1.0, -1.0))
        assert (there + back) / size**2 == pytest.approx(direction @ found.stiffness @ direction, rel=1e-3)


def test_forces_of_the_families_cross_at_the_solutions_alone() -> None:
    """A picture's curves, cut with each other, against the solver's own search."""
    first, second = inverse_problem.families(rho_max=9.0, samples=200)
    crossings = sum(
        count_crossings(
            one[:, [inverse_problem.DIRECTION, inverse_problem.FORCE]],
            inverse_problem.reversed_force(other)[:, [inverse_problem.DIRECTION, inverse_problem.FORCE]],
        )
        for one in first
        for other in second
    )
    assert crossings == len(inverse_problem.solutions(9.0))


def count_crossings(one: Array, other: Array) -> int:
    """Pairs of segments of two polylines that cross, segments over the seam of the angle left out."""
    starts, steps = split(one)
    other_starts, other_steps = split(other)
    gaps = other_starts[None] - starts[:, None]
    areas = cross(steps[:, None], other_steps[None])
    along, across = cross(gaps, other_steps[None]) / areas, cross(gaps, steps[:, None]) / areas
    return int(((along >= 0.0) & (along < 1.0) & (across >= 0.0) & (across < 1.0)).sum())


def split(line: Array) -> tuple[Array, Array]:
    steps = np.diff(line, axis=0)
    whole = np.abs(steps[:, 0]) < 180.0
    return line[:-1][whole], steps[whole]


def cross(one: Array, other: Array) -> Array:
    return one[..., 0] * other[..., 1] - one[..., 1] * other[..., 0]
