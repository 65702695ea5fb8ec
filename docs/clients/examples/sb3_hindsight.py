"""Stable-Baselines3's hindsight replay: goals are told apart in the observation, rewards are asked for again."""

import gymnasium
from stable_baselines3 import SAC, HerReplayBuffer


def main() -> int:
    env = gymnasium.make("pcm_gym:PCM/2RFR-Reach-v0")
    model = SAC(
        "MultiInputPolicy",
        env,
        replay_buffer_class=HerReplayBuffer,
        learning_starts=200,
        train_freq=(1, "episode"),
        gradient_steps=20,
        device="cpu",
    )
    model.learn(total_timesteps=1000)
    return model.num_timesteps


if __name__ == "__main__":
    print(main())
