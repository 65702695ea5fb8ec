"""What a real rig does that its model does not know: the defaults of difficulty "rig"."""

import numpy as np

from pcm_gym.environments.arguments import EnvironmentArguments
from pcm_gym.mechanism import Mechanism

# Payload in either direction, in EI / L^2, and what rods and bases are off by, relative and in mean rod lengths.
_PAYLOAD, _OFF, _DISPLACED = 1.5, 0.02, 0.02
# Time constant of the actuators in steps, their play in rad and mean rod lengths, and the noise of the sensors.
_LAG, _PLAY, _NOISE = 1.0, 0.01, 0.005
_VARIANTS = 32


def rig_arguments(mechanism: Mechanism) -> EnvironmentArguments:
    """Return the arguments of an environment that is like a real rig, where they differ from the defaults.

    Each episode has a payload of its own, up to 1.5 EI / L^2 in any direction, which is not told. Rods are off by up to
    2 % in length and stiffness, bases and attachments of a platform by up to 0.02 mean rod lengths. Actuators follow
    with a time constant of 1 step and a play of 0.01 rad or mean rod lengths. What is sensed has noise of 0.005, and is
    what a rig has sensors for.
    """
    units = mechanism.units
    payload = np.zeros(mechanism.dof)
    payload[:2] = _PAYLOAD * units.force
    randomisation = {"length": _OFF, "stiffness": _OFF, "base": _DISPLACED * units.length}
    if mechanism.dof == 3:
        randomisation["attachment"] = _DISPLACED * units.length
    return {
        "load": (-payload, payload),
        "observe_load": False,
        "randomisation": randomisation,
        "variants": _VARIANTS,
        "actuator_lag": _LAG,
        "backlash": units.inputs_from_kernel(np.full(mechanism.leg_count, _PLAY)),
        "observation_noise": _NOISE,
        "observe": "rig",
    }
