"""Packages whose names are imported when they are first asked for, so that importing the package itself is quick."""

import sys
from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from typing import Any


def attribute_loader(package: str, names: Sequence[str], rooms: Sequence[str]) -> Callable[[str], Any]:
    """Return the `__getattr__` of a package (PEP 562) that takes its names from its rooms.

    Parameters
    ----------
    package : str
        Name of the package.
    names : sequence of str
        What it gives out: its ``__all__``.
    rooms : sequence of str
        Its modules, which it gives out, too. A name is looked for in one after the other: those that are the quickest
        to import, or that others import anyway, come first.
    """

    def load(name: str) -> Any:
        if name in rooms:
            return import_module(f"{package}.{name}")
        if name in names:
            for room in rooms:
                module = import_module(f"{package}.{room}")
                if hasattr(module, name):
                    value = getattr(module, name)
                    setattr(sys.modules[package], name, value)  # which is found without asking from now on
                    return value
        raise AttributeError(f"module {package!r} has no attribute {name!r}")

    return load


def exact_loader(package: str, rooms: Mapping[str, Sequence[str]]) -> Callable[[str], Any]:
    """Return the `__getattr__` of a package (PEP 562) whose names are each in a room of its own choice.

    For packages whose rooms import from each other, and other things under the same names. No room may have the name of
    what another gives out: importing it would hide that.

    Parameters
    ----------
    package : str
        Name of the package.
    rooms : mapping of str to sequence of str
        Its modules, which it gives out, too, with the names that it takes from each.
    """
    room_of = {name: room for room, names in rooms.items() for name in names}

    def load(name: str) -> Any:
        if name in room_of:
            value = getattr(import_module(f"{package}.{room_of[name]}"), name)
            setattr(sys.modules[package], name, value)  # which is found without asking from now on
            return value
        if name in rooms:
            return import_module(f"{package}.{name}")
        raise AttributeError(f"module {package!r} has no attribute {name!r}")

    return load
