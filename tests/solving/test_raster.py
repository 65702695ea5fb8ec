"""Rasters and regions: areas and boundaries of figures that are known."""

import math

import numpy as np
import pytest

from pcm_gym.solving import Raster, Region


def raster(count: int = 100) -> Raster:
    return Raster.over([-1.0, -1.0], [1.0, 1.0], (count, count + 7), (False, False))


def disc(plane: Raster, radius: float, hole: float = 0.0) -> Region:
    distance = np.linalg.norm(plane.all_nodes - [0.013, 0.007], axis=1).reshape(plane.shape)
    return Region(plane, (distance <= radius) & (distance >= hole))


def enclosed(line: np.ndarray) -> float:
    return 0.5 * float(np.sum(line[:-1, 0] * line[1:, 1] - line[1:, 0] * line[:-1, 1]))


def test_every_node_is_in_its_own_cell_and_cells_fill_the_box():
    plane = raster()
    assert np.array_equal(plane.cells_of(plane.all_nodes), np.arange(plane.size))
    assert plane.cell_area * plane.size == pytest.approx(4.0)
    corners = [[-0.9999, -0.9999], [0.9999, 0.9999], [1.0001, 0.0], [0.0, -1.0001]]
    assert plane.cells_of(corners).tolist() == [0, plane.size - 1, -1, -1]


def test_a_point_lies_between_the_nodes_around_it():
    plane, rng = raster(), np.random.default_rng(6)
    for point in rng.uniform(-0.9, 0.9, (50, 2)):
        gaps = np.abs(plane.nodes(plane.cells_around(point)) - point)
        assert gaps.shape == (4, 2)
        assert (gaps <= plane.pitch).all()
    assert len(plane.cells_around([-1.0, -1.0])) == 1
    assert len(plane.cells_around([3.0, 0.0])) == 0


def test_a_closed_axis_continues_at_its_other_end():
    ring = Raster.over([0.0, -math.pi], [1.0, math.pi], (4, 12), (False, True))
    assert ring.cells_of([[0.1, math.pi + 0.1]]) == ring.cells_of([[0.1, -math.pi + 0.1]])
    assert len(ring.cells_around([0.5, math.pi])) == 4
    full_turn = Region(ring, np.ones(ring.shape, dtype=bool))
    assert full_turn.area == pytest.approx(2.0 * math.pi)
    assert full_turn.area_error == pytest.approx(2.0 * math.sqrt(24 / 12) * ring.cell_area)  # the ends along x alone


@pytest.mark.parametrize("count", [30, 100, 300])
@pytest.mark.parametrize(("radius", "hole"), [(0.8, 0.0), (0.61, 0.2), (0.3, 0.13)])
def test_the_area_of_a_ring_is_right_within_its_error(count, radius, hole):
    region = disc(raster(count), radius, hole)
    truth = math.pi * (radius**2 - hole**2)
    assert abs(region.area - truth) < 1.5 * region.area_error
    assert region.area_error < 0.1 * truth


def test_boundaries_are_closed_and_enclose_the_area():
    region = disc(raster(200), 0.7, 0.3)
    assert len(region.boundaries) == 2
    assert all(np.array_equal(line[0], line[-1]) for line in region.boundaries)
    radii = sorted(float(np.linalg.norm(line - [0.013, 0.007], axis=1).mean()) for line in region.boundaries)
    assert radii == pytest.approx([0.3, 0.7], abs=0.01)
    assert abs(sum(map(enclosed, region.boundaries))) == pytest.approx(region.area, rel=2e-3)


def test_a_region_at_the_edge_of_the_raster_has_a_closed_boundary():
    plane = raster()
    (line,) = Region(plane, np.ones(plane.shape, dtype=bool)).boundaries
    assert np.array_equal(line[0], line[-1])
    assert abs(enclosed(line)) == pytest.approx(4.0, rel=1e-3)


def test_a_region_knows_its_points():
    region = disc(raster(), 0.5)
    assert region.contains([[0.0, 0.0], [0.49, 0.0], [0.6, 0.0], [5.0, 0.0]]).tolist() == [True, True, False, False]


def test_boundaries_of_a_volume_are_refused():
    space = Raster.over([0.0] * 3, [1.0] * 3, (3, 3, 3), (False,) * 3)
    with pytest.raises(ValueError, match="plane"):
        Region(space, np.ones(space.shape, dtype=bool)).boundaries  # noqa: B018
