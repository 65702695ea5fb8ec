"""Every equilibrium at given inputs: a search over the end-effector's pose.

At a pose every hinge is at a known place, and each rod's force is known but for its sheet (see `sheets`). So the poses
are cut into cells; over a cell each leg offers a few affine forces; a combination of one offer per leg, for which the
forces on the end-effector may balance somewhere in the cell, gives a start for Newton's method. Closure is not among
the equations, which leaves two or three instead of four or six.

A point end-effector is treated as a platform that has no arms and cannot turn, with a third leg that offers no force.
"""

import math
from typing import NamedTuple

import numpy as np

from pcm_gym.arrays import Array, Integers
from pcm_gym.kernels.enumeration.cells import grid_load
from pcm_gym.kernels.enumeration.found import FOUND, SPENT, SPENT_AT_ONCE, Found, correct_and_keep
from pcm_gym.kernels.enumeration.sheets import (
    ERROR_RADIUS,
    ERROR_X,
    ERROR_Y,
    FORCE_X,
    FORCE_Y,
    GRADE_CELL,
    GRADE_HIGH,
    GRADE_LOW,
    RHO_CELL,
    RHO_HIGH,
    RHO_LOW,
    SIDE,
    X_HIGH,
    X_LOW,
    Y_HIGH,
    Y_LOW,
    Sheets,
)
from pcm_gym.kernels.numerics.compilation import kernel
from pcm_gym.kernels.statics.closure import ATTACH_X, ATTACH_Y, LENGTH, STIFFNESS, make_workspace, set_inputs
from pcm_gym.kernels.statics.newton import NewtonRules

# Columns of an offer, world frame: the force at the centre of the pose cell, its slopes by the hinge's position, its
# error (segment and radius), how far it may be from that at the centre; the hinge's arm; and, to start from it, the
# patch and the tip from the patch's node, clamp's frame.
_FORCE_X, _FORCE_Y, _XX, _XY, _YX, _YY, _SEGMENT_X, _SEGMENT_Y, _RADIUS, _SPREAD_X, _SPREAD_Y = range(11)
_ARM_X, _ARM_Y, _PATCH, _TIP_X, _TIP_Y = range(11, 16)
_OFFER_COLUMNS = 16

# Columns of a leg's frame: place and direction of its clamp, as in the workspace; its hinge from the end-effector's
# origin, at the angle of the pose cell.
_CLAMP_X, _CLAMP_Y, _CLAMP_COS, _CLAMP_SIN, _HINGE_X, _HINGE_Y = range(6)
_FRAME_COLUMNS = 6

# Rows of the balance of a combination: what the unit of each pose coordinate and of each leg's error does to the forces
# and the moment; the unbalanced rest at the centre, and the pose that balances it.
_MOVES, _SEGMENTS, _REST, _ANSWER = 0, 3, 6, 7
_BALANCE_ROWS = 8

# Of the room in a patch's square, this part is for the pose cell's width and the rest for its turn.
_WIDTH_PART = 0.6
# Starts are this far inside the block of a patch, in cells of the rod's grid: its edge may be a straight rod.
_INSIDE = 0.3
# Rods whose reaches miss each other by no more than this part of a pose cell may touch.
_TOUCHING = 1e-9
# Half a pose cell's turn, at most, in rad.
_LARGEST_HALF_TURN = 0.2
# Starts are within a pose cell of their solution; what leads Newton's method farther away than this, in lengths of the
# shortest rod, starts near it elsewhere. Longer corrections are shortened to it.
_REACH = 0.2
# Columns of a place beside those of every search: the angle, the pose cell, and the pair of offers.
_TURN, _CELL, _PAIR = range(2, 5)
# So many combinations whose forces are far apart take as long as one that is looked at more closely.
_CHEAP_TESTS = 64


class _PoseCells(NamedTuple):
    """Cells that cover all poses at which every leg may reach its hinge."""

    low_x: float
    low_y: float
    half_width: float
    half_turn: float
    columns: int
    rows: int
    turns: int


class _Search(NamedTuple):
    """Where the legs are, and the pose cell that is looked at."""

    legs: Array  # (legs, 12)
    frames: Array  # (legs, 6)
    pose: Array  # (3,): the centre of the cell
    poses: _PoseCells
    sheets: Sheets


@kernel
def _cover_poses(legs: Array, clamps: Array, sheets: Sheets) -> _PoseCells:
    room, longest_arm = math.inf, 0.0
    low_x = low_y = -math.inf
    high_x = high_y = math.inf
    for leg in range(legs.shape[0]):
        room = min(room, (sheets.half_width - 0.5 * sheets.spacing) * legs[leg, LENGTH])
        arm = math.hypot(legs[leg, ATTACH_X], legs[leg, ATTACH_Y])
        longest_arm = max(longest_arm, arm)
        reach = legs[leg, LENGTH] + arm
        low_x, high_x = max(low_x, clamps[leg, 0] - reach), min(high_x, clamps[leg, 0] + reach)
        low_y, high_y = max(low_y, clamps[leg, 1] - reach), min(high_y, clamps[leg, 1] + reach)
    turns, half_turn, part = 1, 0.0, 1.0
    if legs.shape[0] == 3:
        part = _WIDTH_PART
        # half a turn moves a hinge by less than arm (half_turn + half_turn^2 / 2)
        widest = min(_LARGEST_HALF_TURN, (1.0 - part) * room / ((1.0 + 0.5 * _LARGEST_HALF_TURN) * longest_arm))
        turns = math.ceil(math.pi / widest)
        half_turn = math.pi / turns
    half_width = part * room / math.sqrt(2.0)
    columns, rows = _cells_across(high_x - low_x, half_width), _cells_across(high_y - low_y, half_width)
    return _PoseCells(low_x, low_y, half_width, half_turn, columns, rows, turns)


@kernel
def _cells_across(span: float, half_width: float) -> int:
    """Return how many cells cover this span; one if rods that just reach each other leave none but rounding."""
    if span < -_TOUCHING * half_width:
        return 0
    return max(1, math.ceil(0.5 * span / half_width))


@kernel
def _set_hinges(legs: Array, phi: float, frames: Array) -> None:
    """Fill in where the hinges are from the end-effector's origin, at an angle of the platform."""
    c, s = math.cos(phi), math.sin(phi)
    for leg in range(legs.shape[0]):
        frames[leg, _HINGE_X] = c * legs[leg, ATTACH_X] - s * legs[leg, ATTACH_Y]
        frames[leg, _HINGE_Y] = s * legs[leg, ATTACH_X] + c * legs[leg, ATTACH_Y]


@kernel
def _set_offers(
    legs: Array, leg: int, frames: Array, pose: Array, poses: _PoseCells, sheets: Sheets, offers: Array
) -> int:
    """Fill `offers` (legs, m, 16) of a leg over the cell around a pose; return their number."""
    length, clamp_c, clamp_s = legs[leg, LENGTH], frames[leg, _CLAMP_COS], frames[leg, _CLAMP_SIN]
    arm_x, arm_y = frames[leg, _HINGE_X], frames[leg, _HINGE_Y]
    away_x = (pose[0] + arm_x - frames[leg, _CLAMP_X]) / length
    away_y = (pose[1] + arm_y - frames[leg, _CLAMP_Y]) / length
    tip_x, tip_y = clamp_c * away_x + clamp_s * away_y, clamp_c * away_y - clamp_s * away_x
    column, row = round(tip_x / sheets.spacing), round(tip_y / sheets.spacing)
    if max(abs(column), abs(row)) > sheets.extent:
        return 0
    tip_x -= column * sheets.spacing
    tip_y -= row * sheets.spacing
    half, half_turn = poses.half_width, poses.half_turn
    swing_x, swing_y = (clamp_s * arm_x - clamp_c * arm_y) / length, (clamp_c * arm_x + clamp_s * arm_y) / length
    around = (abs(clamp_c) + abs(clamp_s)) * half / length
    around += 0.5 * half_turn * half_turn * math.hypot(arm_x, arm_y) / length
    around_x, around_y = around + abs(swing_x) * half_turn, around + abs(swing_y) * half_turn
    force_unit = legs[leg, STIFFNESS] / (length * length)
    square = (column + sheets.extent) * (2 * sheets.extent + 1) + row + sheets.extent
    patches = sheets.patches
    count = 0
    for n in range(sheets.offsets[square], sheets.offsets[square + 1]):
        if tip_x + around_x < patches[n, X_LOW] or tip_x - around_x > patches[n, X_HIGH]:
            continue
        if tip_y + around_y < patches[n, Y_LOW] or tip_y - around_y > patches[n, Y_HIGH]:
            continue
        out = offers[leg, count]
        _set_turned_force(patches[n], (tip_x, tip_y), (clamp_c, clamp_s), (force_unit, force_unit / length), out)
        by_turn_x, by_turn_y = out[_XY] * arm_x - out[_XX] * arm_y, out[_YY] * arm_x - out[_YX] * arm_y
        out[_SPREAD_X] = (abs(out[_XX]) + abs(out[_XY])) * half + abs(by_turn_x) * half_turn
        out[_SPREAD_Y] = (abs(out[_YX]) + abs(out[_YY])) * half + abs(by_turn_y) * half_turn
        out[_SPREAD_X] += abs(out[_SEGMENT_X]) + out[_RADIUS]
        out[_SPREAD_Y] += abs(out[_SEGMENT_Y]) + out[_RADIUS]
        out[_ARM_X], out[_ARM_Y], out[_PATCH], out[_TIP_X], out[_TIP_Y] = arm_x, arm_y, n, tip_x, tip_y
        count += 1
    return count


@kernel
def _set_turned_force(
    patch: Array, tip: tuple[float, float], turn: tuple[float, float], units: tuple[float, float], out: Array
) -> None:
    """Fill force, slopes and error of an offer: those of the patch, turned from the clamp's frame into the world's.

    `turn` is cosine and sine of the clamp's angle, `units` those of force and slope.
    """
    (tip_x, tip_y), (c, s), (force_unit, slope_unit) = tip, turn, units
    force_x = force_unit * (patch[FORCE_X] + patch[FORCE_X + 1] * tip_x + patch[FORCE_X + 2] * tip_y)
    force_y = force_unit * (patch[FORCE_Y] + patch[FORCE_Y + 1] * tip_x + patch[FORCE_Y + 2] * tip_y)
    out[_FORCE_X], out[_FORCE_Y] = c * force_x - s * force_y, s * force_x + c * force_y
    x_x, x_y = c * patch[FORCE_X + 1] - s * patch[FORCE_Y + 1], c * patch[FORCE_X + 2] - s * patch[FORCE_Y + 2]
    y_x, y_y = s * patch[FORCE_X + 1] + c * patch[FORCE_Y + 1], s * patch[FORCE_X + 2] + c * patch[FORCE_Y + 2]
    out[_XX], out[_XY] = slope_unit * (x_x * c - x_y * s), slope_unit * (x_x * s + x_y * c)
    out[_YX], out[_YY] = slope_unit * (y_x * c - y_y * s), slope_unit * (y_x * s + y_y * c)
    out[_SEGMENT_X] = force_unit * (c * patch[ERROR_X] - s * patch[ERROR_Y])
    out[_SEGMENT_Y] = force_unit * (s * patch[ERROR_X] + c * patch[ERROR_Y])
    out[_RADIUS] = force_unit * patch[ERROR_RADIUS]


@kernel
def _may_balance(offers: Array, i: int, j: int, k: int, poses: _PoseCells, load: Array, balance: Array) -> bool:
    """Return whether these offers, one of each leg, may balance the load somewhere in the pose cell.

    What forces and moment can be in the cell is a zonotope: the sum of the segments that the pose and the errors move
    them along. It is separated from zero by a plane along two of the segments, or not at all.
    """
    radius, moment_error = _set_balance(offers, i, j, k, poses, load, balance)
    rest_x, rest_y, rest_z = balance[_REST, 0], balance[_REST, 1], balance[_REST, 2]
    for a in range(_REST):
        for b in range(a):
            x = balance[a, 1] * balance[b, 2] - balance[a, 2] * balance[b, 1]
            y = balance[a, 2] * balance[b, 0] - balance[a, 0] * balance[b, 2]
            z = balance[a, 0] * balance[b, 1] - balance[a, 1] * balance[b, 0]
            reach = radius * math.sqrt(x * x + y * y) + moment_error * abs(z)
            for g in range(_REST):
                reach += abs(x * balance[g, 0] + y * balance[g, 1] + z * balance[g, 2])
            # the two segments themselves come out as rounding errors
            if abs(x * rest_x + y * rest_y + z * rest_z) > reach * (1.0 + 1e-9):
                return False
    return True


@kernel
def _set_balance(
    offers: Array, i: int, j: int, k: int, poses: _PoseCells, load: Array, balance: Array
) -> tuple[float, float]:
    """Fill segments and rest of the balance; return the errors beside the segments, of the force and of the moment."""
    half, half_turn = poses.half_width, poses.half_turn
    xx = xy = xz = yx = yy = yz = zx = zy = zz = 0.0
    rest_x, rest_y, rest_z = -load[0], -load[1], -load[2]
    radius = moment_error = 0.0
    for leg in range(3):
        n = (i, j, k)[leg]
        arm_x, arm_y = offers[leg, n, _ARM_X], offers[leg, n, _ARM_Y]
        force_x, force_y = offers[leg, n, _FORCE_X], offers[leg, n, _FORCE_Y]
        own_xx, own_xy, own_yx, own_yy = (
            offers[leg, n, _XX],
            offers[leg, n, _XY],
            offers[leg, n, _YX],
            offers[leg, n, _YY],
        )
        turn_x, turn_y = own_xy * arm_x - own_xx * arm_y, own_yy * arm_x - own_yx * arm_y
        rest_x += force_x
        rest_y += force_y
        rest_z += arm_x * force_y - arm_y * force_x
        xx += own_xx
        xy += own_yx
        xz += arm_x * own_yx - arm_y * own_xx
        yx += own_xy
        yy += own_yy
        yz += arm_x * own_yy - arm_y * own_xy
        zx += turn_x
        zy += turn_y
        zz += arm_x * turn_y - arm_y * turn_x - arm_x * force_x - arm_y * force_y
        segment_x, segment_y = offers[leg, n, _SEGMENT_X], offers[leg, n, _SEGMENT_Y]
        balance[_SEGMENTS + leg, 0], balance[_SEGMENTS + leg, 1] = segment_x, segment_y
        balance[_SEGMENTS + leg, 2] = arm_x * segment_y - arm_y * segment_x
        radius += offers[leg, n, _RADIUS]
        arm = abs(arm_x) + abs(arm_y)
        moment_error += arm * offers[leg, n, _RADIUS]
        # the arms turn while the forces change: second order
        moment_error += arm * half_turn * (offers[leg, n, _SPREAD_X] + offers[leg, n, _SPREAD_Y])
        moment_error += 0.5 * arm * half_turn * half_turn * (abs(force_x) + abs(force_y))
    balance[_MOVES, 0], balance[_MOVES, 1], balance[_MOVES, 2] = half * xx, half * xy, half * xz
    balance[_MOVES + 1, 0], balance[_MOVES + 1, 1], balance[_MOVES + 1, 2] = half * yx, half * yy, half * yz
    balance[_MOVES + 2, 0], balance[_MOVES + 2, 1] = half_turn * zx, half_turn * zy
    # a point end-effector, which cannot turn, is given a turn of its own
    balance[_MOVES + 2, 2] = half_turn * zz if half_turn > 0.0 else 1.0
    balance[_REST, 0], balance[_REST, 1], balance[_REST, 2] = rest_x, rest_y, rest_z
    return radius, moment_error


@kernel
def _triple_product(balance: Array, first: int, second: int, third: int) -> float:
    return float(
        balance[first, 0] * (balance[second, 1] * balance[third, 2] - balance[second, 2] * balance[third, 1])
        + balance[first, 1] * (balance[second, 2] * balance[third, 0] - balance[second, 0] * balance[third, 2])
        + balance[first, 2] * (balance[second, 0] * balance[third, 1] - balance[second, 1] * balance[third, 0])
    )


@kernel
def _set_answer(balance: Array) -> None:
    """Fill in where in the pose cell, in [-1, 1] each way, the affine forces balance, or are nearest to it."""
    whole = _triple_product(balance, _MOVES, _MOVES + 1, _MOVES + 2)
    for d in range(3):
        first, second = _MOVES + (d + 1) % 3, _MOVES + (d + 2) % 3
        part = -_triple_product(balance, _REST, first, second)
        balance[_ANSWER, d] = min(max(part / whole, -1.0), 1.0) if whole != 0.0 else 0.0


@kernel
def _set_start(search: _Search, offers: Array, i: int, j: int, k: int, answer: Array, start: Array) -> None:
    """Fill `start` (size,) with the rods of these offers and the pose, at the answer (3,) of their balance."""
    legs, frames, pose, poses, sheets = search
    leg_count, patches = legs.shape[0], sheets.patches
    move_x, move_y, turn = poses.half_width * answer[0], poses.half_width * answer[1], poses.half_turn * answer[2]
    for leg in range(leg_count):
        offer = offers[leg, (i, j, k)[leg]]
        n, length, c, s = int(offer[_PATCH]), legs[leg, LENGTH], frames[leg, _CLAMP_COS], frames[leg, _CLAMP_SIN]
        hinge_x, hinge_y = (move_x - turn * offer[_ARM_Y]) / length, (move_y + turn * offer[_ARM_X]) / length
        tip_x = min(max(offer[_TIP_X] + c * hinge_x + s * hinge_y, patches[n, X_LOW]), patches[n, X_HIGH])
        tip_y = min(max(offer[_TIP_Y] + c * hinge_y - s * hinge_x, patches[n, Y_LOW]), patches[n, Y_HIGH])
        row = patches[n, RHO_CELL] + patches[n, RHO_CELL + 1] * tip_x + patches[n, RHO_CELL + 2] * tip_y
        column = patches[n, GRADE_CELL] + patches[n, GRADE_CELL + 1] * tip_x + patches[n, GRADE_CELL + 2] * tip_y
        row = min(max(row, patches[n, RHO_LOW] + _INSIDE), patches[n, RHO_HIGH] - _INSIDE)
        column = min(max(column, patches[n, GRADE_LOW] + _INSIDE), patches[n, GRADE_HIGH] - _INSIDE)
        rho, grade = sheets.rho_max * row / sheets.size, column / sheets.size
        start[2 * leg], start[2 * leg + 1] = grid_load(rho, grade, int(patches[n, SIDE]))
    start[2 * leg_count], start[2 * leg_count + 1] = pose[0] + move_x, pose[1] + move_y
    if leg_count == 3:
        start[2 * leg_count + 2] = pose[2] + turn


@kernel
def _combine_offers(
    search: _Search,
    counts: Integers,
    offers: Array,
    load: Array,
    balance: Array,
    starts: Array,
    place: Integers,
) -> bool:
    """Add a start to `starts` for each combination of offers that may balance.

    Goes on with the pair of offers of the first two legs that `place` tells; returns whether that was all of them, or
    the call is to end first.
    """
    found, spent = place[FOUND], place[SPENT]
    for pair in range(place[_PAIR], counts[0] * counts[1]):
        if found + counts[2] > starts.shape[0] or spent >= SPENT_AT_ONCE:
            place[FOUND], place[SPENT], place[_PAIR] = found, spent, pair
            return False
        spent += 1 + counts[2] // _CHEAP_TESTS
        i, j = pair // counts[1], pair % counts[1]
        force_x = offers[0, i, _FORCE_X] + offers[1, j, _FORCE_X] - load[0]
        force_y = offers[0, i, _FORCE_Y] + offers[1, j, _FORCE_Y] - load[1]
        spread_x = offers[0, i, _SPREAD_X] + offers[1, j, _SPREAD_X]
        spread_y = offers[0, i, _SPREAD_Y] + offers[1, j, _SPREAD_Y]
        for k in range(counts[2]):
            if abs(force_x + offers[2, k, _FORCE_X]) > spread_x + offers[2, k, _SPREAD_X]:
                continue
            if abs(force_y + offers[2, k, _FORCE_Y]) > spread_y + offers[2, k, _SPREAD_Y]:
                continue
            spent += 1
            if not _may_balance(offers, i, j, k, search.poses, load, balance):
                continue
            _set_answer(balance)
            _set_start(search, offers, i, j, k, balance[_ANSWER], starts[found])
            found += 1
    place[FOUND], place[SPENT], place[_PAIR] = found, spent, 0
    return True


@kernel
def _cells_within(low: float, half_width: float, count: int, least: float, largest: float) -> tuple[int, int]:
    """Return the first of `count` cells along an axis whose centre is within these bounds, and the one after the last.

    With one more at each end, for rounding.
    """
    first = math.floor(0.5 * ((least - low) / half_width - 1.0))
    last = math.ceil(0.5 * ((largest - low) / half_width - 1.0)) + 1
    return min(max(first, 0), count), min(max(last, 0), count)


@kernel
def _cells_in_reach(search: _Search) -> tuple[int, int, int, int]:
    """Return the first column and row of pose cells at the present angle that all legs may reach, and their ends."""
    legs, frames, poses, sheets = search.legs, search.frames, search.poses, search.sheets
    low_x = low_y = -math.inf
    high_x = high_y = math.inf
    for leg in range(legs.shape[0]):
        x, y = frames[leg, _CLAMP_X] - frames[leg, _HINGE_X], frames[leg, _CLAMP_Y] - frames[leg, _HINGE_Y]
        # the corner of the lattice, which is turned with the clamp
        reach = math.sqrt(2.0) * (sheets.extent + 0.5) * sheets.spacing * legs[leg, LENGTH]
        low_x, high_x = max(low_x, x - reach), min(high_x, x + reach)
        low_y, high_y = max(low_y, y - reach), min(high_y, y + reach)
    first_column, last_column = _cells_within(poses.low_x, poses.half_width, poses.columns, low_x, high_x)
    first_row, last_row = _cells_within(poses.low_y, poses.half_width, poses.rows, low_y, high_y)
    return first_column, last_column, first_row, last_row


@kernel
def find_starts(legs: Array, inputs: Array, load: Array, sheets: Sheets, place: Integers, starts: Array) -> bool:
    """Fill `starts` (m, size) with states near which there may be an equilibrium; return whether more are to come.

    A call does a slice of the work. It begins where the one before has left `place` (5,), all zero at first, and leaves
    there how many it has found, and how much it has spent. There must be room for as many starts as the largest number
    of patches of a square.
    """
    leg_count, dof = legs.shape[0], load.shape[0]
    work = make_workspace(leg_count, starts.shape[1])
    set_inputs(legs, inputs, work)
    poses = _cover_poses(legs, work.clamps, sheets)
    frames = np.empty((leg_count, _FRAME_COLUMNS))
    frames[:, :_HINGE_X] = work.clamps
    whole_load, pose = np.zeros(3), np.zeros(3)
    whole_load[:dof] = load
    most = np.diff(sheets.offsets).max()
    offers, counts = np.zeros((3, most, _OFFER_COLUMNS)), np.ones(3, dtype=np.int64)
    balance = np.zeros((_BALANCE_ROWS, 3))
    search = _Search(legs, frames, pose, poses, sheets)
    place[FOUND] = place[SPENT] = 0
    for turn in range(place[_TURN], poses.turns):
        place[SPENT] += 1
        pose[2] = -math.pi + (2 * turn + 1) * poses.half_turn if dof == 3 else 0.0
        _set_hinges(legs, pose[2], frames)
        first_column, last_column, first_row, last_row = _cells_in_reach(search)
        rows = last_row - first_row
        for cell in range(place[_CELL], (last_column - first_column) * rows):
            place[SPENT] += 1
            pose[0] = poses.low_x + (2 * (first_column + cell // rows) + 1) * poses.half_width
            pose[1] = poses.low_y + (2 * (first_row + cell % rows) + 1) * poses.half_width
            for leg in range(leg_count):
                counts[leg] = _set_offers(legs, leg, frames, pose, poses, sheets, offers)
                if counts[leg] == 0:
                    break
            is_done = counts.min() == 0 or _combine_offers(search, counts, offers, whole_load, balance, starts, place)
            if not is_done or place[SPENT] >= SPENT_AT_ONCE:
                place[_TURN], place[_CELL] = turn, cell + is_done
                return True
        place[_CELL] = 0
        if place[SPENT] >= SPENT_AT_ONCE:
            place[_TURN] = turn + 1
            return True
    return False


@kernel
def polish_starts(legs: Array, inputs: Array, load: Array, sheets: Sheets, starts: Array, found: Found) -> None:
    """Correct the starts to equilibria; put the different ones into `found`."""
    work = make_workspace(legs.shape[0], found.x.shape[1])
    # pose cells are as small as the shortest rod wants them
    reach = _REACH * min(1.0, legs[:, LENGTH].min())
    rules = NewtonRules(math.inf, 1e3, 40, 2e-15, _REACH, reach)
    for start in starts:
        correct_and_keep(legs, start, inputs, load, rules, work, found)
