"""States to draw: of each catalogued mechanism, equilibria at given inputs found from random rods."""

import itertools
from functools import cache

import numpy as np
import pytest

from pcm_gym.kernels.equilibrium import search_forward
from pcm_gym.mechanism import Mechanism, get_mechanism, mechanism_names
from pcm_gym.solving import BranchTracker, Equilibrium

START_COUNT = 4000
LOAD_MAX = 20.0  # rho up to 5.3: loops and crossings
KEPT_COUNT = 12  # of the most stable, and of the least


def search(mechanism: Mechanism, inputs: np.ndarray) -> list[Equilibrium]:
    """Equilibria at these inputs, unloaded, the stable ones first."""
    random = np.random.default_rng(0)
    starts = random.uniform(-LOAD_MAX, LOAD_MAX, (START_COUNT, mechanism.state_size))
    starts[:, -1] = random.uniform(-np.pi, np.pi, START_COUNT)
    found = np.empty_like(starts)
    count = search_forward(mechanism.leg_table, inputs / mechanism.units.inputs, np.zeros(mechanism.dof), starts, found)
    rods = found[:count, : 2 * mechanism.leg_count]
    kept = found[:count][np.abs(rods).max(axis=1, initial=0.0) < 3.0 * LOAD_MAX]
    equilibria = [Equilibrium(mechanism, state, inputs, np.zeros(mechanism.dof)) for state in kept]
    return sorted(equilibria, key=lambda equilibrium: (equilibrium.index, equilibrium.energy))


@cache
def home_equilibria(name: str) -> list[Equilibrium]:
    mechanism = get_mechanism(name)
    found = search(mechanism, np.array(mechanism.home_inputs))
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
