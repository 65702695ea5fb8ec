"""The controller that does nothing."""

import numpy as np

from pcm_gym.arrays import Array
from pcm_gym.references.view import View


class StandingStill:
    """No action at all: whatever succeeds with it asked for nothing."""

    def act(self, view: View) -> Array:
        """Actions (n, actuators), all zero."""
        return np.zeros(view.action_shape)
