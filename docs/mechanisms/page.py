"""The text of the page of the catalogued mechanisms."""

from collections.abc import Mapping

import numpy as np

from benchmarks.evidence import Evidence

_HEAD = """# The mechanisms

Written by `python -m docs.mechanisms`; `tests/mechanism/test_catalogue_evidence.py` holds it with fewer moves.

Each of these could be built: of strips of spring steel on edge, 1 m long, 20 mm x 0.5 mm, which yield at a curvature of
20 per metre. Nowhere on the home sheets, all that stable ways from home reach within the limits, does a rod yield or
cross what it must not: itself, and on a platform other rods and its edges. Nor is one ever drawn straight, where its
tension would know no bounds: not on random straight moves from home, nor on those from where tasks start. At a few
folds, where a move ends because it loses stability, a rod touches itself. Two rods of a point end-effector may cross,
one above the other, and so may their rails. And each is worth controlling: random straight moves from home meet folds,
and the home sheets cover inputs more than once, around cusps, so that the damped Jacobian, which heads straight for a
goal, often ends at the wrong equilibrium or in a fall. `python -m benchmarks geometries` is the search.

`2RFR-paper`, `2PFR-paper` and `3PFR-paper` are the geometries of the [figures](../paper_figures.md): round wires, 1 mm
in radius, which yield at 5 per metre.
"""


def page(found: Mapping[str, Evidence]) -> str:
    """Return the page."""
    return "\n".join([_HEAD, _table(found), *(_section(name, own) for name, own in found.items())])


def image_name(name: str) -> str:
    """File name of the picture of a mechanism."""
    return f"{name}.png"


def _table(found: Mapping[str, Evidence]) -> str:
    rows = [_row(own) for own in found.values()]
    lines = [f"| | {' | '.join(found)} |", "|---|" + "---|" * len(found)]
    lines += [f"| {title} | {' | '.join(row[title] for row in rows)} |" for title in rows[0]]
    return "\n".join(lines) + "\n"


def _row(evidence: Evidence) -> dict[str, str]:
    sheets, moves, ways = evidence.sheets, evidence.moves, evidence.ways
    stress = sheets.strength.stress
    quantiles = ", ".join(f"{value:.2f}" for value in (*np.quantile(stress, [0.5, 0.9]), stress.max()))
    home = max(rod.stress_ratio for rod in sheets.home.rods)
    return {
        "stress over yield stress at home": f"{home:.2f}",
        "on the home sheets: half, 90 %, most": quantiles,
        "forbidden crossings there": str(int(sheets.strength.has_contact.sum())),
        "equilibria looked at there": f"{len(sheets.roadmap):,}",
        "random moves from home, and as many from starts": f"{moves.count:,}",
        "of them lose stability": f"{moves.lost:.1%}, {ways.lost:.1%}",
        "end where a rod is drawn straight": f"{moves.given_up:.2%}, {ways.given_up:.2%}",
        "greatest stress on them": f"{moves.greatest_stress:.2f}, {ways.greatest_stress:.2f}",
        "moves with a forbidden crossing": f"{moves.contacts}, {ways.contacts}",
        "with one at the very fold where they end": f"{moves.contacts_at_folds}, {ways.contacts_at_folds}",
        "inputs covered": f"{sheets.covered:.1%}",
        "of them more than once": f"{sheets.covered_again:.1%}",
        "span of the poses (m, m, rad)": ", ".join(f"{value:.2f}" for value in sheets.span),
        "ends of moves joined to home by the roadmap": f"{moves.on_roadmap:.1%}, {ways.on_roadmap:.1%}",
        "damped Jacobian, goals anywhere: safe": f"{evidence.resolved_rate.safe:.1%}",
        "the same: loses stability": f"{evidence.resolved_rate.lost:.1%}",
        "random actions: safe": f"{evidence.random.safe:.1%}",
        "random actions: lose stability": f"{evidence.random.lost:.1%}",
        "episodes of each": f"{evidence.random.count:,}",
        "what is asked and does not hold": "; ".join(evidence.failings) or "nothing",
    }


def _section(name: str, evidence: Evidence) -> str:
    mechanism = evidence.sheets.roadmap.mechanism
    return f"## {name}\n\n{mechanism.description.capitalize()}.\n\n![{name}](../images/mechanisms/{image_name(name)})\n"
