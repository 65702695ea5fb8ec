"""What a controller must do."""

from typing import Protocol

from agents.controllers.view import View
from pcm_gym.arrays import Array


class Controller(Protocol):
    """Whatever chooses actions for episodes that run side by side.

    An episode must come out the same whatever runs beside it.
    """

    def act(self, view: View) -> Array:
        """Actions (n, actuators) in [-1, 1], one row for each of the view's."""
