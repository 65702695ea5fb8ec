"""A policy does with NumPy alone what its file says, for one observation and for many, and refuses all else."""

import itertools
import json
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest

import pcm_gym
from pcm_gym.policies import shipped
from pcm_gym.policies.network import ACTIVATIONS, Layer, Network, Normaliser
from pcm_gym.policies.policy import Policy
from pcm_gym.policies.shipped import PolicyKey

ID = "PCM/2RFR-Reach-v0"
KEYS = ("observation", "achieved_goal", "desired_goal")


def policy_for(env: Any, seed: int = 0, **changes: Any) -> Policy:
    """Return a policy of random numbers for an environment."""
    generator = np.random.default_rng(seed)
    sizes = tuple(env.observation_space[key].shape[-1] for key in KEYS)
    widths = (sum(sizes) + sizes[2], 16, 8, env.action_space.shape[-1])
    layers = tuple(
        Layer(generator.normal(0.0, 0.4, pair).astype(np.float32), generator.normal(0, 0.1, pair[1]).astype(np.float32))
        for pair in itertools.pairwise(widths)
    )
    normaliser = Normaliser(generator.normal(0.0, 0.1, sizes[0]), generator.uniform(0.5, 2.0, sizes[0]), 10.0)
    usual: dict[str, Any] = {
        "keys": KEYS,
        "sizes": sizes,
        "features": "goal_error",
        "activation": "tanh",
        "output": "clip",
        "fine": 0.05,
        "layers": layers,
        "normaliser": normaliser,
    }
    return Policy(Network(**usual | changes), {"seed": seed, "environment": {"id": ID}})


@pytest.fixture(scope="module")
def env() -> Any:
    return gymnasium.make(ID)


@pytest.fixture(scope="module")
def batch() -> Any:
    return gymnasium.make_vec(ID, num_envs=5, vectorization_mode="vector_entry_point")


@pytest.mark.parametrize("activation", ACTIVATIONS)
@pytest.mark.parametrize("output", ["clip", "tanh"])
def test_one_observation_and_many_lead_to_the_same_actions(batch: Any, activation: str, output: str) -> None:
    policy = policy_for(batch, activation=activation, output=output)
    observations, _ = batch.reset(seed=4)
    actions = policy(observations)
    assert actions.shape == (5, 2)
    assert actions.dtype == np.float32
    assert batch.action_space.contains(actions)
    for row in range(5):
        alone = policy({key: array[row] for key, array in observations.items()})
        assert alone.shape == (2,)
        np.testing.assert_allclose(alone, actions[row], rtol=0, atol=1e-6)


def test_a_file_gives_the_same_policy_back(batch: Any, tmp_path: Path) -> None:
    policy, path = policy_for(batch), tmp_path / "policy.npz"
    policy.save(path)
    loaded = pcm_gym.load_policy(path)
    observations, _ = batch.reset(seed=1)
    np.testing.assert_array_equal(loaded(observations), policy(observations))
    assert loaded.card.items() >= policy.card.items()
    assert len(loaded.card["digest"]) == 64
    loaded.save(tmp_path / "again.npz")
    assert pcm_gym.load_policy(str(tmp_path / "again.npz")).card == loaded.card
    loaded.card["seed"] = 9
    assert loaded.card["seed"] == 0


def test_the_digest_is_that_of_the_numbers(batch: Any, tmp_path: Path) -> None:
    digests = []
    others: list[dict[str, Any]] = [{}, {"fine": 0.06}, {"normaliser": None}, {"activation": "relu"}]
    for number, changes in enumerate(others):
        policy_for(batch, **changes).save(tmp_path / f"{number}.npz")
        digests.append(pcm_gym.load_policy(tmp_path / f"{number}.npz").card["digest"])
    assert len(set(digests)) == 4


@pytest.mark.parametrize(
    ("observation", "message"),
    [
        (None, "observation must have the entries"),
        ({}, "got no 'observation'"),
        ({"desired_goal": np.zeros(3)}, r"observation\['desired_goal'\] must be \(2,\) or \(n, 2\), got \(3,\)"),
        ({"desired_goal": np.zeros((4, 2))}, "as many environments as the others"),
        ({"desired_goal": np.array(["a", "b"])}, "must be an array of numbers"),
        ({"desired_goal": np.array([None, 1.0])}, "must be an array of numbers"),
    ],
)
def test_what_is_no_observation_of_its_environment_is_refused(env: Any, observation: Any, message: str) -> None:
    whole = env.reset(seed=0)[0] if observation else {}
    with pytest.raises((TypeError, ValueError), match=message):
        policy_for(env)(None if observation is None else whole | observation)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"features": "pictures"}, "features must be one of"),
        ({"activation": "sin"}, "activation must be one of"),
        ({"output": "none"}, "output must be one of"),
        ({"fine": 0.0}, "fine must be"),
        ({"keys": ("a", "b", "c")}, "goal-based"),
        ({"layers": ()}, "at least one"),
        ({"sizes": (3, 2, 2)}, r"layers\[0\] must take 9 numbers"),
        ({"normaliser": Normaliser(np.zeros(3), np.ones(3), 1.0)}, "normaliser must have"),
    ],
)
def test_networks_that_do_not_fit_together_are_refused(env: Any, changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        policy_for(env, **changes)


def test_shipped_policies_are_found_by_id_difficulty_and_kind(
    env: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(shipped, "FOLDER", tmp_path)
    keys = [PolicyKey(ID), PolicyKey(ID, "detour", "smallest"), PolicyKey("PCM/3PFR-Reach-v0", None, "safest")]
    for seed, key in enumerate(keys):
        policy_for(env, seed).save(tmp_path / key.file_name)
    assert sorted(map(str, pcm_gym.shipped_policies())) == sorted(map(str, keys))
    assert [pcm_gym.load_policy(*key).card["seed"] for key in keys] == [0, 1, 2]
    with pytest.raises(pcm_gym.PolicyError, match=r"'PCM/2RFR-Reach-v0', difficulty 'around'(.|\n)*detour, smallest"):
        pcm_gym.load_policy(ID, "around")
    with pytest.raises(pcm_gym.PolicyError, match="no policy for 'CartPole-v1'"):
        pcm_gym.load_policy("CartPole-v1")
    with pytest.raises(ValueError, match="kind must be one of"):
        pcm_gym.load_policy(ID, kind="fastest")


def test_every_shipped_policy_loads_and_acts_in_its_environment() -> None:
    for key in pcm_gym.shipped_policies():
        policy = pcm_gym.load_policy(*key)
        declared = policy.card["environment"]
        assert declared["id"] == key.environment_id
        own = gymnasium.make(declared["id"], **declared["kwargs"])
        assert own.action_space.contains(policy(own.reset(seed=0)[0]))


def test_learning_libraries_are_not_needed(env: Any, tmp_path: Path) -> None:
    policy_for(env).save(tmp_path / "policy.npz")
    code = (
        "import sys; sys.modules['torch'] = sys.modules['stable_baselines3'] = None\n"
        "import json, numpy as np, pcm_gym\n"
        f"policy = pcm_gym.load_policy({str(tmp_path / 'policy.npz')!r})\n"
        "found = policy({'observation': np.zeros(%d), 'achieved_goal': np.zeros(2), 'desired_goal': np.ones(2)})\n"
        "print(json.dumps(found.tolist()))"
    ) % env.observation_space["observation"].shape
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert len(json.loads(done.stdout)) == 2


def broken(sound: bytes) -> Any:
    numbers = np.random.default_rng(0)
    yield from (b"", b"no policy", b"PK\x05\x06" + bytes(18))
    for length in numbers.integers(1, len(sound), 40):
        yield sound[:length]
    for _ in range(150):
        changed = bytearray(sound)
        changed[int(numbers.integers(len(changed)))] ^= 1 << int(numbers.integers(8))
        yield bytes(changed)


def test_a_damaged_file_is_a_policy_error_or_does_no_harm(batch: Any, tmp_path: Path) -> None:
    policy, path = policy_for(batch), tmp_path / "policy.npz"
    policy.save(path)
    observations, _ = batch.reset(seed=1)
    expected, refused, begin = policy(observations), 0, time.perf_counter()
    for content in broken(path.read_bytes()):
        (tmp_path / "broken.npz").write_bytes(content)
        try:
            found = pcm_gym.load_policy(tmp_path / "broken.npz")
        except pcm_gym.PolicyError:
            refused += 1
        else:
            np.testing.assert_array_equal(found(observations), expected)
    assert refused > 150
    assert time.perf_counter() - begin < 60.0
    with pytest.raises(FileNotFoundError, match="cannot be read"):
        pcm_gym.load_policy(tmp_path / "nowhere.npz")


def test_pickles_are_not_read(batch: Any, tmp_path: Path) -> None:
    policy_for(batch).save(tmp_path / "policy.npz")
    with np.load(tmp_path / "policy.npz") as archive:
        arrays = dict(archive)
    for name, hostile in (("card", np.array([object()])), ("weights_0", np.array([Path("x")], dtype=object))):
        np.savez(tmp_path / "hostile.npz", allow_pickle=True, **arrays | {name: hostile})
        with pytest.raises(pcm_gym.PolicyError):
            pcm_gym.load_policy(tmp_path / "hostile.npz")
    for name, other in (("version", np.array(99)), ("format", np.array("x")), ("bias_0", arrays["bias_0"] + 1.0)):
        np.savez(tmp_path / "other.npz", **arrays | {name: other})
        with pytest.raises(pcm_gym.PolicyError, match=r"version 99|is not a policy|not those that its card is of|type"):
            pcm_gym.load_policy(tmp_path / "other.npz")
