"""Tables of the figures."""

import math
import statistics
from collections.abc import Mapping, Sequence

import numpy as np
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from benchmarks.endurance import Tally
from benchmarks.kinematics import LONG
from benchmarks.margins import Judged
from benchmarks.multistart import METHODS
from benchmarks.shield import Defence
from benchmarks.startup import STAGES
from benchmarks.timing import Summary
from pcm_gym.solving import Event

_COUNTED = (Event.FOLD, Event.INDEX_CHANGE, Event.ACTUATOR_LIMIT, Event.SOLVER_FAILURE)

Summaries = Mapping[str, Mapping[str, Summary]]


def print_machine(console: Console, machine: Mapping[str, str]) -> None:
    console.print(
        "  ".join(f"[dim]{key}[/dim] {value}" for key, value in machine.items()), highlight=False, soft_wrap=True
    )


def print_single(console: Console, single: Summaries, absent: Mapping[str, str], peers: tuple[str, ...]) -> None:
    table = _table("One environment, random actions, full info: steps per second")
    present = [peer for peer in peers if peer in single]
    for heading in ("with resets", "min - max", "without", "min - max", "a reset, us", "episode"):
        table.add_column(heading, justify="right", no_wrap=True)
    for peer in present:
        table.add_column(f"of {peer.partition('-')[0]}", justify="right", no_wrap=True)
    for name, figures in single.items():
        rate, without = figures["steps_per_second"], figures["steps_per_second_without_resets"]
        ratios = [f"{rate.median / single[peer]['steps_per_second'].median:.2f}" for peer in present]
        table.add_row(
            name,
            _count(rate.median),
            _range(rate),
            _count(without.median),
            _range(without),
            f"{figures['reset_microseconds'].median:.0f}",
            f"{figures['steps_per_episode'].median:.0f}",
            *ratios,
        )
    for name, reason in absent.items():
        table.add_row(name, "absent")
        console.print(f"[dim]{name} is absent: {escape(reason)}[/dim]", highlight=False)
    console.print(table)


def print_batch(console: Console, batch: Summaries, absent: Mapping[str, str]) -> None:
    table = _table("Batches, random actions, full info, resets included")
    for heading in ("steps per second", "min - max", "a reset of all, in steps"):
        table.add_column(heading, justify="right", no_wrap=True)
    for name, figures in batch.items():
        rate = figures["steps_per_second"]
        table.add_row(name, _count(rate.median), _range(rate), f"{figures['reset_in_steps'].median:.1f}")
    for name, reason in absent.items():
        table.add_row(name, "absent")
        console.print(f"[dim]{name} is absent: {escape(reason)}[/dim]", highlight=False)
    console.print(table)


def print_parts(console: Console, parts: Summaries, memory: Summaries) -> None:
    """One row per mechanism: what the parts of a row's step take, and how it would be row by row."""
    table = _table("Where the time of a batched step goes: microseconds per environment, one thread, 1024 environments")
    headings = {
        "solve": "solve",
        "stability": "stability",
        "alone": "rows alone",
        "observation": "observation",
        "python": "Python",
        "total": "total",
        "all_alone": "kernel, all alone",
    }
    for heading in (*headings.values(), "rows alone, share", "bytes held each"):
        table.add_column(heading, justify="right", no_wrap=True)
    for name, figures in parts.items():
        times = [f"{figures[key].median:.2f}" for key in headings]
        table.add_row(name, *times, f"{figures['refused'].median:.1%}", _count(memory[name]["bytes"].median))
    console.print(table)


def print_startup(console: Console, startup: Summaries) -> None:
    table = _table("A fresh process: seconds, and of those the processor's")
    for heading in ("total", "min - max", "import gymnasium", "import pcm_gym", "make", "reset", "first step"):
        table.add_column(heading, justify="right", no_wrap=True)
    for name, figures in startup.items():
        for label, unit in ((name, "seconds"), ("  processor", "processor_seconds")):
            total = figures[f"total_{unit}"]
            table.add_row(
                label,
                f"{total.median:.2f}",
                f"{total.least:.2f} - {total.most:.2f}",
                *(f"{figures[f'{stage}_{unit}'].median:.2f}" for stage in STAGES),
            )
    console.print(table)


def print_endurance(console: Console, tallies: Sequence[Tally]) -> None:
    table = _table("Random and adversarial steps; events per 100,000 of them")
    headings = (
        "steps",
        "episodes",
        *(str(event).replace("_", " ") for event in _COUNTED),
        "index > 0",
        "contradictions",
    )
    for heading in headings:
        table.add_column(heading, justify="right", no_wrap=True)
    for tally in tallies:
        table.add_row(
            f"{tally.environment_id}, {tally.on_instability}",
            _count(tally.steps),
            _count(tally.episodes),
            *(f"{tally.per_100_000(event):.1f}" for event in _COUNTED),
            f"{1e5 * tally.unstable_steps / tally.steps:.0f}",
            str(tally.contradictions.total()),
        )
        for reason, count in tally.contradictions.items():
            console.print(f"{tally.environment_id}, {tally.on_instability}: not {reason!r} in {count} steps")
    console.print(table)


def print_defences(console: Console, found: Sequence[Sequence[Defence]]) -> None:
    table = _table("Adversarial steps with a shield, and without")
    headings = ("steps", "replaced", "losses", "failures", "below the margin", "least margin", "losses without")
    for heading in headings:
        table.add_column(heading, justify="right", no_wrap=True)
    for shielded, without in found:
        table.add_row(
            shielded.name,
            _count(shielded.steps),
            _count(shielded.replaced),
            str(shielded.losses),
            str(shielded.failures),
            str(shielded.below),
            f"{shielded.least_margin:.7f}",
            _count(without.losses),
        )
    console.print(table)


def print_margins(console: Console, found: Sequence[Judged]) -> None:
    """Print what margins say at the environments' thresholds, marked, and at others."""
    table = _table("Singularity margins, judged by the nearest fold")
    headings = ("threshold", "within", "called safe", "outside", "not called safe", "of alarms false")
    for heading in headings:
        table.add_column(heading, justify="right", no_wrap=True)
    for judged in found:
        for threshold in judged.thresholds:
            calls = judged.calls(threshold)
            table.add_row(
                f"{judged.name}, environments" if threshold == judged.threshold else judged.name,
                f"{threshold:g}",
                _count(calls.within),
                f"{100.0 * calls.missed_part:.2f} %",
                _count(calls.outside),
                f"{100.0 * calls.false_part:.1f} %",
                f"{100.0 * calls.false_part_of_alarms:.1f} %",
            )
    console.print(table)
    for judged in found:
        least, median, most = judged.ratios()
        console.print(f"{judged.name}: margin over distance {median:.2f}, in 98 of 100 {least:.2f} to {most:.2f}")


def print_solvers(console: Console, families: Mapping[str, Summaries]) -> None:
    table = _table("Every equilibrium of a position problem: milliseconds of processor time")
    for heading in ("problems", "solutions", "of one", "median", "quartiles", "most"):
        table.add_column(heading, justify="right", no_wrap=True)
    for family, members in families.items():
        times = [1e3 * time for time in _medians(members, "seconds")]
        counts = _medians(members, "solutions")
        lower, median, upper = np.percentile(times, (25.0, 50.0, 75.0))
        table.add_row(
            family,
            str(len(members)),
            f"{sum(counts):.0f}",
            f"{min(counts):.0f} - {max(counts):.0f}",
            f"{median:.1f}",
            f"{lower:.1f} - {upper:.1f}",
            f"{max(times):.1f}",
        )
    console.print(table)


def print_tables(console: Console, tables: Summaries) -> None:
    table = _table("The rod's table, made by the first solve: milliseconds")
    table.add_column("once", justify="right", no_wrap=True)
    for kind, figures in tables.items():
        table.add_row(kind, f"{1e3 * figures['table_seconds'].median:.0f}")
    console.print(table)


def print_searches(console: Console, families: Mapping[str, Summaries], seconds: float) -> None:
    table = _table(f"Searches from random starts for the same sets, each for up to {seconds:g} s of processor time")
    headings = (
        "",
        "complete",
        "time until then / ours",
        "missed in our time",
        f"in {LONG:.0f} times ours",
        "not in our sets",
    )
    for heading in headings:
        table.add_column(heading, justify="right", no_wrap=True)
    for family, members in families.items():
        for method in METHODS:
            table.add_row(family, method, *_search_row(members, method, seconds))
    console.print(table)
    console.print(
        "[dim]Times are medians over the problems; > a lower bound, < an upper bound, where searches were cut off. "
        "A search cannot know when it is complete; here it is told.[/dim]",
        highlight=False,
    )


def _search_row(members: Summaries, method: str, seconds: float) -> tuple[str, ...]:
    complete = [value == 1.0 for value in _medians(members, f"{method}: is_complete")]
    ratios = _medians(members, f"{method}: times_ours")
    ours, solutions = _medians(members, "seconds"), sum(_medians(members, "solutions"))
    bound = statistics.median(ratios)
    exact = statistics.median(ratio if met else math.inf for ratio, met in zip(ratios, complete, strict=True))
    missed = [sum(_medians(members, f"{method}: missed_in_{span}_time")) / solutions for span in ("our", "long")]
    is_cut = any(not met and LONG * time > seconds for time, met in zip(ours, complete, strict=True))
    return (
        f"{sum(complete)} of {len(members)}",
        f"{exact:,.1f}" if math.isfinite(exact) else f"> {bound:,.1f}",
        f"{missed[0]:.0%}",
        f"{'< ' if is_cut and missed[1] > 0.0 else ''}{missed[1]:.0%}",
        f"{sum(_medians(members, f'{method}: not_in_our_set')):.0f}",
    )


def _medians(members: Summaries, key: str) -> list[float]:
    return [figures[key].median for figures in members.values()]


def _table(title: str) -> Table:
    table = Table(title=title, title_justify="left", title_style="bold")
    table.add_column("", no_wrap=True)
    return table


def _count(value: float) -> str:
    return f"{value:,.0f}"


def _range(summary: Summary) -> str:
    return f"{_count(summary.least)} - {_count(summary.most)}"
