"""The controller that follows the exact Jacobian of the motion."""

import numpy as np

from pcm_gym.arrays import Array
from pcm_gym.references.view import View


class ResolvedRateController:
    """Straight towards the goal through the exact Jacobian of the motion; it knows nothing of stability.

    The increment of the inputs is the damped least-squares solution of ``J dq = goal - pose`` (Y. Nakamura and
    H. Hanafusa, 1986, J. Dyn. Sys. Meas. Control 108), shortened as a whole to the largest increment allowed. The pose
    is the observed one; the Jacobian is that of the true mechanism.

    Parameters
    ----------
    damping
        Damping in parts of the Jacobian's largest singular value.
    """

    def __init__(self, damping: float = 0.05) -> None:
        self._damping = damping

    def act(self, view: View) -> Array:
        """Actions (n, actuators) of one resolved-rate step each."""
        wanted = damped_solutions(view.jacobians, view.pose_errors, self._damping) / view.simulation.settings.stride
        return shortened(wanted)


def shortened(actions: Array) -> Array:
    """Return actions (n, legs), those beyond [-1, 1] shortened as a whole."""
    short: Array = actions / np.maximum(1.0, np.abs(actions).max(axis=1, keepdims=True))
    return short


def damped_solutions(jacobians: Array, errors: Array, damping: float) -> Array:
    """Damped least-squares solutions (n, legs) of ``jacobian x = error``; zero where a Jacobian is zero or not finite.

    Each singular value `s` is inverted as ``s / (s**2 + (damping * s_max)**2)``.

    Parameters
    ----------
    jacobians
        Array (n, d, legs).
    errors
        Array (n, d).
    damping
        In parts of each Jacobian's largest singular value.
    """
    solutions = np.zeros((len(jacobians), jacobians.shape[2]))
    usable = np.isfinite(jacobians).all(axis=(1, 2)) & jacobians.any(axis=(1, 2))
    left, values, right = np.linalg.svd(jacobians[usable], full_matrices=False)
    inverted = values / (values**2 + (damping * values[:, :1]) ** 2)
    components = inverted[:, :, None] * (left.mT @ errors[usable, :, None])
    solutions[usable] = (right.mT @ components)[:, :, 0]
    return solutions
