"""When episodes are first a success."""

from collections.abc import Mapping
from typing import Any


class FirstSuccesses:
    """A `Watch` that notes after how many steps an episode is first a success.

    Attributes
    ----------
    steps : dict
        By the episode's seed; those that never are a success are left out.
    """

    def __init__(self) -> None:
        self.steps: dict[int, int] = {}
        self._elapsed: dict[int, int] = {}

    def __call__(self, row: int, seed: int, infos: Mapping[str, Any]) -> None:
        """Note a reset, which has no infos, or a step."""
        self._elapsed[seed] = self._elapsed[seed] + 1 if infos else 0
        if infos and infos["is_success"][row]:
            self.steps.setdefault(seed, self._elapsed[seed])
