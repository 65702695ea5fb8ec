"""The commands that chart what there is: over inputs and poses, and along a line."""

import sys
from enum import StrEnum
from pathlib import Path
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
from pcm_gym.commands.errors import RefusalError
from pcm_gym.commands.output import print_json, print_table

if TYPE_CHECKING:
    from pcm_gym import BifurcationDiagram


class Ordinate(StrEnum):
    """What a diagram shows over the way."""

    ENERGY = "energy"
    X = "x"
    Y = "y"
    PHI = "phi"


def atlas(
    mechanism: MechanismName,
    out: Annotated[Path | None, typer.Option("--out", help="File to keep the atlas in, .npz.")] = None,
    load: Load = None,
    rho_max: RhoMax = 9.0,
    pitch: Annotated[float | None, typer.Option(help="Pitch of the raster of positions, m.")] = None,
    input_cells: Annotated[int | None, typer.Option(help="Cells of the raster of inputs along each axis.")] = None,
    seed_nodes: Annotated[int | None, typer.Option(help="Inputs along each axis at which sheets are sought.")] = None,
    orientation: Annotated[float | None, typer.Option(help="Only this angle of a platform, rad.")] = None,
    as_json: AsJson = False,
) -> None:
    """Chart the stable equilibria over inputs and poses, branch by branch."""
    import pcm_gym

    chart = pcm_gym.build_atlas(
        mechanism_of(mechanism),
        values_of(load),
        rho_max,
        progress=sys.stderr.isatty(),
        pitch=pitch,
        input_cells=input_cells,
        seed_nodes=seed_nodes,
        orientation=orientation,
    )
    if out is not None:
        chart.save(out)
    branches = [
        {
            "number": branch.number,
            "pose_area": branch.workspace.area,
            "pose_area_error": branch.workspace.area_error,
            "input_area": branch.input_region.area,
            "input_area_error": branch.input_region.area_error,
            "contains_home": branch.contains_home,
            "largest_rho": branch.largest_rho,
        }
        for branch in chart.branches
    ]
    if as_json:
        counts = {"equilibria_over_poses": len(chart.over_poses), "equilibria_over_inputs": len(chart.over_inputs)}
        print_json({"mechanism": chart.mechanism.name, **counts, "branches": branches})
        return
    print_table(tuple(branches[0]), [tuple(row.values()) for row in branches])
    typer.echo("Branches that meet no seed, or are narrower than the pitch, may be missing.")
    if out is not None:
        typer.echo(f"written to {out}")


def diagram(
    mechanism: MechanismName,
    inputs: Inputs = None,
    load: Load = None,
    to: Annotated[
        Numbers | None, typer.Option("--to", parser=numbers, metavar="NUMBERS", help="Inputs at the end of the line.")
    ] = None,
    to_load: Annotated[
        Numbers | None,
        typer.Option("--to-load", parser=numbers, metavar="NUMBERS", help="Load at the end of the line."),
    ] = None,
    rho_max: RhoMax = 9.0,
    slices: Annotated[int, typer.Option(help="Complete sets of equilibria to find on the way.", min=1)] = 24,
    certify: Certify = False,
    out: Annotated[Path | None, typer.Option("--out", help="Picture to draw, .svg.")] = None,
    ordinate: Annotated[Ordinate, typer.Option(help="What the picture shows over the line.")] = Ordinate.ENERGY,
    as_json: AsJson = False,
) -> None:
    """Find every branch of equilibria along a line of inputs or load, with its folds: a bifurcation diagram."""
    import pcm_gym

    if to is None and to_load is None:
        raise typer.BadParameter("one of them is needed: where the line ends", param_hint="--to, --to-load")
    if out is not None and out.suffix.lower() != ".svg":
        raise RefusalError(f"{out} must end in .svg")
    own = mechanism_of(mechanism)
    first, first_load = home_inputs_or(own, inputs), own.check_load(values_of(load))
    along: dict[str, Any] = {
        "inputs": first if to is None else (own.check_inputs(first), own.check_inputs(to.values)),
        "load": first_load if to_load is None else (first_load, own.check_load(to_load.values)),
    }
    found = pcm_gym.bifurcation_diagram(
        own, along, rho_max, slices=slices, certify=certify, progress=sys.stderr.isatty()
    )
    if out is not None:
        from pcm_gym.rendering.diagram import diagram_svg

        out.write_text(diagram_svg(found, ordinate.value), encoding="utf-8")
    if as_json:
        print_json(_diagram_data(found))
        return
    _print_points(found)
    if certify:
        typer.echo(f"proved complete: {sum(each.is_proved for each in found.slices)} of {len(found.slices)} slices")
    typer.echo("A branch that meets no slice and crosses no other one may be missing.")
    if out is not None:
        typer.echo(f"written to {out}")


def _print_points(found: "BifurcationDiagram") -> None:
    columns = ("kind", "fraction", "indices", "branches", "pose", "inputs", "load", "energy")
    rows = []
    for point in found.points:
        there, branches = point.equilibrium, [number for number, _ in point.branches]
        place = (there.pose, there.inputs, there.load, there.energy)
        rows.append((point.kind.value, f"{point.fraction:.9f}", point.indices, branches, *place))
    if rows:
        print_table(columns, rows)
    typer.echo(f"{len(found.branches)} branches, {len(found.points)} special points")
    unfollowed = sum(len(each.unfollowed) for each in found.slices)
    if unfollowed:
        typer.echo(f"{unfollowed} singular equilibria could not be followed")


def _diagram_data(found: "BifurcationDiagram") -> dict[str, Any]:
    branches = [
        {
            "fraction": branch.fractions,
            "pose": branch.poses,
            "energy": branch.energies,
            "index": branch.indices,
            "is_stable": branch.is_stable,
            "stability_margin": branch.stability_margins,
            "singularity_margin": branch.singularity_margins,
            "special": branch.special,
            "ends": [str(end) for end in branch.ends],
        }
        for branch in found.branches
    ]
    points = [
        {
            "kind": str(point.kind),
            "fraction": point.fraction,
            "indices": point.indices,
            "branches": point.branches,
            "pose": point.equilibrium.pose,
            "inputs": point.equilibrium.inputs,
            "load": point.equilibrium.load,
        }
        for point in found.points
    ]
    slices = [{"fraction": each.fraction, "count": each.found, "is_proved": each.is_proved} for each in found.slices]
    return {
        "mechanism": found.mechanism.name,
        "inputs": found.way.inputs,
        "load": found.way.loads,
        "branches": branches,
        "points": points,
        "slices": slices,
    }
