"""A mechanism is data: compared, pickled and frozen as such, and independent of the units it is written in."""

import copy
import dataclasses
import math
import pickle
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pcm_gym.mechanism import Leg, Mechanism, Prismatic, Revolute, Rod, get_mechanism, mechanism_names
from pcm_gym.solving import BranchTracker, Equilibrium
from tests.reference.mechanisms import FAMILIES, home_by_construction, random_mechanism


@pytest.mark.parametrize("name", mechanism_names())
class TestData:
    def test_two_of_a_kind_are_equal(self, name: str) -> None:
        assert get_mechanism(name) == get_mechanism(name)
        assert hash(get_mechanism(name)) == hash(get_mechanism(name))

    def test_a_changed_rod_makes_another_mechanism(self, name: str) -> None:
        mechanism = get_mechanism(name)
        leg = dataclasses.replace(mechanism.legs[0], rod=Rod(1.0, 2.0))
        assert dataclasses.replace(mechanism, legs=(leg, *mechanism.legs[1:])) != mechanism

    def test_survives_pickling_and_copying(self, name: str) -> None:
        mechanism = get_mechanism(name)
        table = np.array(mechanism.leg_table)  # derived data, cached
        for twin in (pickle.loads(pickle.dumps(mechanism)), copy.deepcopy(mechanism), copy.copy(mechanism)):
            assert twin == mechanism
            np.testing.assert_array_equal(twin.leg_table, table)

    def test_pickle_holds_the_data_alone(self, name: str) -> None:
        fresh, used = get_mechanism(name), get_mechanism(name)
        assert used.leg_table is not None
        assert used.units is not None
        assert pickle.dumps(fresh) == pickle.dumps(used)

    def test_is_frozen(self, name: str) -> None:
        mechanism: Any = get_mechanism(name)
        with pytest.raises(dataclasses.FrozenInstanceError):
            mechanism.name = "other"
        with pytest.raises(ValueError, match="read-only"):
            mechanism.leg_table[0, 0] = 1.0

    def test_home_is_within_limits(self, name: str) -> None:
        mechanism = get_mechanism(name)
        assert mechanism.home_inputs is not None
        assert np.all(mechanism.lower_limits <= mechanism.home_inputs)
        assert np.all(mechanism.home_inputs <= mechanism.upper_limits)


def test_catalogue_is_of_steel_rods() -> None:
    """1 m, E = 200 GPa: of round wire 1 mm in radius after the paper, else of strip, 20 mm by 0.5 mm."""
    for name in mechanism_names():
        stiffness = 0.1570796 if name.endswith("-paper") else 0.0416667
        for leg in get_mechanism(name).legs:
            assert leg.rod.length == 1.0
            assert leg.rod.bending_stiffness == pytest.approx(stiffness, abs=5e-8)


def test_geometries_of_the_paper_are_as_stated() -> None:
    two_rfr, two_pfr, three_pfr = (get_mechanism(name) for name in ("2RFR-paper", "2PFR-paper", "3PFR-paper"))
    assert [leg.actuator.base for leg in two_rfr.legs] == [(-0.2, 0.0), (0.2, 0.0)]
    assert two_rfr.home_inputs is not None
    np.testing.assert_allclose(np.degrees(two_rfr.home_inputs), [120.0, 60.0])
    for leg, x in zip(two_pfr.legs, (-0.2, 0.2), strict=True):
        assert isinstance(leg.actuator, Prismatic)
        assert leg.actuator.base == (x, 0.0)
        assert leg.actuator.axis_angle == leg.actuator.clamp_angle == math.pi / 2.0
    for leg, direction_deg in zip(three_pfr.legs, (90.0, 210.0, 330.0), strict=True):
        direction = math.radians(direction_deg)
        outwards = np.array([math.cos(direction), math.sin(direction)])
        assert isinstance(leg.actuator, Prismatic)
        np.testing.assert_allclose(leg.actuator.base, 0.7 * outwards, atol=1e-15)
        np.testing.assert_allclose(leg.attachment, 0.3 * outwards, atol=1e-15)
        assert leg.actuator.axis_angle == pytest.approx(direction + math.pi / 2.0)
        assert leg.actuator.clamp_angle == pytest.approx(direction + math.pi + 0.9)


def scaled(mechanism: Mechanism, length: float, stiffness: float) -> Mechanism:
    """Return the mechanism with all lengths times `length` and EI times `stiffness`."""

    def pair(values: tuple[float, float]) -> tuple[float, float]:
        return (values[0] * length, values[1] * length)

    legs = []
    for leg in mechanism.legs:
        actuator = dataclasses.replace(leg.actuator, base=pair(leg.actuator.base))
        if isinstance(actuator, Prismatic):
            actuator = dataclasses.replace(actuator, limits=pair(actuator.limits))
        rod = Rod(leg.rod.length * length, leg.rod.bending_stiffness * stiffness)
        legs.append(Leg(actuator, rod, pair(leg.attachment)))
    return Mechanism(mechanism.name, tuple(legs))


def facts(equilibrium: Equilibrium) -> dict[str, np.ndarray]:
    return {
        "pose": equilibrium.pose,
        "energy": np.array(equilibrium.energy),
        "stiffness": equilibrium.stiffness,
        "forward_jacobian": equilibrium.forward_jacobian,
        "forces": np.array([rod.force for rod in equilibrium.rods]),
        "shape": equilibrium.shape(5),
        "index": np.array(equilibrium.index),
        "rods": np.array([[rod.modulus, rod.psi, rod.mode, rod.rho] for rod in equilibrium.rods]),
        "margins": np.array([equilibrium.stability_margin, equilibrium.singularity_margin, equilibrium.residual]),
        "inputs": equilibrium.inputs,
    }


def expected_factors(mechanism: Mechanism, length: float, stiffness: float) -> dict[str, np.ndarray]:
    """Return by what each fact must grow: pose like L, force like EI/L^2, energy like EI/L, stiffness like EI/L^3."""
    pose = np.array([length, length, 1.0])[: mechanism.dof]
    inputs = np.array([1.0 if isinstance(leg.actuator, Revolute) else length for leg in mechanism.legs])
    one = np.ones(())
    return {
        "pose": pose,
        "energy": one * stiffness / length,
        "stiffness": stiffness / length / np.outer(pose, pose),
        "forward_jacobian": np.outer(pose, 1.0 / inputs),
        "forces": one * stiffness / length**2,
        "shape": one * length,
        "index": one,
        "rods": one,
        "margins": one,
        "inputs": inputs,
    }


def tracked_facts(start: Equilibrium, mechanism: Mechanism, length: float, stiffness: float) -> dict[str, np.ndarray]:
    """Return the facts of the scaled mechanism after one step in inputs and load, scaled too."""
    factors = expected_factors(mechanism, length, stiffness)
    dof = mechanism.dof
    load_factor = (stiffness / length**2 * np.array([1.0, 1.0, length]))[:dof]
    load = np.array([0.7, -1.1, 0.4])[:dof] * start.mechanism.units.load * load_factor
    inputs = start.inputs * factors["inputs"]
    begin = Equilibrium(mechanism, start.state, inputs, np.zeros(dof))
    move = np.array([0.06, -0.04, 0.03])[: mechanism.leg_count] * factors["inputs"]
    return facts(BranchTracker(mechanism, begin).step(inputs + move, load).equilibrium)


@pytest.fixture(scope="module", params=FAMILIES)
def home(request: pytest.FixtureRequest) -> Equilibrium:
    return home_by_construction(request.param)


@settings(max_examples=15)
@given(length_exponent=st.integers(-20, 20), stiffness_exponent=st.integers(-30, 30))
def test_powers_of_two_in_the_units_change_no_bit(
    home: Equilibrium, length_exponent: int, stiffness_exponent: int
) -> None:
    length, stiffness = 2.0**length_exponent, 2.0**stiffness_exponent
    plain = tracked_facts(home, scaled(home.mechanism, 1.0, 1.0), 1.0, 1.0)
    found = tracked_facts(home, scaled(home.mechanism, length, stiffness), length, stiffness)
    factors = expected_factors(home.mechanism, length, stiffness)
    for name, value in plain.items():
        np.testing.assert_array_equal(found[name], value * factors[name], err_msg=name)


@settings(max_examples=15)
@given(length=st.floats(1e-4, 1e4), stiffness=st.floats(1e-6, 1e9))
def test_units_scale_as_dimensional_analysis_says(home: Equilibrium, length: float, stiffness: float) -> None:
    """Newton stops at 1e-11; the stiffness of nearly straight rods, of the 2PFR, magnifies that a thousandfold."""
    plain = tracked_facts(home, scaled(home.mechanism, 1.0, 1.0), 1.0, 1.0)
    found = tracked_facts(home, scaled(home.mechanism, length, stiffness), length, stiffness)
    factors = expected_factors(home.mechanism, length, stiffness)
    for name, value in plain.items():
        tolerance = 2e-7 * np.abs(value).max() + 1e-10
        np.testing.assert_allclose(found[name] / factors[name], value, rtol=0.0, atol=tolerance, err_msg=name)


@pytest.mark.parametrize("family", FAMILIES)
def test_leg_table_is_dimensionless(family: str) -> None:
    mechanism = random_mechanism(family, np.random.default_rng(5))
    np.testing.assert_allclose(scaled(mechanism, 37.0, 0.01).leg_table, mechanism.leg_table, rtol=1e-14, atol=1e-15)
    assert np.mean(mechanism.leg_table[:, 6]) == pytest.approx(1.0)  # lengths in the mean rod length
    assert np.mean(mechanism.leg_table[:, 7]) == pytest.approx(1.0)  # stiffness in the mean stiffness
