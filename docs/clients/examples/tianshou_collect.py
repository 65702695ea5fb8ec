"""Tianshou: a collector over environments in one process."""

import gymnasium
from tianshou.data import Collector, VectorReplayBuffer
from tianshou.env import DummyVectorEnv
from tianshou.policy import RandomPolicy


def main() -> int:
    def make() -> gymnasium.Env:
        return gymnasium.wrappers.FlattenObservation(gymnasium.make("pcm_gym:PCM/2RFR-Reach-v0"))

    envs = DummyVectorEnv([make] * 4)
    collector = Collector(RandomPolicy(), envs, VectorReplayBuffer(2000, 4))
    return collector.collect(n_step=1000, random=True)["n/st"]


if __name__ == "__main__":
    print(main())
