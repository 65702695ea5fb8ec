"""States to draw: of each catalogued mechanism, equilibria at its home inputs."""

import itertools
from functools import cache

import pytest

from pcm_gym.mechanism import Mechanism, get_mechanism, mechanism_names
from pcm_gym.solving import BranchTracker, Equilibrium, solve_forward

RHO_MAX = {2: 10.0, 3: 7.0}  # loops and crossings, by degrees of freedom
KEPT_COUNT = 12  # of the most stable, and of the least


@cache
def home_equilibria(name: str) -> list[Equilibrium]:
    """Return equilibria at the home inputs, the stable ones first."""
    mechanism = get_mechanism(name)
    assert mechanism.home_inputs is not None
    found = list(solve_forward(mechanism, mechanism.home_inputs, rho_max=RHO_MAX[mechanism.dof]))
    found.sort(key=lambda equilibrium: (equilibrium.index, equilibrium.energy))
    return found if len(found) < 2 * KEPT_COUNT else found[:KEPT_COUNT] + found[-KEPT_COUNT:]


@pytest.fixture(params=mechanism_names())
def mechanism(request: pytest.FixtureRequest) -> Mechanism:
    return get_mechanism(request.param)


@pytest.fixture
def equilibria(mechanism: Mechanism) -> list[Equilibrium]:
    """Equilibria at the home inputs, the first of them stable and the last unstable."""
    return home_equilibria(mechanism.name)


@pytest.fixture
def stable(equilibria: list[Equilibrium]) -> Equilibrium:
    assert equilibria[0].is_stable
    return equilibria[0]


@pytest.fixture
def unstable(equilibria: list[Equilibrium]) -> Equilibrium:
    assert not equilibria[-1].is_stable
    return equilibria[-1]


@pytest.fixture
def equilibria_towards_limits(mechanism: Mechanism, equilibria: list[Equilibrium]) -> list[Equilibrium]:
    """Branches followed from home to every corner of the inputs' limits, or to the fold on the way."""
    limits = [leg.actuator.limits for leg in mechanism.legs]
    return [
        BranchTracker(mechanism, start, follow_index_changes=True).step(corner).equilibrium
        for start in equilibria
        for corner in itertools.product(*limits)
    ]
