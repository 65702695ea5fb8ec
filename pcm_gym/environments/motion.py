"""What a step moves, apart from goals and episodes: mechanisms and the actuators that they hang on."""

from typing import NamedTuple

from pcm_gym.arrays import Array, Integers, Mask
from pcm_gym.environments.rows import Rows
from pcm_gym.kernels.statics.states import States


class Motion(NamedTuple):
    """Where mechanisms and their actuators are, one row each, dimensionless: all that the next step moves or needs."""

    x: Array  # (n, 2 legs + d)
    inputs: Array  # (n, legs): where the clamps are
    load: Array  # (n, d)
    scene: Integers  # (n,): whose mechanism it is
    commands: Array  # (n, legs): what the actuators have been told, unless they are ideal
    drives: Array  # (n, legs): where their drives are, unless they are ideal

    @classmethod
    def of(cls, rows: Rows) -> "Motion":
        """Return the motion of a batch, in its own arrays."""
        return cls(rows.x, rows.inputs, rows.load, rows.scene, rows.commands, rows.drives)

    @property
    def states(self) -> States:
        """The states of the mechanisms."""
        return States(self.x, self.inputs, self.load)

    def copied(self, rows: Integers | Mask) -> "Motion":
        """Return a copy of some rows, one as often as it is named."""
        x, inputs, load = self.x[rows], self.inputs[rows], self.load[rows]
        return Motion(x, inputs, load, self.scene[rows], self.commands[rows], self.drives[rows])


class Response(NamedTuple):
    """Where one step takes actuators, one row each, dimensionless."""

    moves: Array  # (n, legs): of the clamps, in terms of the largest increments
    commands: Array  # (n, legs)
    drives: Array  # (n, legs)
    is_cut: Mask  # (n,): whether a command was cut at a limit
