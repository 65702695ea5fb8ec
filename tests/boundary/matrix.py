"""Every door with every value: what is wrong is refused in words, what is right comes to the right result."""

import dataclasses
import random
import time
import warnings
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numba.core.dispatcher import Dispatcher

import pcm_gym
from tests.boundary.doors import ALIASES, Door, doors
from tests.boundary.values import WRONG, layouts

LONGEST = 10.0  # seconds that any case may take


@dataclass(frozen=True)
class Case:
    """A door, one argument of it, and what that is in place of what is right."""

    door: Door
    argument: str
    value_name: str
    value: Any
    is_layout: bool

    @property
    def name(self) -> str:
        return f"{self.door.name}({self.argument}={self.value_name})"


def cases() -> Iterator[Case]:
    """All of them."""
    for door in doors():
        for argument, right in door.arguments.items():
            if argument in door.unchecked:
                continue
            for name, value in WRONG.items():
                if (argument, name) in door.lengthy:
                    continue
                yield Case(door, argument, name, value, is_layout=False)
            if argument in door.arrays:
                for name, value in layouts(right):
                    yield Case(door, argument, name, value, is_layout=True)


def sample(count: int, seed: int = 0) -> list[Case]:
    """So many of them, at least one of each door and argument."""
    every = list(cases())
    random.Random(seed).shuffle(every)
    seen: set[tuple[str, str]] = set()
    first: list[Case] = []
    others: list[Case] = []
    for case in every:
        key = (case.door.name, case.argument)
        (others if key in seen else first).append(case)
        seen.add(key)
    return (first + others)[:count]


# What readers say of a path tells what is wrong with the file, and planners why there is no motion: not what was given.
_OF_CONTENT = (
    pcm_gym.AtlasError,
    pcm_gym.DesignError,
    pcm_gym.MechanismFileError,
    pcm_gym.PlanningError,
    pcm_gym.PolicyError,
)


class Judge:
    """Tries cases, and remembers what equal arguments have come to."""

    def __init__(self) -> None:
        self.outcomes: Counter[str] = Counter()
        self.slowest = ("", 0.0)
        self._right: dict[int, Any] = {}

    def prepare(self, door: Door) -> None:
        """Call a door with right arguments, which compiles what it needs and tells what is right."""
        if id(door) not in self._right:
            try:
                self._right[id(door)] = (door, door.call(**door.arguments))
            except _OF_CONTENT:
                self._right[id(door)] = (door, None)

    def complaint(self, case: Case) -> str | None:
        """What is wrong with what a case comes to; nothing, if all is well."""
        self.prepare(case.door)
        begin, before = time.perf_counter(), overload_counts()
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                result = case.door.call(**{**case.door.arguments, case.argument: case.value})
        except (TypeError, ValueError) as error:
            found = None if not case.is_layout else f"refused a right value: {error}"
            found = found or _words(case, error)
            self.outcomes["refused"] += 1
        except BaseException as error:
            if isinstance(error, KeyboardInterrupt):
                raise
            found = f"{type(error).__name__}: {error}"
        else:
            self.outcomes["taken"] += 1
            found = self._of_result(case, result)
        took = time.perf_counter() - begin
        if took > self.slowest[1]:
            self.slowest = (case.name, took)
        if found is None and took > LONGEST:
            found = f"took {took:.1f} s"
        new = overload_counts() - before
        if found is None and new and case.is_layout:
            found = f"compiled {dict(new)}"
        return found

    def _of_result(self, case: Case, result: Any) -> str | None:
        numbers = list(reals(result))
        if any(np.isnan(array).any() for array in numbers):
            return "not a number came out"
        if case.is_layout and case.door.compares:
            for found, expected in zip(numbers, reals(self._right[id(case.door)][1]), strict=True):
                if found.shape != expected.shape or not np.array_equal(found, expected):
                    return "another result than from the same numbers"
        return None


def _words(case: Case, error: Exception) -> str | None:
    """What an error's message lacks."""
    message = str(error)
    names = (case.argument, *ALIASES.get(case.argument, ()))
    if not any(name in message for name in names):
        return f"the error does not name {case.argument}: {message[:300]}"
    if "got" not in message and "rho <=" not in message and not isinstance(error, _OF_CONTENT):
        return f"the error does not show the value: {message[:300]}"
    return None


def overload_counts() -> Counter[str]:
    """How many kinds of arguments each kernel of the package has been compiled, or loaded, for."""
    return Counter({name: len(kernel.overloads) for name, kernel in _kernels().items()})


def _kernels() -> dict[str, Dispatcher]:
    import sys

    found = {}
    for name, module in list(sys.modules.items()):
        if name.startswith("pcm_gym.kernels"):
            for key, value in vars(module).items():
                if isinstance(value, Dispatcher) and value.py_func.__module__ == name:
                    found[f"{name}.{key}"] = value
    return found


def reals(value: Any, depth: int = 0) -> Iterator[np.ndarray[Any, Any]]:
    """All real numbers in a result, as arrays; what is no witness (nan) is left out."""
    if isinstance(value, bool | int):
        yield np.asarray(float(min(max(value, -(1 << 62)), 1 << 62)))  # no float can be larger than any integer
    elif isinstance(value, float | np.number):
        yield np.asarray(value, dtype=np.float64)
    elif isinstance(value, np.ndarray):
        if value.dtype.kind in "fiub":
            yield np.asarray(value, dtype=np.float64)
    elif isinstance(value, Mapping):
        for key, own in value.items():
            if key != "witness":
                yield from reals(own, depth + 1)
    elif isinstance(value, tuple | list | pcm_gym.EquilibriumSet | pcm_gym.StableStates):
        for own in value:
            yield from reals(own, depth + 1)
    elif isinstance(value, pcm_gym.Equilibrium):
        yield from reals((value.state, value.inputs, value.load, value.energy, value.stability_margin), depth + 1)
    elif dataclasses.is_dataclass(value) and not isinstance(value, type) and depth < 4:
        yield from reals([getattr(value, own.name) for own in dataclasses.fields(value)], depth + 1)
