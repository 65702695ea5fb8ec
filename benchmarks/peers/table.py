"""The table of the peers, on the console and as a page."""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from benchmarks.peers.catalogue import BATCH, FOLLOWERS, ONE, OURS
from benchmarks.timing import Summary

HEADINGS = (
    "",
    "steps/s",
    "spread",
    "our batch is faster by",
    "our one environment by",
    "tip error, L",
    "says beside the tip",
)
_MARKS = re.compile(r"(<!-- measured -->\n).*?(<!-- end -->)", re.DOTALL)

Summaries = Mapping[str, Mapping[str, Summary]]


def rows(found: Summaries, absent: Mapping[str, str]) -> list[tuple[str, ...]]:
    """Return a row of text for each peer that was measured and for each that is absent."""
    lines = []
    for name, figures in found.items():
        rate, peer = figures["steps_per_second"], (OURS | FOLLOWERS).get(name)
        ratios = [found[ours]["steps_per_second"].median / rate.median for ours in (BATCH, ONE)]
        lines.append(
            (
                name,
                _three_digits(rate.median),
                f"{(rate.most - rate.least) / rate.median:.0%}",
                *map(_three_digits, ratios),
                f"{figures['tip_error'].most:.0e}" if "tip_error" in figures else "",
                "another task" if peer is None else peer.tells,
            )
        )
    return lines + [(name, "absent", *[""] * (len(HEADINGS) - 2)) for name in absent]


def print_peers(console: Console, found: Summaries, setups: Mapping[str, str], absent: Mapping[str, str]) -> None:
    """Print the table, how each peer was set up, and why some are absent."""
    table = Table(
        title="A step of one degree with the 2RFR, in turn, one thread", title_justify="left", title_style="bold"
    )
    for heading in HEADINGS:
        is_text = heading in (HEADINGS[0], HEADINGS[-1])
        table.add_column(heading, justify="left" if is_text else "right", no_wrap=heading == HEADINGS[0])
    for row in rows(found, absent):
        table.add_row(*row)
    console.print(table)
    for name, setup in setups.items():
        console.print(f"[dim]{name}: {escape(setup)}[/dim]", highlight=False)
    for name, reason in absent.items():
        console.print(f"[dim]{name} is absent: {escape(reason)}[/dim]", highlight=False)


def write_page(
    path: Path, machine: Mapping[str, str], found: Summaries, setups: Mapping[str, str], absent: Mapping[str, str]
) -> None:
    """Put the table between the marks of a page.

    Raises
    ------
    ValueError
        If the page has no marks.
    """
    text = path.read_text(encoding="utf-8")
    place = _MARKS.search(text)
    if place is None:
        raise ValueError(f"{path} has no marks <!-- measured --> and <!-- end -->")
    described = ", ".join(f"{key} {value}" for key, value in machine.items() if key != "load")
    parts = (
        _markdown(HEADINGS, rows(found, absent)),
        _markdown(("", "how it was set up"), list(setups.items())),
        *([_markdown(("absent", "why"), list(absent.items()))] if absent else []),
        f"Measured on: {described}.",
    )
    body = "\n\n".join(parts)
    path.write_text(f"{text[: place.end(1)]}\n{body}\n\n{text[place.start(2) :]}", encoding="utf-8")


def _markdown(headings: Sequence[str], lines: Sequence[Sequence[str]]) -> str:
    texts = [headings, ["---"] * len(headings), *lines]
    return "\n".join(f"| {' | '.join(line)} |" for line in texts)


def _three_digits(value: float) -> str:
    return f"{float(f'{value:.3g}'):,.{0 if value >= 99.95 else 1 if value >= 9.995 else 2}f}"
