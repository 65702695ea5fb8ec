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
        actions, rows = self._controller.act(view), np.flatnonzero(view.under_way)
        shield = Shield(view.simulation, view.simulation.settings.singular_margin)
        # as they are told to the environment
        actions[rows], _ = shield.choose(rows, actions[rows].astype(np.float32).astype(np.float64))
        return actions
