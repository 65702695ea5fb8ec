"""The line of inputs that the pictures have in common: motor 1 stands still, motor 2 turns."""

import math

from pcm_gym import EquilibriumSet, Mechanism, get_mechanism, solve_forward

MECHANISM = "2RFR-paper"
# Motor 1 and the range of motor 2, degrees.
HELD, FIRST, LAST = 60.0, -60.0, 200.0
# Largest load of a rod that is shown: what lies above is unstable, and drawn over everything else.
RHO_MAX = 7.0


def mechanism() -> Mechanism:
    """Return the mechanism of the pictures."""
    return get_mechanism(MECHANISM)


def inputs_at(degrees: float) -> tuple[float, float]:
    """Return the inputs where motor 2 stands at this angle, rad."""
    return math.radians(HELD), math.radians(degrees)


def all_at(degrees: float) -> EquilibriumSet:
    """Return every equilibrium there."""
    return solve_forward(mechanism(), inputs_at(degrees), rho_max=RHO_MAX)
