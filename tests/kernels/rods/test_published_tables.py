"""One rod against the tables of textbooks and papers: bent cantilevers and buckled columns, L = EI = 1."""

import math

import pytest
from scipy.optimize import brentq
from scipy.special import ellipe, ellipk

from pcm_gym.kernels.rods.rod import RodPoint, rod

# Mattiasson, "Numerical results from large deflection beam and frame problems analysed by means of elliptic integrals"
# (1981): a cantilever under a transverse force P at its tip. P L^2 / EI, deflection w / L, shortening u / L, tip angle.
CANTILEVER = [
    (0.0, 0.0, 0.0, 0.0),
    (1.0, 0.30172, 0.05643, 0.46135),
    (2.0, 0.49346, 0.16064, 0.78175),
    (5.0, 0.71379, 0.38763, 1.21537),
    (10.0, 0.81061, 0.55500, 1.43029),
]
# Timoshenko and Gere, "Theory of Elastic Stability" (1961), table 2-4: a buckled column, clamped below, free above.
# Tip angle in degrees, P / P_cr, height x / l and sideways deflection y / l of the tip.
COLUMN = [
    (20.0, 1.015, 0.970, 0.220),
    (40.0, 1.063, 0.881, 0.422),
    (60.0, 1.152, 0.741, 0.593),
    (80.0, 1.293, 0.560, 0.719),
    (100.0, 1.518, 0.349, 0.792),
    (120.0, 1.884, 0.123, 0.803),
    (140.0, 2.541, -0.107, 0.750),
    (160.0, 4.029, -0.340, 0.625),
    (176.0, 9.116, -0.577, 0.421),
]
CRITICAL = math.pi**2 / 4.0


def loaded(load: float, b: float) -> RodPoint:
    """Return the rod whose tip is at the angle b to a force of this size."""
    return rod(load * math.cos(b), -load * math.sin(b))


@pytest.mark.parametrize(("load", "deflection", "shortening", "tip_angle"), CANTILEVER)
def test_cantilever_bends_as_mattiasson_printed(
    load: float, deflection: float, shortening: float, tip_angle: float
) -> None:
    def across(b: float) -> float:
        return loaded(load, b).force_x  # none, where the force is at a right angle to the clamp

    # from the right angle of the straight rod the tip turns towards the force
    b = brentq(across, -0.5 * math.pi, -0.05, xtol=1e-14) if load else -0.5 * math.pi
    found = loaded(load, b)
    assert found.force_y == pytest.approx(load, abs=1e-12)
    assert found.tip_y == pytest.approx(deflection, abs=6e-6)  # five digits are printed
    assert 1.0 - found.tip_x == pytest.approx(shortening, abs=6e-6)
    assert 0.5 * math.pi + b == pytest.approx(tip_angle, abs=6e-6)


@pytest.mark.parametrize(("angle_deg", "load_ratio", "height", "sideways"), COLUMN)
def test_column_buckles_as_timoshenko_printed(
    angle_deg: float, load_ratio: float, height: float, sideways: float
) -> None:
    """The force keeps its direction, back along the clamp; the tip turns away from it by the angle."""
    angle = math.radians(angle_deg)

    def across(load: float) -> float:
        return loaded(load, math.pi - angle).force_y

    load = brentq(across, CRITICAL, 1.5 * load_ratio * CRITICAL, xtol=1e-13)
    found = loaded(load, math.pi - angle)
    assert found.force_x == pytest.approx(-load, rel=1e-12)
    # three decimals are printed, the last of them not always rounded: 2.541 stands for 2.5423
    assert load / CRITICAL == pytest.approx(load_ratio, abs=1.5e-3)
    assert found.tip_x == pytest.approx(height, abs=1e-3)
    assert abs(found.tip_y) == pytest.approx(sideways, abs=1e-3)
    # and in full, by the complete elliptic integrals of SciPy with modulus sin(angle / 2)
    modulus = math.sin(0.5 * angle)
    quarter, area = ellipk(modulus**2), ellipe(modulus**2)
    assert load == pytest.approx(quarter**2, rel=1e-12)
    assert found.tip_x == pytest.approx(2.0 * area / quarter - 1.0, abs=1e-12)
    assert abs(found.tip_y) == pytest.approx(2.0 * modulus / quarter, abs=1e-12)
