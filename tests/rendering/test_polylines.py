"""Polylines of equilibria: where the parts are, and the moment in the rods."""

import numpy as np
import pytest

from pcm_gym.mechanism import Mechanism, Revolute
from pcm_gym.rendering import Polylines, equilibrium_polylines
from pcm_gym.solving import Equilibrium


def tangent_angles(points: np.ndarray) -> np.ndarray:
    """Unwrapped directions of the pieces of polylines (legs, points, 2)."""
    pieces = np.diff(points, axis=1)
    return np.unwrap(np.arctan2(pieces[..., 1], pieces[..., 0]), axis=1)


def test_shapes(stable: Equilibrium, mechanism: Mechanism) -> None:
    lines = equilibrium_polylines(stable, points=17)
    assert lines.rods.shape == (mechanism.leg_count, 17, 2)
    assert lines.moments.shape == (mechanism.leg_count, 17)
    assert lines.platform.shape == (mechanism.leg_count, 2)


def test_parts_meet(equilibria: list[Equilibrium]) -> None:
    for equilibrium in equilibria:
        lines = equilibrium_polylines(equilibrium)
        np.testing.assert_allclose(lines.platform, lines.hinges, atol=1e-9)
        np.testing.assert_allclose(lines.end_effector, equilibrium.pose[:2])


def test_rods_leave_along_their_clamps(equilibria: list[Equilibrium]) -> None:
    for equilibrium in equilibria:
        lines = equilibrium_polylines(equilibrium, points=4001)
        error = tangent_angles(lines.rods)[:, 0] - lines.clamp_angles
        # the first piece turns by half of curvature times its length, here below 0.01
        np.testing.assert_allclose(np.cos(error), 1.0, atol=1e-4)


def test_motors_turn_and_sliders_move(stable: Equilibrium, mechanism: Mechanism) -> None:
    lines = equilibrium_polylines(stable)
    for leg, value, clamp, angle in zip(mechanism.legs, stable.inputs, lines.clamps, lines.clamp_angles, strict=True):
        turns = isinstance(leg.actuator, Revolute)
        assert angle == leg.actuator.clamp_angle + (value if turns else 0.0)
        assert np.linalg.norm(clamp - leg.actuator.base) == pytest.approx(0.0 if turns else abs(value), abs=1e-12)


def test_moment_vanishes_at_the_hinges(equilibria: list[Equilibrium]) -> None:
    for equilibrium in equilibria:
        assert np.all(equilibrium_polylines(equilibrium).moments[:, -1] == 0.0)


def test_moment_is_stiffness_times_curvature(equilibria: list[Equilibrium], mechanism: Mechanism) -> None:
    points = 2001
    stiffness = np.array([[leg.rod.bending_stiffness] for leg in mechanism.legs])
    step = np.array([[leg.rod.length] for leg in mechanism.legs]) / (points - 1)
    for equilibrium in equilibria:
        lines = equilibrium_polylines(equilibrium, points)
        curvature = np.diff(tangent_angles(lines.rods), axis=1) / step
        # central differences of second order: relative error about (rho / points)^2
        atol = 1e-4 * np.abs(lines.moments).max()
        np.testing.assert_allclose(lines.moments[:, 1:-1], stiffness * curvature, rtol=0.0, atol=atol)


def test_arrays_are_new_and_writeable(stable: Equilibrium) -> None:
    def arrays(lines: Polylines) -> list[np.ndarray]:
        return [lines.rods, lines.moments, lines.clamp_angles, lines.end_effector, lines.platform]

    first, second = equilibrium_polylines(stable), equilibrium_polylines(stable)
    for one, other in zip(arrays(first), arrays(second), strict=True):
        assert one.flags.writeable
        assert not np.shares_memory(one, other)
        np.testing.assert_array_equal(one, other)


def test_one_point_is_not_a_line(stable: Equilibrium) -> None:
    with pytest.raises(ValueError, match="at least 2"):
        equilibrium_polylines(stable, points=1)
