"""sbx, Stable-Baselines3 on JAX, takes flat observations."""

import gymnasium
from sbx import SAC


def main() -> int:
    env = gymnasium.wrappers.FlattenObservation(gymnasium.make("pcm_gym:PCM/2RFR-Reach-v0"))
    model = SAC("MlpPolicy", env, learning_starts=200)
    model.learn(total_timesteps=1000)
    return model.num_timesteps


if __name__ == "__main__":
    print(main())
