"""PPO of Stable-Baselines3, with the loop that a fast batch needs: the same updates, in a fraction of the time."""

from typing import Any

import numpy as np
import stable_baselines3
import torch
from stable_baselines3.common.buffers import RolloutBuffer
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.distributions import DiagGaussianDistribution
from stable_baselines3.common.utils import explained_variance, obs_as_tensor
from stable_baselines3.common.vec_env import VecEnv
from torch import Tensor

from agents.learners.surrogate import TOLD, Minibatch, Terms, surrogate
from pcm_gym.arrays import Array, Integers

_APPROXIMATE_KL = TOLD.index("approx_kl")
# In terms of the target: where an epoch is broken off, as in Stable-Baselines3.
_FARTHEST = 1.5


class FastPPO(stable_baselines3.PPO):
    """`stable_baselines3.PPO` for large batches: it learns the same, and is saved and loaded as that is.

    Where it saves time: the values of all episodes that end in a step are computed at once, and only their infos are
    read; features are computed once per rollout, not in every epoch; a rollout is shuffled once per epoch, of which
    minibatches are views; the loss of a Gaussian policy is differentiated in closed form, down to the outputs of the
    networks; Adam updates all parameters in one call; nothing is logged that was not asked for.

    Its policies have a Gaussian distribution whose deviation does not depend on the state, and features without
    parameters; others are refused.

    Parameters
    ----------
    *args, **kwargs
        Those of `stable_baselines3.PPO`.

    Raises
    ------
    ValueError
        If the policy is of another kind.
    """

    def _setup_model(self) -> None:
        arguments = self.policy_kwargs.setdefault("optimizer_kwargs", {"eps": 1e-5})  # that of Stable-Baselines3
        arguments.setdefault("fused", True)
        super()._setup_model()
        if not isinstance(self.policy.action_dist, DiagGaussianDistribution):
            raise ValueError("use_sde must be false: the fast PPO has Gaussian policies")
        if any(True for _ in self.policy.features_extractor.parameters()):
            raise ValueError("features_extractor_class must have no parameters: the fast PPO computes features once")

    def collect_rollouts(
        self, env: VecEnv, callback: BaseCallback, rollout_buffer: RolloutBuffer, n_rollout_steps: int
    ) -> bool:
        """Fill the buffer with steps of the policy; return false where the callback has ended the training."""
        self.policy.set_training_mode(False)
        rollout_buffer.reset()
        callback.on_rollout_start()
        for _ in range(n_rollout_steps):
            observations: Any = self._last_obs
            with torch.no_grad():
                chosen, values, log_probs = self.policy(obs_as_tensor(observations, self.device))
            actions = chosen.numpy()
            # the space of the actions is a Box
            clipped = np.clip(actions, self.action_space.low, self.action_space.high)  # type: ignore[attr-defined]
            new_observations, rewards, dones, infos = env.step(clipped)
            self.num_timesteps += env.num_envs
            callback.update_locals(locals())
            if not callback.on_step():
                return False
            ended = np.flatnonzero(dones)
            self._update_info_buffer([infos[row] for row in ended.tolist()], dones[ended])
            self._bootstrap(rewards, infos, ended)
            starts: Any = self._last_episode_starts
            rollout_buffer.add(observations, actions, rewards, starts, values, log_probs)
            self._last_obs, self._last_episode_starts = new_observations, dones  # type: ignore[assignment]  # of a Dict
        rollout_buffer.compute_returns_and_advantage(self._values(self._last_obs), dones)
        callback.update_locals(locals())
        callback.on_rollout_end()
        return True

    def train(self) -> None:
        """Update the policy with the rollout in the buffer."""
        self.policy.set_training_mode(True)
        self._update_learning_rate(self.policy.optimizer)
        terms, rollout, told = self._terms(), self._rollout(), []
        for _ in range(self.n_epochs):
            order = np.random.permutation(len(rollout.returns))  # noqa: NPY002 (the chance of Stable-Baselines3)
            shuffled = rollout.chosen(torch.from_numpy(order))
            epoch, goes_on = self._epoch(shuffled, terms)
            told.append(torch.stack(epoch))
            self._n_updates += 1
            if not goes_on:
                break
        self._log(told, terms)

    def _epoch(self, rollout: Minibatch, terms: Terms) -> tuple[list[Tensor], bool]:
        """Update the policy with each minibatch in turn; return what is told of them, and whether to go on."""
        told: list[Tensor] = []
        parameters = list(self.policy.parameters())
        networks, log_stds = self.policy.mlp_extractor, self.policy.log_std
        for first in range(0, len(rollout.returns), self.batch_size):
            batch = rollout.part(first, first + self.batch_size)
            means = self.policy.action_net(networks.forward_actor(batch.features))
            values = self.policy.value_net(networks.forward_critic(batch.features))
            slopes, own = surrogate(terms, batch, means, log_stds, values[:, 0])
            told.append(own)
            if self.target_kl is not None and own[_APPROXIMATE_KL] > _FARTHEST * self.target_kl:
                return told, False
            for parameter in parameters:
                parameter.grad = None
            torch.autograd.backward((means, values), (slopes.means, slopes.values[:, None]))
            log_stds.grad = slopes.log_stds
            torch.nn.utils.clip_grad_norm_(parameters, self.max_grad_norm)
            self.policy.optimizer.step()
        return told, True

    def _terms(self) -> Terms:
        progress, clip_range_vf = self._current_progress_remaining, self.clip_range_vf
        return Terms(
            self.clip_range(progress),  # type: ignore[operator]  # a schedule since `_setup_model`
            None if clip_range_vf is None else clip_range_vf(progress),  # type: ignore[operator]  # likewise
            self.ent_coef,
            self.vf_coef,
            self.normalize_advantage,
        )

    def _rollout(self) -> Minibatch:
        """Return all steps in the buffer, in the order in which Stable-Baselines3 numbers them."""
        buffer: Any = self.rollout_buffer
        arrays = {key: buffer.swap_and_flatten(array) for key, array in buffer.observations.items()}
        with torch.no_grad():
            observations: Any = obs_as_tensor(arrays, self.device)
            features: Any = self.policy.extract_features(observations, self.policy.features_extractor)
        flat = (buffer.swap_and_flatten(getattr(buffer, name)) for name in Minibatch._fields[1:])
        actions, *others = (torch.from_numpy(array) for array in flat)
        return Minibatch(features, actions, *(own[:, 0] for own in others))

    def _bootstrap(self, rewards: Array, infos: Any, ended: Integers) -> None:
        """Add to rewards (n,) what is expected beyond the ends of episodes that only time has ended."""
        rows = [row for row in ended.tolist() if infos[row]["TimeLimit.truncated"]]
        if rows:
            last = [infos[row]["terminal_observation"] for row in rows]
            stacked = {key: np.stack([own[key] for own in last]) for key in last[0]}
            rewards[rows] += self.gamma * self._values(stacked).numpy()[:, 0]

    def _values(self, observations: Any) -> Tensor:
        """Return the values (n, 1) of observations."""
        with torch.no_grad():
            return self.policy.predict_values(obs_as_tensor(observations, self.device))

    def _log(self, told: list[Tensor], terms: Terms) -> None:
        """Log what Stable-Baselines3 does of the epochs, each with what is told of its minibatches, (m, 5)."""
        means = dict(zip(TOLD, torch.cat(told).mean(0).tolist(), strict=True))
        means["approx_kl"] = told[-1][:, _APPROXIMATE_KL].mean().item()
        policy_loss, value_loss, entropy_loss = told[-1][-1, :3].tolist()
        buffer = self.rollout_buffer
        means |= {
            "loss": policy_loss + self.ent_coef * entropy_loss + self.vf_coef * value_loss,
            "explained_variance": float(explained_variance(buffer.values.ravel(), buffer.returns.ravel())),
            "std": self.policy.log_std.exp().mean().item(),
            "clip_range": terms.clip_range,
        }
        for name, value in means.items():
            self.logger.record(f"train/{name}", value)
        if terms.clip_range_vf is not None:
            self.logger.record("train/clip_range_vf", terms.clip_range_vf)
        self.logger.record("train/n_updates", self._n_updates, exclude="tensorboard")
