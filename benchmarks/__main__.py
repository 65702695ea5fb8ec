"""The command line: ``python -m benchmarks``."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.progress import Progress

import pcm_gym
from benchmarks import report
from benchmarks.batch import make_batches, memory_per_environment, step_parts
from benchmarks.machine import describe_machine
from benchmarks.single import PEERS, make_all, throughput
from benchmarks.startup import startup
from benchmarks.timing import Measure, Summary, interleave

Results = dict[str, dict[str, Summary]]


def main(
    repeats: Annotated[int, typer.Option(min=1, help="Measurements of each, in turn.")] = 5,
    seconds: Annotated[float, typer.Option(min=0.01, help="Length of one measurement.")] = 1.0,
    json_path: Annotated[Path | None, typer.Option("--json", help="Where to write the figures as JSON.")] = None,
    cold: Annotated[bool, typer.Option(help="Also time a first run, which compiles the kernels (a minute).")] = False,
) -> None:
    """Measure the environments beside others, in one run and in turn: medians, least and most of the repeats.

    Trust ratios within one run; other work on the machine moves all figures.
    """
    console = Console(width=None if Console().is_terminal else 150)
    machine = describe_machine()
    report.print_machine(console, machine)
    environments, absent = make_all()
    ids = pcm_gym.environment_ids()
    with Progress(console=console, transient=True) as progress:

        def run(title: str, measures: Mapping[str, Measure], count: int) -> Results:
            task = progress.add_task(title, total=len(measures) * count)
            return interleave(measures, count, lambda: progress.advance(task))

        single = run("single", {name: throughput(env, seconds) for name, env in environments.items()}, repeats)
        batches, batch_absent = make_batches(ids, seconds)
        batch = run("batch", batches, repeats)
        memory = run("memory", {name: memory_per_environment(name) for name in ids}, 1)
        parts = run("parts", {name: step_parts(name) for name in ids}, repeats)
        starts = run("start, warm", {f"{ids[0]}, warm": startup(ids[0])}, max(repeats, 3))
        if cold:
            starts |= run("start, cold", {f"{ids[0]}, compiling": startup(ids[0], is_cold=True)}, 1)
    report.print_single(console, single, absent, PEERS)
    report.print_batch(console, batch, batch_absent)
    report.print_parts(console, parts, memory)
    report.print_startup(console, starts)
    if json_path is not None:
        results = {"single": single, "batch": batch, "parts": parts, "memory": memory, "startup": starts}
        _write(json_path, machine, absent | batch_absent, results)
        console.print(f"Figures written to {json_path}")


def _write(path: Path, machine: dict[str, str], absent: dict[str, str], results: dict[str, Results]) -> None:
    figures = {
        group: {name: {key: summary.as_dict() for key, summary in found.items()} for name, found in of_group.items()}
        for group, of_group in results.items()
    }
    path.write_text(json.dumps({"machine": machine, "absent": absent, **figures}, indent=2) + "\n")


if __name__ == "__main__":
    typer.run(main)
