"""What is known of scenes is worked out once for equal ones, and takes a bounded part of the memory."""

import weakref

import numpy as np

import pcm_gym
from pcm_gym.tasks import Scene
from pcm_gym.tasks.memory import byte_count, make_cache, remembered


class Chart:
    """An array that tells when nobody holds it any more."""

    def __init__(self, size: int) -> None:
        self.values = np.zeros(size)


def test_what_is_kept_takes_no_more_than_the_cache_may() -> None:
    charts: list[weakref.ref[Chart]] = []

    def chart(number: int, size: int) -> Chart:
        made = Chart(size)
        charts.append(weakref.ref(made))
        return made

    room = 1 << 22
    remember = remembered(chart, make_cache(room))
    for number in range(200):
        assert remember(number, 10_000 + 100 * number).values.nbytes > 0
        assert sum(byte_count(made) for made in map(weakref.ref.__call__, charts) if made is not None) <= room
    assert len(charts) == 200
    assert remember(199, 10_000 + 100 * 199) is charts[-1]()


def test_value_that_is_too_large_for_the_cache_is_returned_and_not_kept() -> None:
    cache = make_cache(1 << 16)
    assert remembered(Chart, cache)(100_000).values.size == 100_000
    assert len(cache) == 0


def test_functions_of_one_cache_do_not_mix_up_their_values() -> None:
    cache = make_cache(1 << 20)
    double, triple = remembered(lambda x: 2 * x, cache), remembered(lambda x: 3 * x, cache)
    assert [double(2), triple(2), double(2)] == [4, 6, 4]
    assert len(cache) == 2


def test_equal_scenes_share_one_roadmap() -> None:
    mechanism = pcm_gym.get_mechanism("2PFR")
    home = pcm_gym.home_equilibrium(mechanism)
    copies = [pcm_gym.Equilibrium(mechanism, home.state, home.inputs, home.load) for _ in range(2)]
    first, second = (Scene(mechanism, (0.0, 0.0), (0.03, 0.03), 0.05, origin) for origin in copies)
    assert first.origin is not second.origin
    assert first.roadmap is second.roadmap


def test_roadmap_counts_for_what_it_works_out_later() -> None:
    mechanism = pcm_gym.get_mechanism("2RFR")
    roadmap = pcm_gym.build_roadmap(mechanism, [pcm_gym.home_equilibrium(mechanism)], least_margin=0.05)
    counted = byte_count(roadmap)
    graph = roadmap._graph
    arrays = [value for value in vars(roadmap).values() if isinstance(value, np.ndarray)]
    arrays += [roadmap.components, roadmap.pose_densities, roadmap.pose_density_sums]
    arrays += [graph.data, graph.indices, graph.indptr]
    assert sum(array.nbytes for array in arrays) <= counted
