"""Minari: a data set of the planner's episodes, kept and read again."""

import gymnasium
import minari

from pcm_gym.references import ReferencePolicy

NAME = "pcm/2RFR-Reach/planner-v0"


def main() -> int:
    env = minari.DataCollector(gymnasium.make("pcm_gym:PCM/2RFR-Reach-v0"), record_infos=False)
    policy, steps = ReferencePolicy("planner", env), 0
    for seed in range(20):
        observation, _ = env.reset(seed=seed)
        ended = False
        while not ended:
            observation, _, terminated, truncated, _ = env.step(policy(observation))
            steps, ended = steps + 1, terminated or truncated
    if NAME in minari.list_local_datasets():
        minari.delete_dataset(NAME)
    written = env.create_dataset(dataset_id=NAME, algorithm_name="planner", author="pcm_gym")
    read = minari.load_dataset(NAME)
    assert read.total_steps == written.total_steps == steps
    return steps


if __name__ == "__main__":
    print(main())
