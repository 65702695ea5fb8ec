"""RLlib: one iteration of PPO. Its workers import the package by the id."""

import gymnasium
from ray.rllib.algorithms.ppo import PPOConfig
from ray.tune.registry import register_env


def make(_: dict) -> gymnasium.Env:
    return gymnasium.wrappers.FlattenObservation(gymnasium.make("pcm_gym:PCM/2RFR-Reach-v0"))


def main() -> int:
    register_env("pcm", make)
    config = (
        PPOConfig()
        .environment("pcm")
        .env_runners(num_env_runners=1)
        .training(train_batch_size_per_learner=1000, minibatch_size=250, num_epochs=2)
    )
    algorithm = config.build_algo()
    result = algorithm.train()
    algorithm.stop()
    return int(result["num_env_steps_sampled_lifetime"])


if __name__ == "__main__":
    print(main())
