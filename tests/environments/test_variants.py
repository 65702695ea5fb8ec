"""Every argument that changes what an environment does leaves it within the conventions of Gymnasium and SB3."""

from typing import Any

import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import pcm_gym
from tests.environments.rollouts import assert_same, make_bare, make_native, sweeping_actions

BEHAVIOURS: list[dict[str, Any]] = [{"on_instability": behaviour} for behaviour in ("snap", "hold", "continue")]
REALISM: list[dict[str, Any]] = [
    {"load": ((-0.01, -0.02), (0.01, 0.02)), "variants": 2},
    {"randomisation": {"stiffness": 0.1, "length": 0.02, "base": 0.01}, "variants": 2},
    {"actuator_lag": 1.0, "backlash": 0.005, "rate_limit": 0.02},
    {"observation_noise": 0.01},
]
OF_TASK: dict[str, list[dict[str, Any]]] = {
    "Reach": [{"difficulty": "anywhere"}, {"difficulty": "detour"}, *BEHAVIOURS, *REALISM],
    "Track": [{"path": "circle"}, {"path": "eight"}, {"path": "spline"}, *BEHAVIOURS[:1], *REALISM[:1]],
    "Switch": [{"difficulty": "fall", "on_instability": "snap"}, *REALISM[3:]],
}
VARIANTS = [
    pytest.param(environment_id, keywords, id=f"{environment_id}-{'-'.join(map(str, keywords))}-{n}")
    for environment_id in pcm_gym.environment_ids()
    for n, keywords in enumerate(OF_TASK[environment_id.split("-")[1]])
    if (environment_id, keywords.get("difficulty")) != ("PCM/3PFR-Switch-v0", "fall")
]

pytestmark = pytest.mark.parametrize(("environment_id", "keywords"), VARIANTS)


def test_passes_both_checks(environment_id: str, keywords: dict[str, Any], capsys: pytest.CaptureFixture[str]) -> None:
    check_env(make_bare(environment_id, **keywords), skip_render_check=True)
    checker = pytest.importorskip("stable_baselines3.common.env_checker")
    checker.check_env(make_bare(environment_id, **keywords), warn=True, skip_render_check=True)
    assert capsys.readouterr().out.count("\n") <= 2  # that it takes the environment for one with goals, nothing else


def test_batch_equals_single_environment(environment_id: str, keywords: dict[str, Any]) -> None:
    batch, single = make_native(environment_id, 3, **keywords), make_bare(environment_id, **keywords)
    observation, _ = batch.reset(seed=0)
    space = batch.observation_space
    assert_same({key: array[1] for key, array in observation.items()}, single.reset(seed=1)[0])
    for action in sweeping_actions(25, batch.action_space.shape, seed=2):
        observation, reward, terminated, truncated, infos = batch.step(action)
        assert space.contains(observation)
        assert np.isfinite(reward).all()
        expected = single.step(action[1])
        assert_same({key: array[1] for key, array in observation.items()}, expected[0])
        assert (reward[1], terminated[1], truncated[1], infos["cost"][1]) == (*expected[1:4], expected[4]["cost"])
        if terminated[1] or truncated[1]:
            break
