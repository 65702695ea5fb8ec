"""All golden scenarios by name, and the file with what is kept of them."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tests.golden.kinematics import KINEMATICS
from tests.golden.records import Record
from tests.golden.rollouts import ROLLOUTS, SYMMETRIC

PATH = Path(__file__).with_name("golden.npz")

SCENARIOS: dict[str, Callable[[], Record]] = {
    **KINEMATICS,
    **{name: rollout.run for name, rollout in ROLLOUTS.items()},
}
# Those whose values are kept: the others are only good for a comparison on one machine.
PORTABLE = [name for name in SCENARIOS if SYMMETRIC not in name]


def read_golden() -> dict[str, dict[str, NDArray[Any]]]:
    """What was kept, by scenario and layer."""
    with np.load(PATH) as file:
        arrays = dict(file)
    golden: dict[str, dict[str, NDArray[Any]]] = {}
    for key, array in arrays.items():
        scenario, layer = key.split("/")
        golden.setdefault(scenario, {})[layer] = array
    return golden
