"""A controller behind the solver's shield."""

import numpy as np

from pcm_gym.arrays import Array
from pcm_gym.environments.shield import Shield
from pcm_gym.references.controller import Controller
from pcm_gym.references.view import View


class ShieldedController:
    """Acts as another controller does; what is not safe is replaced by what `SolverShield` would take instead.

    Parameters
    ----------
    controller : Controller
    """

    def __init__(self, controller: Controller) -> None:
        self._controller = controller

    def act(self, view: View) -> Array:
        """Actions (n, actuators), safe ones wherever there are any."""
        return shielded(view, self._controller.act(view))


def shielded(view: View, actions: Array) -> Array:
    """Return actions (n, actuators), those that are not safe replaced."""
    shield, rows = Shield(view.simulation, view.simulation.settings.singular_margin), np.flatnonzero(view.under_way)
    chosen = actions.astype(np.float32).astype(np.float64)  # as they are told to the environment
    chosen[rows], _ = shield.choose(rows, chosen[rows])
    return chosen
