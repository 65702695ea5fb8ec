"""Gymnasium's own batches, in this process and in others, and the native one."""

import gymnasium


def main() -> int:
    steps = 0
    for mode in ("sync", "async"):
        envs = gymnasium.make_vec("pcm_gym:PCM/2RFR-Reach-v0", num_envs=4, vectorization_mode=mode)
        steps += run(envs)
    # All rows in lock-step in one process: the fastest way.
    return steps + run(gymnasium.make_vec("pcm_gym:PCM/2RFR-Reach-v0", 64, vectorization_mode="vector_entry_point"))


def run(envs: gymnasium.vector.VectorEnv) -> int:
    envs = gymnasium.wrappers.vector.RecordEpisodeStatistics(envs)
    envs.reset(seed=0)
    envs.action_space.seed(0)
    for _ in range(100):
        envs.step(envs.action_space.sample())
    envs.close()
    return 100 * envs.num_envs


if __name__ == "__main__":
    print(main())
