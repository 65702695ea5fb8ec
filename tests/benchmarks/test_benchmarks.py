"""The benchmarks measure, in turn, what is there, and say what is not. No time is asserted."""

import json
from pathlib import Path

import gymnasium
import numpy as np
import pytest

import pcm_gym
from benchmarks import batch, single
from benchmarks.batch import batch_throughput, make_batches, memory_per_environment, step_parts
from benchmarks.certificates import try_paths
from benchmarks.endurance import Case, Tally, contradictions, endure, make_batch, read_cases, write_cases
from benchmarks.machine import describe_machine
from benchmarks.shield import KINDS, defend
from benchmarks.timing import Summary, interleave
from benchmarks.training import make_loops
from pcm_gym.kernels.statics.states import States


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
    for loop in make_loops(environment_id, 4, "relu", rollouts=1).values():
        assert all(rate > 0.0 for rate in loop().values())
    parts = step_parts(environment_id)()
    assert all(parts[name] > 0.0 for name in ("solve", "total", "all_alone"))
    assert all(describe_machine().values())


@pytest.mark.parametrize("on_instability", ["terminate", "snap", "hold", "continue"])
def test_endurance_finds_no_contradiction(on_instability: str) -> None:
    tally = endure("PCM/2RFR-Reach-v0", on_instability, 30_000, 1.0, 3, lambda _: None)
    assert tally.steps == 30_000
    assert tally.contradictions.total() == 0
    assert tally.events["fold"] > 100
    assert (tally.unstable_steps > 0) == (on_instability == "continue")
    assert json.loads(json.dumps(tally.as_dict()))["events"]["fold"] == tally.events["fold"]


def test_shields_withstand_an_adversary_and_agree() -> None:
    """What is lost without them is not lost with them, one by one or together."""
    found = {}
    for kind in KINDS:
        found[kind], without = defend("2RFR", "lag", "hold", kind, 2500, lambda _: None)
        assert without.losses > 20
        assert found[kind].replaced > 100
        assert (found[kind].losses, found[kind].failures, found[kind].below) == (0, 0, 0)
        found[kind].name = ""
    assert found["single"] == found["vector"]


def test_certificates_are_counted_and_timed() -> None:
    tally = try_paths("2RFR", 3, 6, 0, lambda: None)
    assert (tally.paths, tally.proved, len(tally.step_times)) == (3, 3, 3)
    assert set(tally.mutations.values()) == {1}
    assert sum(tally.proved_mutations.values()) == 0
    assert json.loads(json.dumps(tally.as_dict()))["mechanism"] == "2RFR"


def test_endurance_keeps_what_does_not_fit_together(tmp_path: Path) -> None:
    """A batch that terminates is told to snap."""
    env = make_batch("PCM/2RFR-Reach-v0", "terminate", 1.0, 200)
    env.reset(seed=0)
    simulation = env._simulation
    actions = np.random.default_rng(0).choice([-1.0, 1.0], env.action_space.shape)
    for _ in range(30):
        before = States(*(array.copy() for array in simulation.rows.states))
        outcome = env.step(actions)
        lost = outcome[2]
        assert dict(contradictions(env, "terminate", before, actions, outcome)) == {}
        if lost.any():
            found = dict(contradictions(env, "snap", before, actions, outcome))
            assert found.keys() == {"terminated by what ends it", "is_stable true", "goes on after a fold"}
            assert all((rows == lost).all() for rows in found.values())
            break
    row = int(np.flatnonzero(lost)[0])
    numbers = (array[row].tolist() for array in (*before, actions))
    case = Case("wrong", "PCM/2RFR-Reach-v0", "terminate", 1.0, 0, "random", *numbers)
    tally = Tally("PCM/2RFR-Reach-v0", "terminate", cases=[case])
    assert write_cases(tmp_path / "cases.json", [tally]) == 1
    [again] = read_cases(tmp_path / "cases.json")
    assert again == case
    info = again.repeat()
    assert info["event"] == pcm_gym.Event.FOLD
    assert info["stability_margin"] == outcome[4]["stability_margin"][row]
