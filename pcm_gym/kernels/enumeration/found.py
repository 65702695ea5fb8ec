"""The equilibria that a search has found: each kept once, and twins across a fold looked for."""

import math
from typing import NamedTuple

import numpy as np

from pcm_gym.arrays import Array, Integers, Mask
from pcm_gym.kernels.numerics.compilation import kernel
from pcm_gym.kernels.numerics.linear import determinant, solve_linear
from pcm_gym.kernels.statics.closure import (
    TURN,
    Workspace,
    make_workspace,
    place,
    set_inverse_matrix,
    set_residual,
    solve_equilibrium_system,
)
from pcm_gym.kernels.statics.newton import (
    CONVERGED,
    SINGULAR,
    NewtonRules,
    correction_size,
    solve_forward_locally,
    solve_inverse_locally,
)
from pcm_gym.kernels.statics.stability import assess_stability

# Near a fold Newton's method halves the error at best, and the correction never falls below the noise.
POLISH_RULES = NewtonRules(first_correction=np.inf, contraction=1e3, iterations=40, residual=2e-15)
# States nearer than the first are one; states nearer than the second are one if they are of the same kind.
_SAME_STATE, _SAME_BRANCH = 1e-10, 1e-6
# Rounding of the residual, which makes a state uncertain by this times its softness; and the most that is taken for it.
# States on a family are soft beyond bounds: they are kept at this distance from each other.
_ROUNDING, _LARGEST_BLUR = 1e-14, 0.1
# A fold up to this far away, in the measure of `correction_size`, may have a partner beyond it; the step that tells;
# and where the partner is sought, in distances from the fold.
_FARTHEST_FOLD, _FOLD_PROBE = 0.2, 1e-4
_FOLD_FACTORS = (2.0, 1.4, 3.0)
# Equilibria whose partners are looked for in one call.
_PARTNERS_AT_ONCE = 64

# Long searches are made slice by slice: a place tells where the next one begins. Its first columns: what the last one
# has found, and what it has spent, in tests that take some tenths of a microsecond; about how much it may spend.
FOUND, SPENT = range(2)
SPENT_AT_ONCE = 1 << 17


class Found(NamedTuple):
    """The equilibria found so far, and what is asked of them."""

    rho_max: float  # the largest load of a rod
    is_inverse: bool  # whether their pose is given, and not their inputs
    x: Array  # (m, size)
    inputs: Array  # (m, legs)
    kinds: Integers  # (m,): what differs on the two sides of a fold
    softness: Array  # (m,): how far an error of 1 in the residual moves them; beyond bounds at folds and on families
    total: Integers  # (1,): how many there are

    def chosen(self, which: int | Mask) -> "Found":
        """Return the first so many of them, or those of a mask."""
        places = slice(which) if isinstance(which, int) else which
        return self._replace(
            x=self.x[places], inputs=self.inputs[places], kinds=self.kinds[places], softness=self.softness[places]
        )


def make_found(capacity: int, leg_count: int, size: int, rho_max: float, is_inverse: bool) -> Found:
    """Return room for so many equilibria."""
    return Found(
        rho_max,
        is_inverse,
        np.empty((capacity, size)),
        np.empty((capacity, leg_count)),
        np.empty(capacity, dtype=np.int64),
        np.empty(capacity),
        np.zeros(1, dtype=np.int64),
    )


@kernel
def _keep(legs: Array, x: Array, inputs: Array, kind: int, work: Workspace, found: Found) -> None:
    """Add an equilibrium to those found if its loads are in range, there is room, and it is new.

    The platform's angle is brought into (-pi, pi]. Equilibria of different kind are two however near they are, unless
    both may have been moved that far by rounding: they meet at a fold. Where there is no room the number found is left
    at the capacity, which tells that some may be missing.
    """
    for leg in range(legs.shape[0]):
        if math.hypot(x[2 * leg], x[2 * leg + 1]) > found.rho_max * found.rho_max:
            return
    count = found.total[0]
    if count == found.x.shape[0]:
        return
    if x.shape[0] - 2 * legs.shape[0] == 3:
        x[-1] = principal_angle(x[-1])
    for n in range(count):
        gap = _gap(legs, x, inputs, n, found)
        if gap < _SAME_STATE or (gap < _SAME_BRANCH and found.kinds[n] == kind):
            return
    softness = _set_soft_step(legs, x, inputs, found.is_inverse, work)
    for n in range(count):
        blur = _ROUNDING * min(softness, found.softness[n])
        if blur > _SAME_STATE and _gap(legs, x, inputs, n, found) < min(blur, _LARGEST_BLUR):
            return
    found.x[count], found.inputs[count], found.kinds[count], found.softness[count] = x, inputs, kind, softness
    found.total[0] = count + 1


@kernel
def correct_and_keep(
    legs: Array, x: Array, inputs: Array, load: Array, rules: NewtonRules, work: Workspace, found: Found
) -> None:
    """Correct `x` and, at a given pose, `inputs` to an equilibrium, and keep it."""
    if found.is_inverse:
        status = solve_inverse_locally(legs, inputs, load, x, rules, work)
    else:
        status = solve_forward_locally(legs, inputs, load, x, rules, work)
    if status == SINGULAR:  # on a family there may be nothing left to correct
        place(legs, x, inputs, work)
        status = CONVERGED if max(set_residual(legs, x, load, work)) < rules.residual else SINGULAR
    if status != CONVERGED:
        return
    if found.is_inverse:
        for leg in range(legs.shape[0]):
            if legs[leg, TURN] != 0.0:
                inputs[leg] = principal_angle(inputs[leg])
    _keep(legs, x, inputs, _kind(legs, x, inputs, found.is_inverse, work), work, found)


@kernel
def _kind(legs: Array, x: Array, inputs: Array, is_inverse: bool, work: Workspace) -> int:
    """Return what differs on the two sides of a fold: the Morse index, at a given pose also the side itself."""
    place(legs, x, inputs, work)
    index = assess_stability(legs, x, work).morse_index
    if not is_inverse:
        return index
    set_inverse_matrix(legs, x, work)
    return 2 * index + (1 if determinant(work.matrix, x.shape[0]) > 0.0 else 0)


@kernel
def _gap(legs: Array, x: Array, inputs: Array, n: int, found: Found) -> float:
    """Return how far a state is from the one found as number `n`; angles are compared across their seam."""
    gap, turn, last = 0.0, 0.0, x.shape[0] - 1
    if last == 2 * legs.shape[0] + 2:
        turn = 2.0 * math.pi * round((found.x[n, last] - x[last]) / (2.0 * math.pi))
        x[last] += turn
    for j in range(x.shape[0]):
        gap = max(gap, abs(found.x[n, j] - x[j]) / (1.0 + abs(found.x[n, j])))
    x[last] -= turn
    for leg in range(inputs.shape[0]):
        difference = found.inputs[n, leg] - inputs[leg]
        if legs[leg, TURN] != 0.0:
            difference -= 2.0 * math.pi * round(difference / (2.0 * math.pi))
        gap = max(gap, abs(difference) / (1.0 + abs(found.inputs[n, leg])))
    return gap


@kernel
def principal_angle(angle: float) -> float:
    """Return the angle in (-pi, pi]."""
    turned = angle - 2.0 * math.pi * math.ceil((angle - math.pi) / (2.0 * math.pi))
    return math.pi if turned <= -math.pi else turned


@kernel
def keep_partners(legs: Array, load: Array, first: int, found: Found) -> int:
    """Look for the partners across a fold of some equilibria, from `first` on; return which is the next.

    What is found has partners too: it is for the caller to go on until all have been asked about.
    """
    work = make_workspace(legs.shape[0], found.x.shape[1])
    last = min(first + _PARTNERS_AT_ONCE, found.total[0])
    for n in range(first, last):
        _look_across_fold(legs, load, n, work, found)
    return int(last)


@kernel
def correct_all(legs: Array, states: Array, inputs: Array, load: Array, found: Found) -> int:
    """Correct states (m, size) at inputs (m, legs) to equilibria, and keep the different ones; return their number."""
    work = make_workspace(legs.shape[0], states.shape[1])
    for n in range(states.shape[0]):
        correct_and_keep(legs, states[n].copy(), inputs[n].copy(), load, POLISH_RULES, work, found)
    return int(found.total[0])


@kernel
def _look_across_fold(legs: Array, load: Array, n: int, work: Workspace, found: Found) -> None:
    """Look for the partner of an equilibrium across a fold, as far beyond it as the equilibrium is before it.

    The way goes along the direction in which the mechanism is softest; where the fold is follows from how the
    softness changes on the way. Steps are short enough to stay on the partner's side of the fold.
    """
    is_inverse = found.is_inverse
    x, inputs = found.x[n].copy(), found.inputs[n].copy()
    softness = _set_soft_step(legs, x, inputs, is_inverse, work)
    if not 0.0 < softness < math.inf:
        return
    direction = work.vector[: x.shape[0]] / softness
    _move(x, inputs, _FOLD_PROBE, direction, is_inverse)
    if not _set_soft_step(legs, x, inputs, is_inverse, work) > 0.0:
        return
    # 1 / softness, with its sign
    hardness = np.dot(direction, direction) / np.dot(direction, work.vector[: x.shape[0]])
    distance = -_FOLD_PROBE / (hardness * softness - 1.0)
    if not abs(distance) < _FARTHEST_FOLD:
        return
    rules = NewtonRules(np.inf, 1e3, 60, 2e-15, 0.5 * abs(distance), np.inf)
    for factor in _FOLD_FACTORS:
        x[:], inputs[:] = found.x[n], found.inputs[n]
        _move(x, inputs, factor * distance, direction, is_inverse)
        correct_and_keep(legs, x, inputs, load, rules, work, found)


@kernel
def _move(x: Array, inputs: Array, distance: float, direction: Array, is_inverse: bool) -> None:
    """Add a distance along a direction to the unknowns: the rods and the pose, or the rods and the inputs."""
    given = x.shape[0] - inputs.shape[0] if is_inverse else x.shape[0]
    x[:given] += distance * direction[:given]
    if is_inverse:
        inputs += distance * direction[given:]


@kernel
def _set_soft_step(legs: Array, x: Array, inputs: Array, is_inverse: bool, work: Workspace) -> float:
    """Fill `work.vector` with the response to some errors, near a fold along its soft direction; return its size."""
    size, pose = x.shape[0], 2 * legs.shape[0]
    place(legs, x, inputs, work)
    for row in range(size):
        work.residual[row] = 1.0 / (1.0 + row)
    if not is_inverse:
        if not solve_equilibrium_system(legs, x, work.residual, work):
            return math.inf
        work.vector[:size] = work.step
        return correction_size(legs, x, work)
    set_inverse_matrix(legs, x, work)
    work.vector[:size] = work.residual
    if not solve_linear(work.matrix, work.vector, size):
        return math.inf
    work.step[:pose], work.step[pose:] = work.vector[:pose], 0.0
    largest = correction_size(legs, x, work)
    for i in range(pose, size):
        largest = max(largest, abs(work.vector[i]))
    return largest
