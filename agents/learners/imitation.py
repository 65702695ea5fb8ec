"""Imitation of a reference before a learner learns by itself: behaviour cloning, and DAgger."""

from dataclasses import replace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.utils import obs_as_tensor
from torch import Tensor

from agents.learners.settings import ConfigError, ImitationConfig
from pcm_gym.references import View, new_reference

_LEAST_LOG_STD = -3.0
Observation = dict[str, NDArray[Any]]


class Imitation(BaseCallback):
    """Clones a reference when a training begins, in the environments of the training; its steps are counted.

    In each round the environments take steps; then the policy learns all that the reference has done so far. In the
    first round the reference acts alone: one round is behaviour cloning. In the others the policy begins each episode
    and the reference takes over after a number of steps that is drawn, so that it shows what to do where the policy
    leads (DAgger: S. Ross, G. Gordon and D. Bagnell, 2011, "A reduction of imitation learning and structured prediction
    to no-regret online learning", AISTATS; with one change of hands an episode, as in S. Ross and D. Bagnell, 2014,
    arXiv:1406.5979, because what a reference says that follows a plan makes sense only if it is followed). At last the
    policy's deviation is made the error that is left, and its critic learns the values of the policy, which does not
    change meanwhile.

    Parameters
    ----------
    config
        What is imitated, and how long.
    seed
        Of the reference's own chance.

    Raises
    ------
    ConfigError
        If there is no such reference.
    """

    def __init__(self, config: ImitationConfig, seed: int) -> None:
        super().__init__()
        self._config, self._seed = config, seed
        try:
            self._reference = new_reference(config.reference)
        except ValueError as error:
            raise ConfigError(f"imitation.reference: {error}") from error
        self._seen: list[Observation] = []
        self._said: list[NDArray[np.float32]] = []

    def _on_training_start(self) -> None:
        learner: Any = self.model
        if getattr(learner, "has_imitated", False):  # which is kept in snapshots
            return
        self._generator = np.random.default_rng(self._seed)
        self._generators = [np.random.default_rng([self._seed, row]) for row in range(learner.n_envs)]
        actor = [*learner.policy.mlp_extractor.policy_net.parameters(), *learner.policy.action_net.parameters()]
        self._optimizer = torch.optim.Adam(actor, lr=self._config.learning_rate)
        for number in range(self._config.rounds):
            self._gather(learner, shares=number > 0)
            error = self._fit(learner)
        learner.policy.log_std.data = error.sqrt().log().clamp(min=_LEAST_LOG_STD)
        self._seen.clear()
        self._said.clear()
        for _ in range(self._config.critic_rollouts):
            callback = learner._init_callback(None)
            learner.collect_rollouts(learner.env, callback, learner.rollout_buffer, learner.n_steps)
            learner.rollout_buffer.advantages[:] = 0.0  # nothing draws the policy anywhere
            learner.train()
        learner.has_imitated = True

    def _on_step(self) -> bool:
        return True

    def _gather(self, learner: Any, *, shares: bool) -> None:
        """Take the steps of a round, and keep what the reference does; with `shares` the policy begins each episode."""
        env, normaliser = learner.env, learner.get_vec_normalize_env()
        handed_over = self._hand_overs(learner.n_envs, shares)
        for _ in range(0, self._config.steps, learner.n_envs):
            observation = learner._last_obs if normaliser is None else normaliser.get_original_obs()
            whole = View.of(env.unwrapped.batch, observation, self._generators)
            begun = whole.elapsed == 0
            handed_over[begun] = self._hand_overs(begun.sum(), shares)
            rows = whole.elapsed >= handed_over
            # for the reference an episode begins where it takes over
            view = replace(whole, elapsed=whole.elapsed - handed_over, under_way=rows)
            said = self._reference.act(view).astype(np.float32)
            actions = np.where(rows[:, None], said, learner.predict(learner._last_obs, deterministic=True)[0])
            self._seen.append({key: array[rows] for key, array in observation.items()})
            self._said.append(said[rows])
            learner._last_obs, _, learner._last_episode_starts, _ = env.step(actions)
            learner.num_timesteps += learner.n_envs

    def _hand_overs(self, count: int, shares: bool) -> NDArray[np.int64]:
        """Draw after how many steps of `count` episodes the reference takes over."""
        return self._generator.integers(0, self._config.longest_share if shares else 0, count, endpoint=True)

    def _fit(self, learner: Any) -> Tensor:
        """Learn what has been said; return the mean squared error of each actuator, (actuators,)."""
        policy, said = learner.policy, torch.from_numpy(np.concatenate(self._said))
        seen: Any = {key: np.concatenate([own[key] for own in self._seen]) for key in self._seen[0]}
        normaliser = learner.get_vec_normalize_env()
        if normaliser is not None:
            seen = normaliser.normalize_obs(seen)
        with torch.no_grad():
            features = policy.extract_features(obs_as_tensor(seen, learner.device), policy.features_extractor)
        errors: list[Tensor] = []
        for _ in range(self._config.epochs):
            errors.clear()
            for rows in torch.split(torch.randperm(len(said)), self._config.batch_size):
                means = policy.action_net(policy.mlp_extractor.forward_actor(features[rows]))
                error = (means - said[rows]).square().mean(0)
                self._optimizer.zero_grad()
                error.sum().backward()
                self._optimizer.step()
                errors.append(error.detach())
        return torch.stack(errors).mean(0)
