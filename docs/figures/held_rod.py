"""A rod held at both ends that is not in equilibrium: how its energy falls as it buckles between them.

The rod is cut into equal segments, whose angles to the clamp are the unknowns. Unit length, unit stiffness.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.linalg import null_space

from docs.figures.rods import force_of, shape_of
from pcm_gym.arrays import Array

_ITERATIONS = 30
_RESIDUAL_TOL = 1e-10


@dataclass(frozen=True)
class HeldShape:
    """One shape of the rod on its way.

    Attributes
    ----------
    points : array (segments + 1, 2)
        Its centre line.
    energy : float
        Its energy less that of the equilibrium.
    deflection : float
        Its largest distance from the equilibrium, with the sign of the side to which it went.
    """

    points: Array
    energy: float
    deflection: float


class HeldRod:
    """The equilibrium of a rod at a load, with its clamp and its tip held."""

    def __init__(self, load: Array, segments: int = 240) -> None:
        nodes = shape_of(load, segments + 1)
        steps = np.diff(nodes, axis=0)
        self._size = 1.0 / segments
        self._tip = nodes[-1]
        self._bending = _bending_matrix(segments)
        angles = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
        self._angles, self._force = self._relaxed(angles, force_of(load), np.empty((0, segments)), np.empty(0))
        self._points = self._line(self._angles)

    @property
    def curvatures(self) -> tuple[Array, Array]:
        """Eigenvalues of the energy's second variation with the tip held, ascending, and their directions."""
        allowed = null_space(self._pull(self._angles))
        values, vectors = np.linalg.eigh(allowed.T @ self._hessian(self._angles, self._force) @ allowed)
        return values, allowed @ vectors

    def descend(self, farthest: float, count: int) -> Iterator[HeldShape]:
        """Shapes of least energy for given parts along the most unstable direction, up to `farthest` (rms angle, rad).

        There are `count` on each side, the equilibrium between them.
        """
        direction = self.curvatures[1][:, :1].T
        reach = farthest * self._angles.size**0.5
        for side in (-1.0, 1.0):
            angles, force = self._angles, self._force
            shapes = []
            for part in np.linspace(0.0, side * reach, count + 1):
                angles, force = self._relaxed(angles, force, direction, direction @ self._angles + part)
                shapes.append(self._held_shape(angles, side))
            yield from reversed(shapes[1:]) if side < 0.0 else shapes

    def _held_shape(self, angles: Array, side: float) -> HeldShape:
        points = self._line(angles)
        deflection = side * float(np.linalg.norm(points - self._points, axis=1).max())
        return HeldShape(points, self._energy(angles) - self._energy(self._angles), deflection)

    def _energy(self, angles: Array) -> float:
        return float(0.5 * angles @ self._bending @ angles)

    def _line(self, angles: Array) -> Array:
        steps = self._size * np.stack([np.cos(angles), np.sin(angles)], axis=1)
        return np.vstack([np.zeros(2), np.cumsum(steps, axis=0)])

    def _pull(self, angles: Array) -> Array:
        """Derivative of the tip by the angles, (2, segments)."""
        return self._size * np.stack([-np.sin(angles), np.cos(angles)])

    def _hessian(self, angles: Array, force: Array) -> Array:
        return self._bending + np.diag(self._size * (force[0] * np.cos(angles) + force[1] * np.sin(angles)))

    def _relaxed(self, angles: Array, force: Array, directions: Array, parts: Array) -> tuple[Array, Array]:
        """Equilibrium with the tip held and given parts along some directions: Newton's method with multipliers."""
        multipliers = np.append(force, np.zeros(len(directions)))
        for _ in range(_ITERATIONS):
            rows = np.vstack([self._pull(angles), directions])
            miss = np.append(self._line(angles)[-1] - self._tip, directions @ angles - parts)
            residual = np.append(self._bending @ angles - multipliers @ rows, miss)
            if np.abs(residual).max() < _RESIDUAL_TOL:
                break
            corner = np.zeros((len(rows), len(rows)))
            matrix = np.block([[self._hessian(angles, multipliers), -rows.T], [rows, corner]])
            step = np.linalg.solve(matrix, -residual)
            angles, multipliers = angles + step[: angles.size], multipliers + step[angles.size :]
        else:
            raise RuntimeError("a held rod did not relax to an equilibrium")
        return angles, multipliers[:2]


def _bending_matrix(segments: int) -> Array:
    """Matrix of the bending energy: neighbours a segment apart, the first half a segment from the clamp."""
    matrix = 2.0 * np.eye(segments) - np.eye(segments, k=1) - np.eye(segments, k=-1)
    matrix[0, 0], matrix[-1, -1] = 3.0, 1.0
    return segments * matrix
