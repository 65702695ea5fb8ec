"""What is known of the equilibria along a way, one parameter in inputs and load, and its equations near one of them."""

import math

from pcm_gym.arrays import Array
from pcm_gym.kernels.branches.problem import Problem, make_tracer_of
from pcm_gym.kernels.branches.tracer import place_at
from pcm_gym.kernels.numerics.compilation import kernel
from pcm_gym.kernels.statics.closure import Workspace, make_workspace, set_matrix, set_path_derivative, set_residual
from pcm_gym.kernels.statics.equilibrium import total_energy
from pcm_gym.kernels.statics.margin import singularity_margin
from pcm_gym.kernels.statics.stability import assess_stability

# Columns of what `describe_way` fills.
ENERGY, MORSE_INDEX, STABILITY_MARGIN, SINGULARITY_MARGIN, LARGEST_RHO = range(5)
FACT_COLUMNS = 5


@kernel
def describe_way(legs: Array, path: Array, problem: Problem, facts: Array) -> None:
    """Fill `facts` (n, 5) with what is known of each point (n, size + 1) of a way."""
    t = make_tracer_of(legs, problem)
    size = path.shape[1] - 1
    work = make_workspace(legs.shape[0], size)
    for n in range(path.shape[0]):
        t.trial[:] = path[n]
        place_at(legs, t.trial, t, work)
        verdict = assess_stability(legs, t.trial_x, work)
        facts[n, ENERGY] = total_energy(legs, t.trial_x, t.load)
        facts[n, MORSE_INDEX] = verdict.morse_index
        facts[n, STABILITY_MARGIN] = verdict.stability_margin
        facts[n, SINGULARITY_MARGIN] = singularity_margin(legs, t.trial_x, work)
        largest = 0.0
        for i in range(legs.shape[0]):
            largest = max(largest, math.sqrt(math.hypot(path[n, 2 * i], path[n, 2 * i + 1])))
        facts[n, LARGEST_RHO] = largest


@kernel
def set_equations(legs: Array, y: Array, problem: Problem, residual: Array, matrix: Array) -> None:
    """Fill `residual` (size,) and `matrix` (size, size + 1), its derivative by state and parameter, at a point."""
    t, size = make_tracer_of(legs, problem), residual.shape[0]
    work: Workspace = make_workspace(legs.shape[0], size)
    place_at(legs, y, t, work)
    set_residual(legs, y[:size], t.load, work)
    residual[:] = work.residual
    set_matrix(legs, y[:size], work)
    matrix[:, :size] = work.matrix[:size, :size]
    set_path_derivative(legs, y[:size], t.input_rates[0], t.load_rates[0], work, work.step)
    matrix[:, size] = work.step
