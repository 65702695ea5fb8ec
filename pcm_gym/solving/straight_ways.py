"""Straight ways of the inputs: which of them keep stability and margin, and how ways are shortened by them."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from pcm_gym.arrays import Array, Integers, Mask
from pcm_gym.kernels.charts.motions import follow_inputs
from pcm_gym.kernels.charts.walks import walk
from pcm_gym.kernels.numerics.slices import slices
from pcm_gym.kernels.statics.states import SAME_STATE, States
from pcm_gym.mechanism import Mechanism
from pcm_gym.solving.limits import StructuralLimits

# Ways that are walked in one call of compiled code, and steps that are followed in one.
_WALKED_AT_ONCE, _FOLLOWED_AT_ONCE = 512, 256
# Passes of shortening; each pulls from the other end.
_PASSES = 4
# By so little a way may be longer than its number of steps.
_ROUNDING = 1e-9
# Ways shorter than another by less than this, in steps, are no shorter.
_LEAST_GAIN = 1e-6


class Way(NamedTuple):
    """Equilibria one after the other, dimensionless."""

    x: Array  # (p, size)
    inputs: Array  # (p, legs)

    @property
    def reversed(self) -> "Way":
        """The way back."""
        return Way(self.x[::-1], self.inputs[::-1])


@dataclass(frozen=True)
class StraightWays:
    """Straight ways between equilibria of a mechanism under a load.

    Attributes
    ----------
    mechanism : Mechanism
    load : array (d,)
        Dimensionless.
    stride : array (legs,)
        Longest step along each input, dimensionless.
    least_margin : float
        Singularity margin that is kept after each step.
    structure : StructuralLimits
        Limits of the structure that are kept after each step.
    """

    mechanism: Mechanism
    load: Array
    stride: Array
    least_margin: float
    structure: StructuralLimits

    def states(self, x: Array, inputs: Array) -> States:
        """Return copies of states (n, size) at inputs (n, legs), under the load."""
        return States(x.copy(), inputs.copy(), np.tile(self.load, (len(x), 1)))

    def walked(self, x: Array, inputs: Array, targets: Array) -> tuple[Array, Mask]:
        """Return where straight ways to the inputs `targets` (n, legs) lead, (n, size), and which arrive."""
        states = self.states(x, inputs)
        counts = self.lengths(inputs, targets).astype(np.int64) + 2
        if self.structure:
            return states.x, self._walk_within(states, targets, int(counts.max(initial=0)))
        self._walk(states, targets, counts)
        arrives: Mask = (states.inputs == targets).all(axis=1)
        return states.x, arrives

    def _walk(self, states: States, targets: Array, counts: Integers) -> None:
        for first, last in slices(len(counts), _WALKED_AT_ONCE):
            some = States(*(array[first:last] for array in states))
            legs = self.mechanism.leg_table
            walk(legs, some, targets[first:last], self.stride, counts[first:last], self.least_margin)

    def _walk_within(self, states: States, targets: Array, count: int) -> Mask:
        """Walk step by step, in place; return which arrive and break no limit of the structure after any step."""
        arrives, rows = np.zeros(len(targets), dtype=np.bool_), np.arange(len(targets))
        for _ in range(count):
            moved = States(*(array[rows] for array in states))
            self._walk(moved, targets[rows], np.ones(len(rows), dtype=np.int64))
            is_kept = self.structure.are_kept(moved.x, moved.inputs)
            goes_on = (moved.inputs != states.inputs[rows]).any(axis=1)
            for array, values in zip(states, moved, strict=True):
                array[rows] = values
            is_there = (moved.inputs == targets[rows]).all(axis=1)
            arrives[rows] = is_kept & is_there
            rows = rows[is_kept & goes_on & ~is_there]
            if not len(rows):
                break
        return arrives

    def lead(self, start: Way, end: Way) -> Mask:
        """Return for each row of `start` whether the straight way leads to that of `end`."""
        x, arrives = self.walked(start.x, start.inputs, np.ascontiguousarray(end.inputs))
        leads: Mask = arrives & self.are_same(x, end.x)
        return leads

    def lead_surely(self, start: Way, end: Way) -> Mask:
        """Return what `lead` does, by the tracker itself in even steps, one by one: a walk gives up on some ways."""
        leads = np.zeros(len(start.x), dtype=np.bool_)
        for row in range(len(leads)):
            ends = Way(*(np.stack([first[row], last[row]]) for first, last in zip(start, end, strict=True)))
            leads[row] = self._followed(ends, self._evenly_divided(ends.inputs)) is not None
        return leads

    def lengths(self, start: Array, end: Array) -> Array:
        """Return how many steps straight ways from inputs to inputs (..., legs) take, not rounded."""
        lengths: Array = (np.abs(end - start) / self.stride).max(axis=-1)
        return lengths

    def are_same(self, x: Array, other: Array) -> Mask:
        """Return which states (n, size) at the same inputs are one; as the kernel of the same name."""
        plane = 2 * self.mechanism.leg_count + 2
        near = np.abs(x - other)[:, :plane] <= SAME_STATE * (1.0 + np.abs(x[:, :plane]))
        turns: Array = np.abs(np.sin(0.5 * (x - other)[:, plane:]))
        same: Mask = np.asarray(np.concatenate([near, turns <= SAME_STATE], axis=1).all(axis=1))
        return same

    def shortened(self, ways: Sequence[Way]) -> list[Way | None]:
        """Return ways, each step verified, of as few steps as found; None where not even the given way is verified.

        The given ways are followed in straight lines from row to row.
        """
        found: list[Way | None] = [None] * len(ways)
        going = list(range(len(ways)))
        for turn in range(_PASSES):
            ahead = [_known(found[n], ways[n]) for n in going]
            pulled = self._pulled([way.reversed if turn % 2 else way for way in ahead])
            trials = [self._stepped(way.reversed if turn % 2 else way) for way in pulled]
            gains = [self._gain(found[n], trial) for n, trial in zip(going, trials, strict=True)]
            for n, trial, gain in zip(going, trials, gains, strict=True):
                found[n] = trial if gain > 0.0 else found[n]
            going = [n for n, gain in zip(going, gains, strict=True) if gain > _LEAST_GAIN]
            if not going:
                break
        return [self._stepped(way) if own is None else own for own, way in zip(found, ways, strict=True)]

    def _gain(self, way: Way | None, other: Way | None) -> float:
        """Return by how many steps the other way is shorter, whole steps first."""
        if other is None or way is None:
            return 0.0 if other is None else math.inf
        by_steps = len(way.inputs) - len(other.inputs)
        return by_steps if by_steps else self._length(way) - self._length(other)

    def _length(self, way: Way) -> float:
        return float(self.lengths(way.inputs[:-1], way.inputs[1:]).sum())

    def _stepped(self, way: Way) -> Way | None:
        """Return a way in steps, each verified: the longest over all of it, or else even ones from row to row."""
        found = self._followed(way, self._divided(way.inputs))
        return self._followed(way, self._evenly_divided(way.inputs)) if found is None else found

    def _divided(self, inputs: Array) -> Array:
        """Return inputs (n, legs) after each of the longest steps along a polyline (p, legs), corners cut."""
        places = np.concatenate([[0.0], np.cumsum(self.lengths(inputs[:-1], inputs[1:]))])
        count = math.ceil(places[-1] - _ROUNDING)
        wanted = np.minimum(np.arange(count + 1), places[-1])
        divided = np.stack([np.interp(wanted, places, values) for values in inputs.T], axis=1)
        divided[0], divided[-1] = inputs[0], inputs[-1]
        return divided

    def _evenly_divided(self, inputs: Array) -> Array:
        """Return inputs (n, legs) along a polyline (p, legs), its corners among them: the same in both directions."""
        counts = np.ceil(self.lengths(inputs[:-1], inputs[1:]) - _ROUNDING).astype(np.int64)
        rows = np.repeat(np.arange(len(counts)), counts)
        parts = (np.arange(len(rows)) - np.repeat(np.cumsum(counts) - counts, counts) + 1) / counts[rows]
        between = inputs[rows] + parts[:, None] * (inputs[rows + 1] - inputs[rows])
        return np.concatenate([inputs[:1], np.where(parts[:, None] == 1.0, inputs[rows + 1], between)])

    def _followed(self, way: Way, inputs: Array) -> Way | None:
        """Return the way over inputs (n, legs) from the start of another one; None unless it is verified to its end."""
        x = np.empty((len(inputs), way.x.shape[1]))
        x[0] = way.x[0]
        for first, last in slices(len(inputs) - 1, _FOLLOWED_AT_ONCE):
            part = slice(first, last + 1)
            count = follow_inputs(self.mechanism.leg_table, self.load, inputs[part], self.least_margin, x[part])
            if count < last + 1 - first:
                return None
        if not (self.are_same(x[-1:], way.x[-1:])[0] and self.structure.are_kept(x[1:], inputs[1:]).all()):
            return None
        return Way(x, inputs)

    def _pulled(self, ways: Sequence[Way]) -> list[Way]:
        """Return ways of which rows are left out: from each that is kept, a straight way leads to the next one.

        From each row the last one is tried first, and then, by bisection, the farthest to which a straight way leads.
        """
        ends = np.array([len(way.inputs) - 1 for way in ways])
        kept: list[list[int]] = [[0] for _ in ways]
        anchors, low, high = np.zeros_like(ends), np.minimum(1, ends), ends + 1
        trials = ends.copy()
        while (open_ := np.flatnonzero(low < ends)).size:
            leads = self._lead_in(ways, open_, anchors, trials)
            low[open_] = np.where(leads, trials[open_], low[open_])
            high[open_] = np.where(leads, high[open_], trials[open_])
            for n in open_[high[open_] - low[open_] <= 1].tolist():
                if low[n] < ends[n]:
                    kept[n].append(int(low[n]))
                    anchors[n], low[n], high[n] = low[n], low[n] + 1, ends[n] + 1
            fresh = high == ends + 1
            trials = np.where(fresh, ends, (low + high) // 2)
        return [
            Way(way.x[[*rows, end]], way.inputs[[*rows, end]]) if end else way
            for way, rows, end in zip(ways, kept, ends.tolist(), strict=True)
        ]

    def _lead_in(self, ways: Sequence[Way], chosen: Integers, starts: Integers, ends: Integers) -> Mask:
        """Return for some ways whether the straight way leads from the row `starts` to the row `ends` of each."""
        first, last = (
            Way(
                np.array([ways[n].x[rows[n]] for n in chosen.tolist()]),
                np.array([ways[n].inputs[rows[n]] for n in chosen.tolist()]),
            )
            for rows in (starts, ends)
        )
        return self.lead(first, last)


def _known(found: Way | None, given: Way) -> Way:
    return given if found is None else found
