"""sb3-contrib: truncated quantile critics."""

import gymnasium
from sb3_contrib import TQC


def main() -> int:
    env = gymnasium.make("pcm_gym:PCM/2RFR-Reach-v0")
    model = TQC("MultiInputPolicy", env, learning_starts=200, train_freq=20, gradient_steps=20, device="cpu")
    model.learn(total_timesteps=1000)
    return model.num_timesteps


if __name__ == "__main__":
    print(main())
