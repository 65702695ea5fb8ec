"""Gymnasium's wrappers that hand out tensors, around a single environment and around a native batch."""

import gymnasium
import torch
from gymnasium.wrappers import NumpyToTorch
from gymnasium.wrappers.vector import NumpyToTorch as VectorNumpyToTorch


def main() -> int:
    env = NumpyToTorch(gymnasium.make("pcm_gym:PCM/2RFR-Reach-v0"))
    observation, _ = env.reset(seed=0)
    assert isinstance(observation["observation"], torch.Tensor)
    env.step(torch.zeros(2))

    envs = VectorNumpyToTorch(
        gymnasium.make_vec("pcm_gym:PCM/2RFR-Reach-v0", 64, vectorization_mode="vector_entry_point")
    )
    envs.reset(seed=0)
    for _ in range(20):
        actions = 2.0 * torch.rand(64, 2) - 1.0
        observation, reward, *_ = envs.step(actions)
    assert isinstance(reward, torch.Tensor)
    return 1 + 20 * 64


if __name__ == "__main__":
    print(main())
