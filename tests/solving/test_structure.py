"""Strength and crossings of equilibria: against dense shapes, differences of energy, and crossings of polylines."""

import math
from dataclasses import replace

import numpy as np
import pytest

from pcm_gym.arrays import Array
from pcm_gym.kernels.numerics.compilation import kernel
from pcm_gym.kernels.rods.elliptic import jacobi, quarter_period
from pcm_gym.kernels.rods.rod import rod, tip_half_angle
from pcm_gym.kernels.structure.contact import set_contacts
from pcm_gym.kernels.structure.loops import TOUCHING_COSINE, crosses_itself, find_loops
from pcm_gym.mechanism import SPRING_STEEL, Leg, Mechanism, Prismatic, Revolute, Rod, Strip, get_mechanism
from pcm_gym.solving import BranchTracker, Equilibrium, home_equilibrium
from tests.reference.mechanisms import FAMILIES, find_equilibria, random_inputs, random_load, random_mechanism
from tests.reference.polylines import polyline_crossings


def some_equilibria(count: int, seed: int) -> list[Equilibrium]:
    """Return equilibria, stable or not, of mechanisms of three families, with unequal rods, loaded and not."""
    rng, number = np.random.default_rng(seed), 0
    found: list[Equilibrium] = []
    while len(found) < count:
        mechanism = random_mechanism(FAMILIES[number % 3], rng)
        load = random_load(mechanism, rng) * (number % 2)
        found += find_equilibria(mechanism, random_inputs(mechanism, rng), load, rng, starts=60, rho_max=9.0)[:20]
        number += 1
    return found[:count]


@pytest.fixture(scope="module")
def equilibria() -> list[Equilibrium]:
    return some_equilibria(1000, 3)


def densest_curvature(angles: Array, step: float) -> float:
    """Return the greatest curvature of a rod from its tangent's angle at equal steps, by fourth-order differences.

    Curvature is odd about the hinge, where it vanishes, so the angle is even there. At the clamp the differences are
    one-sided. A parabola through the greatest value and its neighbours is the curvature between them.
    """
    ends = np.concatenate([angles, angles[-2:-5:-1]])
    inner = (ends[:-4] - 8.0 * ends[1:-3] + 8.0 * ends[3:-1] - ends[4:]) / (12.0 * step)
    clamp = np.array([-25.0, 48.0, -36.0, 16.0, -3.0]) @ angles[:5] / (12.0 * step)
    second = np.array([-3.0, -10.0, 18.0, -6.0, 1.0]) @ angles[:5] / (12.0 * step)
    curvature = np.abs(np.concatenate([[clamp, second], inner]))
    k = int(curvature.argmax())
    if k in (0, len(curvature) - 1):
        return float(curvature[k])
    left, middle, right = curvature[k - 1 : k + 2]
    bend = left - 2.0 * middle + right
    return float(middle - 0.125 * (right - left) ** 2 / bend) if bend else float(middle)


@kernel
def set_tangents(g_x: float, g_y: float, angles: Array) -> None:
    """Fill the tangent's angle relative to the force at equal steps from base to tip: the closed form beta(u)."""
    load = math.hypot(g_x, g_y)
    kappa, kappa_c = tip_half_angle(g_x, g_y, load)
    for n in range(angles.shape[0]):
        u = (1.0 - n / (angles.shape[0] - 1)) * math.sqrt(load)
        _, cn, _, _, _ = jacobi(u, kappa, abs(kappa_c))
        angles[n] = 2.0 * math.atan2(kappa_c, kappa * cn)


def test_largest_curvature_is_that_of_the_dense_shape(equilibria):
    # turns of the tangent between dense points, taken from the shape alone: exact to the square of their distance
    for equilibrium in equilibria:
        for rod_state, leg, shape in zip(
            equilibrium.rods, equilibrium.mechanism.legs, equilibrium.shape(4001), strict=True
        ):
            chords = np.diff(shape, axis=0)
            turns = np.diff(np.unwrap(np.arctan2(chords[:, 1], chords[:, 0])))
            dense = np.abs(turns).max() * 4000 / leg.rod.length
            assert dense == pytest.approx(rod_state.largest_curvature, rel=2e-3, abs=1e-6)


def test_largest_curvature_is_that_of_the_angle_to_eight_digits(equilibria):
    angles = np.empty(8001)
    for equilibrium in equilibria[:300]:
        for i, (rod_state, leg) in enumerate(zip(equilibrium.rods, equilibrium.mechanism.legs, strict=True)):
            set_tangents(equilibrium.state[2 * i], equilibrium.state[2 * i + 1], angles)
            dense = densest_curvature(np.unwrap(angles), leg.rod.length / 8000)
            assert dense == pytest.approx(rod_state.largest_curvature, rel=1e-8, abs=1e-8)


def test_stress_is_that_of_bending():
    # 20 x 0.5 mm, 200 GPa, 1 GPa: by hand it yields at 1 / (200 * 0.25 mm) = 20 / m, and EI is 0.041667 N m^2
    rod = Rod(1.0, section=Strip(0.02, 0.0005), material=SPRING_STEEL)
    home = get_mechanism("2RFR-paper")
    strip = replace(home, legs=tuple(replace(leg, rod=rod) for leg in home.legs))
    for state in home_equilibrium(strip).rods:
        assert state.stress_ratio == pytest.approx(state.largest_curvature / 20.0, rel=1e-12)
    bare = replace(home, legs=tuple(replace(leg, rod=Rod()) for leg in home.legs))
    assert all(math.isnan(state.stress_ratio) for state in home_equilibrium(bare).rods)


def test_home_agrees_with_shooting():
    # 2RFR, 120 and 60 degrees, EI = 0.1570796: largest curvature 2.231 / m, moment of the clamp 0.3504 N m
    home = home_equilibrium(get_mechanism("2RFR-paper"))
    assert home.rods[0].largest_curvature == pytest.approx(2.231, abs=5e-4)
    assert np.abs(home.actuator_forces) == pytest.approx([0.3504] * 2, abs=5e-5)


def test_actuator_forces_are_differences_of_energy(equilibria):
    # central differences of fourth order along the branch, exact to 1e-9 of the scale a twentieth from the nearest fold
    compared = 0
    for equilibrium in equilibria:
        mechanism, scale = equilibrium.mechanism, 1.0 + np.abs(equilibrium.actuator_forces).max()
        if equilibrium.singularity_margin < 0.05:
            continue
        for i in range(mechanism.leg_count):
            found = [_energy_beside(equilibrium, i, way) for way in (-2e-4, -1e-4, 1e-4, 2e-4)]
            energies = [energy for energy in found if energy is not None]
            if len(energies) < 4:
                continue
            slope = (energies[0] - 8.0 * energies[1] + 8.0 * energies[2] - energies[3]) / 12e-4
            assert slope == pytest.approx(equilibrium.actuator_forces[i], abs=1e-8 * scale)
            compared += 1
    assert compared > 1000


def _energy_beside(equilibrium: Equilibrium, leg: int, way: float) -> float | None:
    inputs = np.array(equilibrium.inputs)
    inputs[leg] += way
    step = BranchTracker(equilibrium.mechanism, equilibrium).step(inputs)
    return step.equilibrium.energy if step.fraction == 1.0 else None


def check_crossings(equilibria: list[Equilibrium]) -> tuple[int, int]:
    """Compare with polylines; return how many differ in number, and how many crossings there are."""
    different = total = 0
    for equilibrium in equilibria:
        wanted = polyline_crossings(equilibrium, 1001)
        found = sorted((*crossing.legs, *crossing.arc_lengths) for crossing in equilibrium.crossings)
        total += len(wanted)
        if [crossing[:2] for crossing in found] != [crossing[:2] for crossing in wanted]:
            different += 1
        elif wanted:
            # a chord of the polyline is off by at most its curvature times the squared step over 8, over the sine
            assert np.array(found) == pytest.approx(np.array(wanted), abs=5e-3)
    return different, total


def test_crossings_are_those_of_dense_polylines(equilibria):
    different, total = check_crossings(equilibria)
    assert total > 500
    assert different <= 1


@pytest.mark.slow
def test_ten_thousand_crossings_are_those_of_dense_polylines():
    different, total = check_crossings(some_equilibria(10_000, 11))
    assert total > 5000
    assert different <= 10


def test_both_parts_are_at_the_place_of_their_crossing(equilibria):
    for equilibrium in equilibria[:200]:
        for crossing in equilibrium.crossings:
            for leg, arc in zip(crossing.legs, crossing.arc_lengths, strict=True):
                if leg < equilibrium.mechanism.leg_count:
                    assert _point_at(equilibrium, leg, arc) == pytest.approx(crossing.place, abs=1e-9)


def _point_at(equilibrium: Equilibrium, leg: int, arc: float) -> Array:
    """Return the point at an arc length, by a cut: the rest of the rod is a clamped rod of its own."""
    length = equilibrium.mechanism.legs[leg].rod.length
    part, g = 1.0 - arc / length, equilibrium.state[2 * leg : 2 * leg + 2]
    whole, cut = rod(*g), rod(*(part * part * g))
    turn = math.atan2(whole.force_y, whole.force_x) - math.atan2(cut.force_y, cut.force_x)
    c, s = math.cos(turn), math.sin(turn)
    local = np.array(
        [whole.tip_x - part * (c * cut.tip_x - s * cut.tip_y), whole.tip_y - part * (s * cut.tip_x + c * cut.tip_y)]
    )
    actuator, value = equilibrium.mechanism.legs[leg].actuator, float(equilibrium.inputs[leg])
    angle = actuator.clamp_direction(value)
    c, s = math.cos(angle), math.sin(angle)
    base: Array = np.array(actuator.clamp_point(value))
    return base + length * np.array([c * local[0] - s * local[1], s * local[0] + c * local[1]])


def test_the_elastica_that_touches_itself():
    # the neighbouring loops of the free elastica touch at a known shape, m = 0.7312; on both sides of it
    for excess, wanted in ((-1e-6, 0), (1e-6, 2)):
        cosine, rho = TOUCHING_COSINE + excess, 12.0
        g = rho**2 * np.array([cosine, -math.sqrt(1.0 - cosine**2)])
        quarter = quarter_period(math.sqrt(0.5 * (1.0 - cosine)))
        found = np.empty((9, 2))
        assert 5.0 * quarter < rho < 6.0 * quarter
        assert find_loops(g[0], g[1], found) == wanted
        assert crosses_itself(g[0], g[1], 0.5 * rho / quarter) == (wanted > 0)


def test_contact_is_a_crossing_that_is_forbidden(equilibria):
    for equilibrium in equilibria:
        mechanism = equilibrium.mechanism
        _, inputs, _ = equilibrium.kernel_values()
        contacts = np.empty(1, np.bool_)
        set_contacts(mechanism.leg_table, equilibrium.state[None].copy(), inputs[None], contacts)
        forbidden = [c for c in equilibrium.crossings if mechanism.dof == 3 or c.legs[0] == c.legs[1]]
        assert contacts[0] == bool(forbidden)


def test_straight_rods_that_cross_and_an_edge_between_them():
    # two unloaded rods in a plane with a third leg: by hand
    legs = (
        Leg(Prismatic((-0.5, 0.0), 0.0, 0.0), Rod(1.0), (0.5, 0.0)),
        Leg(Prismatic((0.2, -0.5), 0.0, math.pi / 2.0), Rod(1.0), (0.2, 0.5)),
        Leg(Revolute((0.0, 1.0), 0.0), Rod(math.hypot(0.3, 0.2)), (-0.3, 0.8)),
    )
    mechanism = Mechanism("crossed", legs, home_inputs=(0.0, 0.0, 0.0))
    angle = math.atan2(-0.2, -0.3)
    state = np.zeros(9)
    equilibrium = Equilibrium(mechanism, state, np.array([0.0, 0.0, angle]), np.zeros(3))
    assert equilibrium.residual < 1e-15
    found = {crossing.legs: crossing for crossing in equilibrium.crossings}
    assert found[0, 1].place == pytest.approx((0.2, 0.0), abs=1e-14)
    assert found[0, 1].arc_lengths == pytest.approx((0.7, 0.5), abs=1e-14)
    # edge 2 leads from hinge 2 at (-0.3, 0.8) to hinge 0 at (0.5, 0.0): rod 1 passes it at x = 0.2, y = 0.3
    assert found[1, 5].place == pytest.approx((0.2, 0.3), abs=1e-14)
    assert found[1, 5].arc_lengths == pytest.approx((0.8, 0.5 * math.hypot(1.0, 1.0)), abs=1e-14)
    assert set(found) == {(0, 1), (1, 5)}
