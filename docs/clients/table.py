"""The table of clients. A new one is a file in `examples` and a line here."""

from collections.abc import Mapping
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

EXAMPLES = Path(__file__).parent / "examples"


@dataclass(frozen=True)
class Client:
    """A way in which others step environments.

    Attributes
    ----------
    title : str
    needs : tuple of str
        Distributions that the example imports.
    remark : str
        What a reader must know of it.
    """

    title: str
    needs: tuple[str, ...]
    remark: str = ""

    def missing(self) -> tuple[str, ...]:
        """Return what of it is not installed."""
        return tuple(name for name in self.needs if _version(name) is None)

    def versions(self) -> dict[str, str]:
        """Return the versions of what is installed."""
        return {name: found for name in self.needs if (found := _version(name)) is not None}


def _version(name: str) -> str | None:
    try:
        return version(name)
    except PackageNotFoundError:
        return None


# By the names of their files.
CLIENTS: Mapping[str, Client] = {
    "gymnasium_vector": Client(
        "Gymnasium, batches",
        ("gymnasium",),
        '`"sync"` and `"async"` are Gymnasium\'s, the native batch is this package\'s: equal results, far sooner.',
    ),
    "gymnasium_numpy_to_torch": Client(
        "Gymnasium, tensors",
        ("gymnasium", "torch", "array-api-compat"),
        "The wrapper needs `array-api-compat`, which Gymnasium does not bring.",
    ),
    "sb3_dummy": Client("Stable-Baselines3, one process", ("stable-baselines3", "gymnasium", "torch")),
    "sb3_subproc": Client(
        "Stable-Baselines3, many processes",
        ("stable-baselines3", "gymnasium", "torch"),
        "The steps are so cheap that processes seldom pay; a native batch does, see `agents` in a checkout.",
    ),
    "sb3_hindsight": Client("Stable-Baselines3, hindsight", ("stable-baselines3", "gymnasium", "torch")),
    "sb3_contrib_tqc": Client("sb3-contrib", ("sb3-contrib", "stable-baselines3", "gymnasium", "torch")),
    "cleanrl_style": Client(
        "CleanRL style", ("gymnasium", "torch"), "A whole learner in one file, for reading and changing."
    ),
    "minari_datasets": Client(
        "Minari",
        ("minari", "gymnasium", "h5py"),
        "Any policy will do in the planner's place: a reference, a policy that was trained, chance.",
    ),
    "torchrl_single": Client(
        "TorchRL, one environment",
        ("torchrl", "tensordict", "gymnasium", "torch"),
        "`GymEnv` adds an argument `frameskip`, which no environment here takes; `GymWrapper` adds nothing.",
    ),
    "torchrl_batched": Client("TorchRL, a native batch", ("torchrl", "tensordict", "gymnasium", "torch")),
    "tianshou_collect": Client("Tianshou", ("tianshou", "gymnasium", "torch")),
    "rllib_ppo": Client("RLlib", ("ray", "gymnasium", "torch")),
    "rl_zoo3_train": Client("rl_zoo3", ("rl_zoo3", "stable-baselines3", "gymnasium", "torch")),
    "sbx_sac": Client("sbx", ("sbx-rl", "jax", "stable-baselines3", "gymnasium")),
}
