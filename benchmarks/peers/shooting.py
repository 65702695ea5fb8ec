"""SciPy by shooting: both rods are integrated from the clamps, and `root` finds force and curvatures there.

`odeint` (LSODA in compiled code, more than twice as fast here as `solve_ivp` with any method), with the default method
of `root`; the derivatives are written with `math`, faster than NumPy on single numbers. Tolerances of 1e-6 leave an
error of 1e-6 L; tighter ones cost time and gain what few would ask for. Each step begins at the last solution.
"""

from scipy.integrate import odeint
from scipy.optimize import root

from benchmarks.peers.following import Places, Step
from benchmarks.peers.problem import clamped, exact_path, misses, slopes
from pcm_gym.arrays import Array

TOL = 1e-6


def prepare(place: Places) -> Step:
    """Return the step that begins at a place on the path."""
    last = exact_path().unknowns[place]

    def ends(guess: Array, target: Array) -> Array:
        start = clamped(target, guess[2:])
        force = tuple(guess[:2])
        both: Array = odeint(slopes, start, (0.0, 1.0), args=force, tfirst=True, rtol=TOL, atol=TOL)
        tip: Array = both[1]
        return tip

    def step(target: Array) -> Array:
        nonlocal last
        found = root(lambda guess: misses(ends(guess, target)), last, tol=TOL)
        if not found.success:
            raise RuntimeError(found.message)
        last = found.x
        tips = ends(last, target)
        return 0.5 * (tips[2:4] + tips[6:8])

    return step
