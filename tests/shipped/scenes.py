"""The scenes that environments are made in where no argument says otherwise, worked out."""

from typing import NamedTuple

import numpy as np

import pcm_gym
from pcm_gym.arrays import Array
from pcm_gym.environments.registration import ENVIRONMENTS
from pcm_gym.environments.settings import Settings
from pcm_gym.tasks import Scene

NAMES = sorted({own.mechanism for own in ENVIRONMENTS})


class Made(NamedTuple):
    home: pcm_gym.Equilibrium
    roadmap: pcm_gym.Roadmap
    step: Array


def scene_of(name: str) -> Scene:
    settings = Settings.from_arguments(name, {})
    return settings.scene(settings.mechanism, settings.load_range[0])


def worked_out(name: str) -> Made:
    scene = scene_of(name)
    step = scene.mechanism.units.inputs_from_kernel(np.array(scene.stride))
    home = pcm_gym.home_equilibrium(scene.mechanism)
    roadmap = pcm_gym.build_roadmap(scene.mechanism, [home], step=step, least_margin=scene.reserve)
    return Made(home, roadmap, step)
