"""Which curve of equilibria is traced."""

from typing import NamedTuple

import numpy as np

from pcm_gym.arrays import Array
from pcm_gym.kernels.branches.tracer import REGULAR, Tracer, make_tracer
from pcm_gym.kernels.numerics.compilation import kernel


class Parameters(NamedTuple):
    """What the parameters p are: inputs and load are linear in them."""

    inputs: Array  # (legs,): where all are 0
    load: Array  # (d,)
    input_rates: Array  # (m, legs)
    load_rates: Array  # (m, d)


def inputs_as_parameters(load: Array) -> Parameters:
    """Return the parameters that are the inputs themselves, as many as degrees of freedom, under a load."""
    count = len(load)
    return Parameters(np.zeros(count), load, np.eye(count), np.zeros((count, count)))


class Problem(NamedTuple):
    """Which curve is traced."""

    parameters: Parameters  # m of them; of singular states they are the inputs
    conditions: Array  # (k, size + m): linear functions of the unknowns that stay constant
    box: Array  # (size + m, 3): least and largest value of each unknown, and its period (0: none)
    rho_max: float
    kind: int  # of the singularity: FORWARD or INVERSE
    is_singular: bool  # whether its states are singular, or those of a line are watched for singular ones


@kernel
def make_tracer_of(legs: Array, problem: Problem) -> Tracer:
    """Return a tracer along the curves of a problem."""
    own = problem.parameters
    singularity = problem.kind if problem.is_singular else REGULAR
    size = 2 * legs.shape[0] + own.load.shape[0]
    t = make_tracer(legs.shape[0], size, problem.conditions.copy(), singularity, False)
    t.first_inputs[:], t.first_load[:] = own.inputs, own.load
    t.input_rates[:], t.load_rates[:] = own.input_rates, own.load_rates
    return t
