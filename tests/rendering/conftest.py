"""States to draw: of each catalogued mechanism, equilibria at its home inputs."""

import itertools
from functools import cache

import numpy as np
import pytest

from pcm_gym.kernels.equilibrium import search_forward
from pcm_gym.kernels.rod_table import make_rod_table
from pcm_gym.mechanism import Mechanism, get_mechanism, mechanism_names
from pcm_gym.solving import BranchTracker, Equilibrium, solve_forward

RHO_MAX = 10.0  # loops and crossings
POSE_COUNT = 120  # near which a platform's equilibria are looked for: seconds less than all of them would take
TABLE_SHAPE = (72, 97)
KEPT_COUNT = 12  # of the most stable, and of the least


def near_random_poses(mechanism: Mechanism, inputs: np.ndarray) -> list[Equilibrium]:
    """Return different equilibria of a platform, unloaded; some, not all."""
    units, load = mechanism.units, np.zeros(mechanism.dof)
    poses = np.random.default_rng(0).uniform([-0.3, -0.3, -1.0], [0.3, 0.3, 1.0], (POSE_COUNT, 3)) / units.pose
    found = np.empty((100 * POSE_COUNT, mechanism.state_size))
    table = make_rod_table(RHO_MAX, *TABLE_SHAPE)
    found = found[: search_forward(mechanism.leg_table, inputs / units.inputs, load, poses, table, found)]
    found = found[np.abs(found[:, : 2 * mechanism.leg_count]).max(axis=1) < RHO_MAX**2]
    _, keep = np.unique(np.round(found, 6), axis=0, return_index=True)
    return [Equilibrium(mechanism, found[row], inputs, load) for row in keep]


@cache
def home_equilibria(name: str) -> list[Equilibrium]:
    """Return equilibria at the home inputs, the stable ones first."""
    mechanism = get_mechanism(name)
    inputs = np.array(mechanism.home_inputs)
    if mechanism.dof == 2:
        found = list(solve_forward(mechanism, inputs, rho_max=RHO_MAX))
    else:
        found = near_random_poses(mechanism, inputs)
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
