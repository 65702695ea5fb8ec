"""What is said where a command fails: a sentence on standard error, and an exit code."""

import os
import sys
from enum import IntEnum
from typing import NoReturn

# What pip would have to install for a module, as an extra of this package.
EXTRAS = {
    "PIL": "render",
    "pygame": "window",
    "moviepy": "video",
    "websockets": "explore",
    "jinja2": "agents",
    "matplotlib": "agents",
    "stable_baselines3": "agents",
    "tensorboard": "agents",
    "torch": "agents",
}
_TRACEBACK = "PCM_GYM_TRACEBACK"


class ExitCode(IntEnum):
    """How a command ended."""

    DONE = 0
    REFUSED = 1  # what was asked for cannot be done; a sentence says why
    WRONG_USE = 2  # no such command or option, or a value that cannot be read
    INTERNAL = 70  # a mistake of the package
    INTERRUPTED = 130  # from the keyboard, about which nothing is said


class RefusalError(Exception):
    """What was asked for cannot be done, for a reason that is said in words."""


def end_with(error: Exception) -> NoReturn:
    """Say what was wrong and end the process; with ``PCM_GYM_TRACEBACK=1`` raise the error as it is."""
    if os.environ.get(_TRACEBACK):
        raise error
    code, sentence = _sentence(error)
    print(f"pcm-gym: {sentence}", file=sys.stderr)
    sys.exit(code)


def _sentence(error: Exception) -> tuple[ExitCode, str]:
    if isinstance(error, ModuleNotFoundError) and error.name:
        return ExitCode.REFUSED, _what_to_install(error.name.partition(".")[0])
    if isinstance(error, OSError) and error.strerror:
        where = f"{error.filename}: " if error.filename else ""
        return ExitCode.REFUSED, f"{where}{error.strerror}"
    if isinstance(error, MemoryError):
        return ExitCode.REFUSED, "there is not enough memory for this"
    # ValueError and TypeError are how the package refuses arguments, RuntimeError how a search gives up its budget
    if isinstance(error, RefusalError | ImportError | OSError | RuntimeError | TypeError | ValueError):
        return ExitCode.REFUSED, str(error) or type(error).__name__
    kind = type(error).__name__
    return ExitCode.INTERNAL, f"a mistake of the package, {kind}: {error} ({_TRACEBACK}=1 shows where)"


def _what_to_install(module: str) -> str:
    extra = EXTRAS.get(module)
    package = f"pcm_gym[{extra}]" if extra else module
    return f"{module} is not installed: pip install '{package}'"
