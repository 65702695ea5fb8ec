"""What the figures were measured on."""

import os
import platform

from agents.experiments.machine import processor, version_of

PACKAGES = ("gymnasium", "numba", "numpy", "scipy", "mujoco", "envpool", "pyelastica", "gym-softrobot")


def describe_machine() -> dict[str, str]:
    """Return processor, cores, load and versions, as a reader of the figures would ask for them."""
    description = {
        "processor": processor(),
        "cores": f"{len(os.sched_getaffinity(0)) if hasattr(os, 'sched_getaffinity') else os.cpu_count()}",
        "load": " ".join(f"{value:.2f}" for value in os.getloadavg()) if hasattr(os, "getloadavg") else "unknown",
        "system": f"{platform.system()} {platform.machine()}",
        "python": platform.python_version(),
    }
    return description | {name: version_of(name) or "absent" for name in PACKAGES}
