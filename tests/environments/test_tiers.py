"""Tiers: train and test are apart, standing still and acting at random fail, and none is empty without saying so."""

from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode
from scipy.spatial import cKDTree

import pcm_gym
from pcm_gym.tasks import GUARD, SPLITS, in_split
from tests.environments.rollouts import MECHANISMS, make_bare, make_native

NAMES = MECHANISMS
TIERS = [
    *(("Reach", difficulty) for difficulty in ("near", "anywhere", "detour", "rig")),
    *(("Track", difficulty) for difficulty in ("inside", "edge", "rig")),
    *(("Switch", difficulty) for difficulty in ("near", "far", "around", "fall", "rig")),
]


def make_tier(name: str, task: str, difficulty: str, count: int, **keywords: Any) -> Any:
    """A batch, reset; skips where the mechanism has no such tier, and says so."""
    keywords = {"on_instability": "snap" if difficulty == "fall" else "terminate", "variants": 2} | keywords
    batch = make_native(f"PCM/{name}-{task}-v0", count, difficulty=difficulty, **keywords)
    try:
        batch.reset(seed=0)
    except ValueError as error:
        if f"difficulty must not be {difficulty!r} for mechanism {name!r}" not in str(error):
            raise
        pytest.skip(str(error))
    return batch


def pairs(batch: Any) -> Any:
    """The starts and goals of the episodes, as goals hold them, without noise."""
    rows, task = batch._simulation.rows, batch.task
    return np.concatenate([task.goals.of_states(rows.x, rows.inputs), rows.goals[:, 0]], axis=1)


@pytest.mark.parametrize(("task", "difficulty"), TIERS)
@pytest.mark.parametrize("name", NAMES)
def test_training_and_test_are_apart_and_all_their_episodes_differ(name: str, task: str, difficulty: str) -> None:
    """By the nearest neighbours of 3,000 episodes each, found by a tree that knows nothing of the strips."""
    found = {split: pairs(make_tier(name, task, difficulty, 3000, split=split)) for split in SPLITS}
    for episodes in found.values():
        assert len(np.unique(np.round(episodes, 9), axis=0)) >= 2990
    distances, _ = cKDTree(found["train"]).query(found["test"])
    assert distances.min() >= GUARD


def test_strips_are_apart_by_construction() -> None:
    """Random pairs of starts and goals in a space of many strips: a fifth is of neither part."""
    places = np.random.default_rng(0).uniform(-1.0, 1.0, (200_000, 4))
    parts = {split: in_split(split, places[:, :2], places[:, 2:]) for split in SPLITS}
    assert not (parts["train"] & parts["test"]).any()
    assert (parts["train"] | parts["test"]).mean() == pytest.approx(0.8, abs=0.01)
    distances, _ = cKDTree(places[parts["train"]]).query(places[parts["test"]])
    assert distances.min() >= GUARD


def test_mechanisms_and_loads_of_training_and_test_differ() -> None:
    variants = {}
    for split in SPLITS:
        batch = make_native("PCM/2RFR-Reach-v0", 40, difficulty="rig", variants=3, split=split)
        batch.reset(seed=0)
        variants[split] = {(batch.true_mechanism(row), tuple(batch.equilibrium(row).load)) for row in range(40)}
        assert len(variants[split]) == 3
    assert not variants["train"] & variants["test"]


@pytest.mark.parametrize(("task", "difficulty"), TIERS)
@pytest.mark.parametrize("name", NAMES)
def test_who_stands_still_and_who_acts_at_random_fail(name: str, task: str, difficulty: str) -> None:
    count, limit = 40, gymnasium.spec(f"PCM/{name}-{task}-v0").max_episode_steps
    assert limit is not None
    numbers = np.random.default_rng(0)
    for amplitude in (0.0, 1.0):
        batch = make_tier(
            name, task, difficulty, count, split="test", autoreset_mode=AutoresetMode.DISABLED, on_instability="snap"
        )
        for _ in range(limit):
            actions = amplitude * numbers.uniform(-1.0, 1.0, batch.action_space.shape)
            *_, infos = batch.step(actions)
            assert infos["is_success"].mean() <= 0.05


@pytest.mark.parametrize("name", NAMES)
def test_a_rig_senses_what_a_rig_has_and_no_more(name: str) -> None:
    seen = {}
    for observe in ("all", "rig", "pose"):
        env = make_bare(f"PCM/{name}-Reach-v0", observe=observe)
        observation, _ = env.reset(seed=0)
        seen[observe] = dict(zip([own.name for own in env.elements], observation["observation"].tolist(), strict=True))
    for observe in ("rig", "pose"):
        assert seen[observe].items() <= seen["all"].items()
    told = {key.rsplit("_", 1)[0] for key in seen["rig"]}
    assert not told & {"is", "stability", "singularity", "tip_load_along", "mode"}
    assert sum(key.startswith("effort_") for key in seen["rig"]) == env.mechanism.leg_count
    assert [key for key in seen["pose"] if key not in ("x", "y", "cos_phi", "sin_phi")] == []


@pytest.mark.parametrize("name", NAMES)
def test_efforts_are_those_of_the_actuators(name: str) -> None:
    """Against the equilibrium's own ones, which other tests hold to differences of the energy."""
    env = make_bare(f"PCM/{name}-Reach-v0")
    first = [own.name for own in env.elements].index("effort_1")
    units = env.mechanism.units
    for seed in range(5):
        observation, _ = env.reset(seed=seed)
        for _ in range(2):  # what is described and what is stepped
            efforts = env.equilibrium.actuator_forces / (units.energy / units.inputs)
            seen = observation["observation"][first : first + env.mechanism.leg_count]
            np.testing.assert_allclose(seen, efforts / (10.0 + np.abs(efforts)), rtol=0.0, atol=1e-9)
            observation, *_ = env.step(np.full(env.mechanism.leg_count, 0.1))


def test_the_rig_is_a_preset_that_arguments_change() -> None:
    env = make_bare("PCM/2RFR-Reach-v0", difficulty="rig", variants=2)
    env.reset(seed=0)
    names = [own.name for own in env.elements]
    assert (
        names
        == ["x", "y", *(f"{what}_{n}" for n in (1, 2) for what in ("input", "clamp_cos", "clamp_sin"))][:2] + names[2:]
    )
    assert {"effort_1", "command_1"} <= {*names}
    assert "load_1" not in names
    assert env.true_mechanism() != env.mechanism
    assert env.equilibrium.load.any()
    plain = make_bare("PCM/2RFR-Reach-v0", difficulty="rig", load=None, randomisation=None, observe="all")
    plain.reset(seed=0)
    assert plain.true_mechanism() == plain.mechanism
    assert "stability_margin" in [own.name for own in plain.elements]


def test_a_noisy_rig_tells_its_pose_with_noise_and_is_judged_by_the_true_one() -> None:
    env = make_bare("PCM/2RFR-Reach-v0", observe="rig", observation_noise=0.05)
    for seed in range(5):
        observation, _ = env.reset(seed=seed)
        true = env.task.goals.of_equilibrium(env.equilibrium)
        np.testing.assert_array_equal(observation["achieved_goal"], observation["observation"][:2])
        assert 0.0 < np.abs(observation["achieved_goal"] - true).max() < 0.3
        _, reward, *_ = env.step(np.zeros(2))
        assert reward == pytest.approx(env.compute_reward(true, observation["desired_goal"], {}), rel=1e-12)


# Shaping


@pytest.mark.parametrize(("name", "task"), [("2RFR", "Reach"), ("3PFR", "Reach"), ("2RFR", "Switch")])
def test_shaping_adds_up_to_the_potential_of_the_start(name: str, task: str) -> None:
    """Discounted, what it adds to an episode is the last potential less the first one, whatever is done (Ng 1999)."""
    discount = 0.97
    plain, shaped = (make_bare(f"PCM/{name}-{task}-v0", shaping=shaping) for shaping in (None, discount))
    numbers, ends = np.random.default_rng(0), 0
    for seed in range(8):
        plain.reset(seed=seed)
        shaped.reset(seed=seed)
        first, added = shaped._simulation.rows.potential[0], 0.0
        assert first < 1.0
        for step in range(25):
            action = numbers.uniform(-1.0, 1.0, plain.mechanism.leg_count)
            foreseen = shaped.preview(action[None]).reward[0]
            _, reward, terminated, *_ = plain.step(action)
            _, other, *_ = shaped.step(action)
            assert other == foreseen
            added += discount**step * (other - reward)
            last = shaped._simulation.rows.potential[0]
            assert last == 0.0 or not terminated
            assert added == pytest.approx(discount ** (step + 1) * last - first, abs=1e-12)
            if terminated:
                ends += 1
                break
    assert ends > 0 or name == "3PFR"


@pytest.mark.parametrize("name", NAMES)
def test_the_potential_grows_along_the_shortest_way_to_the_goal(name: str) -> None:
    env = make_bare(f"PCM/{name}-Reach-v0", shaping=0.99)
    scene = env._simulation.scenes[0]
    for seed in range(4):
        env.reset(seed=seed)
        ends = [env.equilibrium, env.witness]
        step = np.array(scene.stride) * env.mechanism.units.inputs
        motion = pcm_gym.plan_motion(ends[0], ends[1], step=step, least_margin=scene.margin)
        potentials = []
        for inputs in motion.inputs[1:]:
            env.step((inputs - env.equilibrium.inputs) / env.max_action)
            potentials.append(env._simulation.rows.potential[0])
        assert potentials[-1] == pytest.approx(1.0, abs=1e-6)
        # hubs are up to two ways from the goal: it may stand still there, but not fall far
        falls = -np.diff(potentials).min(initial=0.0)
        assert falls <= 0.05
        assert potentials[-1] - potentials[0] >= 0.004 * len(potentials)


def test_shaping_needs_a_discount_factor_and_a_goal_that_stays() -> None:
    for shaping in (0.0, -1.0, 1.5, "much"):
        with pytest.raises((TypeError, ValueError), match="shaping"):
            make_bare("PCM/2RFR-Reach-v0", shaping=shaping)
    with pytest.raises(ValueError, match="shaping must be None for task 'Track'"):
        make_bare("PCM/2RFR-Track-v0", shaping=0.99)
    with pytest.raises(ValueError, match="split must be one of"):
        make_bare("PCM/2RFR-Reach-v0", split="validation")
    with pytest.raises(ValueError, match="observe must be one of"):
        make_bare("PCM/2RFR-Reach-v0", observe="margins")


# Losses and dwelling


@pytest.mark.parametrize("behaviour", ["terminate", "snap", "hold", "continue"])
def test_losses_are_events_and_dwelling_is_where_the_state_is(behaviour: str) -> None:
    batch = make_native("PCM/2RFR-Reach-v0", 64, on_instability=behaviour)
    batch.reset(seed=0)
    numbers, losses, released = np.random.default_rng(0), 0, 0
    for _ in range(60):
        *_, infos = batch.step(np.clip(3.0 * numbers.normal(size=batch.action_space.shape), -1.0, 1.0))
        is_event = np.isin(infos["event"], (pcm_gym.Event.FOLD, pcm_gym.Event.INDEX_CHANGE))
        np.testing.assert_array_equal(infos["losses"] > 0, is_event)
        is_begun = infos["residual"] >= 0.0
        dwelling = (infos["index"] > 0) | (infos["cost_singular"] > 0.0)
        np.testing.assert_array_equal(infos["is_dwelling"][is_begun], dwelling[is_begun])
        if behaviour != "snap":
            assert not infos["energy_released"].any()
        else:
            assert ((infos["energy_released"] > 0.0) <= is_event).all()
        losses += int(infos["losses"].sum())
        released += int((infos["energy_released"] > 0.0).sum())
    assert losses > 0
    assert (released > 0) == (behaviour == "snap")
