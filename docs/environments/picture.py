"""The picture of an environment: its own rendering of an episode on its way."""

import numpy as np
from PIL import Image

from pcm_gym.environments.single import MechanismEnv

_SEED, _STEPS, _COLOURS = 0, 4, 128


def picture(env: MechanismEnv) -> Image.Image:
    """Return the picture of a seeded episode after some steps in one direction, or after the last that did not end it.

    The environment must render "rgb_array".
    """
    env.reset(seed=_SEED)
    action = np.random.default_rng(_SEED).choice([-1.0, 1.0], env.action_space.shape).astype(np.float32)
    frame = env.render()
    for _ in range(_STEPS):
        _, _, terminated, truncated, _ = env.step(action)
        if terminated or truncated:
            break
        frame = env.render()
    assert frame is not None
    return Image.fromarray(frame).quantize(_COLOURS)
