"""TorchRL, a native batch: the wrapper takes environments of Gymnasium, batches too."""

import gymnasium
from torchrl.envs import GymWrapper


def main() -> int:
    envs = gymnasium.make_vec("pcm_gym:PCM/2RFR-Reach-v0", num_envs=64, vectorization_mode="vector_entry_point")
    env = GymWrapper(envs, device="cpu")
    rollout = env.rollout(20, break_when_any_done=False)
    return rollout.numel()


if __name__ == "__main__":
    print(main())
