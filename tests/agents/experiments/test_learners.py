"""Every learner that is chosen by name learns; what the Lagrangian and the shield promise holds while they do."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from stable_baselines3.common.callbacks import CallbackList
from stable_baselines3.common.logger import Logger
from typer.testing import CliRunner

from agents.commands.app import app
from agents.experiments.config import load_config, parse_config
from agents.experiments.learners import experiment_of, is_environment_id, learner_names
from agents.learners.algorithms import ALGORITHMS
from agents.learners.callbacks import EpisodeStatistics
from agents.learners.infos import columns_of
from agents.learners.lagrangian import CostController, Multiplier, turned
from agents.learners.learner import learning_callbacks, load_learner, new_learner, save_learner
from agents.learners.settings import ConfigError, LagrangianConfig
from pcm_gym.references import View, new_reference

ID = "PCM/2RFR-Reach-v0"


def small(learner: str, **changes: Any) -> Any:
    """Return an experiment of that learner with few environments and short rollouts."""
    content = experiment_of(ID, {}, learner).model_dump()
    sizes = {"n_steps": 8, "batch_size": 32, "learning_starts": 800, "buffer_size": 2_000, "gradient_steps": 1}
    own = {key: size for key, size in sizes.items() if key in content["hyperparameters"]}
    content["hyperparameters"] = content["hyperparameters"] | own
    if content["imitation"] is not None:
        content["imitation"] = {"reference": "resolved rate", "rounds": 2, "steps": 160, "critic_rollouts": 1}
    return parse_config(content | {"num_envs": 8} | changes)


def installed(learner: str) -> Any:
    config = small(learner)
    try:
        ALGORITHMS[config.algorithm].load_class()
    except ModuleNotFoundError as error:
        pytest.skip(str(error))
    return config


@pytest.mark.parametrize("learner", learner_names())
def test_every_learner_learns_and_can_be_continued(learner: str, tmp_path: Path) -> None:
    config = installed(learner)
    trained: Any = new_learner(config)
    trained.set_logger(Logger(None, []))
    callbacks = [EpisodeStatistics(), *learning_callbacks(config)]
    before = [own.clone() for own in trained.policy.parameters()]
    trained.learn(960, callback=CallbackList(callbacks))
    assert any((own != other).any() for own, other in zip(trained.policy.parameters(), before, strict=True))
    save_learner(trained, tmp_path)
    loaded: Any = load_learner(config, tmp_path)
    assert loaded.num_timesteps == trained.num_timesteps
    if config.imitation is not None:
        seen = loaded.num_timesteps
        loaded.set_logger(Logger(None, []))
        loaded.learn(1, callback=CallbackList(learning_callbacks(config)), reset_num_timesteps=False)
        assert loaded.num_timesteps == seen + 64, "it is not imitated twice"
    if config.lagrangian is not None:
        assert loaded.cost_multiplier == trained.cost_multiplier


def test_ids_are_told_from_files() -> None:
    assert all(map(is_environment_id, (ID, "CartPole-v1", "three_rfr:My/3RFR-Reach-v0")))
    assert not any(map(is_environment_id, ("configs/demo.yaml", "demo.yaml", "small", "runs/x-v0.yaml", "a/b/c-v0")))


def test_an_id_is_trained_without_a_file(tmp_path: Path) -> None:
    arguments = ["train", ID, "--with", "difficulty=anywhere", "--with", "hold_steps=2", "--total-steps", "1"]
    result = CliRunner().invoke(app, [*arguments, "--runs-dir", str(tmp_path)])
    assert result.exit_code == 0, result.output
    run = tmp_path / "2RFR-Reach-v0-anywhere-2-ppo"
    config = load_config(run / "config.yaml")
    assert config.environment.kwargs == {"difficulty": "anywhere", "hold_steps": 2}
    assert (run / "model.zip").exists()


def test_the_multiplier_is_that_of_a_pid_controller() -> None:
    """The recursion of Stooke et al., algorithm 2, by hand."""
    config = LagrangianConfig(cost_limit=1.0, proportional=0.5, integral=0.1, derivative=2.0)
    multiplier, weight = turned(Multiplier(), config, 3.0)
    assert weight == pytest.approx(0.5 * 2.0 + 0.1 * 2.0 + 2.0 * 3.0)
    multiplier, weight = turned(multiplier, config, 2.0)
    assert weight == pytest.approx(0.5 * 1.0 + (0.2 + 0.1) + 0.0), "a fall of the cost is not rewarded"
    for _ in range(10):
        multiplier, weight = turned(multiplier, config, 0.0)
    assert (multiplier.integral, weight) == (0.0, 0.0), "a cost below its limit is never rewarded"


def test_the_weight_rises_while_the_cost_is_above_its_limit() -> None:
    learner: Any = new_learner(small("ppo_lagrangian"))
    learner.set_logger(Logger(None, []))
    penalty, rewards, controller = learner.get_env().venv, [], CostController(LagrangianConfig())
    plain_step = penalty.venv.step_wait

    def step() -> Any:
        outcome = plain_step()
        rewards.append((outcome[1].copy(), columns_of(outcome[3])["cost"].copy(), penalty.weight))
        return outcome

    penalty.venv.step_wait = step
    learner.learn(8 * 8 * 20, callback=controller)
    assert penalty.weight > 0.0
    weights = [weight for _, _, weight in rewards]
    assert weights[0] == 0.0
    assert len(set(weights)) > 2
    assert learner.cost_multiplier[-1] == penalty.weight


def test_what_is_imitated_is_cloned_and_the_critic_alone_learns_after_it() -> None:
    """Beside a fresh policy, on states that neither has seen; and the deviation is the error that is left."""
    imitation = {"reference": "resolved rate", "rounds": 4, "steps": 4_000, "critic_rollouts": 0}
    config = small("ppo_imitation", num_envs=64, imitation=imitation)
    learners: list[Any] = [new_learner(config) for _ in range(3)]
    fresh, without, with_critic = learners
    for learner, rollouts in ((without, 0), (with_critic, 3)):
        learner.set_logger(Logger(None, []))
        own = small("ppo_imitation", num_envs=64, imitation=imitation | {"critic_rollouts": rollouts})
        learner.set_random_seed(5)
        learner.learn(1, callback=CallbackList(learning_callbacks(own)))
        assert learner.num_timesteps == 4 * 63 * 64 + rollouts * 8 * 64
    states, said = said_of("resolved rate", without)
    before, left = (own.predict(states, deterministic=True)[0] - said for own in (fresh, without))
    assert np.abs(left).mean() < 0.5 * np.abs(before).mean()
    deviation = without.policy.log_std.detach().exp().numpy()
    np.testing.assert_allclose(deviation, np.sqrt((left**2).mean(axis=0)), rtol=0.5)
    for name, parameter in without.policy.state_dict().items():
        is_of_the_critic = "value" in name
        assert bool((with_critic.policy.state_dict()[name] == parameter).all()) != is_of_the_critic, name


def test_in_later_rounds_the_policy_leads_and_the_reference_takes_over_as_where_an_episode_begins() -> None:
    imitation = {"reference": "resolved rate", "rounds": 3, "steps": 2_000, "longest_share": 20, "critic_rollouts": 0}
    config = small("ppo_imitation", num_envs=16, imitation=imitation)
    learner: Any = new_learner(config)
    learner.set_logger(Logger(None, []))
    callback: Any = learning_callbacks(config)[0]
    views: list[View] = []
    plain = callback._reference.act

    def act(view: View) -> Any:
        views.append(view)
        return plain(view)

    callback._reference.act = act
    learner.learn(1, callback=callback)
    rounds = [views[first : first + 125] for first in (0, 125, 250)]
    assert len(views) == 375
    assert all(view.under_way.all() for view in rounds[0]), "in the first round the reference acts alone"
    for view in (*rounds[1], *rounds[2]):
        np.testing.assert_array_equal(view.under_way, view.elapsed >= 0)
    led = np.array([view.under_way.mean() for view in rounds[2]])
    assert 0.5 < led.mean() < 1.0
    begins = np.concatenate([-view.elapsed[view.simulation.rows.elapsed == 0] for view in rounds[2]])
    assert begins.max(initial=0) <= 20


def said_of(reference: str, learner: Any, steps: int = 40) -> tuple[Any, Any]:
    """Return observations as the learner gets them, along a reference's ways, and what the reference does there."""
    env: Any = learner.get_env()
    env.training = False
    env.seed(77)
    observations, seen, said = env.reset(), [], []
    acting, generators = new_reference(reference), [np.random.default_rng(row) for row in range(learner.n_envs)]
    for _ in range(steps):
        said.append(acting.act(View.of(env.unwrapped.batch, env.get_original_obs(), generators)))
        seen.append(observations)
        observations = env.step(said[-1])[0]
    return {key: np.concatenate([own[key] for own in seen]) for key in seen[0]}, np.concatenate(said)


def test_a_reference_that_there_is_not_is_named() -> None:
    with pytest.raises(ConfigError, match=r"imitation\.reference: name must be one of"):
        learning_callbacks(small("ppo_imitation", imitation={"reference": "oracle"}))


def test_nothing_is_lost_behind_the_shield_and_something_is_without() -> None:
    lost = {}
    for learner in ("ppo", "ppo_shielded"):
        own: Any = new_learner(small(learner, num_envs=32))
        own.set_logger(Logger(None, []))
        total = Total()
        own.learn(32 * 8 * 15, callback=total)
        lost[learner] = total.lost
    assert lost["ppo"] > 0
    assert lost["ppo_shielded"] == 0


class Total(EpisodeStatistics):
    """Counts losses of stability."""

    lost = 0

    def _on_step(self) -> bool:
        self.lost += int(np.count_nonzero(columns_of(self.locals["infos"])["cost_unstable"]))
        return super()._on_step()
