"""Rigorous arithmetic with functions of two variables: cubic polynomials with a bound on all that they leave out.

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

from pcm_gym.kernels.numerics.compilation import kernel

# Bounds the rounding errors of one operation relative to the absolute values that go into it: at most 6 products meet
# in one coefficient, and each product and sum has an error of 2^-53 = 1.1e-16.
ROUNDING = 1e-15
# Makes up for the rounding errors of a remainder, a sum and product of at most 40 positive numbers.
OUTWARD = 1.0 + 1e-14
# Covers products that underflow.
TINY = 1e-300
# Relative error of the library's elementary functions: 4 units in the last place.
LIBRARY = 4.0 * 2.3e-16


class Model(NamedTuple):
    """A polynomial in s and t, named coefficients from the constant one up, within remainder."""

    center: float
    s: float
    t: float
    ss: float
    st: float
    tt: float
    sss: float
    sst: float
    stt: float
    ttt: float
    remainder: float


@kernel
def constant(value: float) -> Model:
    """Return the model of a number."""
    return Model(value, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


@kernel
def first_order(a: Model) -> float:
    """Return a bound on the linear part."""
    return abs(a.s) + abs(a.t)


@kernel
def second_order(a: Model) -> float:
    """Return a bound on the quadratic part."""
    return abs(a.ss) + abs(a.st) + abs(a.tt)


@kernel
def third_order(a: Model) -> float:
    """Return a bound on the cubic part."""
    return abs(a.sss) + abs(a.sst) + abs(a.stt) + abs(a.ttt)


@kernel
def radius(a: Model) -> float:
    """Return how far the function may be from the model's centre."""
    return (first_order(a) + second_order(a) + third_order(a) + a.remainder) * OUTWARD


@kernel
def _with_remainder(a: Model, remainder: float) -> Model:
    """Return `a` with its rounding errors added to a new remainder."""
    size = abs(a.center) + first_order(a) + second_order(a) + third_order(a)
    remainder = (remainder + ROUNDING * size + TINY) * OUTWARD
    return Model(a.center, a.s, a.t, a.ss, a.st, a.tt, a.sss, a.sst, a.stt, a.ttt, remainder)


@kernel
def widen(a: Model, error: float) -> Model:
    """Return the model of a function that differs from that of `a` by at most `error`."""
    return _with_remainder(a, a.remainder + error)


@kernel
def exact(a: Model) -> Model:
    """Return the polynomial of `a` alone."""
    return Model(a.center, a.s, a.t, a.ss, a.st, a.tt, a.sss, a.sst, a.stt, a.ttt, 0.0)


@kernel
def add(a: Model, b: Model) -> Model:
    """Return a + b."""
    total = Model(
        a.center + b.center,
        a.s + b.s,
        a.t + b.t,
        a.ss + b.ss,
        a.st + b.st,
        a.tt + b.tt,
        a.sss + b.sss,
        a.sst + b.sst,
        a.stt + b.stt,
        a.ttt + b.ttt,
        0.0,
    )
    return _with_remainder(total, a.remainder + b.remainder)


@kernel
def scale(factor: float, a: Model) -> Model:
    """Return factor a."""
    scaled = Model(
        factor * a.center,
        factor * a.s,
        factor * a.t,
        factor * a.ss,
        factor * a.st,
        factor * a.tt,
        factor * a.sss,
        factor * a.sst,
        factor * a.stt,
        factor * a.ttt,
        0.0,
    )
    return _with_remainder(scaled, abs(factor) * a.remainder)


@kernel
def shift(a: Model, value: float) -> Model:
    """Return a + value."""
    return add(a, constant(value))


@kernel
def subtract(a: Model, b: Model) -> Model:
    """Return a - b."""
    return add(a, scale(-1.0, b))


@kernel
def multiply(a: Model, b: Model) -> Model:
    """Return a b."""
    a_1, a_2, a_3 = first_order(a), second_order(a), third_order(a)
    b_1, b_2, b_3 = first_order(b), second_order(b), third_order(b)
    a_size, b_size = abs(a.center) + a_1 + a_2 + a_3, abs(b.center) + b_1 + b_2 + b_3
    truncated = a_1 * b_3 + a_2 * (b_2 + b_3) + a_3 * (b_1 + b_2 + b_3)
    carried = a_size * b.remainder + b_size * a.remainder + a.remainder * b.remainder
    return Model(
        a.center * b.center,
        a.center * b.s + a.s * b.center,
        a.center * b.t + a.t * b.center,
        a.center * b.ss + a.s * b.s + a.ss * b.center,
        a.center * b.st + a.s * b.t + a.t * b.s + a.st * b.center,
        a.center * b.tt + a.t * b.t + a.tt * b.center,
        a.center * b.sss + a.s * b.ss + a.ss * b.s + a.sss * b.center,
        a.center * b.sst + a.s * b.st + a.t * b.ss + a.ss * b.t + a.st * b.s + a.sst * b.center,
        a.center * b.stt + a.s * b.tt + a.t * b.st + a.st * b.t + a.tt * b.s + a.stt * b.center,
        a.center * b.ttt + a.t * b.tt + a.tt * b.t + a.ttt * b.center,
        (carried + truncated + ROUNDING * a_size * b_size + TINY) * OUTWARD,
    )


@kernel
def reciprocal(a: Model) -> Model:
    """Return 1 / a; the remainder is inf or nan where a may vanish."""
    spread = radius(a) / abs(a.center) * OUTWARD
    if not spread < 1.0:
        return widen(constant(0.0), math.inf)
    inverse = 1.0 / a.center
    part = scale(inverse, Model(0.0, a.s, a.t, a.ss, a.st, a.tt, a.sss, a.sst, a.stt, a.ttt, a.remainder))
    # 1 - x (1 - x (1 - x)) and what comes after it
    series = shift(scale(-1.0, part), 1.0)
    for _ in range(2):
        series = shift(scale(-1.0, multiply(part, series)), 1.0)
    beyond = spread * spread * spread * spread / (1.0 - spread) * OUTWARD
    # the inverse of the centre is itself rounded
    return widen(scale(inverse, series), abs(inverse) * (beyond + ROUNDING / (1.0 - spread)) * OUTWARD)


@kernel
def along_s(center: float, slope: float, remainder: float) -> Model:
    """Return the model of center + s slope, within remainder."""
    return Model(center, slope, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, remainder)


@kernel
def along_t(center: float, slope: float, remainder: float) -> Model:
    """Return the model of center + t slope, within remainder."""
    return Model(center, 0.0, slope, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, remainder)


@kernel
def cosine_and_sine(angle: Model) -> tuple[Model, Model]:
    """Return cos and sin of an angle."""
    part = Model(
        0.0,
        angle.s,
        angle.t,
        angle.ss,
        angle.st,
        angle.tt,
        angle.sss,
        angle.sst,
        angle.stt,
        angle.ttt,
        angle.remainder,
    )
    size = radius(part)
    square, cube = size * size, size * size * size
    part_square = multiply(part, part)
    cos_part = widen(shift(scale(-0.5, part_square), 1.0), square * square / 24.0)
    sin_part = widen(subtract(part, scale(1.0 / 6.0, multiply(part_square, part))), cube * square / 120.0)
    c, s = math.cos(angle.center), math.sin(angle.center)
    cosine, sine = widen(constant(c), LIBRARY * abs(c)), widen(constant(s), LIBRARY * abs(s))
    return (
        subtract(multiply(cosine, cos_part), multiply(sine, sin_part)),
        add(multiply(sine, cos_part), multiply(cosine, sin_part)),
    )


@kernel
def affine(a: Model) -> tuple[float, float, float, float]:
    """Return centre, slopes and remainder of an affine model, the sign of the squares used."""
    center = a.center + 0.5 * (a.ss + a.tt)
    curved = 0.5 * (abs(a.ss) + abs(a.tt)) + abs(a.st) + third_order(a)
    rounding = ROUNDING * (abs(a.center) + abs(a.ss) + abs(a.tt))
    return center, a.s, a.t, (curved + a.remainder + rounding) * OUTWARD


@kernel
def bounds(a: Model) -> tuple[float, float]:
    """Return the centre and the half width of an interval that holds all values."""
    center, along, across, remainder = affine(a)
    return center, (abs(along) + abs(across) + remainder) * OUTWARD
