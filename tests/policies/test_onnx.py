"""The ONNX model of a policy acts as the policy does, as ONNX's own reference evaluator says."""

import json
import sys
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest

from pcm_gym.policies.network import ACTIVATIONS, Layer
from tests.policies.test_policies import ID, KEYS, policy_for

onnx = pytest.importorskip("onnx")
reference: Any = pytest.importorskip("onnx.reference")


@pytest.fixture(scope="module")
def batch() -> Any:
    return gymnasium.make_vec(ID, num_envs=50, vectorization_mode="vector_entry_point")


def acted(path: Path, observations: Any) -> Any:
    singles = {key: np.asarray(value, dtype=np.float32) for key, value in observations.items()}
    return reference.ReferenceEvaluator(str(path)).run(None, singles)[0]


@pytest.mark.parametrize("activation", ACTIVATIONS)
@pytest.mark.parametrize("output", ["clip", "tanh"])
def test_every_kind_of_network_acts_the_same(batch: Any, activation: str, output: str, tmp_path: Path) -> None:
    policy, path = policy_for(batch, activation=activation, output=output), tmp_path / "policy.onnx"
    policy.save_onnx(path)
    for seed in range(4):
        observations, _ = batch.reset(seed=seed)
        np.testing.assert_allclose(acted(path, observations), policy(observations), rtol=0, atol=1e-5)


def test_without_a_normaliser_and_with_plain_features_too(batch: Any, tmp_path: Path) -> None:
    observations, _ = batch.reset(seed=0)
    width = sum(batch.observation_space[key].shape[-1] for key in KEYS)
    numbers = np.random.default_rng(3).normal(0.0, 0.3, (width + 1, 2)).astype(np.float32)
    layer = Layer(numbers[:-1].copy(), numbers[-1].copy())
    changes: list[dict[str, Any]] = [{"normaliser": None}, {"features": "concatenated", "layers": (layer,)}]
    for number, own in enumerate(changes):
        policy, path = policy_for(batch, **own), tmp_path / f"{number}.onnx"
        policy.save_onnx(path)
        np.testing.assert_allclose(acted(path, observations), policy(observations), rtol=0, atol=1e-5)


def test_the_card_goes_with_the_model(batch: Any, tmp_path: Path) -> None:
    policy = policy_for(batch)
    policy.save_onnx(str(tmp_path / "policy.onnx"))
    properties = {own.key: own.value for own in onnx.load(tmp_path / "policy.onnx").metadata_props}
    assert json.loads(properties["card"]) == policy.card


def test_without_onnx_it_is_said_what_to_install(batch: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(sys.modules, "pcm_gym.policies.onnx_file", raising=False)
    monkeypatch.setitem(sys.modules, "onnx", None)
    with pytest.raises(ImportError, match=r"pip install 'pcm_gym\[onnx\]'"):
        policy_for(batch).save_onnx(tmp_path / "policy.onnx")
