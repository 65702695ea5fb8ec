"""Reading the package's docstrings: the sections of numpydoc, and those that environments and tasks have besides."""

import inspect

from docstring_parser import DocstringParam
from docstring_parser.numpydoc import NumpydocParser, ParamSection, Section

_TEXTS = (
    "Action",
    "Observation",
    "Distance",
    "Reward",
    "Info",
    "Starts and goals",
    "Episode end",
    "Loss of stability",
    "Version history",
)
_LISTS = ("Options",)
_PARSER = NumpydocParser()
for _title in _TEXTS:
    _PARSER.add_section(Section(_title, _title))
for _title in _LISTS:
    _PARSER.add_section(ParamSection(_title, _title))


def description(documented: object) -> str:
    """Return what a docstring says before its first section."""
    return (_PARSER.parse(_docstring(documented)).description or "").strip()


def section(documented: object, title: str) -> str:
    """Return the text of a section."""
    found = [meta.description for meta in _PARSER.parse(_docstring(documented)).meta if meta.args == [title]]
    if not found:
        raise ValueError(f"{documented!r} has no section {title!r} in its docstring")
    return found[0] or ""


def entries(documented: object, title: str) -> list[DocstringParam]:
    """Return what a section lists, each with its name, type and meaning; "param" and "attribute" are titles too."""
    metas = _PARSER.parse(_docstring(documented)).meta
    return [meta for meta in metas if isinstance(meta, DocstringParam) and meta.args[0] == title]


def _docstring(documented: object) -> str:
    return inspect.getdoc(documented) or ""
