"""One rod against multiple precision, integration of its differential equation, outside numbers, and itself."""

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.optimize import brentq, fsolve

from pcm_gym.kernels.rod import rod, rod_energy, rod_parameters, rod_shape
from tests.reference.orders import fitted_order
from tests.reference.rod_ode import integrate_rod

GOLDEN = Path(__file__).parents[1] / "golden" / "rod_reference.csv"
REFERENCE = np.loadtxt(GOLDEN, delimiter=",", skiprows=1)
G, TIP, FORCE, ENERGY, TIP_G, FORCE_G = (
    REFERENCE[:, columns] for columns in (slice(0, 2), slice(2, 4), slice(4, 6), 6, slice(7, 11), slice(11, 15))
)
LOAD = np.hypot(G[:, 0], G[:, 1])

# What the project promises; the largest observed is 2e-14, for rod and Jacobian alike, in taut rods.
RELATIVE_TOL = 1e-12


def evaluate(loads: np.ndarray) -> np.ndarray:
    """Return (n, 13): the rod's numbers at each g."""
    return np.array([list(rod(float(g_x), float(g_y))) for g_x, g_y in loads])


def check(error: np.ndarray, tolerance: float) -> None:
    worst = int(np.argmax(error))
    assert error[worst] <= tolerance, f"{error[worst]:.2e} at g = {G[worst].tolist()}"


def some_loads(count: int, seed: int = 1) -> list[tuple[float, float]]:
    """Return loads in all directions with rho up to 12, a third of them nearly straight ahead (taut)."""
    rng = np.random.default_rng(seed)
    loads = []
    for n in range(count):
        rho = rng.uniform(0.3, 12.0)
        b = rng.uniform(-math.pi, math.pi) if n % 3 else rng.choice([-1.0, 1.0]) * math.exp(-rng.uniform(0.2, 1.2) * rho)
        loads.append((rho**2 * math.cos(b), -(rho**2) * math.sin(b)))
    return loads


class TestAgainstMultiplePrecision:
    """The golden table: |g| from 0 to 144, all directions, straight, taut to b = e^(-1.2 rho) and to b = 1e-300."""

    @pytest.fixture(scope="class")
    def found(self) -> np.ndarray:
        return evaluate(G)

    def test_table_covers_its_ends(self) -> None:
        assert len(REFERENCE) > 1000
        assert LOAD.min() == 0.0
        assert LOAD[LOAD > 0.0].min() == pytest.approx(1e-12)
        assert LOAD.max() == pytest.approx(144.0)
        straight = G[:, 1] == 0.0
        assert (straight & (G[:, 0] > 100.0)).any()
        assert (straight & (G[:, 0] < -100.0)).any()
        assert ((LOAD > 0.0499) & (LOAD < 0.05)).any()
        assert ((LOAD > 0.05) & (LOAD < 0.0501)).any()

    def test_tip(self, found: np.ndarray) -> None:
        """Error in lengths of the rod."""
        check(np.linalg.norm(found[:, :2] - TIP, axis=1), RELATIVE_TOL)

    def test_tip_force(self, found: np.ndarray) -> None:
        check(np.linalg.norm(found[:, 2:4] - FORCE, axis=1) / np.where(LOAD > 0.0, LOAD, 1.0), RELATIVE_TOL)

    def test_derivatives_of_tip(self, found: np.ndarray) -> None:
        """Relative to the matrix; it vanishes in straight rods at their critical loads, there relative to 1 / (1 + |g|)."""
        scale = np.linalg.norm(TIP_G, axis=1) + 1.0 / (1.0 + LOAD)
        check(np.linalg.norm(found[:, 4:8] - TIP_G, axis=1) / scale, RELATIVE_TOL)

    def test_derivatives_of_force(self, found: np.ndarray) -> None:
        check(np.linalg.norm(found[:, 8:12] - FORCE_G, axis=1) / np.linalg.norm(FORCE_G, axis=1), RELATIVE_TOL)

    def test_energy(self) -> None:
        """Energy is a difference of numbers of the size of |g|, so its error is relative to 1 + |g|."""
        found = np.array([rod_energy(float(g_x), float(g_y)) for g_x, g_y in G])
        check(np.abs(found - ENERGY) / (1.0 + LOAD), 2e-14)


@given(
    load=st.floats(0.0, 144.0),
    angle=st.floats(-math.pi, math.pi),
)
def test_reflection_is_exact(load: float, angle: float) -> None:
    """The mirror image of a rod is a rod: no direction is preferred, to the last bit."""
    g_x, g_y = load * math.cos(angle), load * math.sin(angle)
    here, mirrored = np.array(rod(g_x, g_y)), np.array(rod(g_x, -g_y))
    signs = np.array([1, -1, 1, -1, 1, -1, -1, 1, 1, -1, -1, 1, 1])
    np.testing.assert_array_equal(here, signs * mirrored)


@pytest.mark.parametrize("g", [(5e-324, 0.0), (0.0, 5e-324), (1e-170, -1e-170), (-1e-300, 1e-310), (100.0, 5e-324)])
def test_denormal_loads_give_numbers(g: tuple[float, float]) -> None:
    point = rod(*g)
    assert np.isfinite(point).all()
    assert (point.tip_x, point.tip_y) == pytest.approx((1.0, 0.0), abs=1e-15)


class TestAgainstTheDifferentialEquation:
    """Integration in the arc length knows neither elliptic functions nor buckling modes."""

    LOADS = some_loads(40)
    # DOP853 at its tightest, over 12 units of dimensionless arc: errors of some 1e-13 grow by less than 100.
    TOLERANCE = 2e-12

    @pytest.mark.parametrize("g", LOADS)
    def test_tip_force_and_energy(self, g: tuple[float, float]) -> None:
        reference, point = integrate_rod(*g), rod(*g)
        scale = math.hypot(*g)
        np.testing.assert_allclose([point.tip_x, point.tip_y], reference.tip, rtol=0.0, atol=self.TOLERANCE)
        np.testing.assert_allclose([point.force_x, point.force_y], reference.force, rtol=0.0, atol=self.TOLERANCE * scale)
        assert rod_energy(*g) == pytest.approx(reference.energy, abs=self.TOLERANCE * (1.0 + scale))

    @pytest.mark.parametrize("g", LOADS[::2])
    def test_shape_lies_on_the_integrated_centre_line(self, g: tuple[float, float]) -> None:
        """The points stand at equal distances along the arc: each is compared with that very point of the arc."""
        shape = np.full((41, 2), np.nan)
        rod_shape(*g, shape)
        # the dense output of DOP853 is of 7th order
        np.testing.assert_allclose(shape, integrate_rod(*g).point(np.linspace(0.0, 1.0, 41)), rtol=0.0, atol=1e-9)

    @pytest.mark.parametrize("g", [(0.0, 0.0), (-30.0, 0.0), (60.0, 0.0), (1e-160, 1e-160), (1e-320, 0.0)])
    def test_shape_of_a_straight_rod(self, g: tuple[float, float]) -> None:
        shape = np.full((11, 2), np.nan)
        rod_shape(*g, shape)
        expected = np.column_stack([np.linspace(0.0, 1.0, 11), np.zeros(11)])
        np.testing.assert_allclose(shape, expected, rtol=0.0, atol=1e-15)

    @pytest.mark.parametrize("g", LOADS[1::4])
    def test_energy_is_the_integral_of_curvature(self, g: tuple[float, float]) -> None:
        """By quadrature of the shape: at distance s from the base the moment is tip force x lever arm."""
        point = rod(*g)

        def energy_density(s: float) -> float:
            # two points, of which the second stands at s
            part = np.empty((2, 2))
            tail = np.array(cut_point(g, s))
            part[0], part[1] = tail, (point.tip_x, point.tip_y)
            arm = part[1] - part[0]
            moment = arm[0] * point.force_y - arm[1] * point.force_x
            return 0.5 * moment**2

        integral, error = quad(energy_density, 0.0, 1.0, epsabs=1e-11, epsrel=1e-11, limit=200)
        assert rod_energy(*g) == pytest.approx(integral, abs=1e-9 + 10.0 * error)


def cut_point(g: tuple[float, float], s: float) -> tuple[float, float]:
    """Return the point of the rod at distance s from its base: the last of a shape whose steps end there is the tip."""
    points = 1025
    shape = _shape_of(g, points)
    # a cubic through the four nearest of 1025 points errs by (rho / 1024)^4 ~ 1e-8 of the curvature's change
    position = s * (points - 1)
    first = int(min(max(math.floor(position) - 1, 0), points - 4))
    t = position - first
    weights = [
        -(t - 1) * (t - 2) * (t - 3) / 6,
        t * (t - 2) * (t - 3) / 2,
        -t * (t - 1) * (t - 3) / 2,
        t * (t - 1) * (t - 2) / 6,
    ]
    x, y = np.array(weights) @ shape[first : first + 4]
    return float(x), float(y)


_SHAPES: dict[tuple[float, float], np.ndarray] = {}


def _shape_of(g: tuple[float, float], points: int) -> np.ndarray:
    if g not in _SHAPES:
        _SHAPES[g] = np.empty((points, 2))
        rod_shape(*g, _SHAPES[g])
    return _SHAPES[g]


def test_series_and_closed_form_meet() -> None:
    """At |g| = 0.05 the kernel changes its method; nothing may show."""
    below, above = 0.05 * (1.0 - 1e-14), 0.05 * (1.0 + 1e-14)
    for angle in np.linspace(-math.pi, math.pi, 61):
        c, s = math.cos(angle), math.sin(angle)
        np.testing.assert_allclose(rod(below * c, below * s), rod(above * c, above * s), rtol=0.0, atol=2e-13)
