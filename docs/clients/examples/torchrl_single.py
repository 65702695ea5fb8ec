"""TorchRL, one environment, rolled out with random actions."""

import gymnasium
from torchrl.envs import GymWrapper
from torchrl.envs.utils import check_env_specs


def main() -> int:
    env = GymWrapper(gymnasium.make("pcm_gym:PCM/2RFR-Reach-v0"), device="cpu")
    check_env_specs(env)
    rollout = env.rollout(1000, break_when_any_done=False)
    return rollout.numel()


if __name__ == "__main__":
    print(main())
