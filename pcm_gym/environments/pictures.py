"""Pictures of the rows of a simulation."""

import os
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pcm_gym.arrays import Array
from pcm_gym.environments.settings import Settings
from pcm_gym.environments.simulation import Simulation
from pcm_gym.mechanism.validation import shown
from pcm_gym.solving import Equilibrium, Region

Frame = NDArray[np.uint8]


class Pictures:
    """Draws rows of simulations with the same settings.

    Parameters
    ----------
    settings : Settings

    Raises
    ------
    TypeError, ValueError
        If the atlas is none, or belongs to another mechanism or load.
    """

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self._workspace = None if settings.render_workspace is None else _region(settings.render_workspace, settings)
        self._renderers: dict[int, Any] = {}

    def draw(self, simulation: Simulation, row: int, trail: Array | None = None) -> Frame:
        """Return the picture of a row, (height, width, 3), with the way of the end-effector behind it, (n, 2)."""
        from pcm_gym.solving import solve_forward  # a search that most environments never make

        here, task, rows = simulation.equilibrium(row), self._settings.task, simulation.rows
        path = [task.goals.pose(goal) for goal in rows.goals[row]] if task.period > 1 else None
        frame: Frame = self._renderer(int(rows.scene[row]), here).draw(
            here,
            goal=task.goals.pose(simulation.goal(row)),
            success_distance=task.goals.success_distance,
            trail=trail,
            stability_lost=bool(rows.lost[row]),
            ghosts=solve_forward(here.mechanism, here.inputs, here.load) if self._settings.render_ghosts else (),
            target=simulation.witness(row) if task.goals.with_inputs else None,
            path=None if path is None else np.array([*path, path[0]]),
        )
        return frame

    def _renderer(self, scene: int, equilibrium: Equilibrium) -> Any:
        from pcm_gym.rendering import FrameRenderer  # drawing is loaded only when a picture is asked for
        from pcm_gym.rendering.camera import reach_bounds

        if scene not in self._renderers:
            bounds = reach_bounds(self._settings.mechanism)
            self._renderers[scene] = FrameRenderer(equilibrium.mechanism, bounds=bounds, workspace=self._workspace)
        return self._renderers[scene]


def _region(workspace: Any, settings: Settings) -> Region:
    from pcm_gym.solving import Atlas, load_atlas  # of which most environments show none

    atlas = load_atlas(workspace) if isinstance(workspace, str | os.PathLike) else workspace
    if not isinstance(atlas, Atlas):
        raise TypeError(f"render_workspace must be an Atlas, or a file with one, got {shown(workspace)}")
    load = settings.load_range[0]
    if settings.load_varies or atlas.mechanism != settings.mechanism or not np.array_equal(atlas.load, load):
        raise ValueError(
            f"render_workspace must be an atlas of {settings.mechanism.name!r} under its constant load, got one of "
            f"{atlas.mechanism.name!r} under {atlas.load.tolist()}"
        )
    return atlas.workspace()
