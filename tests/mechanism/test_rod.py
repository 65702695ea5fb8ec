"""Sections, materials and rods made of them: against numbers by hand, and refusals of what makes no sense."""

import math
from dataclasses import replace
from typing import Any

import pytest

from pcm_gym.mechanism import (
    FIBREGLASS,
    NITINOL,
    SPRING_STEEL,
    Material,
    Rod,
    Round,
    Strip,
    get_mechanism,
    mechanism_from_json,
    mechanism_to_json,
)

STRIP = Strip(width=0.02, thickness=0.0005)
STEEL = Material(modulus=200e9, yield_stress=1e9, density=7850.0)


def test_a_strip_of_20_by_half_a_millimetre():
    # by hand: 200e9 * 0.02 * 0.0005^3 / 12 = 0.0416667 N m^2; 1e9 / (200e9 * 0.00025) = 20 / m; 7850 * 1e-5 kg / m
    rod = Rod(2.0, section=STRIP, material=STEEL)
    assert rod.bending_stiffness == pytest.approx(0.0416666666666667, rel=1e-14)
    assert rod.yield_curvature == pytest.approx(20.0, rel=1e-14)
    assert rod.mass == pytest.approx(0.157, rel=1e-14)
    assert rod.stress_ratio(5.0) == pytest.approx(0.25, rel=1e-14)


def test_a_round_wire_of_one_millimetre_radius():
    # the catalogue's wire, EI = 0.1570796 N m^2; of spring steel it yields at 5 / m
    rod = Rod(1.0, section=Round(1e-3), material=STEEL)
    assert rod.bending_stiffness == pytest.approx(0.1570796, rel=1e-6)
    assert rod.yield_curvature == pytest.approx(5.0, rel=1e-14)
    assert rod.mass == pytest.approx(7850.0 * math.pi * 1e-6, rel=1e-14)


def test_a_bare_stiffness_tells_nothing_of_stress_and_mass():
    rod = Rod(1.5)
    assert rod.bending_stiffness == 1.0
    assert Rod(1.0, 2.5).bending_stiffness == 2.5
    assert all(math.isnan(value) for value in (rod.yield_curvature, rod.mass, rod.stress_ratio(1.0)))


def test_a_strip_is_an_equal_rod_wherever_its_stiffness_is():
    rod = Rod(section=STRIP, material=STEEL)
    assert replace(rod, length=2.0).bending_stiffness == rod.bending_stiffness
    assert rod == Rod(section=STRIP, material=STEEL)
    assert rod != Rod(1.0, rod.bending_stiffness)


def test_scaling_changes_length_and_stiffness_alone():
    for rod in (Rod(2.0, 3.0), Rod(2.0, section=STRIP, material=STEEL)):
        other = rod.scaled(1.5, 0.5)
        assert other.length == 3.0
        assert other.bending_stiffness == pytest.approx(0.5 * rod.bending_stiffness, rel=1e-15)
        assert other.section == rod.section


@pytest.mark.parametrize("section", [STRIP, Round(0.001)])
def test_rods_of_a_material_come_back_from_json(section):
    rod, home = Rod(1.0, section=section, material=NITINOL), get_mechanism("2RFR")
    mechanism = replace(home, legs=tuple(replace(leg, rod=rod) for leg in home.legs), reference=rod)
    assert mechanism_from_json(mechanism_to_json(mechanism)) == mechanism


WRONG: Any = {"section": 0.01, "material": "steel", "radius": "1"}


@pytest.mark.parametrize(
    ("make", "error", "message"),
    [
        (lambda: Rod(section=STRIP), TypeError, "material must be a Material where a section is given, got None"),
        (lambda: Rod(material=STEEL), TypeError, "section must be a Round or a Strip where a material is given"),
        (lambda: Rod(1.0, 1.0, STRIP, STEEL), ValueError, "bending_stiffness must be left out beside section"),
        (lambda: Rod(section=WRONG["section"], material=STEEL), TypeError, "section must be a Round or a Strip"),
        (lambda: Rod(section=STRIP, material=WRONG["material"]), TypeError, "material must be a Material"),
        (lambda: Rod(section=Round(1e-99), material=STEEL), ValueError, "must make a bending stiffness"),
        (lambda: Rod(-1.0, section=STRIP, material=STEEL), ValueError, "length must be greater than 0"),
        (lambda: Round(0.0), ValueError, "radius must be greater than 0"),
        (lambda: Round(WRONG["radius"]), TypeError, "radius must be a number"),
        (lambda: Strip(0.01, -1e-3), ValueError, "thickness must be greater than 0"),
        (lambda: Strip(0.001, 0.01), ValueError, "thickness must be at most the width"),
        (lambda: Strip(math.inf, 0.01), ValueError, "width must be finite"),
        (lambda: Material(0.0, 1.0, 1.0), ValueError, "modulus must be greater than 0"),
        (lambda: Material(1.0, math.nan, 1.0), ValueError, "yield_stress must be finite"),
        (lambda: Material(1.0, 1.0, -1.0), ValueError, "density must be greater than 0"),
        (lambda: Rod().scaled(0.0, 1.0), ValueError, "length must be greater than 0"),
    ],
)
def test_what_makes_no_rod_is_refused_by_name(make, error, message):
    with pytest.raises(error, match=message):
        make()


def test_named_materials_are_those_of_their_sources():
    assert SPRING_STEEL == STEEL
    assert Material(83e9, 379e6, 6450.0) == NITINOL
    assert Material(25e9, 400e6, 1800.0) == FIBREGLASS
