"""The benchmarks measure, in turn, what is there, and say what is not. No time is asserted."""

import gymnasium
import pytest

import pcm_gym
from benchmarks import batch, single
from benchmarks.batch import batch_throughput, make_batches, memory_per_environment, step_parts
from benchmarks.machine import describe_machine
from benchmarks.timing import Summary, interleave


def test_measurements_take_turns_and_are_summarised() -> None:
    order = []

    def measure(name: str) -> dict[str, float]:
        order.append(name)
        return {"value": float(len(order))}

    found = interleave({"a": lambda: measure("a"), "b": lambda: measure("b")}, 3, lambda: None)
    assert "".join(order) == "ababab"
    assert found["a"]["value"] == Summary(median=3.0, least=1.0, most=5.0)


def test_absent_peers_are_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(single, "PEERS", ("Pendulum-v1", "NoSuchPeer-v1"))
    environments, absent = single.make_all()
    assert list(environments) == [*pcm_gym.environment_ids(), "Pendulum-v1"]
    assert list(absent) == ["NoSuchPeer-v1"]
    assert "NoSuchPeer" in absent["NoSuchPeer-v1"]


def test_absent_peer_of_batches_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise ImportError("No module named 'envpool'")

    monkeypatch.setattr(batch, "peer_throughput", refuse)
    measures, absent = make_batches([], 0.01)
    assert measures == {}
    assert absent == {batch.PEER: "No module named 'envpool'"}


def test_everything_measured_is_positive() -> None:
    environment_id = pcm_gym.environment_ids()[0]
    measures = [
        single.throughput(gymnasium.make(environment_id), 0.01),
        batch_throughput(environment_id, 4, 1, 0.01),
        memory_per_environment(environment_id),
    ]
    for measure in measures:
        assert all(value > 0.0 for value in measure().values())
    parts = step_parts(environment_id)()
    assert all(parts[name] > 0.0 for name in ("solve", "total", "all_alone"))
    assert all(describe_machine().values())
