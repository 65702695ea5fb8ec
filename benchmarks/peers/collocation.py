"""SciPy by collocation: `solve_bvp` on both rods at once, with the force as unknown parameters.

The mesh and the solution of one step are the guess of the next. The exact Jacobian is given, which is faster than the
differences that `solve_bvp` takes without it. The first mesh has 11 nodes, which it refines where it has to.
"""

import numpy as np
from scipy.integrate import solve_bvp, solve_ivp

from benchmarks.peers.following import Places, Step
from benchmarks.peers.problem import BASES, clamped, exact_path, slopes
from pcm_gym.arrays import Array

_NODES = 11


def _slopes(_: Array, states: Array, force: Array) -> Array:
    angle_1, curvature_1, _, _, angle_2, curvature_2, _, _ = states
    cos_1, sin_1, cos_2, sin_2 = np.cos(angle_1), np.sin(angle_1), np.cos(angle_2), np.sin(angle_2)
    bend_1, bend_2 = force[0] * sin_1 - force[1] * cos_1, force[1] * cos_2 - force[0] * sin_2
    return np.array([curvature_1, bend_1, cos_1, sin_1, curvature_2, bend_2, cos_2, sin_2])


def _jacobians(_: Array, states: Array, force: Array) -> tuple[Array, Array]:
    by_state, by_force = np.zeros((8, 8, states.shape[1])), np.zeros((8, 2, states.shape[1]))
    for first, sign in ((0, 1.0), (4, -1.0)):
        c, s = np.cos(states[first]), np.sin(states[first])
        by_state[first, first + 1] = 1.0
        by_state[first + 1, first] = sign * (force[0] * c + force[1] * s)
        by_state[first + 2, first], by_state[first + 3, first] = -s, c
        by_force[first + 1, 0], by_force[first + 1, 1] = sign * s, -sign * c
    return by_state, by_force


def prepare(place: Places, tol: float) -> Step:
    """Return the step that begins at a place on the path."""
    path, nodes = exact_path(), np.linspace(0.0, 1.0, _NODES)
    force, curvatures = np.split(path.unknowns[place], 2)
    start = clamped(path.inputs[place], curvatures)
    states = solve_ivp(slopes, (0.0, 1.0), start, args=tuple(force), t_eval=nodes).y

    def step(target: Array) -> Array:
        nonlocal nodes, states, force

        def misses(clamp: Array, tip: Array, _: Array) -> Array:
            at_clamps = clamp[[0, 2, 3, 4, 6, 7]] - [target[0], BASES[0], 0.0, target[1], BASES[1], 0.0]
            return np.concatenate([at_clamps, [tip[1], tip[5], tip[2] - tip[6], tip[3] - tip[7]]])

        found = solve_bvp(_slopes, misses, nodes, states, p=force, tol=tol, fun_jac=_jacobians)
        if not found.success:
            raise RuntimeError(found.message)
        nodes, states, force = found.x, found.y, found.p
        tip: Array = 0.5 * (states[2:4, -1] + states[6:8, -1])
        return tip

    return step
