"""Arguments that commands share, and what is made of them."""

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import typer

from pcm_gym.commands.errors import RefusalError

if TYPE_CHECKING:
    from pcm_gym import Equilibrium, Mechanism

_DEGREES = "deg"


@dataclass(frozen=True)
class Numbers:
    """Numbers of the command line."""

    values: tuple[float, ...]


def numbers(text: str) -> Numbers:
    """Return the numbers of a text such as "0.3,-0.7" or "120deg,60deg"; degrees become radians."""
    return Numbers(tuple(_number(part) for part in text.replace(",", " ").split()))


def _number(part: str) -> float:
    value, is_angle = part.removesuffix(_DEGREES), part.endswith(_DEGREES)
    try:
        number = math.radians(float(value)) if is_angle else float(value)
    except ValueError:
        raise typer.BadParameter(f"{part!r} is no number: numbers look like 0.3,-0.7 or 120deg,60deg") from None
    if not math.isfinite(number):
        raise typer.BadParameter(f"{part!r} is not finite")
    return number


def mechanism_of(name: str) -> "Mechanism":
    """Return the mechanism of a name in the catalogue, or of a file."""
    import pcm_gym
    from pcm_gym.mechanism.text import FILE_SUFFIXES

    if name in pcm_gym.mechanism_names():
        return pcm_gym.get_mechanism(name)
    if name.lower().endswith(FILE_SUFFIXES):
        return pcm_gym.load_mechanism(name)
    raise RefusalError(
        f"there is no mechanism {name!r}: the catalogue has {', '.join(pcm_gym.mechanism_names())}, "
        f"and a file ends in {', '.join(FILE_SUFFIXES)}"
    )


def values_of(given: Numbers | None) -> tuple[float, ...] | None:
    """Return the numbers given, or None."""
    return None if given is None else given.values


def equilibrium_of(
    mechanism: "Mechanism", inputs: Numbers | None, number: int | None, load: Numbers | None
) -> "Equilibrium":
    """Return the equilibrium that is meant.

    Without inputs it is home; with them, what the branch of home leads to; with a number, that one of all equilibria at
    the inputs, or at home's.
    """
    import pcm_gym

    if number is not None:
        found = pcm_gym.solve_forward(mechanism, _inputs(mechanism, inputs), values_of(load))
        if number >= len(found):
            raise RefusalError(
                f"there is no equilibrium {number} at these inputs: there are {len(found)}, counted from 0"
            )
        return found[number]
    home = pcm_gym.home_equilibrium(mechanism, values_of(load))
    if inputs is None:
        return home
    step = pcm_gym.BranchTracker(mechanism, home).step(inputs.values)
    if step.event != pcm_gym.Event.NONE:
        raise RefusalError(
            f"the branch of home ends after {step.fraction:.1%} of the way to these inputs: {step.event.message} "
            "Name another equilibrium by --number, as `pcm-gym fk` counts them"
        )
    return step.equilibrium


def _inputs(mechanism: "Mechanism", inputs: Numbers | None) -> tuple[float, ...]:
    home = mechanism.home_inputs
    assert home is not None  # the middle of the limits by default
    return home if inputs is None else inputs.values


def home_inputs_or(mechanism: "Mechanism", inputs: Numbers | None) -> tuple[float, ...]:
    """Return the inputs given, or those of home."""
    return _inputs(mechanism, inputs)


def _known_names(incomplete: str) -> list[str]:
    from pcm_gym.environments.registration import ENVIRONMENTS  # which is quick to import, as completion must be

    names = dict.fromkeys([*(own.mechanism for own in ENVIRONMENTS), *(own.id for own in ENVIRONMENTS)])
    return [name for name in names if name.startswith(incomplete)]


MechanismName = Annotated[
    str,
    typer.Argument(
        metavar="MECHANISM",
        help="A mechanism by its name in the catalogue, or a file (.json, .yaml).",
        autocompletion=_known_names,
        show_default=False,
    ),
]
Name = Annotated[
    str,
    typer.Argument(
        metavar="ID",
        help="An environment by its id, or a mechanism by its name or file.",
        autocompletion=_known_names,
        show_default=False,
    ),
]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON, for scripts.")]
Inputs = Annotated[
    Numbers | None,
    typer.Option("--inputs", parser=numbers, metavar="NUMBERS", help="Actuator inputs, rad or m; home's by default."),
]
Load = Annotated[
    Numbers | None,
    typer.Option("--load", parser=numbers, metavar="NUMBERS", help="Load on the end-effector: N, N (and N m)."),
]
Number = Annotated[
    int | None,
    typer.Option(
        "--number", min=0, help="Which equilibrium at the inputs, as `fk` counts; by default the one on home's branch."
    ),
]
Certify = Annotated[
    bool, typer.Option("--certify", help="Prove that what is found at given inputs, or a pose, is complete; two legs.")
]
RhoMax = Annotated[
    float, typer.Option("--rho-max", help="Largest dimensionless load L sqrt(|f| / EI) of any rod, up to 30.")
]
