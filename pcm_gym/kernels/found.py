"""The equilibria that a search has found: each kept once, and twins across a fold looked for."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pcm_gym.kernels.closure import Workspace, evaluate_rods, set_inputs, solve_equilibrium_system
from pcm_gym.kernels.compilation import kernel
from pcm_gym.kernels.newton import CONVERGED, NewtonRules, correction_size, solve_forward_locally
from pcm_gym.kernels.stability import assess_stability

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

# Near a fold Newton's method halves the error at best, and the correction never falls below the noise.
POLISH_RULES = NewtonRules(first_correction=np.inf, contraction=1e3, iterations=40, residual=2e-15)
# States nearer than the first are one; states nearer than the second are one if they are of the same kind.
_SAME_STATE, _SAME_BRANCH = 1e-10, 1e-6
# A fold up to this far away, in the measure of `correction_size`, may have a partner beyond it; the step that tells;
# and where the partner is sought, in distances from the fold.
FARTHEST_FOLD, FOLD_PROBE = 0.2, 1e-4
FOLD_FACTORS = (2.0, 1.4, 3.0)


class Found(NamedTuple):
    """The equilibria found so far."""

    x: Array  # (m, size)
    inputs: Array  # (m, legs)
    kinds: Integers  # (m,): what differs on the two sides of a fold


@kernel
def keep(legs: Array, x: Array, inputs: Array, rho_max: float, kind: int, found: Found, count: int) -> int:
    """Add an equilibrium to those found if its loads are in range, there is room, and it is new; return their number.

    The platform's angle is brought into (-pi, pi]. Equilibria of different kind are two however near they are: they
    meet at a fold.
    """
    for leg in range(legs.shape[0]):
        if math.hypot(x[2 * leg], x[2 * leg + 1]) > rho_max * rho_max:
            return count
    if count == found.x.shape[0]:
        return count
    last, is_platform = x.shape[0] - 1, x.shape[0] - 2 * legs.shape[0] == 3
    if is_platform:
        x[last] = principal_angle(x[last])
    for n in range(count):
        turn = 0.0  # that brings the platform's angle to this side of its seam
        if is_platform:
            turn = 2.0 * math.pi * round((found.x[n, last] - x[last]) / (2.0 * math.pi))
        x[last] += turn
        gap = max(_gap(found.x[n], x), _gap(found.inputs[n], inputs))
        x[last] -= turn
        if gap < _SAME_STATE or (gap < _SAME_BRANCH and found.kinds[n] == kind):
            return count
    found.x[count], found.inputs[count], found.kinds[count] = x, inputs, kind
    return count + 1


@kernel
def forward_kind(legs: Array, x: Array, inputs: Array, work: Workspace) -> int:
    """Return what differs on the two sides of a fold at given inputs: the Morse index."""
    set_inputs(legs, inputs, work)
    evaluate_rods(legs, x, work)
    return assess_stability(legs, x, work).morse_index


@kernel
def _gap(first: Array, second: Array) -> float:
    gap = 0.0
    for j in range(first.shape[0]):
        gap = max(gap, abs(first[j] - second[j]) / (1.0 + abs(first[j])))
    return gap


@kernel
def principal_angle(angle: float) -> float:
    """Return the angle in (-pi, pi]."""
    turned = angle - 2.0 * math.pi * math.ceil((angle - math.pi) / (2.0 * math.pi))
    return math.pi if turned <= -math.pi else turned


@kernel
def fold_rules(distance: float) -> NewtonRules:
    """Return the rules of the search for a partner: steps short enough to stay on its side of the fold."""
    return NewtonRules(np.inf, 1e3, 60, 2e-15, 0.5 * abs(distance), np.inf)


@kernel
def look_across_fold(
    legs: Array, inputs: Array, load: Array, rho_max: float, n: int, work: Workspace, found: Found, count: int
) -> int:
    """Look for the partner of an equilibrium across a fold, as far beyond it as the equilibrium is before it.

    The way goes along the direction in which the mechanism is softest; where the fold is follows from how the
    softness changes on the way.
    """
    x = found.x[n].copy()
    set_inputs(legs, inputs, work)
    softness = _set_soft_step(legs, x, work)
    if not 0.0 < softness < math.inf:
        return count
    direction = work.step / softness
    probe = x + FOLD_PROBE * direction
    if not _set_soft_step(legs, probe, work) > 0.0:
        return count
    hardness = np.dot(direction, direction) / np.dot(direction, work.step)  # 1 / softness, with its sign
    distance = -FOLD_PROBE / (hardness * softness - 1.0)
    if not abs(distance) < FARTHEST_FOLD:
        return count
    for factor in FOLD_FACTORS:
        probe = x + factor * distance * direction
        if solve_forward_locally(legs, inputs, load, probe, fold_rules(distance), work) == CONVERGED:
            count = keep(legs, probe, inputs, rho_max, forward_kind(legs, probe, inputs, work), found, count)
    return count


@kernel
def _set_soft_step(legs: Array, x: Array, work: Workspace) -> float:
    """Fill `work.step` with the response to some forces, near a fold along its soft direction; return its size."""
    evaluate_rods(legs, x, work)
    for row in range(x.shape[0]):
        work.residual[row] = 1.0 / (1.0 + row)
    if not solve_equilibrium_system(legs, x, work.residual, work):
        return math.inf
    return correction_size(legs, x, work)
