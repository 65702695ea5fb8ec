"""What is observed of the rows of a simulation: their features as sensors see them, and what else is told."""

from collections.abc import Callable, Iterator
from functools import partial
from typing import NamedTuple

import numpy as np

from pcm_gym.arrays import Array, Integers
from pcm_gym.environments.arguments import Observe
from pcm_gym.environments.rows import Rows
from pcm_gym.environments.settings import Settings
from pcm_gym.tasks import Generators, Layout, Part, box_of, command_elements, feature_layout, load_elements

# The parts of the features that are sensed; None for all.
_SENSED: dict[Observe, tuple[str, ...] | None] = {
    "all": None,
    "rig": ("pose", "inputs", "efforts"),
    "pose": ("pose",),
}


class _Told(NamedTuple):
    """A part of the observation that is told beside the features, and how its values follow from some rows."""

    part: Part
    values: Callable[[Rows, Integers], Array]  # (m, elements)


class Sensors:
    """What is observed with some settings.

    Attributes
    ----------
    layout : Layout
        Where `observe` puts what.
    features : Layout
        Where the kernels put the features of a state.
    """

    def __init__(self, settings: Settings) -> None:
        self.features = feature_layout(settings.mechanism)
        self._told = tuple(_told(settings))
        names = _SENSED[settings.observe]
        sensed = [part for part in self.features.parts if names is None or part.name in names]
        self.layout = Layout((*sensed, *(told.part for told in self._told)))
        columns = [np.arange(len(self.features.elements))[self.features[part.name]] for part in sensed]
        self._columns = None if names is None else np.concatenate(columns)
        self._noise, self._is_measured = settings.observation_noise, self.features.is_measured
        self._box = box_of(self.features.elements)

    def observe(self, state: Rows, rows: Integers, features: Array) -> Array:
        """Return what is observed of some rows (m,) of the state, with their features (m, f) as they are measured."""
        if self._columns is not None:
            features = features[:, self._columns]
        if not self._told:
            return features
        return np.concatenate([features, *(told.values(state, rows) for told in self._told)], axis=1)

    def measure(self, features: Array, rows: Integers, generators: Generators) -> Array:
        """Return the features (m, f) of some rows with noise on all that is measured.

        The generators, one for each row of the state, are its source.
        """
        if self._noise == 0.0:
            return features
        return self._with_noise(features, [generators[row] for row in rows.tolist()])

    def _with_noise(self, features: Array, generators: Generators) -> Array:
        count = np.count_nonzero(self._is_measured)
        noisy = features.copy()
        noisy[:, self._is_measured] += self._noise * np.array([own.standard_normal(count) for own in generators])
        return np.clip(noisy, self._box.low, self._box.high)


def _told(settings: Settings) -> Iterator[_Told]:
    mechanism, units = settings.mechanism, settings.mechanism.units
    for steps in settings.task.look_ahead:
        part = Part(f"goal_in_{steps}", settings.task.goals.elements_in(steps))
        yield _Told(part, partial(Rows.goals_ahead, steps=steps))
    if settings.load_varies and settings.observe_load:
        loads = units.kernel_from_load(settings.load_range)
        yield _Told(Part("load", load_elements(mechanism)), lambda state, rows: _within(state.load[rows], loads))
    if not settings.actuators.are_ideal:
        limits = np.stack(mechanism.kernel_limits)
        part = Part("commands", command_elements(mechanism))
        yield _Told(part, lambda state, rows: _within(state.commands[rows], limits))


def _within(values: Array, bounds: Array) -> Array:
    """Return where values (n, k) are between bounds (2, k): -1 and 1 at the bounds, 0 between equal ones."""
    lower, upper = bounds
    half: Array = 0.5 * (upper - lower)
    within: Array = (values - 0.5 * (upper + lower)) / np.where(half > 0.0, half, 1.0)
    return within
