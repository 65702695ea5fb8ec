"""TorchRL, a native batch. TorchRL resets its rows itself."""

import gymnasium
from gymnasium.vector import AutoresetMode
from torchrl.envs import GymWrapper


def main() -> int:
    envs = gymnasium.make_vec(
        "pcm_gym:PCM/2RFR-Reach-v0",
        num_envs=64,
        vectorization_mode="vector_entry_point",
        autoreset_mode=AutoresetMode.DISABLED,
    )
    env = GymWrapper(envs, device="cpu")
    rollout = env.rollout(20, break_when_any_done=False)
    return rollout.numel()


if __name__ == "__main__":
    print(main())
