"""Checks of arguments, with errors that name the argument, its value and what is allowed.

Numbers are real numbers: no truth values, text, dates, complex or masked ones. Arrays are returned as new ones, of
double precision and in C order, so that compiled code meets one kind of them alone.
"""

import math
import numbers
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

Kind = TypeVar("Kind")
Shape = tuple[int | str, ...]

_LONGEST_SHOWN, _FEW = 200, 8
_LARGEST = 1 << 62  # and its negative: whole numbers that arrays can hold, and sums of two of them
_NO_NUMBERS = bool | np.bool_ | np.timedelta64  # to Python these are numbers, too
# Kinds of arrays that hold real numbers: integers, with or without sign, and floating-point ones.
_NUMERIC, _WHOLE = "iuf", "iu"


def shown(value: Any) -> str:
    """Return a value as errors show it: its representation, cut where it is long."""
    try:
        text = repr(value)
    except Exception:  # whatever a foreign object, or an integer of 5000 digits, raises
        text = f"a {type(value).__name__} that cannot be shown"
    return text if len(text) <= _LONGEST_SHOWN else f"{text[:_LONGEST_SHOWN]}..."


def finite_number(name: str, value: Any) -> float:
    """Return `value` as a float; raise if it is not one finite real number."""
    if not _is_number(value):
        array = _as_array(value)
        if array is None or array.shape != () or array.dtype.kind not in _NUMERIC:
            raise TypeError(f"{name} must be a number, got {shown(value)}")
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise ValueError(f"{name} must be finite, got {shown(value)}")
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


def number_or_nan(name: str, value: Any) -> float:
    """Return `value` as a float, nan where nothing is known; raise if it is no number that is at least zero."""
    return math.nan if isinstance(value, float) and math.isnan(value) else number_not_negative(name, value)


def limit_not_negative(name: str, value: Any) -> float:
    """Return `value` as a float, infinite where there is no limit; raise if it is no number that is at least zero."""
    return math.inf if isinstance(value, float) and value == math.inf else number_not_negative(name, value)


def whole_number(name: str, value: Any, least: int, most: int | None = _LARGEST) -> int:
    """Return `value` as an int; raise if it is no whole number, less than `least` or, unless None, more than `most`."""
    if not isinstance(value, int | np.integer) or isinstance(value, _NO_NUMBERS):
        raise TypeError(f"{name} must be a whole number, got {shown(value)}")
    if value < least:
        raise ValueError(f"{name} must be at least {least}, got {shown(value)}")
    if most is not None and value > most:
        raise ValueError(f"{name} must be at most {most}, got {shown(value)}")
    return int(value)


def truth_value(name: str, value: Any) -> bool:
    """Return `value` as a bool; raise unless it is True or False."""
    if not isinstance(value, bool | np.bool_):
        raise TypeError(f"{name} must be True or False, got {shown(value)}")
    return bool(value)


def finite_tuple(name: str, value: Any, size: int) -> tuple[float, ...]:
    """Return `value` as a tuple of `size` finite floats."""
    return tuple(finite_vector(name, value, size).tolist())


def finite_vector(name: str, value: ArrayLike, size: int) -> NDArray[np.float64]:
    """Return a new float array of `value`; raise unless it holds exactly `size` finite real numbers."""
    array = _numbers(name, value, f"{size} numbers")
    if array.shape != (size,):
        raise ValueError(f"{name} must have shape ({size},), got shape {array.shape}: {shown(value)}")
    return _finite(name, array)


def finite_array(name: str, value: ArrayLike, shape: Shape) -> NDArray[np.float64]:
    """Return a new float array, in C order, of finite real numbers.

    A name in the shape stands for any size, "..." at its beginning for any axes.
    """
    array = _numbers(name, value, "an array of numbers")
    _check_shape(name, array, shape)
    return _finite(name, array)


def whole_array(name: str, value: ArrayLike, shape: Shape, least: int, most: int) -> NDArray[np.int64]:
    """Return a new array, in C order, of whole numbers from `least` to `most`."""
    array = _as_array(value)
    if array is not None and _is_whole_by_parts(array):
        array = array.astype(np.int64)
    if array is None or array.dtype.kind not in _WHOLE:
        raise TypeError(f"{name} must be an array of whole numbers, got {shown(value)}")
    _check_shape(name, array, shape)
    if array.size and not (least <= array.min() and array.max() <= most):
        raise ValueError(f"{name} must be from {least} to {most}, got {shown(value)}")
    return np.array(array, dtype=np.int64, order="C")


def shape_of(value: Any) -> tuple[int, ...]:
    """Return the shape that a value has as an array: () of a number, and of what is no array at all."""
    array = _as_array(value)
    return () if array is None else array.shape


def truth_array(name: str, value: Any, shape: tuple[int, ...]) -> NDArray[np.bool_]:
    """Return a copy of a mask; raise unless it is a bool array of that shape."""
    if not isinstance(value, np.ndarray) or value.dtype != np.bool_ or value.shape != shape:
        raise ValueError(f"{name} must be a bool array of shape {shape}, got {shown(value)}")
    return np.array(value, order="C")


def file_path(name: str, value: Any) -> Path:
    """Return `value` as a path; raise if it is none. Empty text is none, though it stands for a folder elsewhere."""
    try:
        path = Path(value)
    except TypeError:
        raise TypeError(f"{name} must be a path, got {shown(value)}") from None
    if value == "":
        raise ValueError(f"{name} must be a path, got an empty text")
    return path


def limit_pair(name: str, value: Any) -> tuple[float, float]:
    """Return `value` as (lower, upper) with lower < upper."""
    lower, upper = finite_tuple(name, value, 2)
    if lower >= upper:
        raise ValueError(f"{name} must be (lower, upper) with lower < upper, got {(lower, upper)}")
    return lower, upper


def one_of(name: str, value: Any, allowed: Sequence[Any]) -> Any:
    """Return `value`; raise unless it is one of `allowed`, of the same type: 1 is not True."""
    for own in allowed:
        if isinstance(value, type(own)) and isinstance(value, bool) == isinstance(own, bool) and value == own:
            return value
    raise ValueError(f"{name} must be one of {list(allowed)}, got {shown(value)}")


def instance_of(name: str, value: Any, kind: type[Kind]) -> Kind:
    """Return `value`; raise unless it is of that kind."""
    if not isinstance(value, kind):
        raise TypeError(f"{name} must be {_article(kind)}, got {shown(value)}")
    return value


def check_kinds(record: object, **kinds: Any) -> None:
    """Raise unless the attributes of a record that are named are of these kinds."""
    for name, kind in kinds.items():
        value = getattr(record, name)
        if not isinstance(value, kind):
            raise TypeError(f"{name} must be of type {_named(kind)}, got {shown(value)}")


def text(name: str, value: Any) -> str:
    """Return `value`; raise unless it is a string that is not empty."""
    if not isinstance(value, str):
        raise TypeError(f"{name} must be a string, got {shown(value)}")
    if not value:
        raise ValueError(f"{name} must not be empty, got {value!r}")
    return value


def mapping(name: str, value: Any) -> Mapping[Any, Any]:
    """Return `value`; raise unless it is a mapping, such as a dict. None is an empty one."""
    if value is None:
        return {}
    if not isinstance(value, Mapping):
        raise TypeError(f"{name} must be a mapping, got {shown(value)}")
    return value


def sequence_of(name: str, value: Any, kind: Any) -> tuple[Any, ...]:
    """Return the members of a sequence as a tuple; raise unless it is one, and all are of that kind."""
    if isinstance(value, str | bytes | Mapping) or not isinstance(value, Iterable):
        raise TypeError(f"{name} must be a sequence of {_named(kind)}, got {shown(value)}")
    try:
        members = tuple(value)
    except Exception:  # an array without an axis, or whatever a foreign object raises
        raise TypeError(f"{name} must be a sequence of {_named(kind)}, got {shown(value)}") from None
    for member in members:
        if not isinstance(member, kind):
            raise TypeError(f"{name} must be a sequence of {_named(kind)}, got {shown(member)} in it")
    return members


def _is_number(value: Any) -> bool:
    return isinstance(value, numbers.Real) and not isinstance(value, _NO_NUMBERS)


def _as_array(value: Any) -> NDArray[Any] | None:
    """Return `value` as an array as NumPy sees it, uncopied where it is one; None if it is none, or a masked one."""
    if type(value) is np.ndarray:
        return value
    if isinstance(value, np.ma.MaskedArray):
        return None
    try:
        return np.asarray(value)
    except Exception:  # ragged nesting, or whatever a foreign object raises when it is asked for its numbers
        return None


def _is_whole_by_parts(array: NDArray[Any]) -> bool:
    """Return whether an array without a kind of its own holds whole numbers, or nothing at all."""
    if array.dtype.kind != "O":
        return array.dtype.kind == "f" and array.size == 0
    return all(_is_number(own) and isinstance(own, int) and abs(own) <= _LARGEST for own in array.flat)


def _numbers(name: str, value: Any, wanted: str) -> NDArray[Any]:
    """Return `value` as an array of real numbers, uncopied where it is one; raise if it is none."""
    array = _as_array(value)
    if array is not None and array.dtype.kind == "O" and array.size and all(map(_is_number, array.flat)):
        # integers and fractions beyond what an array of numbers can hold, or any that are mixed
        return np.array([finite_number(name, number) for number in array.flat]).reshape(array.shape)
    if array is None or array.dtype.kind not in _NUMERIC:
        raise TypeError(f"{name} must be {wanted}, got {shown(value)}")
    return array


def _finite(name: str, array: NDArray[Any]) -> NDArray[np.float64]:
    if array.dtype.itemsize > 8:  # what is too large for double precision becomes infinite, without a warning
        with np.errstate(all="ignore"):
            array = array.astype(np.float64)
    copy = np.array(array, dtype=np.float64, order="C")
    # an action takes less time one by one
    is_finite = all(map(math.isfinite, copy.flat)) if copy.size < _FEW else np.isfinite(copy).all()
    if not is_finite:
        wrong = copy[~np.isfinite(copy).all(axis=-1)] if copy.ndim > 1 else copy
        raise ValueError(f"{name} must be finite, got {shown(wrong.tolist())}")
    return copy


def _check_shape(name: str, array: NDArray[Any], shape: Shape) -> None:
    last = shape[1:] if shape and shape[0] == "..." else shape
    own = array.shape[array.ndim - len(last) :] if last is not shape and array.ndim >= len(last) else array.shape
    if len(own) == len(last) and all(isinstance(n, str) or n == m for m, n in zip(own, last, strict=True)):
        return
    wanted = ", ".join(map(str, shape)) + ("," if len(shape) == 1 else "")
    raise ValueError(f"{name} must have shape ({wanted}), got {array.shape}")


def _named(kind: Any) -> str:
    return getattr(kind, "__name__", None) or str(kind)


def _article(kind: type) -> str:
    return f"{'an' if kind.__name__[0] in 'AEIOU' else 'a'} {kind.__name__}"
