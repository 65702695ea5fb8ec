"""Where the numbers of a block stand: every quantity in runs of `LANES` numbers, one per lane, a lane for each row.

`LegLanes` and `CommonLanes` declare the layout. They become records: a kernel writes `leg.tip[0, lane]`, and the
compiler sees one address and a constant. Of separate arrays it would not know that they are apart, and so not turn the
loops over the lanes into vector instructions. A record does not keep its block alive: keep the block too.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pcm_gym.arrays import Array
from pcm_gym.kernels.numerics.compilation import formula, kernel
from pcm_gym.kernels.numerics.linear import Axes, Symmetric, Vector
from pcm_gym.kernels.rods.curvature import Form
from pcm_gym.kernels.rods.rod import Functions
from pcm_gym.kernels.statics.formulas import Derivatives, LegStiffness, Pair

# Rows of a block. Its numbers stay in the fastest cache.
LANES = 64


class _Field(NamedTuple):
    shape: tuple[int, ...]  # of runs
    over: tuple[str, ...]  # the fields that it lies over
    offset: int  # in runs


def _runs(*shape: int, over: tuple[str, ...] = ()) -> Any:
    """Declare a field of this many runs, behind the others or over some that are used up when it is filled."""
    return _Field(shape, over, 0)


class LegLanes:
    """What the lanes hold of one leg: arrays (..., `LANES`)."""

    g: Array = _runs(2)  # load at the tip
    input: Array = _runs()
    target: Array = _runs()  # input to move to
    direction: Array = _runs(2)  # cosine and sine of the clamp's angle
    tip: Array = _runs(2)
    force: Array = _runs(2)
    tip_g: Array = _runs(4)
    half_periods: Array = _runs()
    force_g: Array = _runs(4)
    dead_load_index: Array = _runs()
    clamp: Array = _runs(2)
    functions: Array = _runs(5)  # Jacobi's
    stiffness: Array = _runs(3)
    arm: Array = _runs(2)
    right: Array = _runs(2)  # right-hand side of closure
    step: Array = _runs(2)  # of g
    tangent: Array = _runs(2)  # change of g over the step at its rate at the start
    bow: Array = _runs(2)  # change of g beyond that

    # for the margin, which is worked out when the step is done
    curvature: Array = _runs(4, 3, over=("force_g", "dead_load_index", "clamp", "functions"))
    by_tip: Array = _runs(2, over=("right",))  # derivatives of v' K v, see `margin.Cubic`
    by_clamp: Array = _runs(over=("step",))

    # for gradients, of lanes that are not stepped
    force_weight: Array = _runs(2, over=("tangent",))
    effort_weight: Array = _runs(over=("bow",))
    slope: Array = _runs(over=("half_periods",))  # derivative of the weighted sum by the input


class CommonLanes:
    """What the lanes hold once: arrays (..., `LANES`)."""

    pose: Array = _runs(3)
    turn: Array = _runs(2)  # cosine and sine of the pose's angle
    load: Array = _runs(3)
    right: Array = _runs(3)  # right-hand side of equilibrium
    pull: Array = _runs(3)  # what moves the condensed end-effector
    move: Array = _runs(3)
    tangent: Array = _runs(3)  # change of the pose over the step at its rate at the start
    bow: Array = _runs(3)  # change of the pose beyond that
    length: Array = _runs()  # of the step, by the mean of the tangents at its ends
    defect: Array = _runs()  # of the chord from that
    yielding: Array = _runs()  # trace of the compliance at the start of the step
    foreseen: Array = _runs()  # the same as far as the end of the step tells
    greatest: Array = _runs()  # what that would be of a stable state
    along: Array = _runs()  # half the change of a squared eigenvalue over the step at its rate at the end
    is_clear: Array = _runs()  # 1 or 0: no eigenvalue seems to have vanished within the step
    stiffness: Array = _runs(6)
    eigenvalues: Array = _runs(6)  # the stiffness made diagonal
    axes: Array = _runs(3, 3)  # its eigenvectors, one after the other
    size: Array = _runs()  # of the last correction
    previous: Array = _runs()  # of the one before
    closure_error: Array = _runs()
    error: Array = _runs()  # the largest of closure and equilibrium
    largest_force: Array = _runs()
    index: Array = _runs()
    index_before: Array = _runs()  # at the start of the step
    stability_margin: Array = _runs()
    singularity_margin: Array = _runs()
    squared_slope: Array = _runs()
    is_sound: Array = _runs()  # 1 or 0
    is_moving: Array = _runs()

    # for gradients, of lanes that are not stepped
    margin_weight: Array = _runs(over=("along",))


def record_of(lanes: type) -> np.dtype[Any]:
    """Return the record that a class declares."""
    fields: dict[str, _Field] = {}
    end = 0
    for name, declared in vars(lanes).items():
        if isinstance(declared, _Field):
            fields[name] = declared._replace(offset=_start_below(declared, fields) if declared.over else end)
            end = max(end, fields[name].offset + math.prod(declared.shape))
    return np.dtype(
        (
            np.record,
            {
                "names": list(fields),
                "formats": [("f8", (*field.shape, LANES)) for field in fields.values()],
                "offsets": [8 * LANES * field.offset for field in fields.values()],
                "itemsize": 8 * LANES * end,
            },
        )
    )


def _start_below(field: _Field, fields: dict[str, _Field]) -> int:
    """Return where the fields begin that this one lies over; they must be in a row and have room for it."""
    start = end = fields[field.over[0]].offset
    for name in field.over:
        assert fields[name].offset == end, f"{name} does not follow the field before it in {field.over}"
        end += math.prod(fields[name].shape)
    assert end - start >= math.prod(field.shape), f"{field.over} have no room for {field.shape}"
    return start


_LEG_RECORD, _COMMON_RECORD = record_of(LegLanes), record_of(CommonLanes)


class Block(NamedTuple):
    """The numbers of a block of rows."""

    legs: NDArray[Any]  # (legs,) of `LegLanes`
    common: NDArray[Any]  # (1,) of `CommonLanes`


@kernel
def make_block(leg_count: int) -> Block:
    """Return the records of a block."""
    return Block(np.empty(leg_count, _LEG_RECORD), np.empty(1, _COMMON_RECORD))


@formula
def pair(field: Array, lane: int) -> Pair:
    """Return the two numbers that a lane has in a field."""
    return field[0, lane], field[1, lane]


@formula
def triple(field: Array, lane: int) -> Vector:
    """Return the three numbers that a lane has in a field: a vector, or a leg's stiffness."""
    return field[0, lane], field[1, lane], field[2, lane]


@formula
def derivatives(field: Array, lane: int) -> Derivatives:
    """Return the derivatives by g that a lane has in a field."""
    return field[0, lane], field[1, lane], field[2, lane], field[3, lane]


@formula
def functions_of(leg: LegLanes, lane: int) -> Functions:
    """Return Jacobi's functions of a lane."""
    field = leg.functions
    return field[0, lane], field[1, lane], field[2, lane], field[3, lane], field[4, lane]


@formula
def symmetric(field: Array, lane: int) -> Symmetric:
    """Return the matrix that a lane has in a field."""
    return Symmetric(field[0, lane], field[1, lane], field[2, lane], field[3, lane], field[4, lane], field[5, lane])


@formula
def vectors(field: Array, lane: int) -> Axes:
    """Return the three vectors that a lane has in a field."""
    return vector(field, 0, lane), vector(field, 1, lane), vector(field, 2, lane)


@formula
def vector(field: Array, n: int, lane: int) -> Form:
    """Return one vector of those that a lane has in a field."""
    return field[n, 0, lane], field[n, 1, lane], field[n, 2, lane]


@formula
def set_pair(field: Array, lane: int, values: Pair) -> None:
    """Put two numbers into the lane of a field."""
    field[0, lane] = values[0]
    field[1, lane] = values[1]


@formula
def set_triple(field: Array, lane: int, values: Vector | LegStiffness) -> None:
    """Put three numbers into the lane of a field."""
    field[0, lane] = values[0]
    field[1, lane] = values[1]
    field[2, lane] = values[2]


@formula
def set_derivatives(field: Array, lane: int, values: Derivatives) -> None:
    """Put four numbers into the lane of a field."""
    field[0, lane] = values[0]
    field[1, lane] = values[1]
    field[2, lane] = values[2]
    field[3, lane] = values[3]


@formula
def set_functions(leg: LegLanes, lane: int, values: Functions) -> None:
    """Put Jacobi's functions into a lane."""
    field = leg.functions
    field[0, lane] = values[0]
    field[1, lane] = values[1]
    field[2, lane] = values[2]
    field[3, lane] = values[3]
    field[4, lane] = values[4]


@formula
def set_symmetric(field: Array, lane: int, values: Symmetric) -> None:
    """Put a matrix into the lane of a field."""
    field[0, lane] = values.xx
    field[1, lane] = values.xy
    field[2, lane] = values.yy
    field[3, lane] = values.xz
    field[4, lane] = values.yz
    field[5, lane] = values.zz


@formula
def set_vector(field: Array, n: int, lane: int, values: Form) -> None:
    """Put one vector into the lane of a field of them."""
    field[n, 0, lane] = values[0]
    field[n, 1, lane] = values[1]
    field[n, 2, lane] = values[2]


@formula
def add_pair(field: Array, lane: int, values: Pair) -> None:
    """Add to the first two numbers that a lane has in a field."""
    field[0, lane] += values[0]
    field[1, lane] += values[1]


@formula
def add_triple(field: Array, lane: int, values: Vector) -> None:
    """Add to the three numbers that a lane has in a field."""
    field[0, lane] += values[0]
    field[1, lane] += values[1]
    field[2, lane] += values[2]


@formula
def keep_if(common: CommonLanes, lane: int, is_sound: bool) -> None:
    """Refuse a lane unless this holds."""
    common.is_sound[lane] = common.is_sound[lane] if is_sound else 0.0
