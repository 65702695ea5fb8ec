"""Tianshou: a collector over environments in one process."""

import gymnasium
from tianshou.data import Collector, VectorReplayBuffer
from tianshou.env import DummyVectorEnv
from tianshou.policy import RandomPolicy


def main() -> int:
    def make() -> gymnasium.Env:
        return gymnasium.wrappers.FlattenObservation(gymnasium.make("pcm_gym:PCM/2RFR-Reach-v0"))

    envs = DummyVectorEnv([make] * 4)
    policy = RandomPolicy(action_space=envs.action_space[0])
    collector = Collector(policy, envs, VectorReplayBuffer(2000, 4))
    collector.reset()
    return collector.collect(n_step=1000).n_collected_steps


if __name__ == "__main__":
    print(main())
