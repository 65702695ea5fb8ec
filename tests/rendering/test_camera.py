"""The camera: the same scale both ways, and every part in view wherever the mechanism goes."""

import numpy as np
import pytest

from pcm_gym.mechanism import Leg, Mechanism, Prismatic, Revolute, Rod
from pcm_gym.rendering import Camera, FrameRenderer, equilibrium_polylines
from pcm_gym.rendering.camera import rail_ends, reach_bounds
from pcm_gym.solving import Equilibrium

SIZES = [(480, 480), (640, 360), (100, 300)]


def assert_in_view(camera: Camera, points: np.ndarray, margin: float) -> None:
    pixels = camera.pixels(points)
    assert np.all(pixels >= margin - 1e-9)
    assert np.all(pixels <= np.array(camera.size) - margin + 1e-9)


def test_pixels_of_corners_and_centre() -> None:
    camera = Camera.fit((-1.0, 3.0, 0.0, 2.0), (400, 200))
    np.testing.assert_allclose(camera.pixels([(-1.0, 2.0), (3.0, 0.0), (1.0, 1.0)]), [(0, 0), (400, 200), (200, 100)])
    assert camera.bounds == pytest.approx((-1.0, 3.0, 0.0, 2.0))


@pytest.mark.parametrize("size", SIZES)
def test_fit_keeps_bounds_within_margin_and_touches_one_pair_of_sides(size: tuple[int, int]) -> None:
    camera = Camera.fit((-1.0, 1.0, -0.5, 0.5), size, margin=10.0)
    corners = camera.pixels([(-1.0, -0.5), (1.0, 0.5)])
    spare = np.minimum(corners.min(axis=0), np.array(size) - corners.max(axis=0))
    assert spare.min() == pytest.approx(10.0)


def test_points_and_pixels_are_inverse() -> None:
    camera = Camera.fit((-1.0, 3.0, 0.5, 2.0), (400, 300), margin=7.0)
    points = np.random.default_rng(0).normal(size=(3, 4, 2))
    np.testing.assert_allclose(camera.points(camera.pixels(points)), points, atol=1e-12)


def test_magnified_camera_sees_the_same() -> None:
    camera = Camera.fit((-1.0, 1.0, -2.0, 3.0), (300, 200), margin=5.0)
    assert camera.magnified(3).bounds == pytest.approx(camera.bounds)
    np.testing.assert_allclose(camera.magnified(3).pixels((0.3, 0.4)), 3.0 * camera.pixels((0.3, 0.4)))


@pytest.mark.parametrize("size", SIZES)
def test_every_part_is_in_view_at_the_limits(
    mechanism: Mechanism, equilibria_towards_limits: list[Equilibrium], size: tuple[int, int]
) -> None:
    camera = FrameRenderer(mechanism, size).camera
    margin = 10.0 / 480.0 * min(size)  # half an actuator
    at_limits = [
        np.all(np.isin(found.inputs, [mechanism.lower_limits, mechanism.upper_limits]))
        for found in equilibria_towards_limits
    ]
    assert sum(at_limits) > 10
    for leg in mechanism.legs:
        assert_in_view(camera, rail_ends(leg), margin)
    for equilibrium in equilibria_towards_limits:
        lines = equilibrium_polylines(equilibrium)
        for points in (lines.rods, lines.platform, lines.end_effector):
            assert_in_view(camera, points, margin)


def test_reach_of_two_motors() -> None:
    """Tips reach 1 beyond the nearer motor; a rod bows at most to 1 beyond its own base, sideways to half way more."""
    legs = tuple(Leg(Revolute(base=(x, 0.0)), Rod(length=1.0)) for x in (-0.2, 0.2))
    assert reach_bounds(Mechanism("m", legs)) == pytest.approx((-1.0, 1.0, -1.0, 1.0))


def test_reach_includes_the_travel() -> None:
    legs = tuple(Leg(Prismatic((x, 0.0), 0.5 * np.pi, 0.0, (-0.3, 0.7)), Rod(length=1.0)) for x in (-0.2, 0.2))
    assert reach_bounds(Mechanism("m", legs)) == pytest.approx((-1.0, 1.0, -1.3, 1.7))


def test_bounds_of_ones_own() -> None:
    mechanism = Mechanism("m", tuple(Leg(Revolute(base=(x, 0.0))) for x in (-0.2, 0.2)))
    assert FrameRenderer(mechanism, bounds=(0.0, 1.0, 2.0, 3.0)).camera.centre == (0.5, 2.5)
    with pytest.raises(ValueError, match="bounds"):
        FrameRenderer(mechanism, bounds=(1.0, 0.0, 2.0, 3.0))
