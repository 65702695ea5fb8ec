"""Enclosures of one rod: against multiple precision at points in boxes, and against the rod's own derivatives."""

import math
from collections.abc import Iterator

import mpmath
import numpy as np
import pytest
from mpmath import mp, mpf

from pcm_gym.kernels.proofs.rod_enclosure import (
    RodEnclosure,
    enclose_rod,
    enclose_rod_derivatives,
    enclose_slightly_loaded,
    enclose_turnable,
    enclose_turnable_derivatives,
)
from pcm_gym.kernels.proofs.taylor_models import Model, along_s, along_t
from pcm_gym.kernels.rods.rod import rod
from tests.reference.precise_rod import rod_by_elliptic_functions

Box = tuple[float, float, float, float]


def boxes(count: int, relative: float, seed: int) -> Iterator[Box]:
    """Boxes of (rho, half width, b, half width): any rho to 12, a third of them taut, some around b = 0 and b = pi."""
    rng = np.random.default_rng(seed)
    for n in range(count):
        rho = rng.uniform(0.0, 12.0) if n % 5 else 10.0 ** rng.uniform(-8.0, 0.0)
        b = (
            rng.choice([-1.0, 1.0])
            * (
                rng.uniform(0.0, math.pi),
                math.exp(-rho * rng.uniform(0.2, 1.3)),
                rng.choice([0.0, 1e-300, 1e-9 * math.exp(-rho), math.pi]),
            )[n % 3]
        )
        yield rho, relative * min(0.5, rho), float(b), relative * min(0.5, abs(b) + math.exp(-rho))


def at(model: Model, s: float, t: float) -> mpf:
    s, t = mpf(s), mpf(t)
    powers = (1, s, t, s * s, s * t, t * t, s**3, s * s * t, s * t * t, t**3)
    return mpmath.fsum(mpf(c) * power for c, power in zip(model[:10], powers, strict=True))


def precise(box: Box, s: float, t: float) -> tuple[mpf, ...]:
    rho, b = mpf(box[0]) + mpf(s) * mpf(box[1]), mpf(box[2]) + mpf(t) * mpf(box[3])
    return rod_by_elliptic_functions(rho**2 * mpmath.cos(b), -(rho**2) * mpmath.sin(b))[:4]


@pytest.mark.parametrize("relative", [0.0, 1e-9, 1e-3, 0.03, 0.15])
def test_holds_the_rod_in_multiple_precision(relative: float) -> None:
    rng = np.random.default_rng(7)
    with mp.workdps(40):
        for box in boxes(40, relative, seed=1):
            enclosure = enclose_rod(*box)
            s, t = rng.uniform(-1.0, 1.0, 2) if rng.uniform() < 0.7 else rng.choice([-1.0, 1.0], 2)
            for model, truth in zip(enclosure, precise(box, s, t), strict=True):
                assert not abs(at(model, s, t) - truth) > model.remainder, (box, s, t)


def polar(box: Box, s: float, t: float) -> tuple[float, float, float, float]:
    rho, b = box[0] + s * box[1], box[2] + t * box[3]
    return rho, b, rho**2 * math.cos(b), -(rho**2) * math.sin(b)


@pytest.mark.parametrize("relative", [1e-4, 0.01, 0.05, 0.2])
def test_holds_the_rod_in_thousands_of_boxes(relative: float) -> None:
    """In double precision: the rod itself may be wrong by 1e-13."""
    rng = np.random.default_rng(8)
    decided = 0
    for box in boxes(2000, relative, seed=2):
        enclosure = enclose_rod(*box)
        s, t = rng.uniform(-1.0, 1.0, 2)
        rho, _, g_x, g_y = polar(box, s, t)
        for model, value in zip(enclosure, rod(g_x, g_y)[:4], strict=True):
            assert not abs(float(at(model, s, t)) - value) > model.remainder + 1e-12 * (1.0 + rho * rho), (box, s, t)
            decided += model.remainder < 0.5 * (1.0 + rho * rho)
    assert decided > 4 * 2000 * (0.98 if relative < 0.1 else 0.5)


def test_of_a_point_is_as_sharp_as_rounding_allows() -> None:
    for rho, _, b, _ in boxes(2000, 0.0, seed=3):
        for model in enclose_rod(rho, 0.0, b, 0.0):
            assert model.remainder < 1e-9 * (1.0 + rho * rho), (rho, b)


def test_remainders_shrink_with_the_fourth_power_of_the_box() -> None:
    for rho, rho_half, b, b_half in boxes(300, 0.02, seed=4):
        whole, half = (
            np.array([m.remainder for m in enclose_rod(rho, part * rho_half, b, part * b_half)]) for part in (1.0, 0.5)
        )
        noise = 1e-9 * (1.0 + rho * rho)
        assert np.all(half <= whole / 12.0 + noise), (rho, b)


@pytest.mark.parametrize("relative", [0.0, 1e-3, 0.03])
def test_derivatives_hold_those_of_the_rod(relative: float) -> None:
    rng = np.random.default_rng(9)
    for box in boxes(500, relative, seed=5):
        if box[0] < 0.1:
            continue
        s, t = rng.uniform(-1.0, 1.0, 2)
        rho, b, g_x, g_y = polar(box, s, t)
        point = rod(g_x, g_y)
        by_gx = point.tip_x_gx, point.tip_y_gx, point.force_x_gx, point.force_y_gx
        by_gy = point.tip_x_gy, point.tip_y_gy, point.force_x_gy, point.force_y_gy
        _, by_rho, by_b = enclose_rod_derivatives(along_s(box[0], box[1], 0.0), along_t(box[2], box[3], 0.0))
        for x, y, rho_model, b_model in zip(by_gx, by_gy, by_rho, by_b, strict=True):
            along = 2.0 * rho * (x * math.cos(b) - y * math.sin(b))
            across = -rho * rho * (x * math.sin(b) + y * math.cos(b))
            size = rho * rho * (abs(x) + abs(y))
            for model, value in ((rho_model, along), (b_model, across)):
                assert not abs(float(at(model, s, t)) - value) > model.remainder + 1e-11 * (1.0 + size), (box, s, t)
                assert relative > 0.0 or model.remainder < 1e-7 * (1.0 + size)


@pytest.mark.parametrize("relative", [0.0, 1e-3, 0.03])
def test_what_a_rod_does_in_any_direction_holds_that_of_the_rod(relative: float) -> None:
    """p . f, p x f and |p|^2, and their derivatives, from tip, force and derivatives of the scalar code."""
    rng = np.random.default_rng(10)
    for box in boxes(500, relative, seed=6):
        if box[0] < 0.1:
            continue
        s, t = rng.uniform(-1.0, 1.0, 2)
        rho, b, g_x, g_y = polar(box, s, t)
        point = rod(g_x, g_y)
        p, f = np.array([point.tip_x, point.tip_y]), np.array([point.force_x, point.force_y])
        chain = np.array(
            [[2.0 * rho * math.cos(b), -(rho**2) * math.sin(b)], [-2.0 * rho * math.sin(b), -(rho**2) * math.cos(b)]]
        )
        p_z = np.reshape(point[4:8], (2, 2)) @ chain
        f_z = np.reshape(point[8:12], (2, 2)) @ chain
        truths = [[p @ f, p[0] * f[1] - p[1] * f[0], p @ p]]
        for k in range(2):
            cross = p_z[0, k] * f[1] + p[0] * f_z[1, k] - p_z[1, k] * f[0] - p[1] * f_z[0, k]
            truths.append([p_z[:, k] @ f + p @ f_z[:, k], cross, 2.0 * p @ p_z[:, k]])
        models = along_s(box[0], box[1], 0.0), along_t(box[2], box[3], 0.0)
        size = (1.0 + rho * rho) * (1.0 + np.abs(chain).max())
        for own, truth in zip([enclose_turnable(*models), *enclose_turnable_derivatives(*models)], truths, strict=True):
            for model, value in zip(own, truth, strict=True):
                assert not abs(float(at(model, s, t)) - value) > model.remainder + 1e-11 * size, (box, s, t)
                assert relative > 0.0 or model.remainder < 1e-7 * size


@pytest.mark.parametrize("largest", [1e-12, 1e-3, 0.05, 0.3, 0.9])
def test_bounds_of_slightly_loaded_rods_hold(largest: float) -> None:
    bounds = np.array(enclose_slightly_loaded(largest))
    unloaded = np.array([1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0 / 3.0])
    rng = np.random.default_rng(10)
    reached = np.zeros(8)
    for _ in range(500):
        load, angle = largest * math.sqrt(rng.uniform(0.5, 1.0)), rng.uniform(-math.pi, math.pi)
        point = rod(load * math.cos(angle), load * math.sin(angle))
        force = point.force_x_gx, point.force_y_gx, point.force_x_gy, point.force_y_gy
        tip = point.tip_x_gx, point.tip_y_gx, point.tip_x_gy, point.tip_y_gy
        distance = np.abs(np.array([*force, *tip]) - unloaded)
        assert np.all(distance <= bounds + 1e-14)
        reached = np.maximum(reached, distance)
    if largest == 0.3:  # and are not far from what is reached
        assert np.all(reached > 0.25 * bounds)


def test_nothing_is_claimed_of_too_large_a_box() -> None:
    enclosure: RodEnclosure = enclose_rod(6.0, 3.0, 1.0, 1.0)
    assert not any(model.remainder < 1.0 for model in enclosure)
