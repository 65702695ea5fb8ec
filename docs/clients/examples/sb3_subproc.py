"""Stable-Baselines3, each environment in a process of its own: the id imports the package there."""

from stable_baselines3 import PPO
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.vec_env import SubprocVecEnv


def main() -> int:
    envs = make_vec_env("pcm_gym:PCM/2RFR-Reach-v0", n_envs=2, seed=0, vec_env_cls=SubprocVecEnv)
    model = PPO("MultiInputPolicy", envs, n_steps=256, batch_size=128, device="cpu")
    model.learn(total_timesteps=1024)
    envs.close()
    return model.num_timesteps


if __name__ == "__main__":  # processes that are spawned import this file
    print(main())
