"""What a scenario came to, as arrays; what of it is kept, and how it is compared: to the last bit, or to 1e-9."""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

LOSSES = (1, 2)  # codes of a fold and of a change of the index
TOLERANCE = 1e-9
# The scalar kernel estimates the singularity margin by numerical differences, which lose half of the digits.
TOLERANCES = {"estimated_margin": 1e-6}
# About so many rows of real numbers are kept of a scenario, and so many telling ones beside them.
ROWS_KEPT, TELLING_KEPT = 12, 4
# Rounding errors of a state grow as one over its distance from a fold: nearer to one than this, no row is kept.
SOUND_MARGIN = 1e-2


@dataclass(frozen=True)
class Record:
    """Everything that a scenario came to.

    Attributes
    ----------
    exact : dict of arrays
        Integers and truth values, and real numbers that are whole: the same on every processor.
    close : dict of arrays (n, ...)
        Real numbers, one row for each state: on every processor the same to 1e-9, where they are sound.
    is_sound : array (n,)
        The rows in which rounding errors stay small.
    rough : dict of arrays
        What rounding errors decide: residuals, where exactly a fold is met, how often something was refined.
    telling : array of int
        Rows that are worth keeping beside those that are taken evenly.
    """

    exact: dict[str, NDArray[Any]]
    close: dict[str, NDArray[np.float64]]
    is_sound: NDArray[np.bool_]
    rough: dict[str, NDArray[Any]] = field(default_factory=dict)
    telling: NDArray[np.int64] = field(default_factory=lambda: np.empty(0, dtype=np.int64))

    @property
    def fields(self) -> dict[str, NDArray[Any]]:
        """All arrays by name."""
        return {name: np.asarray(array) for name, array in sorted((self.exact | self.close | self.rough).items())}


# Kept in the repository: values that hold on every processor


def kept(record: Record) -> dict[str, NDArray[Any]]:
    """Values of a record to keep: all whole numbers in a row, and some rows of real ones; unsound rows are nan."""
    rows = _kept_rows(record)
    close = _table(record)[rows]
    close[~record.is_sound[rows]] = np.nan
    return {"exact": _whole_numbers(record), "close": close}


def differences(record: Record, expected: Mapping[str, NDArray[Any]]) -> list[str]:
    """What of a record differs from what was kept of it: nothing, if all is well."""
    found, wanted = _whole_numbers(record), expected["exact"]
    if found.shape != wanted.shape:
        return [f"{len(found)} whole numbers instead of {len(wanted)}"]
    if not np.array_equal(found, wanted):
        places = np.flatnonzero(found != wanted)
        return [f"{len(places)} whole numbers, first {_name_of(record, int(places[0]))}"]
    close, wanted = _table(record)[_kept_rows(record)], expected["close"]
    if close.shape != wanted.shape:
        return [f"real numbers of shape {close.shape} instead of {wanted.shape}"]
    messages, first = [], 0
    for name, array in record.close.items():
        width = _width(array)
        own, theirs = close[:, first : first + width], wanted[:, first : first + width]
        first += width
        is_kept = ~np.isnan(theirs).any(axis=1)
        # relative to the largest of the numbers that belong together, a stiffness matrix for one
        scale = np.maximum(1.0, np.abs(theirs[is_kept]).max(axis=1, initial=0.0, keepdims=True))
        error = np.abs(own[is_kept] - theirs[is_kept]) / scale
        if not (error <= TOLERANCES.get(name, TOLERANCE)).all():
            row = int(np.flatnonzero(is_kept)[np.nanargmax(error.max(axis=1))])
            messages.append(f"{name} by {error.max():.2g}, most in kept row {row}")
    return messages


def _whole_numbers(record: Record) -> NDArray[np.int32]:
    parts = [np.ravel(array) for array in record.exact.values()]
    values = np.concatenate(parts) if parts else np.empty(0)
    whole = values.astype(np.int32)
    assert np.array_equal(whole, values), "a number that is not whole is compared as such"
    return whole


def _name_of(record: Record, place: int) -> str:
    for name, array in record.exact.items():
        if place < np.size(array):
            return f"{name}{list(map(int, np.unravel_index(place, np.shape(array))))}"
        place -= np.size(array)
    raise IndexError(place)


def _table(record: Record) -> NDArray[np.float64]:
    parts = [array.reshape(len(array), _width(array)) for array in record.close.values()]
    return np.concatenate([np.empty((len(record.is_sound), 0)), *parts], axis=1)


def _width(array: NDArray[Any]) -> int:
    """How many numbers a row of an array has."""
    return int(np.prod(array.shape[1:]))


def _kept_rows(record: Record) -> NDArray[np.int64]:
    return np.union1d(_spread(np.arange(len(record.is_sound)), ROWS_KEPT), _spread(record.telling, TELLING_KEPT))


def _spread(rows: NDArray[np.int64], count: int) -> NDArray[np.int64]:
    """About so many of the rows, evenly."""
    return rows[:: max(1, len(rows) // count)]


# Kept outside the repository: every bit, for a comparison on one machine


def digests(record: Record) -> dict[str, str]:
    """Hexadecimal digest of each field: of its type, its shape and its bits."""
    return {name: _digest(array) for name, array in record.fields.items()}


def _digest(array: NDArray[Any]) -> str:
    head = f"{array.dtype.str} {array.shape} ".encode()
    return hashlib.sha256(head + np.ascontiguousarray(array).tobytes()).hexdigest()


def largest_differences(first: NDArray[Any], second: NDArray[Any]) -> str:
    """By how much two arrays of a field differ at most, in words."""
    if first.shape != second.shape:
        return f"shapes {first.shape} and {second.shape}"
    a, b = first.astype(np.float64), second.astype(np.float64)
    both_nan = np.isnan(a) & np.isnan(b)
    gap = np.where(both_nan, 0.0, np.abs(a - b))
    size = np.maximum(np.abs(a), np.abs(b))
    relative = np.divide(gap, size, out=np.zeros_like(gap), where=size > 0.0)
    types = "" if first.dtype == second.dtype else f", types {first.dtype} and {second.dtype}"
    count = np.count_nonzero(~(gap == 0.0))
    return f"{count} of {gap.size} by up to {gap.max(initial=0.0):.3g}, relative {relative.max(initial=0.0):.3g}{types}"
