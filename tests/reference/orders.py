"""Orders of convergence, fitted."""

from collections.abc import Callable

import numpy as np

from pcm_gym.arrays import Array


def fitted_order(steps: Array, errors: Array) -> float:
    """Return the slope of log(error) over log(step)."""
    slope, _ = np.polyfit(np.log(steps), np.log(errors), 1)
    return float(slope)


def central_difference_order(
    function: Callable[[Array], Array], at: Array, direction: Array, derivative: Array, steps: Array
) -> tuple[float, float]:
    """Return the order with which central differences approach `derivative`, and the least relative error on the way.

    The steps must be large enough for truncation to exceed rounding: then the order is 2 if the derivative is right,
    and 0 if it is not, however close.
    """
    scale = np.linalg.norm(derivative)
    errors = []
    for step in steps:
        difference = (function(at + step * direction) - function(at - step * direction)) / (2.0 * step)
        errors.append(np.linalg.norm(difference - derivative) / scale)
    return fitted_order(steps, np.array(errors)), float(np.min(errors))
