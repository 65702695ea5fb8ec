"""Which function makes which figure of the paper."""

from collections.abc import Callable

from docs.figures import (
    energy_landscape,
    inverse_problem,
    rod_modes,
    rod_parameters,
    singular_poses,
    solution_sets,
    workspaces,
)
from docs.figures.plate import Plate

FIGURES: dict[int, Callable[[], Plate]] = {
    3: rod_modes.make,
    6: rod_parameters.make,
    8: solution_sets.make_forward,
    9: solution_sets.make_inverse,
    10: inverse_problem.make_rods,
    11: inverse_problem.make_balance,
    12: inverse_problem.make_solutions,
    13: energy_landscape.make,
    14: workspaces.make,
    15: singular_poses.make,
}
