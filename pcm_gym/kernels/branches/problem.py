"""Which curve of equilibria is traced."""

from typing import NamedTuple

import numpy as np

from pcm_gym.arrays import Array


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
