"""The states of proved equilibria: what Newton's method makes of a box, and bounds of how far states are from the true.

`krawczyk` proves that a box of loads holds one equilibrium; here the rest follows from its loads, pose and inputs.
"""

import math

from pcm_gym.arrays import Array, Integers
from pcm_gym.kernels.enumeration.cells import reaching_input
from pcm_gym.kernels.enumeration.found import POLISH_RULES
from pcm_gym.kernels.numerics.compilation import kernel
from pcm_gym.kernels.proofs.krawczyk import POLAR, Proved, make_krawczyk
from pcm_gym.kernels.proofs.rod_cells import (
    ACROSS,
    ALONG,
    B_HALF,
    CENTER,
    PLACED,
    REMAINDER,
    RHO,
    RHO_HALF,
    SLACK,
    SPREAD,
    B,
    Frames,
    set_contribution,
    set_unit_models,
)
from pcm_gym.kernels.rods.rod import rod
from pcm_gym.kernels.statics.closure import (
    BASE_X,
    BASE_Y,
    CLAMP_ANGLE,
    LENGTH,
    TIP_X,
    TURN,
    evaluate_rods,
    make_workspace,
    set_inputs,
)
from pcm_gym.kernels.statics.newton import CONVERGED, solve_forward_locally, solve_inverse_locally


@kernel
def bound_state_errors(frames: Frames, proved: Proved, numbers: Integers, states: Array, errors: Array) -> None:
    """Bound how far states (m, 6) are from the equilibria in the boxes with these numbers, at given inputs.

    In `errors` (m,): the largest difference of a component, relative to 1 + its size.
    """
    work = make_krawczyk()
    for m in range(numbers.shape[0]):
        errors[m] = _bound_load_errors(proved, numbers[m], states[m], work.box)
        _enclose_loads(proved, numbers[m], 0, work.box)
        set_unit_models(work.box, PLACED, work.models)
        set_contribution(frames, 0, work.models, work.parts[0])
        for d in range(2):  # the tip of the first leg
            tip = work.parts[0, 2 + d]
            errors[m] = max(errors[m], _relative_error(states[m, 4 + d], tip[CENTER], tip[SPREAD]))


@kernel
def bound_inverse_errors(
    legs: Array, pose: Array, proved: Proved, numbers: Integers, states: Array, inputs: Array, errors: Array
) -> None:
    """Do what `bound_state_errors` does for states and inputs (m, 2) at a given pose; angles up to full turns."""
    work = make_krawczyk()
    for m in range(numbers.shape[0]):
        errors[m] = _bound_load_errors(proved, numbers[m], states[m], work.box)
        for d in range(2):
            errors[m] = max(errors[m], _relative_error(states[m, 4 + d], pose[d], 0.0))
        for leg in range(2):
            _enclose_loads(proved, numbers[m], leg, work.box)
            set_unit_models(work.box, PLACED, work.models)
            x, x_reach = _center_and_spread(work.models[2])
            y, y_reach = _center_and_spread(work.models[3])
            own, reach, value = reaching_input(legs, leg, pose[0], pose[1], x, y), x_reach + y_reach, inputs[m, leg]
            if legs[leg, TURN] != 0.0:
                size = math.hypot(x, y)
                reach = math.asin(reach / size) if reach < size else math.inf
                value -= 2.0 * math.pi * math.floor((value - own) / (2.0 * math.pi) + 0.5)
            else:
                reach *= legs[leg, LENGTH]
            data = abs(legs[leg, CLAMP_ANGLE]) + abs(legs[leg, BASE_X]) + abs(legs[leg, BASE_Y]) + legs[leg, LENGTH]
            reach += 10.0 * SLACK * (1.0 + data + abs(pose[0]) + abs(pose[1]) + abs(value))
            errors[m] = max(errors[m], _relative_error(value, own, reach))


@kernel
def _center_and_spread(model: Array) -> tuple[float, float]:
    return model[CENTER], abs(model[ALONG]) + abs(model[ACROSS]) + model[REMAINDER]


@kernel
def _relative_error(value: float, own: float, reach: float) -> float:
    """Bound how far a value is from one that is within `reach` of `own`, relative to 1 + its size; inf for nan."""
    error = (abs(value - own) + reach) / (1.0 + abs(value)) * (1.0 + SLACK)
    return error if error >= 0.0 else math.inf


@kernel
def _bound_load_errors(proved: Proved, n: int, state: Array, box: Array) -> float:
    """Bound how far the loads of a state are from those of a proved equilibrium, relative to 1 + their size."""
    largest = 0.0
    for leg in range(2):
        _enclose_loads(proved, n, leg, box)
        load = box[RHO] * box[RHO]
        reach = (2.0 * box[RHO] + box[RHO_HALF]) * box[RHO_HALF]
        reach = (reach + (load + reach) * box[B_HALF]) * (1.0 + SLACK) + SLACK * load
        largest = max(largest, _relative_error(state[2 * leg], load * math.cos(box[B]), reach))
        largest = max(largest, _relative_error(state[2 * leg + 1], -load * math.sin(box[B]), reach))
    return largest


@kernel
def _enclose_loads(proved: Proved, n: int, leg: int, box: Array) -> None:
    """Fill in a box of polar loads in which a rod's load is at a proved equilibrium."""
    first, second = 2 * leg, 2 * leg + 1
    center, error = proved.center[n], proved.error[n]
    box[RHO], box[RHO_HALF], box[B], box[B_HALF] = center[first], error[first], center[second], error[second]
    if proved.charts[n, leg] == POLAR:
        return
    load, reach = math.hypot(center[first], center[second]), math.hypot(error[first], error[second])
    rho = math.sqrt(load)
    box[RHO], box[B] = rho, math.atan2(-center[second], center[first])
    box[RHO_HALF] = max(math.sqrt(load + reach) - rho, rho - math.sqrt(max(load - reach, 0.0))) + SLACK * (1.0 + rho)
    box[B_HALF] = math.pi if reach >= load else math.asin(reach / load) + SLACK


@kernel
def set_state(legs: Array, inputs: Array, load: Array, z: Array, x: Array) -> bool:
    """Put the equilibrium near the polar loads z into the state x (6,); return whether Newton's method converged."""
    work = make_workspace(2, 6)
    _set_loads(z, x)
    set_inputs(legs, inputs, work)
    x[4:] = 0.0
    evaluate_rods(legs, x, work)
    for d in range(2):  # between the tips of the two rods
        x[4 + d] = 0.5 * (work.clamps[0, d] + work.rods[0, TIP_X + d] + work.clamps[1, d] + work.rods[1, TIP_X + d])
    return solve_forward_locally(legs, inputs, load, x, POLISH_RULES, work) == CONVERGED


@kernel
def set_inverse_state(legs: Array, pose: Array, load: Array, z: Array, x: Array, inputs: Array) -> bool:
    """Put the equilibrium at a pose near the polar loads z into the state x (6,) and the inputs (2,); as `set_state`.

    Angles are brought into (-pi, pi].
    """
    _set_loads(z, x)
    x[4:] = pose
    for leg in range(2):
        point = rod(x[2 * leg], x[2 * leg + 1])
        inputs[leg] = reaching_input(legs, leg, pose[0], pose[1], point.tip_x, point.tip_y)
    is_found = solve_inverse_locally(legs, inputs, load, x, POLISH_RULES, make_workspace(2, 6)) == CONVERGED
    for leg in range(2):
        if legs[leg, TURN] != 0.0:
            inputs[leg] += 2.0 * math.pi * math.floor(0.5 - inputs[leg] / (2.0 * math.pi))
    return is_found


@kernel
def _set_loads(z: Array, x: Array) -> None:
    for leg in range(2):
        rho, b = z[2 * leg], z[2 * leg + 1]
        x[2 * leg], x[2 * leg + 1] = rho * rho * math.cos(b), -rho * rho * math.sin(b)
