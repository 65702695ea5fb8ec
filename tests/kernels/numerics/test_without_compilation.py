"""NUMBA_DISABLE_JIT=1 must give the same numbers: the kernels are plain Python functions too."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np

ROOT = Path(__file__).parents[3]

# A bundle of everything that the kernels do, small enough for the interpreter.
BUNDLE = """
import json, math
import numpy as np
from pcm_gym.kernels.rods.elliptic import jacobi
from pcm_gym.kernels.rods.rod import rod, rod_energy, rod_parameters, rod_shape
from pcm_gym.mechanism import Leg, Mechanism, Revolute
from pcm_gym.solving import BranchTracker, Equilibrium, Event, snap
from tests.reference.mechanisms import random_mechanism, random_states

numbers = []
for u in (0.0, 0.3, 4.0, 12.0):
    for k_c in (0.0, 1e-300, 1e-9, 1e-3, 0.5, 1.0):
        numbers += jacobi(u, math.sqrt((1.0 - k_c) * (1.0 + k_c)), k_c)
loads = [(0.0, 0.0), (0.01, 0.02), (3.0, -4.0), (-20.0, 1e-9), (-20.0, 0.0), (100.0, 1e-4), (144.0, 0.0), (5e-324, 0.0)]
for g in loads:
    shape = np.zeros((5, 2))
    rod_shape(*g, shape)
    numbers += [*rod(*g), *rod_parameters(*g), rod_energy(*g), *shape.ravel()]

def all_of(equilibrium):
    return [
        *equilibrium.state, equilibrium.energy, equilibrium.index, equilibrium.stability_margin,
        *equilibrium.stiffness.ravel(), *equilibrium.forward_jacobian.ravel(), *equilibrium.shape(3).ravel(),
    ]

# an exactly straight pair of rods: poles of the rods' stiffness, divisions by zero
mechanism = Mechanism("truss", tuple(Leg(Revolute((x, 0.0))) for x in (-0.6, 0.6)))
angle = math.atan2(0.8, 0.6)
start = Equilibrium(mechanism, [5.0, 0.0, 5.0, 0.0, 0.0, 0.8], [angle, math.pi - angle], [0.0, 8.0])
numbers += all_of(start)
tracker = BranchTracker(mechanism, start)
for inputs, load in (([1.0, 2.3], [0.0, 5.0]), ([0.9, 2.4], [1.0, -3.0]), ([0.5, 2.6], [0.0, -8.0])):
    step = tracker.step(inputs, load)
    numbers += [step.fraction, int(step.event)]
    numbers += all_of(step.equilibrium) if step.event != Event.FOLD else list(step.equilibrium.state)

# a fold: natural steps, arclength steps, its location
tracker = BranchTracker(mechanism, tracker.equilibrium)
step = tracker.step(tracker.equilibrium.inputs, [0.0, -60.0])
numbers += [step.fraction, int(step.event), *step.equilibrium.pose]
landing = snap(step.equilibrium)
numbers += [landing.energy_released, *all_of(landing.equilibrium)]
print(json.dumps([float(number) for number in numbers]))
"""


def numbers(*, is_compiled: bool) -> np.ndarray:
    environment = {**os.environ, "NUMBA_DISABLE_JIT": "0" if is_compiled else "1"}
    command = [sys.executable, "-W", "ignore::RuntimeWarning", "-c", BUNDLE]
    result = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr
    return np.array(json.loads(result.stdout))


def test_the_interpreter_gives_the_same_numbers() -> None:
    """To rounding: machine code may call other versions of sin, cos and exp than the interpreter."""
    compiled, interpreted = numbers(is_compiled=True), numbers(is_compiled=False)
    assert len(compiled) > 400
    np.testing.assert_array_equal(np.isfinite(interpreted), np.isfinite(compiled))
    finite = np.isfinite(compiled)
    # Located folds and stiffness near poles repeat rounding amplified a thousandfold; all else agrees to 1e-14.
    np.testing.assert_allclose(interpreted[finite], compiled[finite], rtol=1e-9, atol=1e-10)
    close = np.abs(interpreted - compiled)[finite] <= 1e-13 * (1.0 + np.abs(compiled[finite]))
    assert close.mean() > 0.9
