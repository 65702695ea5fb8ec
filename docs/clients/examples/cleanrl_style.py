"""A loop in one file, as CleanRL writes them: PPO on a native batch, observations flattened."""

import gymnasium
import numpy as np
import torch
from gymnasium.spaces import flatdim
from torch import nn

ENVS, STEPS, UPDATES = 64, 16, 4


def main() -> int:
    envs = gymnasium.make_vec("pcm_gym:PCM/2RFR-Reach-v0", num_envs=ENVS, vectorization_mode="vector_entry_point")
    envs = gymnasium.wrappers.vector.FlattenObservation(envs)
    inputs, outputs = flatdim(envs.single_observation_space), envs.single_action_space.shape[0]
    actor = nn.Sequential(nn.Linear(inputs, 64), nn.Tanh(), nn.Linear(64, outputs))
    critic = nn.Sequential(nn.Linear(inputs, 64), nn.Tanh(), nn.Linear(64, 1))
    log_std = nn.Parameter(torch.full((outputs,), -0.5))
    optimiser = torch.optim.Adam([*actor.parameters(), *critic.parameters(), log_std], lr=1e-3)

    observation, _ = envs.reset(seed=0)
    for _ in range(UPDATES):
        kept = []
        for _ in range(STEPS):
            seen = torch.as_tensor(np.asarray(observation), dtype=torch.float32)
            with torch.no_grad():
                chosen = torch.distributions.Normal(actor(seen), log_std.exp())
                action = chosen.sample()
                log_probability = chosen.log_prob(action).sum(1)
            clipped = action.clamp(-1.0, 1.0).numpy()
            observation, reward, terminated, truncated, _ = envs.step(clipped)
            ended = torch.as_tensor(terminated | truncated, dtype=torch.float32)
            kept.append((seen, action, log_probability, torch.as_tensor(reward, dtype=torch.float32), ended))
        with torch.no_grad():
            value = critic(torch.as_tensor(np.asarray(observation), dtype=torch.float32))[:, 0]
        gained = []
        for *_, reward, ended in reversed(kept):
            value = reward + 0.98 * (1.0 - ended) * value
            gained.insert(0, value)
        seen, action, before, *_ = (torch.cat(parts) for parts in zip(*kept, strict=True))
        returns = torch.cat(gained)
        for _ in range(4):
            found = critic(seen)[:, 0]
            advantage = (returns - found).detach()
            now = torch.distributions.Normal(actor(seen), log_std.exp()).log_prob(action).sum(1)
            ratio = (now - before).exp()
            gain = torch.min(ratio * advantage, ratio.clamp(0.8, 1.2) * advantage).mean()
            loss = 0.5 * (returns - found).square().mean() - gain
            optimiser.zero_grad()
            loss.backward()
            optimiser.step()
    envs.close()
    return ENVS * STEPS * UPDATES


if __name__ == "__main__":
    print(main())
