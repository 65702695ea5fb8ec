"""Checks of arguments, with errors that name the argument, its value and what is allowed."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray


def finite_number(name: str, value: Any) -> float:
    """Return `value` as a float; raise if it is not one finite number."""
    try:
        number = float(value)
    except (TypeError, ValueError):
        raise TypeError(f"{name} must be a number, got {value!r}") from None
    if not math.isfinite(number):
        raise ValueError(f"{name} must be finite, got {number}")
    return number


def positive_number(name: str, value: Any) -> float:
    """Return `value` as a float; raise if it is not finite and greater than zero."""
    number = finite_number(name, value)
    if number <= 0.0:
        raise ValueError(f"{name} must be greater than 0, got {number}")
    return number


def number_not_negative(name: str, value: Any) -> float:
    """Return `value` as a float; raise if it is not finite and at least zero."""
    number = finite_number(name, value)
    if number < 0.0:
        raise ValueError(f"{name} must be at least 0, got {number}")
    return number


def whole_number(name: str, value: Any, least: int) -> int:
    """Return `value` as an int; raise if it is no whole number, or less than `least`."""
    if not isinstance(value, int | np.integer):
        raise TypeError(f"{name} must be a whole number, got {value!r}")
    if value < least:
        raise ValueError(f"{name} must be at least {least}, got {value}")
    return int(value)


def finite_tuple(name: str, value: Any, size: int) -> tuple[float, ...]:
    """Return `value` as a tuple of `size` finite floats."""
    return tuple(float(number) for number in finite_vector(name, value, size))


def finite_vector(name: str, value: ArrayLike, size: int) -> NDArray[np.float64]:
    """Return a new float array of `value`; raise unless it holds exactly `size` finite numbers, and no strings."""
    try:
        vector = np.array(value, dtype=np.float64)
        is_text = np.asarray(value).dtype.kind in "SU"
    except (TypeError, ValueError):
        is_text = True
    if is_text:
        raise TypeError(f"{name} must be {size} numbers, got {value!r}")
    if vector.shape != (size,):
        raise ValueError(f"{name} must have shape ({size},), got shape {vector.shape}: {value!r}")
    if not np.isfinite(vector).all():
        raise ValueError(f"{name} must be finite, got {vector.tolist()}")
    return vector


def limit_pair(name: str, value: Any) -> tuple[float, float]:
    """Return `value` as (lower, upper) with lower < upper."""
    lower, upper = finite_tuple(name, value, 2)
    if lower >= upper:
        raise ValueError(f"{name} must be (lower, upper) with lower < upper, got {(lower, upper)}")
    return lower, upper


def one_of(name: str, value: Any, allowed: Sequence[Any]) -> Any:
    """Return `value`; raise unless it is one of `allowed`."""
    if value not in allowed:
        raise ValueError(f"{name} must be one of {list(allowed)}, got {value!r}")
    return value
