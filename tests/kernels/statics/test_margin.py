"""The singularity margin: against differences of the stiffness along tracked steps, and in lanes against the scalar."""

import numba
import numpy as np
import pytest

import pcm_gym
from pcm_gym.environments.settings import Settings
from pcm_gym.environments.simulation import Simulation
from pcm_gym.kernels.rods.curvature import bend, lag_in_lanes, rod_bend, rod_curvature
from pcm_gym.kernels.rods.rod import rod, rod_in_lanes
from pcm_gym.kernels.statics.equilibrium import SINGULARITY_MARGIN as MARGIN
from pcm_gym.kernels.statics.equilibrium import describe_equilibrium
from pcm_gym.kernels.statics.margin import STIFF
from pcm_gym.solving import BranchTracker, Equilibrium, Event, home_equilibrium, solve_forward

NAMES = ("2RFR", "2PFR", "3PFR")
# Places and weights of a first difference of fourth order, times 12 widths.
STENCIL = ((-2.0, 1.0), (-1.0, -8.0), (1.0, 8.0), (2.0, -1.0))
LOADS = {"2RFR": (0.25, -0.5), "2PFR": (0.5, -0.25), "3PFR": (0.125, -0.25, 0.05)}


def by_differences(equilibrium: Equilibrium, width: float) -> float:
    """Return the least distance at which a squared eigenvalue of the stiffness would vanish if it were linear."""
    mechanism, eigenvalues = equilibrium.mechanism, []
    units = mechanism.units
    for direction in np.concatenate([np.eye(mechanism.leg_count), -np.eye(mechanism.leg_count)]):
        step = BranchTracker(mechanism, equilibrium).step(equilibrium.inputs + width * direction * units.inputs)
        assert step.event is Event.NONE
        eigenvalues.append(np.linalg.eigvalsh(step.equilibrium.stiffness / units.stiffness))
    ahead, behind = np.split(np.array(eigenvalues), 2)
    slopes = np.linalg.norm((ahead - behind) / (2.0 * width), axis=0)
    size = np.abs(np.linalg.eigvalsh(equilibrium.stiffness / units.stiffness))
    return float(np.min(size * (1.0 + (size / STIFF) ** 2) / (2.0 * slopes)))


@pytest.mark.parametrize("is_loaded", [False, True], ids=["free", "loaded"])
@pytest.mark.parametrize("name", NAMES)
def test_margin_is_that_of_the_tracked_stiffness(name: str, is_loaded: bool) -> None:
    mechanism, generator = pcm_gym.get_mechanism(f"{name}-paper"), np.random.default_rng(0)
    home, load = home_equilibrium(mechanism), LOADS[name] if is_loaded else None
    compared = 0
    for part in generator.uniform(-0.2, 0.2, (12, mechanism.leg_count)):
        inputs = home.inputs + part * (mechanism.upper_limits - mechanism.lower_limits)
        step = BranchTracker(mechanism, home).step(inputs, load)
        if step.event is Event.NONE and step.equilibrium.singularity_margin > 1e-2:
            compared += 1
            expected = min(by_differences(step.equilibrium, 1e-5), 10.0)
            assert step.equilibrium.singularity_margin == pytest.approx(expected, rel=1e-5)
    assert compared > 6


def test_margin_of_unstable_states_is_that_of_the_tracked_stiffness() -> None:
    mechanism = pcm_gym.get_mechanism("2RFR-paper")
    found = solve_forward(mechanism, [2.0, 1.0])
    unstable = [e for e in found if not e.is_stable and e.singularity_margin > 1e-2]
    assert len(unstable) > 5
    for equilibrium in unstable:
        expected = min(by_differences(equilibrium, 1e-6), 10.0)
        assert equilibrium.singularity_margin == pytest.approx(expected, rel=1e-4)


@numba.njit(error_model="numpy")
def bends_in_lanes(g: np.ndarray, steps: np.ndarray, out: np.ndarray) -> None:
    for n in range(len(g)):
        _, functions, _ = rod_in_lanes(g[n, 0], g[n, 1])
        curvature = rod_curvature(g[n, 0], g[n, 1], functions, lag_in_lanes(g[n, 0], g[n, 1], functions))
        bends = bend(g[n, 0], g[n, 1], curvature, steps[n, 0], steps[n, 1])
        for k in range(4):
            out[n, k] = bends[k]


def test_bend_of_a_rod_is_the_second_difference_along_its_path() -> None:
    """The path of constant rates of rho and b, from strongly loaded to nearly unloaded rods, all directions."""
    generator = np.random.default_rng(1)
    rho, b = generator.uniform(0.3, 9.0, 500), generator.uniform(-3.1, 3.1, 500)
    rates = generator.normal(size=(500, 2)) * [1.0, 0.3]

    def values(t: float) -> tuple[np.ndarray, np.ndarray]:
        own_rho, own_b = rho + t * rates[:, 0], b + t * rates[:, 1]
        g = np.column_stack([own_rho**2 * np.cos(own_b), -(own_rho**2) * np.sin(own_b)])
        return g, np.array([rod(*map(float, row))[:4] for row in g])

    width = 1e-3
    g, middle = values(0.0)
    near = (values(width)[1] - 2.0 * middle + values(-width)[1]) / width**2
    far = (values(2.0 * width)[1] - 2.0 * middle + values(-2.0 * width)[1]) / (2.0 * width) ** 2
    expected = (4.0 * near - far) / 3.0
    steps = np.column_stack(
        [
            2.0 * rho * rates[:, 0] * np.cos(b) - rho**2 * np.sin(b) * rates[:, 1],
            -2.0 * rho * rates[:, 0] * np.sin(b) - rho**2 * np.cos(b) * rates[:, 1],
        ]
    )
    found = np.empty((500, 4))
    bends_in_lanes(g, steps, found)
    scale = 1.0 + np.abs(expected).max(axis=1, keepdims=True)
    gentle = np.abs(far - near).max(axis=1) < 1e-3 * scale[:, 0]  # elsewhere the differences are too wide
    assert gentle.mean() > 0.8
    assert (np.abs(found - expected) / scale)[gentle].max() < 1e-6


def by_g(g: np.ndarray) -> tuple[np.ndarray, float]:
    """Return the derivatives of tip and force by g, (4, 2), and 1 + the size of the force."""
    point = rod(*map(float, g))
    return np.array(point[4:12]).reshape(4, 2), 1.0 + abs(point.force_x) + abs(point.force_y)


def loads_of(kind: str, generator: np.random.Generator) -> np.ndarray:
    rho, b = generator.uniform(0.23, 12.0), generator.uniform(-np.pi, np.pi)
    side = generator.choice([-1.0, 1.0])
    if kind == "nearly unloaded":
        rho = generator.uniform(0.0, 0.23)  # on both sides of the end of the power series
    elif kind == "taut":
        b = side * np.exp(-generator.uniform(0.2, 1.2) * rho)
    elif kind == "nearly straight":
        b = side * 10.0 ** generator.uniform(-12.0, -3.0)
    elif kind == "compressed":
        b = np.pi - side * 10.0 ** generator.uniform(-16.0, -2.0)
    elif kind == "straight":
        return np.array([rho**2, 0.0])
    return np.array([rho**2 * np.cos(b), -(rho**2) * np.sin(b)])


@pytest.mark.parametrize("kind", ["any", "nearly unloaded", "taut", "nearly straight", "compressed", "straight"])
def test_bend_of_a_rod_is_that_of_differences_where_its_path_does_not_matter(kind: str) -> None:
    """Force bends times tip motions less tip bends times force motions, for steps of order one of tip and force."""
    generator = np.random.default_rng(3)
    for _ in range(200):
        g = loads_of(kind, generator)
        own, force = by_g(g)
        scale = np.array([1.0, 1.0, 1.0 / force, 1.0 / force])[:, None]
        _, singular, axes = np.linalg.svd(scale * own)
        basis = axes.T / singular
        step = basis @ generator.normal(size=2)

        def product(bends: np.ndarray, motions: np.ndarray = own @ basis, force: float = force) -> np.ndarray:
            return (bends[2:] @ motions[:2] - bends[:2] @ motions[2:]) / force

        found, errors = product(np.array(rod_bend(*map(float, g), *map(float, step)))), []
        for width in (1e-3, 3e-4, 1e-4, 3e-5):  # strongly bent rods want narrow differences, others wide ones
            way = width / np.abs(scale[:, 0] * (own @ step)).max()
            weighted = [weight * by_g(g + place * way * step)[0] @ step for place, weight in STENCIL]
            expected = product(sum(weighted) / (12.0 * way))
            errors.append(np.abs(found - expected).max() / (1.0 + np.abs(expected).max()))
        assert min(errors) < 1e-7, g


@pytest.mark.parametrize("is_loaded", [False, True], ids=["free", "loaded"])
@pytest.mark.parametrize("name", NAMES)
def test_margin_in_lanes_is_the_scalar_one(name: str, is_loaded: bool) -> None:
    """On random walks that run into limits and folds: one condenses the rods, the other moves them one by one."""
    count, generator = 200, np.random.default_rng(2)
    settings = Settings.from_arguments(name, {"load": LOADS[name] if is_loaded else None})
    simulation, legs = Simulation(settings, count), np.array(settings.mechanism.leg_table)
    generators = [np.random.default_rng(row) for row in range(count)]
    simulation.reset_rows(np.arange(count), generators, None)
    held = generator.choice([-1.0, 1.0], (count, settings.mechanism.leg_count))
    stopped = 0
    for n in range(30):
        stepped = simulation.step(held if n % 3 else generator.uniform(-1.0, 1.0, held.shape), generators)
        found, states = stepped.verdicts["singularity_margin"], simulation.rows.states
        facts = [describe_equilibrium(legs, *(array[row].copy() for array in states)) for row in range(count)]
        expected = np.array([scalars[MARGIN] for scalars, *_ in facts])
        assert np.all((found >= 0.0) & (found < 10.0 + 1e-9))
        is_calm = stepped.verdicts["residual"] < 1e-12
        np.testing.assert_allclose(found[is_calm], expected[is_calm], rtol=1e-7, atol=1e-9)
        stopped += int(np.count_nonzero(np.isin(stepped.verdicts["event"], (1, 2))))
    assert stopped > 0 or name == "2PFR"
