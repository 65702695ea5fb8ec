"""The page of the clients, made of the examples and of their runs."""

from collections.abc import Mapping
from pathlib import Path

from docs.clients.running import Run
from docs.clients.table import CLIENTS, EXAMPLES, Client

PAGE = Path(__file__).parents[1] / "clients.md"
_HEAD = """\
<!-- Written by `python -m docs.clients` from the examples and from their runs; edit those. -->

# Clients

Lines that work, for libraries that step environments. Each block is a file of `docs/clients/examples`, which was run as
it stands here: a short training, or a thousand steps at least. The versions are those of that run.

Three things hold for all of them.

- Workers that are processes of their own know no environment before `import pcm_gym`. The id
  `"pcm_gym:PCM/2RFR-Reach-v0"` imports it wherever it is used.
- The observation is a dict. Libraries that want one array take `gymnasium.wrappers.FlattenObservation`, or its sibling
  for batches in `gymnasium.wrappers.vector`.
- `info["event"]` is a whole number, the number of a `pcm_gym.Event`, so that wrappers which make tensors of everything
  can do so.
"""


def page(runs: Mapping[str, Run]) -> str:
    """Return the page as Markdown; the examples that did not run are named at its end."""
    parts = [_HEAD, _table(runs)]
    parts += [_section(name, CLIENTS[name], found) for name, found in runs.items() if name in CLIENTS]
    absent = [f"{client.title} (`{name}.py`)" for name, client in CLIENTS.items() if name not in runs]
    if absent:
        parts.append(f"## Not tried\n\nTheir examples are there, but have not run yet: {', '.join(absent)}.\n")
    return "\n".join(parts)


def _table(runs: Mapping[str, Run]) -> str:
    lines = ["| client | versions | Python | steps |", "| --- | --- | --- | --- |"]
    for name, found in runs.items():
        lines.append(f"| {CLIENTS[name].title} | {_versions(found)} | {found.python} | {found.steps:,} |")
    return "\n".join(lines) + "\n"


def _versions(found: Run) -> str:
    return ", ".join(f"{package} {number}" for package, number in found.versions.items())


def _section(name: str, client: Client, found: Run) -> str:
    remark = f"{client.remark}\n\n" if client.remark else ""
    code = (EXAMPLES / f"{name}.py").read_text(encoding="utf-8")
    return f"## {client.title}\n\n{remark}Tried with {_versions(found)}.\n\n```python\n{code}```\n"
