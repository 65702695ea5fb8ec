"""The command that charts the workspace."""

import sys
from pathlib import Path
from typing import Annotated

import typer

from pcm_gym.commands.arguments import AsJson, Load, MechanismName, RhoMax, mechanism_of, values_of
from pcm_gym.commands.output import print_json, print_table


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
