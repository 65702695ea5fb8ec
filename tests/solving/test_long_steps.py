"""Steps of any length end where the branch does, by the discretised energy and by the same way in many parts."""

import math

import gymnasium
import numpy as np
import pytest
from numpy.typing import ArrayLike
from scipy.optimize import brentq

from benchmarks.ways import described, judged
from pcm_gym.mechanism import Leg, Mechanism, Prismatic, Revolute, Rod
from pcm_gym.solving import BranchTracker, Equilibrium, Event, TrackedStep, solve_forward
from tests.reference.discrete_energy import DiscreteEnergy
from tests.solving.test_tracking import independent_fold

DIVISIONS = (1, 2, 3, 7, 64)
# The discretised rods are off by less than this part of the way.
DISCRETE = 2e-3


def narrow() -> Mechanism:
    """Return two equal rods whose motors are close together."""
    legs = tuple(
        Leg(Revolute((side * 0.05, 0.0), clamp_angle=0.0, limits=(-6.0, 6.0)), Rod(1.0, bending_stiffness=1.0))
        for side in (-1.0, 1.0)
    )
    return Mechanism("narrow", legs, home_inputs=(0.5 * math.pi + 0.1, 0.5 * math.pi - 0.1))


def unlike() -> Mechanism:
    """Return a revolute and a prismatic leg without any symmetry."""
    first = Revolute(
        (-0.2331371432711577, -0.08678963751770925), clamp_angle=0.20687548015474727, limits=(-math.pi, math.pi)
    )
    second = Prismatic(
        (0.2331371432711577, 0.005340698338201971),
        axis_angle=1.6259502848068998,
        clamp_angle=2.3641271602783798,
        limits=(-2.0, 2.0),
    )
    legs = (
        Leg(first, Rod(1.0607339725492895, bending_stiffness=0.5920857005617851)),
        Leg(second, Rod(0.991790722121595, bending_stiffness=0.7849185877151437)),
    )
    return Mechanism("unlike", legs, home_inputs=(0.0, 0.0))


def stable_near(mechanism: Mechanism, inputs: ArrayLike, load: ArrayLike, pose: tuple[float, float]) -> Equilibrium:
    return min(solve_forward(mechanism, inputs, load).stable, key=lambda found: math.dist(found.pose, pose))


def last_step(start: Equilibrium, inputs: np.ndarray, parts: int) -> tuple[TrackedStep, float]:
    """Return the last step of a way in parts, and the part of the way where it ended."""
    tracker = BranchTracker(start.mechanism, start)
    for part in range(1, parts + 1):
        step = tracker.step(start.inputs + part / parts * (inputs - start.inputs), start.load)
        if step.event != Event.NONE:
            break
    return step, (part - 1 + step.fraction) / parts


@pytest.mark.parametrize("parts", DIVISIONS)
def test_a_fold_within_a_step_is_found_where_the_discretised_energy_has_it(parts: int) -> None:
    """Behind that fold there is another stable branch, to which Newton's method goes from afar."""
    load = (0.7443967137046243, 4.446921280981519)
    start = stable_near(unlike(), (-2.8855562922210534, -0.2591618500770084), load, (0.11262313, 0.41758626))
    target = np.array([-3.023193622547879, -0.0858506768532063])
    step, fraction = last_step(start, target, parts)
    assert step.event == Event.FOLD
    fold = independent_fold(start, target, np.array(load), step=0.02)
    assert fold is not None
    assert abs(fraction - fold) < DISCRETE
    assert abs(fraction - 0.74440407) < 1e-7


def even(value: float) -> np.ndarray:
    """Return inputs of two revolute legs that are mirror images."""
    return np.array([0.5 * math.pi + value, 0.5 * math.pi - value])


def softness(mechanism: Mechanism, value: float) -> float:
    """Return the least eigenvalue of the discretised energy at the upright even state with these even inputs."""
    load = np.array([0.0, -8.0])
    upright = min(solve_forward(mechanism, even(value), load), key=lambda found: math.dist(found.pose, (0.0, 0.996)))
    discrete = DiscreteEnergy(mechanism)
    z = discrete.solve(discrete.start(upright), even(value), load)
    return float(discrete.eigenvalues(z, even(value), load)[0])


@pytest.mark.parametrize("parts", DIVISIONS)
def test_a_window_of_instability_within_a_step_is_not_passed(parts: int) -> None:
    """Before and behind it the branch is stable; where it begins says the discretised energy."""
    start = stable_near(narrow(), even(0.1), (0.0, -8.0), (0.0, 0.996))
    step, fraction = last_step(start, even(-0.7), parts)
    assert step.event == Event.INDEX_CHANGE
    around = np.array([-0.05, -0.12, -0.22, -0.29])  # not at the edge itself, where the discretised one is singular
    fitted = np.polynomial.Polynomial.fit(around, [softness(start.mechanism, value) for value in around], 3)
    edge = brentq(fitted, -0.12, -0.22)
    assert abs(0.1 - 0.8 * fraction - edge) < 2e-3
    np.testing.assert_allclose(step.equilibrium.pose[0], 0.0, atol=1e-6)


@pytest.mark.parametrize("behaviour", ["terminate", "hold"])
def test_a_step_of_an_environment_does_not_pass_that_window_either(behaviour: str) -> None:
    mechanism = narrow()
    env = gymnasium.make_vec(
        "pcm_gym:PCM/2RFR-Reach-v0",
        num_envs=2,
        vectorization_mode="vector_entry_point",
        mechanism=mechanism,
        load=(0.0, -8.0),
        max_action=0.8,
        singular_margin=1e-3,
        on_instability=behaviour,
    )
    start = stable_near(mechanism, even(0.1), (0.0, -8.0), (0.0, 0.996))
    env.reset(seed=0, options={"equilibrium": start})
    _, _, _, _, info = env.step(np.tile(np.array([-1.0, 1.0], np.float32), (2, 1)))
    assert [Event(event) for event in info["event"]] == [Event.INDEX_CHANGE] * 2


@pytest.mark.parametrize("parts", DIVISIONS)
def test_a_step_beside_a_pitchfork_stays_on_its_side(parts: int) -> None:
    """Its mirror image is 6 cm away, with the same index."""
    start = stable_near(narrow(), (1.45160796, 1.69002651), (0.0, 15.0), (0.0008, -0.2174))
    step, _ = last_step(start, np.array([1.50518584, 1.63644863]), parts)
    assert step.event == Event.NONE
    np.testing.assert_allclose(step.equilibrium.pose, (0.03258504, -0.19723302), atol=1e-7)


def test_random_long_steps_come_to_what_many_parts_of_them_do() -> None:
    """Two legs, platforms and mirror images beside pitchforks, loaded, stable and unstable, up to two lengths long."""
    tally = judged(3_000, seed=3)
    assert not tally.jumps, "\n".join(map(described, tally.jumps))
    assert len(tally.wrong) <= 10
    assert tally.given_up <= 100
