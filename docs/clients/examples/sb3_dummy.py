"""Stable-Baselines3, environments one after the other in one process."""

from stable_baselines3 import PPO
from stable_baselines3.common.env_util import make_vec_env


def main() -> int:
    envs = make_vec_env("pcm_gym:PCM/2RFR-Reach-v0", n_envs=4, seed=0)
    model = PPO("MultiInputPolicy", envs, n_steps=128, batch_size=128, device="cpu")
    model.learn(total_timesteps=1024)
    envs.close()
    return model.num_timesteps


if __name__ == "__main__":
    print(main())
