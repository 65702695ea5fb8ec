"""Commands that find all equilibria: at some inputs, and at a pose."""

from typing import TYPE_CHECKING, Annotated, Any

import typer

from pcm_gym.commands.arguments import (
    AsJson,
    Certify,
    Inputs,
    Load,
    MechanismName,
    Numbers,
    RhoMax,
    home_inputs_or,
    mechanism_of,
    numbers,
    values_of,
)
from pcm_gym.commands.output import EQUILIBRIUM_COLUMNS, equilibrium_data, equilibrium_rows, print_json, print_table

if TYPE_CHECKING:
    from pcm_gym import EquilibriumSet

StableOnly = Annotated[bool, typer.Option("--stable", help="Show the stable ones alone.")]


def fk(
    mechanism: MechanismName,
    inputs: Inputs = None,
    load: Load = None,
    rho_max: RhoMax = 9.0,
    certify: Certify = False,
    stable: StableOnly = False,
    as_json: AsJson = False,
) -> None:
    """Find every equilibrium at some inputs: forward kinematics."""
    import pcm_gym

    own = mechanism_of(mechanism)
    found = pcm_gym.solve_forward(own, home_inputs_or(own, inputs), values_of(load), rho_max, certify=certify)
    _tell(found, stable, as_json)


def ik(
    mechanism: MechanismName,
    pose: Annotated[
        Numbers, typer.Option("--pose", parser=numbers, metavar="NUMBERS", help="Pose: x,y or x,y,phi in m and rad.")
    ],
    load: Load = None,
    rho_max: RhoMax = 9.0,
    certify: Certify = False,
    stable: StableOnly = False,
    as_json: AsJson = False,
) -> None:
    """Find every equilibrium at a pose, with its inputs: inverse kinematics."""
    import pcm_gym

    found = pcm_gym.solve_inverse(mechanism_of(mechanism), pose.values, values_of(load), rho_max, certify=certify)
    _tell(found, stable, as_json)


def _tell(found: "EquilibriumSet", only_stable: bool, as_json: bool) -> None:
    numbered = [(number, each) for number, each in enumerate(found) if each.is_stable or not only_stable]
    if as_json:
        content: dict[str, Any] = {
            "equilibria": [{"number": number, **equilibrium_data(each)} for number, each in numbered],
            "families": [
                {"kind": own.kind, "dimension": own.dimension, "representative": equilibrium_data(own.representative)}
                for own in found.families
            ],
            "reason": found.reason,
            "certificate": None if found.certificate is None else str(found.certificate.status),
        }
        print_json(content)
        return
    rows = equilibrium_rows(each for _, each in numbered)
    if rows:
        numbers_kept = [number for number, _ in numbered]
        print_table(EQUILIBRIUM_COLUMNS, [(number, *row[1:]) for number, row in zip(numbers_kept, rows, strict=True)])
    stable_count = sum(each.is_stable for each in found)
    typer.echo(f"{len(found)} equilibria, {stable_count} stable" if len(found) else f"none: {found.reason}")
    for family in found.families:
        typer.echo(repr(family))
    if found.certificate is not None:
        typer.echo(f"completeness: {found.certificate.status}")
