"""Tables of the figures."""

from collections.abc import Mapping

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from benchmarks.timing import Summary

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
    table = _table("A fresh process: seconds")
    for heading in ("total", "min - max", "import gymnasium", "import pcm_gym", "make", "reset", "first step"):
        table.add_column(heading, justify="right", no_wrap=True)
    for name, figures in startup.items():
        total = figures["total_seconds"]
        stages = ("import_gymnasium", "import", "make", "reset", "step")
        table.add_row(
            name,
            f"{total.median:.2f}",
            f"{total.least:.2f} - {total.most:.2f}",
            *(f"{figures[f'{stage}_seconds'].median:.2f}" for stage in stages),
        )
    console.print(table)


def _table(title: str) -> Table:
    table = Table(title=title, title_justify="left", title_style="bold")
    table.add_column("", no_wrap=True)
    return table


def _count(value: float) -> str:
    return f"{value:,.0f}"


def _range(summary: Summary) -> str:
    return f"{_count(summary.least)} - {_count(summary.most)}"
