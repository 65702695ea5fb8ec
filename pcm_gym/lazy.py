"""Packages whose names are imported when they are first asked for, so that importing the package itself is quick."""

import sys
from collections.abc import Callable, Sequence
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
