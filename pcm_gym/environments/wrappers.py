"""Wrappers for single environments: the cost as an element of the step, and a shield that asks the solver first."""

import math
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from pcm_gym.arrays import Array
from pcm_gym.environments.single import MechanismEnv, Observation
from pcm_gym.mechanism.validation import positive_number
from pcm_gym.solving import BranchTracker, Equilibrium, Event

Action = NDArray[np.float32]

# Directions in which a shield looks for another action, per pair of inputs, and distances that it tries in each.
_DIRECTIONS, _DISTANCES = 16, 8
_GOLDEN_SECTION = 0.5 * (3.0 - math.sqrt(5.0))
# Halvings that bring the replacement nearer to the action that was asked for.
_REFINEMENTS = 6


class CostStep(gymnasium.Wrapper[Observation, Action, Observation, Action]):
    """Returns the cost beside the reward, as Safety-Gymnasium does: six values per step.

    ``observation, reward, cost, terminated, truncated, info = env.step(action)``. For libraries of safe reinforcement
    learning that expect it; what they hand on to must not be a wrapper or checker of Gymnasium's five values.
    """

    def step(  # type: ignore[override]  # six values instead of five are its purpose
        self, action: Action
    ) -> tuple[Observation, float, float, bool, bool, dict[str, Any]]:
        """Step, with ``info["cost"]`` as the third value."""
        observation, reward, terminated, truncated, info = self.env.step(action)
        return observation, float(reward), float(info["cost"]), terminated, truncated, info


class SolverShield(gymnasium.Wrapper[Observation, Action, Observation, Action]):
    """Asks the solver before each action and replaces one that is not safe by a safe one near it.

    An action is safe if the mechanism arrives on its branch, stable, and with a singularity margin of at least
    `least_margin`. Of a fixed set of candidates around the action the nearest safe one is taken and moved towards the
    action as far as it stays safe. If none is safe, as in a state already below the margin, that which keeps the
    largest margin is taken, staying included. ``info["shielded"]`` says whether the action was replaced.

    Parameters
    ----------
    env : gymnasium.Env
        An environment of this package, wrapped or not.
    least_margin : float, optional
        The threshold of `cost_singular` of the environment by default.

    Notes
    -----
    A safe action costs one more solution of the step; one that is not, up to some hundred: a few milliseconds.
    """

    def __init__(self, env: gymnasium.Env[Observation, Action], least_margin: float | None = None) -> None:
        super().__init__(env)
        if not isinstance(env.unwrapped, MechanismEnv):
            raise TypeError(f"env must be an environment of pcm_gym, got {env.unwrapped!r}")
        self._mechanism_env = env.unwrapped
        margin = env.unwrapped.singular_margin if least_margin is None else least_margin
        self.least_margin = positive_number("least_margin", margin)
        self._offsets = _offsets(env.unwrapped.mechanism.leg_count)

    def step(self, action: Action) -> tuple[Observation, Any, bool, bool, dict[str, Any]]:
        """Step with the action, or with the safe one that replaces it."""
        env = self._mechanism_env
        here = env.equilibrium
        target = self._target(here.inputs, np.clip(np.asarray(action, dtype=np.float64), -1.0, 1.0))
        margin = self._margin_at(target, here)
        is_safe = margin >= self.least_margin
        if not is_safe:  # what the limits would cut is not wanted
            wanted = (target - here.inputs) / env.max_action
            action = self._replacement(wanted, margin, here).astype(np.float32)
        observation, reward, terminated, truncated, info = self.env.step(action)
        return observation, reward, terminated, truncated, {**info, "shielded": not is_safe}

    def _replacement(self, wanted: Array, margin: float, here: Equilibrium) -> Array:
        length = float(np.linalg.norm(wanted))
        best, best_margin = wanted, margin
        for offset in (*self._offsets, -wanted / max(length, 1e-300)):  # the last is to stay
            candidate = np.clip(wanted + length * offset, -1.0, 1.0)
            own = self._margin_after(candidate, here)
            if own >= self.least_margin:
                return self._moved_towards(wanted, candidate, here)
            if own > best_margin:
                best, best_margin = candidate, own
        return best

    def _moved_towards(self, wanted: Array, safe: Array, here: Equilibrium) -> Array:
        part, step = 0.0, 1.0  # of the way from the safe action to the one that is wanted
        for _ in range(_REFINEMENTS):
            step *= 0.5
            if self._margin_after(safe + (part + step) * (wanted - safe), here) >= self.least_margin:
                part += step
        return safe + part * (wanted - safe)

    def _target(self, inputs: Array, action: Array) -> Array:
        """Return the inputs after an action, cut at the limits, exactly as the environment makes them."""
        mechanism, move = self._mechanism_env.mechanism, action.astype(np.float32).astype(np.float64)
        target = inputs + move * self._mechanism_env.max_action
        return np.clip(target, mechanism.lower_limits, mechanism.upper_limits)

    def _margin_after(self, action: Array, here: Equilibrium) -> float:
        return self._margin_at(self._target(here.inputs, action), here)

    def _margin_at(self, target: Array, here: Equilibrium) -> float:
        """Return the singularity margin at the target inputs; minus infinity if the way does not lead there, stable."""
        arrived = BranchTracker(here.mechanism, here).step(target)
        if arrived.event is not Event.NONE or not arrived.equilibrium.is_stable:
            return -math.inf
        return arrived.equilibrium.singularity_margin


def _offsets(dimension: int) -> Array:
    """Return where candidates are from an action of length 1, (m, dimension), the nearest first.

    Directions are even on the circle, or nearly even on the sphere (a golden spiral).
    """
    if dimension == 2:
        angle = 2.0 * np.pi * np.arange(_DIRECTIONS, dtype=np.float64) / _DIRECTIONS
        directions: Array = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    else:
        place = (np.arange(2 * _DIRECTIONS, dtype=np.float64) + 0.5) / (2 * _DIRECTIONS)
        angle = 2.0 * np.pi * _GOLDEN_SECTION * 2 * _DIRECTIONS * place
        radius = 2.0 * np.sqrt(place * (1.0 - place))
        directions = np.stack([radius * np.cos(angle), radius * np.sin(angle), 1.0 - 2.0 * place], axis=1)
    distances: Array = np.arange(1, _DISTANCES + 1, dtype=np.float64) / _DISTANCES
    offsets: Array = (distances[:, None, None] * directions).reshape(-1, dimension)
    return offsets
