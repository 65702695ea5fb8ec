"""Episodes side by side on the native batch are those of a plain loop over single environments, to the last bit."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest

from agents.controllers.trained import TrainedController
from agents.evaluation.episodes import NOTED_INFOS, EpisodeResult, StepLog, longest_run
from agents.evaluation.rollouts import make_evaluation_batch, run_episodes
from agents.experiments.config import parse_config
from agents.learners.files import MODEL, NORMALISATION
from agents.learners.learner import new_learner, save_learner
from agents.learners.policy import LearntPolicy, load_policy
from agents.learners.settings import EnvironmentConfig
from pcm_gym.references import Controller, View
from pcm_gym.references.random import RandomController
from pcm_gym.references.resolved_rate import ResolvedRateController

SEEDS = (31, 41, 59, 26, 53, 58, 97)
ENVIRONMENTS = {
    "reach": EnvironmentConfig(id="PCM/2RFR-Reach-v0"),
    "platform": EnvironmentConfig(id="PCM/3PFR-Reach-v0", kwargs={"on_instability": "continue"}),
    "noisy path": EnvironmentConfig(
        id="PCM/2PFR-Track-v0", kwargs={"observation_noise": 0.01, "on_instability": "snap", "actuator_lag": 1.0}
    ),
}

# Action of a single environment: from it, from its observation, and from the controller's source of chance.
Act = Callable[[Any, dict[str, np.ndarray], np.random.Generator], np.ndarray]


def act_at_random(env: Any, observation: dict[str, np.ndarray], generator: np.random.Generator) -> np.ndarray:
    return generator.uniform(-1.0, 1.0, env.action_space.shape)


def act_by_resolved_rate(env: Any, observation: dict[str, np.ndarray], generator: np.random.Generator) -> np.ndarray:
    own = env.unwrapped
    here, there = observation["achieved_goal"], observation["desired_goal"]
    error = (there - here)[:2]
    if len(here) == 4:
        turn = np.arctan2(there[3], there[2]) - np.arctan2(here[3], here[2])
        error = np.append(error, (turn + np.pi) % (2.0 * np.pi) - np.pi)
    jacobian = own.equilibrium.forward_jacobian / own.mechanism.units.jacobian
    left, values, right = np.linalg.svd(jacobian, full_matrices=False)
    inverted = values / (values**2 + (0.05 * values[0]) ** 2)
    action = right.T @ (inverted * (left.T @ error)) / own.mechanism.units.kernel_from_inputs(own.max_action)
    return action / max(1.0, np.abs(action).max())


def plain_episode(environment: EnvironmentConfig, act: Act, episode: int, seed: int) -> EpisodeResult:
    env: Any = gymnasium.make(environment.id, **environment.kwargs, split="test")
    generator, infos, rewards, is_over = np.random.default_rng([seed, 1]), [], [], False
    observation, _ = env.reset(seed=seed)
    while not is_over:
        action = act(env, observation, generator).astype(np.float32)
        observation, reward, terminated, truncated, info = env.step(action)
        infos.append(info)
        rewards.append(reward)
        is_over = terminated or truncated
    costs = [info["cost"] for info in infos]
    return EpisodeResult(
        policy="any",
        episode=episode,
        seed=seed,
        is_success=infos[-1]["is_success"],
        is_safe_success=infos[-1]["is_success"] and max(costs) == 0.0,
        is_violation=any(info["cost_unstable"] for info in infos),
        is_solver_failure=any(info["cost_solver"] for info in infos),
        final_error=float(np.hypot(*(env.unwrapped.goal - env.unwrapped.equilibrium.pose)[:2])),
        smallest_stability_margin=min(info["stability_margin"] for info in infos),
        smallest_singularity_margin=min(info["singularity_margin"] for info in infos),
        cost=sum(costs),
        longest_cost_run=longest_run(np.array(costs) > 0.0),
        total_reward=float(np.sum(rewards)),
        length=len(infos),
    )


def plain_loop(environment: EnvironmentConfig, act: Act, seeds: Sequence[int]) -> list[EpisodeResult]:
    return [plain_episode(environment, act, episode, seed) for episode, seed in enumerate(seeds)]


def side_by_side(
    environment: EnvironmentConfig, controller: Controller, seeds: Sequence[int], count: int
) -> list[EpisodeResult]:
    found = run_episodes(make_evaluation_batch(environment, count), "any", controller, seeds)
    return sorted(found, key=lambda result: result.episode)


@pytest.fixture(scope="module")
def policy(tmp_path_factory: pytest.TempPathFactory) -> LearntPolicy:
    """A policy that is small and the same every time, and acts far from nought."""
    folder: Path = tmp_path_factory.mktemp("policy")
    hyperparameters = {"n_steps": 32, "batch_size": 64, "n_epochs": 2, "policy_kwargs": {"net_arch": [8]}}
    content = {"name": "x", "environment": {"id": "PCM/2RFR-Reach-v0"}, "total_steps": 256, "num_envs": 4}
    learner = new_learner(parse_config(content | {"hyperparameters": hyperparameters}))
    learner.learn(256)
    save_learner(learner, folder)
    return load_policy("PPO", folder / MODEL, folder / NORMALISATION)


@pytest.mark.parametrize("count", [1, 3, 16])
@pytest.mark.parametrize("environment", ENVIRONMENTS.values(), ids=ENVIRONMENTS.keys())
@pytest.mark.parametrize(
    ("controller", "act"),
    [(RandomController(), act_at_random), (ResolvedRateController(), act_by_resolved_rate)],
    ids=["random", "resolved rate"],
)
def test_side_by_side_is_the_plain_loop(
    controller: Controller, act: Act, environment: EnvironmentConfig, count: int
) -> None:
    assert side_by_side(environment, controller, SEEDS, count) == plain_loop(environment, act, SEEDS)


def test_learnt_policy_acts_side_by_side_as_alone(policy: LearntPolicy) -> None:
    def act(env: Any, observation: dict[str, np.ndarray], generator: np.random.Generator) -> np.ndarray:
        return policy({key: values[None] for key, values in observation.items()})[0]

    together = side_by_side(ENVIRONMENTS["reach"], TrainedController(policy), SEEDS, 3)
    for found, alone in zip(together, plain_loop(ENVIRONMENTS["reach"], act, SEEDS), strict=True):
        assert (found.seed, found.length, found.cost) == (alone.seed, alone.length, alone.cost)
        # inference in float32 rounds otherwise in batches of another size
        assert found.total_reward == pytest.approx(alone.total_reward, rel=1e-4)
        assert found.final_error == pytest.approx(alone.final_error, abs=1e-4)


def test_every_episode_is_watched_from_its_reset_to_its_end() -> None:
    seen: dict[int, list[bool]] = {}
    batch = make_evaluation_batch(ENVIRONMENTS["reach"], 3)
    results = list(
        run_episodes(
            batch,
            "any",
            RandomController(),
            SEEDS,
            lambda row, seed, infos: seen.setdefault(seed, []).append("event" in infos),
        )
    )
    assert seen == {result.seed: [False] + [True] * result.length for result in results}


def test_controller_is_told_where_episodes_are_and_how_old() -> None:
    ages: list[int] = []

    class Listener(RandomController):
        def act(self, view: View) -> np.ndarray:
            ages.extend(view.elapsed[view.under_way].tolist())
            return super().act(view)

    results = side_by_side(ENVIRONMENTS["reach"], Listener(), SEEDS, 3)
    assert sorted(ages) == sorted(age for result in results for age in range(result.length))


def test_nothing_to_run_gives_nothing() -> None:
    assert side_by_side(ENVIRONMENTS["reach"], RandomController(), [], 2) == []


def test_log_keeps_episodes_longer_than_it_has_room_for() -> None:
    log = StepLog(2)
    for step in range(300):
        if step == 100:
            log.begin(np.array([False, True]))
        infos = dict.fromkeys(NOTED_INFOS, np.zeros(2))
        log.add(np.array([step, -step], dtype=np.float64), infos)
    np.testing.assert_array_equal(log.steps(0)["reward"], np.arange(300))
    np.testing.assert_array_equal(log.steps(1)["reward"], -np.arange(100, 300))


@pytest.mark.parametrize(
    ("flags", "expected"),
    [([], 0), ([False], 0), ([True], 1), ([True, True, False, True], 2), ([False, True, True], 2)],
)
def test_longest_run_counts_successive_flags(flags: list[bool], expected: int) -> None:
    assert longest_run(np.array(flags, dtype=np.bool_)) == expected
