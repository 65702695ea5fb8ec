"""What a real rig does that its model does not know: the defaults of difficulty "rig"."""

import numpy as np

from pcm_gym.environments.arguments import EnvironmentArguments
from pcm_gym.mechanism import Mechanism
from pcm_gym.tasks import Task

# Payload in either direction, in EI / L^2, the arm with which it turns a platform, in distances of the hinges from its
# middle, and what rods and bases are off by, relative and in mean rod lengths.
_PAYLOAD, _ARM, _OFF, _DISPLACED = 2.0, 0.5, 0.02, 0.03
# Time constant of the actuators in steps, their play in rad and mean rod lengths, and the noise of the sensors.
_LAG, _PLAY, _NOISE = 1.0, 0.01, 0.005
# Whoever follows a path can follow it closely: mean rod lengths from the goal.
_CLOSE = 0.01
_VARIANTS = 32


def rig_arguments(task: Task) -> EnvironmentArguments:
    """Return the arguments of an environment that is like a real rig, where they differ from the defaults.

    Each episode has a payload of its own, up to 2 EI / L^2 in any direction, which is not told; it hangs beside the
    middle of a platform, by up to half of the hinges' distance. Rods are off by up to 2 % in length and stiffness,
    bases and attachments of a platform by up to 0.03 mean rod lengths. Actuators follow with a time constant of 1 step
    and a play of 0.01 rad or mean rod lengths. What is sensed has noise of 0.005, and is what a rig has sensors for.
    A goal that moves counts as reached within 0.01 mean rod lengths.
    """
    mechanism = task.goals.mechanism
    units = mechanism.units
    payload = np.full(mechanism.dof, _PAYLOAD * units.force)
    randomisation = {"length": _OFF, "stiffness": _OFF, "base": _DISPLACED * units.length}
    if mechanism.dof == 3:
        payload[2] *= _ARM * _hinge_radius(mechanism)
        randomisation["attachment"] = _DISPLACED * units.length
    arguments: EnvironmentArguments = {
        "load": (-payload, payload),
        "observe_load": False,
        "randomisation": randomisation,
        "variants": _VARIANTS,
        "actuator_lag": _LAG,
        "backlash": units.inputs_from_kernel(np.full(mechanism.leg_count, _PLAY)),
        "observation_noise": _NOISE,
        "observe": "rig",
    }
    if task.period > 1:
        arguments["success_distance"] = _CLOSE * units.length
    return arguments


def _hinge_radius(mechanism: Mechanism) -> float:
    """Return the root mean square of the hinges' distances from the platform's origin, m."""
    return float(np.sqrt(np.mean([x * x + y * y for x, y in (leg.attachment for leg in mechanism.legs)])))
