"""The command line: ``python -m benchmarks`` with one of its commands; ``--help`` lists them."""

import itertools
import json
from collections.abc import Mapping
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer
from rich import print_json
from rich.console import Console
from rich.progress import Progress

import pcm_gym
from agents.benchmarking.tiers import tiers
from benchmarks import report
from benchmarks.against import HERE, Checkout, paired_ratios, print_ratios
from benchmarks.batch import make_batches, memory_per_environment, step_parts
from benchmarks.calibration import calibration
from benchmarks.certificates import print_tallies, try_paths
from benchmarks.endurance import endure, read_cases, write_cases
from benchmarks.explorer import browsed, explored, interact, take_pictures
from benchmarks.geometries import FAMILIES, search
from benchmarks.gradients import gradients
from benchmarks.kinematics import solve_and_search, table_cost
from benchmarks.machine import describe_machine
from benchmarks.margins import judge_margins
from benchmarks.peers import catalogue, table
from benchmarks.problems import MECHANISMS, make_problems
from benchmarks.references import PLANNER, as_json, judge, markdown
from benchmarks.shield import DIFFICULTIES, KINDS, defend
from benchmarks.single import PEERS, make_all, throughput
from benchmarks.startup import startup
from benchmarks.timing import Measure, Summary, interleave
from benchmarks.ways import judged
from pcm_gym.environments.settings import BEHAVIOURS
from pcm_gym.references import REFERENCES

Results = dict[str, dict[str, Summary]]


JsonPath = Annotated[Path | None, typer.Option("--json", help="Where to write the figures as JSON.")]

app = typer.Typer(
    no_args_is_help=True,
    help="Measure on this machine, beside others, in one run and in turn. "
    "Trust ratios within one run; other work on the machine moves all figures.",
)


@app.command()
def environments(
    repeats: Annotated[int, typer.Option(min=1, help="Measurements of each, in turn.")] = 5,
    seconds: Annotated[float, typer.Option(min=0.01, help="Length of one measurement.")] = 1.0,
    json_path: JsonPath = None,
    cold: Annotated[bool, typer.Option(help="Also time a first run, which compiles the kernels (a minute).")] = False,
) -> None:
    """Measure the environments beside others: medians, least and most of the repeats."""
    console, machine = _start()
    made, absent = make_all()
    ids = pcm_gym.environment_ids()
    with Progress(console=console, transient=True) as progress:
        single = _run(progress, "single", {name: throughput(env, seconds) for name, env in made.items()}, repeats)
        batches, batch_absent = make_batches(ids, seconds)
        batch = _run(progress, "batch", batches, repeats)
        memory = _run(progress, "memory", {name: memory_per_environment(name) for name in ids}, 1)
        parts = _run(progress, "parts", {name: step_parts(name) for name in ids}, repeats)
        starts = _run(progress, "start, warm", {f"{ids[0]}, warm": startup(ids[0])}, max(repeats, 3))
        if cold:
            starts |= _run(progress, "start, cold", {f"{ids[0]}, compiling": startup(ids[0], is_cold=True)}, 1)
    report.print_single(console, single, absent, PEERS)
    report.print_batch(console, batch, batch_absent)
    report.print_parts(console, parts, memory)
    report.print_startup(console, starts)
    results = {"single": single, "batch": batch, "parts": parts, "memory": memory, "startup": starts}
    _write(console, json_path, {"machine": machine, "absent": absent | batch_absent}, results)


@app.command()
def start(
    environment_id: Annotated[str, typer.Argument(help="Environment that is made, reset and stepped once.")] = (
        "PCM/2RFR-Reach-v0"
    ),
    repeats: Annotated[int, typer.Option(min=1, help="Warm starts.")] = 5,
    cold: Annotated[bool, typer.Option(help="Also start once with an empty cache, which compiles the kernels.")] = True,
    json_path: JsonPath = None,
) -> None:
    """Measure from a fresh process to the first step, with compiled kernels and with none.

    The processor's seconds are those to compare; they too grow where others use the machine.
    """
    console, machine = _start()
    starts: dict[str, dict[str, Summary]] = {}
    if cold:
        name = f"{environment_id}, compiling"
        starts |= interleave({name: startup(environment_id, is_cold=True, show_progress=True)}, 1, lambda: None)
    starts |= interleave({f"{environment_id}, warm": startup(environment_id)}, repeats, lambda: None)
    report.print_startup(console, starts)
    _write(console, json_path, {"machine": machine}, {"startup": starts})


@app.command()
def kinematics(
    problems: Annotated[int, typer.Option(min=1, help="Position problems of each kind.")] = 6,
    repeats: Annotated[int, typer.Option(min=1, help="Measurements of each, in turn.")] = 1,
    seconds: Annotated[float, typer.Option(min=0.01, help="Longest search from random starts, processor time.")] = 3.0,
    json_path: JsonPath = None,
) -> None:
    """Measure how long every solution of the position problem takes, beside searches from random starts.

    The searches use SciPy and NumPy alone. About two minutes of processor time; more problems, more repeats and longer
    searches take more.
    """
    console, machine = _start()
    results: dict[str, Results] = {}
    with Progress(console=console, transient=True) as progress:
        kinds = list(itertools.product((False, True), MECHANISMS))
        making = progress.add_task("problems, kernels", total=len(kinds))
        families = {}
        for is_inverse, name in kinds:
            families[f"{'inverse' if is_inverse else 'forward'} {name}"] = make_problems(
                name, problems, is_inverse=is_inverse
            )
            progress.advance(making)
        for family, members in families.items():
            measures = {f"problem {n}": solve_and_search(problem, seconds) for n, problem in enumerate(members, 1)}
            results[family] = _run(progress, family, measures, repeats)
        # last, because they push the tables in use out of the solvers' memory
        costs = {members[0].kind: table_cost(members[0]) for members in families.values()}
        tables = _run(progress, "tables", costs, repeats)
    report.print_solvers(console, results)
    report.print_tables(console, tables)
    report.print_searches(console, results, seconds)
    _write(console, json_path, {"machine": machine}, results | {"tables": tables})


@app.command()
def peers(
    only: Annotated[
        list[str] | None, typer.Option(help="Part of a peer's name; may be given several times. Ours always run.")
    ] = None,
    repeats: Annotated[int, typer.Option(min=1, help="Measurements of each, in turn.")] = 5,
    seconds: Annotated[float, typer.Option(min=0.01, help="Length of one measurement.")] = 1.0,
    json_path: JsonPath = None,
    page: Annotated[Path | None, typer.Option(help="Page whose marked part is written anew.")] = None,
) -> None:
    """Measure one small step of the 2RFR beside other simulators and solvers, and its error beside theirs.

    About four minutes, half of which others take to compile.
    """
    names = [name for name in catalogue.PEERS if only is None or any(part.lower() in name.lower() for part in only)]
    if not names:
        raise typer.BadParameter(f"must be part of one of {list(catalogue.PEERS)}, got {only}", param_hint="--only")
    console, machine = _start()
    with Progress(console=console, transient=True) as progress:
        making = progress.add_task("peers made ready", total=len(catalogue.OURS) + len(names))
        ready = catalogue.prepare(names, seconds, lambda: progress.advance(making))
        found = _run(progress, "peers", ready.measures, repeats)
    table.print_peers(console, found, ready.setups, ready.absent)
    _write(console, json_path, {"machine": machine, "absent": ready.absent, "setups": ready.setups}, {"peers": found})
    if page is not None:
        table.write_page(page, machine, found, ready.setups, ready.absent)
        console.print(f"Table written to {page}")


@app.command()
def endurance(
    steps: Annotated[int, typer.Option(min=1, help="Steps of each mechanism with each behaviour.")] = 1_000_000,
    mechanisms: Annotated[list[str] | None, typer.Option("--mechanism", help="Only these; all by default.")] = None,
    behaviours: Annotated[
        list[str] | None, typer.Option("--on-instability", help="Only these; all by default.")
    ] = None,
    step_size: Annotated[float, typer.Option(min=0.0, help="Increments in terms of the default ones.")] = 1.0,
    seed: Annotated[int, typer.Option()] = 0,
    json_path: JsonPath = None,
    cases_path: Annotated[Path, typer.Option("--cases", help="Where to keep failures and contradictions.")] = Path(
        "endurance-cases.json"
    ),
    replay: Annotated[Path | None, typer.Option(help="Repeat the steps kept in this file, and nothing else.")] = None,
) -> None:
    """Drive every environment by chance and into folds and limits, and check every step; some minutes.

    A step in which something does not fit together is a contradiction. The exit status is 1 if there is one.
    """
    if replay is not None:
        for case in read_cases(replay):
            print_json(data={**asdict(case), "now": case.repeat()})
        return
    console, machine = _start()
    names = mechanisms or list(MECHANISMS)
    ids = [name for name in pcm_gym.environment_ids() if name in {f"PCM/{own}-Reach-v0" for own in names}]
    chosen = list(itertools.product(ids, behaviours or BEHAVIOURS))
    tallies = []
    with Progress(console=console, transient=True) as progress:
        for environment_id, on_instability in chosen:
            task = progress.add_task(f"{environment_id}, {on_instability}", total=steps)
            advance = partial(progress.advance, task)
            tallies.append(endure(environment_id, on_instability, steps, step_size, seed, advance))
    report.print_endurance(console, tallies)
    if json_path is not None:
        json_path.write_text(
            json.dumps({"machine": machine, "endurance": [tally.as_dict() for tally in tallies]}, indent=2) + "\n"
        )
        console.print(f"Figures written to {json_path}")
    if any(tally.cases for tally in tallies):
        console.print(f"{write_cases(cases_path, tallies)} steps kept in {cases_path}; --replay repeats them")
    if any(tally.contradictions for tally in tallies):
        raise typer.Exit(1)


@app.command()
def against(
    checkout: Annotated[Path, typer.Argument(help="Root of the other checkout, as `git worktree add` makes one.")],
    only: Annotated[str, typer.Option(help="Only measures whose name holds this.")] = "",
    pairs: Annotated[int, typer.Option(min=1, help="Pairs of each measurement.")] = 10,
    json_path: JsonPath = None,
) -> None:
    """Time this checkout and another one in turn: batches, single environments, forward and inverse sets.

    The first run compiles the kernels of both. A checkout is best compared with itself first: what is seen then is what
    the machine adds.
    """
    console, machine = _start()
    try:
        mine, other = Checkout(HERE), Checkout(checkout.resolve())
    except ValueError as error:
        raise typer.BadParameter(str(error), param_hint="CHECKOUT") from error
    chosen = [name for name in mine.measures if only in name]
    if not chosen:
        raise typer.BadParameter(f"must be part of one of {mine.measures}, got {only!r}", param_hint="--only")
    ratios = {}
    with Progress(console=console, transient=True) as progress:
        task = progress.add_task("pairs", total=len(chosen) * pairs)
        for name in chosen:
            progress.update(task, description=name)
            ratios[name] = paired_ratios(name, mine, other, pairs, lambda: progress.advance(task))
    for own in (mine, other):
        own.close()
    print_ratios(console, ratios)
    if json_path is not None:
        json_path.write_text(json.dumps({"machine": machine, "ratios": ratios}, indent=2) + "\n")
        console.print(f"Figures written to {json_path}")


@app.command()
def shield(
    steps: Annotated[int, typer.Option(min=1, help="Steps of each mechanism with each behaviour.")] = 20_000,
    mechanisms: Annotated[list[str] | None, typer.Option("--mechanism", help="Only these; all by default.")] = None,
    behaviours: Annotated[
        list[str] | None, typer.Option("--on-instability", help="Only these; all by default.")
    ] = None,
    difficulties: Annotated[
        list[str] | None, typer.Option("--with", help=f"Of {list(DIFFICULTIES)}; all of it at once by default.")
    ] = None,
    kinds: Annotated[list[str] | None, typer.Option("--kind", help=f"Of {list(KINDS)}; both by default.")] = None,
    json_path: JsonPath = None,
) -> None:
    """Drive shielded environments towards folds and count what is lost, beside the same without a shield.

    The exit status is 1 if a shield loses stability, or does not keep its margin.
    """
    console, machine = _start()
    names = mechanisms or list(MECHANISMS)
    chosen = list(itertools.product(names, difficulties or ["all"], behaviours or BEHAVIOURS, kinds or KINDS))
    found = []
    with Progress(console=console, transient=True) as progress:
        for case in chosen:
            task = progress.add_task(", ".join(case), total=2 * steps)
            found.append(tuple(defend(*case, steps, partial(progress.advance, task))))
    report.print_defences(console, found)
    if json_path is not None:
        figures = [[asdict(defence) for defence in pair] for pair in found]
        json_path.write_text(json.dumps({"machine": machine, "shield": figures}, indent=2) + "\n")
        console.print(f"Figures written to {json_path}")
    if any(shielded.losses or shielded.failures or shielded.below for shielded, _ in found):
        raise typer.Exit(1)


@app.command()
def certificates(
    paths: Annotated[int, typer.Option(min=0, help="Random paths of each mechanism without an event.")] = 1000,
    mutations: Annotated[int, typer.Option(min=0, help="Paths of each mechanism that are wrong on purpose.")] = 1000,
    mechanisms: Annotated[list[str] | None, typer.Option("--mechanism", help="Only these; all by default.")] = None,
    seed: Annotated[int, typer.Option()] = 0,
    json_path: JsonPath = None,
) -> None:
    """Prove random paths of five steps of an agent, and time that; try to prove wrong ones. Some minutes.

    The exit status is 1 if a wrong path is proved.
    """
    console, machine = _start()
    tallies = []
    with Progress(console=console, transient=True) as progress:
        for name in mechanisms or MECHANISMS:
            task = progress.add_task(name, total=paths + mutations)
            tallies.append(try_paths(name, paths, mutations, seed, partial(progress.advance, task)))
    print_tallies(console, tallies)
    if json_path is not None:
        json_path.write_text(
            json.dumps({"machine": machine, "certificates": [tally.as_dict() for tally in tallies]}, indent=2) + "\n"
        )
        console.print(f"Figures written to {json_path}")
    if any(sum(tally.proved_mutations.values()) for tally in tallies):
        raise typer.Exit(1)


@app.command()
def training(
    environment_id: Annotated[str, typer.Argument(help="Environment that is learnt.")] = "PCM/2RFR-Reach-v0",
    num_envs: Annotated[int, typer.Option(min=1, help="Environments side by side.")] = 1024,
    activation: Annotated[str, typer.Option(help="Activation function of the networks.")] = "relu",
    rollouts: Annotated[int, typer.Option(min=1, help="Rollouts of 16 steps in one measurement.")] = 4,
    repeats: Annotated[int, typer.Option(min=1, help="Measurements of each, in turn.")] = 5,
    json_path: JsonPath = None,
) -> None:
    """Measure steps of a batch, with inference, and with learning, beside Stable-Baselines3's own loop."""
    from benchmarks.training import make_loops, print_training  # it loads torch, which the others do without

    console, machine = _start()
    with Progress(console=console, transient=True) as progress:
        loops = make_loops(environment_id, num_envs, activation, rollouts)
        found = _run(progress, "training", loops, repeats)
    print_training(console, found)
    _write(console, json_path, {"machine": machine}, {"training": found})


@app.command()
def explorer(
    interactions: Annotated[int, typer.Option(min=1, help="Drags, keys, clicks and choices.")] = 1000,
    mechanism: Annotated[str, typer.Option(help="Which one is explored.")] = "2RFR",
    most: Annotated[float, typer.Option(help="Largest 95th percentile of an answer, ms.")] = 100.0,
    seed: Annotated[int, typer.Option()] = 0,
    pictures: Annotated[Path | None, typer.Option(help="Folder for pictures of the page, wide and narrow.")] = None,
    json_path: JsonPath = None,
) -> None:
    """Use the explorer at random in headless Chromium; a quarter of an hour.

    The exit status is 1 if answers took longer, or anything went wrong.
    """
    console, _ = _start()
    with explored(mechanism) as address, browsed(address) as page:
        if pictures is not None:
            take_pictures(page, pictures)
        found = interact(page, interactions, seed)
    console.print(found)
    if json_path is not None:
        json_path.write_text(json.dumps(asdict(found), indent=2) + "\n", encoding="utf-8")
    raise typer.Exit(int(found.percentile > most or bool(found.errors)))


@app.command()
def margins(
    states: Annotated[int, typer.Option(min=2, help="States of each mechanism.")] = 10_000,
    mechanisms: Annotated[list[str] | None, typer.Option("--mechanism", help="Only these; all by default.")] = None,
    seed: Annotated[int, typer.Option()] = 0,
    json_path: JsonPath = None,
) -> None:
    """Judge the singularity margin by the nearest fold, at states anywhere and beside folds; a quarter of an hour.

    The exit status is 1 if more than 1 % of the states within an environment's threshold are called safe, or more than
    20 % of those outside are not.
    """
    console, machine = _start()
    names = mechanisms or list(MECHANISMS)
    found = []
    with Progress(console=console, transient=True) as progress:
        for name in names:
            task = progress.add_task(name, total=states)
            found.append(judge_margins(name, states, seed, partial(progress.advance, task)))
    report.print_margins(console, found)
    if json_path is not None:
        figures = {
            judged.name: [asdict(judged.calls(threshold)) for threshold in judged.thresholds] for judged in found
        }
        json_path.write_text(json.dumps({"machine": machine, "margins": figures}, indent=2) + "\n")
        console.print(f"Figures written to {json_path}")
    own = [judged.calls(judged.threshold) for judged in found]
    if any(calls.missed_part > 0.01 or calls.false_part > 0.2 for calls in own):
        raise typer.Exit(1)


@app.command()
def ways(
    count: Annotated[int, typer.Option(min=1, help="Random ways.")] = 20_000,
    seed: Annotated[int, typer.Option()] = 0,
) -> None:
    """Go random ways along branches in one step and in many parts; two milliseconds each.

    The exit status is 1 if a step came to something else than the same way in parts.
    """
    console, _ = _start()
    with Progress(console=console, transient=True) as progress:
        task = progress.add_task("ways", total=count)
        tally = judged(count, seed, partial(progress.advance, task))
    report.print_ways(console, tally)
    if tally.jumps:
        raise typer.Exit(1)


@app.command()
def references(
    ids: Annotated[list[str] | None, typer.Option("--id", help="Only these environments; all by default.")] = None,
    names: Annotated[list[str] | None, typer.Option("--reference", help="Only these; all by default.")] = None,
    episodes: Annotated[int, typer.Option(min=1, help="Episodes of each tier, for each reference.")] = 1000,
    split: Annotated[str, typer.Option(help="Which episodes: train or test.")] = "test",
    path: Annotated[Path, typer.Option("--page", help="Where to write the table.")] = Path("docs/references.md"),
    json_path: JsonPath = None,
) -> None:
    """Let the references act in every tier of every environment: an hour for all, 1,000 episodes each."""
    for given, known in ((ids, pcm_gym.environment_ids()), (names, tuple(REFERENCES))):
        for name in given or ():
            if name not in known:
                raise typer.BadParameter(f"must be one of {list(known)}, got {name!r}")
    console, machine = _start()
    chosen, found = names or list(REFERENCES), tiers(ids or pcm_gym.environment_ids(), split)
    scores, refusals = [], []
    with Progress(console=console, transient=True) as progress:
        task = progress.add_task("tiers", total=len(found))
        for tier in found:
            own = progress.add_task(f"{tier.id} {tier.name}", total=episodes * len({PLANNER, *chosen}))
            of_tier, refusal = judge(tier, chosen, episodes, partial(progress.advance, own))
            scores += of_tier
            refusals += [refusal] if refusal else []
            progress.remove_task(own)
            progress.advance(task)
    path.write_text(markdown(scores, refusals, f"{episodes} episodes of the split {split!r} each."))
    console.print(f"Table written to {path}")
    if json_path is not None:
        json_path.write_text(json.dumps({"machine": machine, **as_json(scores, refusals)}, indent=2) + "\n")
        console.print(f"Figures written to {json_path}")


@app.command()
def geometries(
    path: Annotated[Path, typer.Argument(help="Where to write what is found, line by line; it may hold some already.")],
    families: Annotated[
        list[str] | None, typer.Option("--family", help=f"Of {list(FAMILIES)}; all by default.")
    ] = None,
    count: Annotated[int, typer.Option(min=1, help="Points of each family's sequence.")] = 256,
) -> None:
    """Search for geometries that could be built and are worth controlling; some seconds for each point."""
    with Progress(transient=True) as progress:
        for name in families or FAMILIES:
            task = progress.add_task(name, total=count)
            search(name, count, path, partial(progress.advance, task))


app.command()(gradients)
app.command()(calibration)


def _start() -> tuple[Console, dict[str, str]]:
    console = Console(width=None if Console().is_terminal else 150)
    machine = describe_machine()
    report.print_machine(console, machine)
    return console, machine


def _run(progress: Progress, title: str, measures: Mapping[str, Measure], count: int) -> Results:
    task = progress.add_task(title, total=len(measures) * count)
    return interleave(measures, count, lambda: progress.advance(task))


def _write(console: Console, path: Path | None, conditions: dict[str, Any], results: dict[str, Results]) -> None:
    if path is None:
        return
    figures = {
        group: {name: {key: summary.as_dict() for key, summary in found.items()} for name, found in of_group.items()}
        for group, of_group in results.items()
    }
    path.write_text(json.dumps({**conditions, **figures}, indent=2) + "\n")
    console.print(f"Figures written to {path}")


if __name__ == "__main__":
    app()
