"""Which actions are safe, and what replaces the others: decided for many rows at once, from what steps would do."""

import itertools
import math

import numpy as np

from pcm_gym.arrays import Array, Integers, Mask
from pcm_gym.environments.motion import Motion
from pcm_gym.environments.simulation import Simulation
from pcm_gym.kernels.branches.continuation import ACTUATOR_LIMIT, NONE
from pcm_gym.kernels.snaps.instability import TERMINATE
from pcm_gym.kernels.stepping.report import Report, StepRules
from pcm_gym.kernels.stepping.transition import GIVE_UP

# Directions in which another action is looked for, per pair of inputs, and distances that are tried in each. The
# farthest is about the width of the space of actions; the nearest are closer together than the others.
_DIRECTIONS, _DISTANCES, _FARTHEST = 16, 8, 2.0
_GOLDEN_SECTION = 0.5 * (3.0 - math.sqrt(5.0))
# Parts of the way from a safe action to the one that is wanted, of which the last safe one is taken.
_PARTS = np.arange(15, -1, -1) / 16.0
# A drive is where it has been told to be if this part of the largest increment is missing: an action, which has single
# precision, cannot tell it more exactly.
_AT_REST = 1e-7
# Rows whose actions are replaced at a time; bounds the memory.
_ROWS_AT_ONCE = 256


class Shield:
    """Chooses actions for the rows of a simulation after which the mechanism can always be stopped in time.

    The way of an action is its step and, where the clamps do not stand still then, stopping: steps that bring the
    commands back to where the drives are, as fast as they may, until the clamps are at rest. An action is safe if every
    step of its way arrives stable and keeps the least margin. See `SolverShield` for what follows from that.

    Parameters
    ----------
    simulation : Simulation
    least_margin : float
        Least singularity margin to be kept, in rad and mean rod lengths.
    """

    def __init__(self, simulation: Simulation, least_margin: float) -> None:
        self._simulation, self._least_margin = simulation, least_margin
        self._actuators, self._stride = simulation.settings.actuators, simulation.settings.stride
        # whatever comes of a lost stability is not safe, and candidates that are hard to follow need not be followed
        rules = simulation.settings.rules
        self._exact, self._quick = rules._replace(behaviour=TERMINATE), rules._replace(behaviour=GIVE_UP)
        self._offsets = _offsets(simulation.settings.mechanism.leg_count)

    def choose(self, rows: Integers, actions: Array) -> tuple[Array, Mask]:
        """Return actions for some rows and which of them are replaced, (m, legs) and (m,), from those asked for."""
        motion = self._simulation.motion.copied(rows)
        _, is_safe = self._best(motion, actions[:, None], self._exact)
        chosen, unsafe = actions.copy(), np.flatnonzero(~is_safe)
        for first in range(0, len(unsafe), _ROWS_AT_ONCE):
            some = unsafe[first : first + _ROWS_AT_ONCE]
            chosen[some] = self._replacements(motion.copied(some), actions[some])
        return chosen, ~is_safe

    def _replacements(self, motion: Motion, actions: Array) -> Array:
        """Return safe actions near those asked for, (m, legs); where none is found, those with the best ways."""
        lower, upper = self._reach(motion)
        wanted = np.clip(actions, lower, upper)  # what the limits would cut is not wanted
        around = np.clip(wanted[:, None] + self._offsets, lower[:, None], upper[:, None])
        candidates = np.concatenate([wanted[:, None], around, self._stopping(motion)[:, None]], axis=1)
        candidates = _nearest_first(_as_told(candidates), wanted)
        safe, is_found = self._best(motion, candidates, self._quick)
        between = safe[:, None] + _PARTS[:, None] * (wanted - safe)[:, None]
        chosen, _ = self._best(motion, _as_told(between), self._quick)
        left = np.flatnonzero(~is_found)
        if len(left):
            chosen[left], _ = self._best(motion.copied(left), candidates[left], self._exact, least=0.0)
        return chosen

    def _best(
        self, motion: Motion, candidates: Array, rules: StepRules, least: float | None = None
    ) -> tuple[Array, Mask]:
        """Return the first safe one of candidates (m, k, legs) for each row, and whether there is one.

        Where there is none it is the one with the best way; ways are gone as long as their margin is at least `least`,
        the one that is safe by default.
        """
        scores = self._scores(motion, candidates, rules, self._least_margin if least is None else least)
        rows, best = np.arange(len(candidates)), np.minimum(scores, self._least_margin).argmax(axis=1)
        return candidates[rows, best], scores[rows, best] >= self._least_margin

    def _scores(self, motion: Motion, candidates: Array, rules: StepRules, least: float) -> Array:
        """Return the least margins on the ways of candidates (m, k, legs), (m, k), each until it is less than `least`.

        Where a way does not arrive stable the number is negative, the nearer to 0 the later that happens.
        """
        actions = candidates.reshape(-1, candidates.shape[2])
        scores, going = np.full(len(actions), np.inf), np.arange(len(actions))
        motion = motion.copied(going // candidates.shape[1])
        for step in itertools.count(1):
            margins = _margins(self._simulation.foresee(motion, actions, rules), -1.0 / step)
            scores[going] = np.minimum(scores[going], margins)
            goes_on = (margins >= least) & self._is_moving(motion)
            if not goes_on.any():
                break
            going, motion = going[goes_on], motion.copied(goes_on)
            actions = self._stopping(motion)
        return scores.reshape(candidates.shape[:2])

    def _reach(self, motion: Motion) -> tuple[Array, Array]:
        """Return the least and greatest actions, (m, legs) each, that are not cut."""
        commands, _ = self._actuators.told(motion)
        lower, upper = ((limit - commands) / self._stride for limit in self._simulation.limits)
        return np.clip(lower, -1.0, 0.0), np.clip(upper, 0.0, 1.0)

    def _missing(self, motion: Motion) -> Array:
        """Return how far the commands are ahead of the drives, in terms of the largest increments, (m, legs)."""
        commands, drives = self._actuators.told(motion)
        return (commands - drives) / self._stride

    def _stopping(self, motion: Motion) -> Array:
        """Return the actions that bring the commands back to the drives, (m, legs)."""
        return _as_told(np.clip(-self._missing(motion), -1.0, 1.0))

    def _is_moving(self, motion: Motion) -> Mask:
        """Return whether clamps would move without another action, (m,)."""
        return np.asarray(np.abs(self._missing(motion)).max(axis=1) > _AT_REST)


def _margins(report: Report, otherwise: float) -> Array:
    """Return the singularity margins (m,) where steps arrive stable, and another number elsewhere."""
    return np.where(arrives_stable(report), report.verdicts["singularity_margin"], otherwise)


def arrives_stable(report: Report) -> Mask:
    """Return which steps (m,) arrive, on the branch and stable."""
    events, index = report.verdicts["event"], report.verdicts["index"]
    arrives: Mask = ((events == NONE) | (events == ACTUATOR_LIMIT)) & (index == 0)
    return arrives


def _as_told(actions: Array) -> Array:
    """Return actions with the precision that the space of actions has."""
    return actions.astype(np.float32).astype(np.float64)


def _nearest_first(candidates: Array, wanted: Array) -> Array:
    """Return candidates (m, k, legs) by their distance from the actions wanted, (m, legs)."""
    squares: Array = (candidates - wanted[:, None]) ** 2
    order = squares.sum(axis=2).argsort(axis=1, kind="stable")
    ordered: Array = np.take_along_axis(candidates, order[:, :, None], axis=1)
    return ordered


def _offsets(dimension: int) -> Array:
    """Return where candidates are from the action that is wanted, (m, dimension).

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
    distances: Array = _FARTHEST * (np.arange(1, _DISTANCES + 1, dtype=np.float64) / _DISTANCES) ** 2
    offsets: Array = (distances[:, None, None] * directions).reshape(-1, dimension)
    return offsets
