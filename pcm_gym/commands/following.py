"""Commands that follow one equilibrium: along its branch, to its nearest fold, and down from there."""

from typing import TYPE_CHECKING, Annotated, Any

import typer

from pcm_gym.commands.arguments import (
    AsJson,
    Inputs,
    Load,
    MechanismName,
    Number,
    Numbers,
    equilibrium_of,
    mechanism_of,
    numbers,
    values_of,
)
from pcm_gym.commands.errors import RefusalError
from pcm_gym.commands.output import (
    EQUILIBRIUM_COLUMNS,
    equilibrium_data,
    equilibrium_rows,
    print_json,
    print_lines,
    print_table,
)

if TYPE_CHECKING:
    from pcm_gym import Equilibrium

Targets = Annotated[
    list[Numbers] | None,
    typer.Option("--to", parser=numbers, metavar="NUMBERS", help="Inputs to go to; may be given several times."),
]


def track(
    mechanism: MechanismName,
    to: Targets = None,
    inputs: Inputs = None,
    number: Number = None,
    load: Load = None,
    certify: Annotated[bool, typer.Option("--certify", help="Prove that one branch leads there.")] = False,
    follow_index_changes: Annotated[
        bool, typer.Option("--follow-index-changes", help="Go on through bifurcations, with another index.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Follow a branch along straight lines of inputs, until it ends."""
    import pcm_gym

    if not to:
        raise typer.BadParameter("is needed: the inputs to go to", param_hint="--to")
    own = mechanism_of(mechanism)
    start = equilibrium_of(own, inputs, number, load)
    tracker = pcm_gym.BranchTracker(own, start, follow_index_changes=follow_index_changes, certify=certify)
    steps = []
    for target in to:
        steps.append(tracker.step(target.values))
        if steps[-1].event != pcm_gym.Event.NONE:
            break
    if as_json:
        print_json(
            {
                "start": equilibrium_data(start),
                "steps": [
                    {
                        "event": str(step.event),
                        "fraction": step.fraction,
                        "certificate": None if step.certificate is None else step.certificate.status,
                        "equilibrium": equilibrium_data(step.equilibrium),
                    }
                    for step in steps
                ],
            }
        )
        return
    _print_equilibrium("start", start)
    for step in steps:
        typer.echo(f"\n{step.fraction:.6%} of the way: {step.event.message}")
        if step.certificate is not None:
            typer.echo(f"the way: {step.certificate.status}")
        _print_equilibrium("there", step.equilibrium)


def plan(
    mechanism: MechanismName,
    pose: Annotated[
        Numbers | None, typer.Option("--pose", parser=numbers, metavar="NUMBERS", help="Goal: a pose, in any mode.")
    ] = None,
    to: Annotated[
        Numbers | None, typer.Option("--to", parser=numbers, metavar="NUMBERS", help="Goal: inputs, in any mode.")
    ] = None,
    inputs: Inputs = None,
    number: Number = None,
    load: Load = None,
    step: Annotated[
        Numbers | None, typer.Option("--step", parser=numbers, metavar="NUMBERS", help="Longest step of each input.")
    ] = None,
    least_margin: Annotated[
        float | None, typer.Option("--least-margin", help="Distance to keep from folds, rad and mean rod lengths.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Plan a motion that never loses stability: to a pose, to inputs, or to both at once."""
    import pcm_gym

    goal = {key: given.values for key, given in (("pose", pose), ("inputs", to)) if given is not None}
    if not goal:
        raise typer.BadParameter("one of them is needed: the goal", param_hint="--pose, --to")
    start = equilibrium_of(mechanism_of(mechanism), inputs, number, load)
    motion = pcm_gym.plan_motion(start, goal, step=values_of(step), least_margin=least_margin)
    if as_json:
        places = [equilibrium_data(each) for each in motion.equilibria]
        print_json({"length": motion.length, "inputs": motion.inputs, "equilibria": places})
        return
    print_table(EQUILIBRIUM_COLUMNS, equilibrium_rows(motion.equilibria))
    print_lines({"steps": motion.length})


def fold(
    mechanism: MechanismName,
    inputs: Inputs = None,
    number: Number = None,
    load: Load = None,
    reach: Annotated[float | None, typer.Option("--reach", help="Largest distance, rad and mean rod lengths.")] = None,
    as_json: AsJson = False,
) -> None:
    """Find the fold that is nearest in the space of the inputs."""
    import pcm_gym

    start = equilibrium_of(mechanism_of(mechanism), inputs, number, load)
    found = pcm_gym.nearest_fold(start, reach)
    if as_json:
        content: dict[str, Any] = {"start": equilibrium_data(start), "fold": None}
        if found is not None:
            there = equilibrium_data(found.equilibrium)
            content["fold"] = {"distance": found.distance, "direction": found.direction, "equilibrium": there}
        print_json(content)
        return
    _print_equilibrium("start", start)
    if found is None:
        typer.echo("\nno fold within reach")
        return
    typer.echo("")
    print_lines({"distance": found.distance, "direction": found.direction})
    _print_equilibrium("fold", found.equilibrium)


def snap(
    mechanism: MechanismName,
    to: Annotated[
        Numbers | None,
        typer.Option(
            "--to",
            parser=numbers,
            metavar="NUMBERS",
            help="Inputs on the way to which it folds.",
        ),
    ] = None,
    inputs: Inputs = None,
    number: Number = None,
    load: Load = None,
    as_json: AsJson = False,
) -> None:
    """Tell where the mechanism falls: from an unstable equilibrium, or from the fold that it meets."""
    import pcm_gym

    start = equilibrium_of(mechanism_of(mechanism), inputs, number, load)
    edge = _edge(start, to)
    fall = pcm_gym.snap(edge)
    if as_json:
        print_json(
            {
                "from": equilibrium_data(edge),
                "status": str(fall.status),
                "energy_released": fall.energy_released,
                "landing": equilibrium_data(fall.equilibrium) if fall.is_landed else None,
            }
        )
        return
    _print_equilibrium("from", edge)
    typer.echo(f"\n{fall.status.message}")
    if fall.is_landed:
        print_lines({"energy released": fall.energy_released})
        _print_equilibrium("landing", fall.equilibrium)


def _edge(start: "Equilibrium", to: Numbers | None) -> "Equilibrium":
    """Return where stability is lost: here if there is none, on the way to some inputs, or at the nearest fold."""
    import pcm_gym

    if to is None and not start.is_stable:
        return start
    if to is None:
        nearest = pcm_gym.nearest_fold(start)
        if nearest is None:
            raise RefusalError("there is no fold within the actuators' ranges: nothing to snap from")
        return nearest.equilibrium
    step = pcm_gym.BranchTracker(start.mechanism, start).step(to.values)
    if step.event not in (pcm_gym.Event.FOLD, pcm_gym.Event.INDEX_CHANGE):
        raise RefusalError(f"nothing to snap from: the way to these inputs loses no stability. {step.event.message}")
    return step.equilibrium


def _print_equilibrium(title: str, equilibrium: "Equilibrium") -> None:
    print_lines(
        {
            title: "",
            "  pose": equilibrium.pose,
            "  inputs": equilibrium.inputs,
            "  modes": equilibrium.modes,
            "  index": "0, stable" if equilibrium.is_stable else equilibrium.index,
            "  energy": equilibrium.energy,
            "  stability margin": equilibrium.stability_margin,
            "  singularity margin": equilibrium.singularity_margin,
        }
    )
