"""Rigorous arithmetic with functions of two variables: quadratic polynomials with a bound on all that they leave out.

A model encloses a function f of (s, t) on the square [-1, 1]^2: everywhere in the square f is within `remainder` of
the polynomial. Every operation encloses its true result: what is truncated, and the rounding errors of the operation
itself, are added to the remainder. So no directed rounding is needed. The only assumption is IEEE 754 double precision
with rounding to nearest, and elementary functions of the C library (sin, cos) that are accurate to 4 units in the last
place. A failure (division by a function that may vanish) gives a remainder that is inf or nan; a proof must be
written so that it fails then: `bound < x` is false.

Operations follow Makino and Berz, Taylor models and other validated functional inclusion methods, 2003.
"""

import math
from typing import NamedTuple

from pcm_gym.kernels.compilation import kernel

# Bounds the rounding errors of one operation relative to the absolute values that go into it: at most 6 products and
# sums meet in one coefficient, with an error of 2^-53 = 1.1e-16 each.
ROUNDING = 1e-15
# Makes up for the rounding errors of a remainder, a sum and product of at most 40 positive numbers.
OUTWARD = 1.0 + 1e-14
# Covers products that underflow.
TINY = 1e-300
# Relative error of the library's elementary functions: 4 units in the last place.
LIBRARY = 4.0 * 2.3e-16


class Model(NamedTuple):
    """center + s along + t across + s^2 ss + s t st + t^2 tt, within remainder."""

    center: float
    along: float
    across: float
    ss: float
    st: float
    tt: float
    remainder: float


@kernel
def constant(value: float) -> Model:
    """Return the model of a number."""
    return Model(value, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


@kernel
def first_order(a: Model) -> float:
    """Return a bound on the linear part."""
    return abs(a.along) + abs(a.across)


@kernel
def second_order(a: Model) -> float:
    """Return a bound on the quadratic part."""
    return abs(a.ss) + abs(a.st) + abs(a.tt)


@kernel
def radius(a: Model) -> float:
    """Return how far the function may be from the model's centre."""
    return (first_order(a) + second_order(a) + a.remainder) * OUTWARD


@kernel
def add(a: Model, b: Model) -> Model:
    """Return a + b."""
    center, along, across = a.center + b.center, a.along + b.along, a.across + b.across
    ss, st, tt = a.ss + b.ss, a.st + b.st, a.tt + b.tt
    size = abs(center) + abs(along) + abs(across) + abs(ss) + abs(st) + abs(tt)
    return Model(center, along, across, ss, st, tt, (a.remainder + b.remainder + ROUNDING * size) * OUTWARD)


@kernel
def scale(factor: float, a: Model) -> Model:
    """Return factor a."""
    center, along, across = factor * a.center, factor * a.along, factor * a.across
    ss, st, tt = factor * a.ss, factor * a.st, factor * a.tt
    size = abs(center) + abs(along) + abs(across) + abs(ss) + abs(st) + abs(tt)
    return Model(
        center, along, across, ss, st, tt, (abs(factor) * a.remainder + ROUNDING * size + TINY) * OUTWARD
    )


@kernel
def shift(a: Model, value: float) -> Model:
    """Return a + value."""
    center = a.center + value
    remainder = (a.remainder + ROUNDING * abs(center)) * OUTWARD
    return Model(center, a.along, a.across, a.ss, a.st, a.tt, remainder)


@kernel
def subtract(a: Model, b: Model) -> Model:
    """Return a - b."""
    return add(a, scale(-1.0, b))


@kernel
def multiply(a: Model, b: Model) -> Model:
    """Return a b."""
    a_1, a_2, b_1, b_2 = first_order(a), second_order(a), first_order(b), second_order(b)
    a_size, b_size = abs(a.center) + a_1 + a_2, abs(b.center) + b_1 + b_2
    truncated = a_1 * b_2 + a_2 * b_1 + a_2 * b_2
    remainder = a_size * b.remainder + b_size * a.remainder + a.remainder * b.remainder + ROUNDING * a_size * b_size
    return Model(
        a.center * b.center,
        a.center * b.along + a.along * b.center,
        a.center * b.across + a.across * b.center,
        a.center * b.ss + a.along * b.along + a.ss * b.center,
        a.center * b.st + a.along * b.across + a.across * b.along + a.st * b.center,
        a.center * b.tt + a.across * b.across + a.tt * b.center,
        (remainder + truncated + TINY) * OUTWARD,
    )


@kernel
def reciprocal(a: Model) -> Model:
    """Return 1 / a; the remainder is inf or nan where a may vanish."""
    spread = radius(a) / abs(a.center) * OUTWARD
    if not spread < 1.0:
        return Model(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, math.inf)
    inverse = 1.0 / a.center
    part = scale(inverse, Model(0.0, a.along, a.across, a.ss, a.st, a.tt, a.remainder))
    series = shift(subtract(multiply(part, part), part), 1.0)
    beyond = spread * spread * spread / (1.0 - spread) * (1.0 + 1e-13)
    result = scale(inverse, series)
    # the inverse of the centre is itself rounded
    remainder = result.remainder + abs(inverse) * (beyond + ROUNDING / (1.0 - spread))
    return Model(result.center, result.along, result.across, result.ss, result.st, result.tt, remainder * OUTWARD)


@kernel
def cosine_and_sine(angle: float, half_width: float) -> tuple[Model, Model]:
    """Return cos and sin of angle + t half_width."""
    c, s = math.cos(angle), math.sin(angle)
    square = 0.5 * half_width * half_width
    cubic = half_width * square / 3.0
    rounding = ROUNDING + LIBRARY
    cosine_error = rounding * (abs(c) + abs(s) * half_width + abs(c) * square)
    sine_error = rounding * (abs(s) + abs(c) * half_width + abs(s) * square)
    cosine_cubic, sine_cubic = cubic * (abs(s) + half_width), cubic * min(1.0, abs(c) + half_width)
    return (
        Model(c, 0.0, -s * half_width, 0.0, 0.0, -c * square, (cosine_error + cosine_cubic) * OUTWARD + TINY),
        Model(s, 0.0, c * half_width, 0.0, 0.0, -s * square, (sine_error + sine_cubic) * OUTWARD + TINY),
    )


@kernel
def bounds(a: Model) -> tuple[float, float]:
    """Return the centre and the half width of an interval that holds all values, the squares' signs used."""
    middle = a.center + 0.5 * (a.ss + a.tt)
    half_width = first_order(a) + 0.5 * (abs(a.ss) + abs(a.tt)) + abs(a.st) + a.remainder
    return middle, (half_width + ROUNDING * (abs(a.center) + abs(a.ss) + abs(a.tt))) * OUTWARD
