"""The controller that knows nothing."""

import numpy as np

from pcm_gym.arrays import Array
from pcm_gym.references.view import View


class RandomController:
    """Uniformly random actions, drawn from each episode's own generator."""

    def act(self, view: View) -> Array:
        """Actions (n, actuators), uniform in [-1, 1]."""
        actions = np.zeros(view.action_shape)
        for row in view.rows:
            actions[row] = view.generators[row].uniform(-1.0, 1.0, actions.shape[1])
        return actions
