"""What doors are tried with: values that are wrong almost everywhere, and right arrays in every layout and type."""

import datetime
import math
from collections.abc import Iterator
from decimal import Decimal
from fractions import Fraction
from typing import Any

import numpy as np

Cases = Iterator[tuple[str, Any]]


class Hostile:
    """Raises whatever is asked of it."""

    def __repr__(self) -> str:
        raise RuntimeError("no representation")

    def __array__(self, *_: Any, **__: Any) -> Any:
        raise RuntimeError("no array")

    def __float__(self) -> float:
        raise RuntimeError("no number")

    def __eq__(self, other: object) -> bool:
        raise RuntimeError("no comparison")

    def __hash__(self) -> int:
        raise RuntimeError("no hash")

    def __len__(self) -> int:
        raise RuntimeError("no length")

    def __iter__(self) -> Any:
        raise RuntimeError("no members")


WRONG: dict[str, Any] = {
    "None": None,
    "True": True,
    "numpy True": np.True_,
    "text of a number": "1",
    "empty text": "",
    "bytes": b"1",
    "complex": 1.0 + 0.0j,
    "numpy complex": np.complex64(1.0),
    "nan": math.nan,
    "inf": math.inf,
    "-inf": -math.inf,
    "10**400": 10**400,
    "-10**400": -(10**400),
    "10**5000": 10**5000,
    "2**63": 2**63,
    "1e308": 1e308,
    "-1": -1,
    "-1.0": -1.0,
    "0": 0,
    "2.5": 2.5,
    "long double": np.longdouble("1e400"),
    "decimal": Decimal("0.5"),
    "fraction": Fraction(1, 2),
    "date": datetime.date(2020, 1, 1),
    "datetime64": np.datetime64(1, "s"),
    "timedelta64": np.timedelta64(1, "s"),
    "masked": np.ma.masked,
    "masked array": np.ma.array([0.1, 0.2, 0.3], mask=[True, False, False]),
    "empty list": [],
    "empty array": np.empty(0),
    "empty dict": {},
    "dict": {"x": 1.0},
    "set": {1.0, 2.0},
    "object": object(),
    "hostile": Hostile(),
    "function": math.sin,
    "type": float,
    "array of a type": np.array(["a", "b"]),
    "array of bytes": np.array([b"1", b"2"]),
    "array of objects": np.array([object(), object()]),
    "array of records": np.zeros(2, dtype=[("x", float)]),
    "array of bools": np.array([True, False]),
    "complex array": np.array([1.0 + 0.0j, 0.0]),
    "ragged": [[1.0], [2.0, 3.0]],
    "deep": np.zeros((1, 1, 1, 1, 1)),
    "no axes": np.array(1.0),
    "five numbers": [0.1, 0.2, 0.3, 0.4, 0.5],
    "numbers of a matrix": [[0.1, 0.2], [0.3, 0.4]],
    "nan in a pair": [0.1, math.nan],
    "nan among three": [0.1, math.nan, 0.3],
    "inf in a pair": np.array([0.1, math.inf]),
    "huge in a pair": [0.1, 10**400],
    "None in a pair": [0.1, None],
    "text in a pair": ["0.1", "0.2"],
    "without end": np.broadcast_to(0.0, (1 << 40,)),
    "without end, twice": np.broadcast_to(0.0, (2, 1 << 40)),
    "range": range(10**12),
}


def layouts(value: Any) -> Cases:
    """The same numbers in other containers, types and layouts; those in which they are not exactly the same are apart.

    `value` is an array of numbers. Each case must come to the same result.
    """
    array = np.asarray(value)
    real = array.astype(np.int64 if array.dtype.kind in "iu" else np.float64)
    yield "list", array.tolist()
    yield "nested tuples", _tuples(array.tolist())
    yield "objects", array.astype(object)
    yield "in Fortran's order", np.asfortranarray(real)
    spread = np.zeros((*array.shape, 2), dtype=real.dtype)
    spread[..., 0] = real
    yield "strided", spread[..., 0]
    yield "backwards", np.flip(np.flip(real).copy())
    frozen = array.copy()
    frozen.setflags(write=False)
    yield "read-only", frozen
    yield "of other byte order", real.astype(real.dtype.newbyteorder(">"))
    yield "subclass", real.view(Subclass)
    if real.dtype.kind == "f" and np.array_equal(real.astype(np.float32), real):
        yield "single precision", real.astype(np.float32)
    if np.array_equal(np.round(real), real):
        for kind in (np.int64, np.int32, np.int8):
            if np.array_equal(real.astype(kind), real):
                yield f"{np.dtype(kind).name}", real.astype(kind)


class Subclass(np.ndarray[Any, Any]):
    """An array by another name."""


def _tuples(value: Any) -> Any:
    return tuple(map(_tuples, value)) if isinstance(value, list) else value
