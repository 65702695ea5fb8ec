"""What a controller must do."""

from typing import Protocol

from pcm_gym.arrays import Array
from pcm_gym.references.view import View


class Controller(Protocol):
    """Whatever chooses actions for episodes that run side by side.

    An episode must come out the same whatever runs beside it. One controller acts in one batch at a time.
    """

    def act(self, view: View) -> Array:
        """Actions (n, actuators) in [-1, 1], one row for each of the view's."""
