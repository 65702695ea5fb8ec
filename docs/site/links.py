"""An extension of Sphinx: pages that are read in the repository, too, link to its files; on the site these links hold.

A link to a page of the site stays, or leads to where that page is; of a link to any other file the text is left, with
the file's name. Pictures that are links, which the repository's pages write as HTML, become Markdown.
"""

import os
import re
from pathlib import Path, PurePosixPath
from typing import Any

ROOT = Path(__file__).parents[2]
DOCS = PurePosixPath("docs")
# Files beside `docs`, and the pages that hold them.
PAGES = {
    "README.md": "docs/index.md",
    "ARCHITECTURE.md": "docs/architecture.md",
    "CHANGELOG.md": "docs/changelog.md",
    "CITATION.cff": "docs/citation.md",
    "CONTRIBUTING.md": "docs/contributing.md",
}

_FENCE = re.compile(r"(^```.*?^```$)", flags=re.DOTALL | re.MULTILINE)
_LINK = re.compile(
    r"(?<!!)\[(?P<text>(?:[^\[\]]|!\[[^\]]*\]\([^)]*\))*)\]\((?P<path>[^()\s#:]+)(?P<anchor>#[^()\s]*)?\)"
)
_PICTURE = re.compile(
    r'<a href="(?P<page>[^"]+)"><img src="(?P<image>[^"]+)" width="(?P<width>\d+)" alt="(?P<text>[^"]*)"></a>'
)


def setup(app: Any) -> dict[str, Any]:
    """Connect the extension to an application of Sphinx."""
    app.connect("source-read", _on_source_read)
    app.connect("include-read", _on_include_read)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def within_site(text: str, file: str, page: str) -> str:
    """Return the text of a file as a page of the site shows it.

    Parameters
    ----------
    text : str
        Markdown.
    file, page : str
        The file that it stands in, from which its links count, and the page that shows it: paths in the repository.
    """

    def shown(part: str) -> str:
        return _relinked(_PICTURE.sub(_picture, part), PurePosixPath(file), PurePosixPath(page))

    parts = _FENCE.split(text)
    parts[::2] = map(shown, parts[::2])
    return "".join(parts)


def _picture(found: re.Match[str]) -> str:
    return "[![{text}]({image}){{w={width}px}}]({page})".format_map(found.groupdict())


def _relinked(text: str, file: PurePosixPath, page: PurePosixPath) -> str:
    def replaced(found: re.Match[str]) -> str:
        path = os.path.normpath(file.parent / found["path"])
        if not (ROOT / path).exists():
            return found[0]  # no link of ours; what is dead, Sphinx reports
        path = PAGES.get(path, path)
        if not PurePosixPath(path).is_relative_to(DOCS):
            name = f"`{path}`"
            return name if found["text"].strip("`") in path else f"{found['text']} ({name})"
        return f"[{found['text']}]({os.path.relpath(path, page.parent)}{found['anchor'] or ''})"

    return _LINK.sub(replaced, text)


def _on_source_read(app: Any, name: str, source: list[str]) -> None:
    path = str(app.env.doc2path(name, base=False))
    if path.endswith(".md"):
        source[0] = within_site(source[0], f"{DOCS}/{path}", f"{DOCS}/{path}")


def _on_include_read(app: Any, path: Path, name: str, content: list[str]) -> None:
    file = os.path.relpath(Path(app.srcdir) / path, ROOT)
    content[0] = within_site(content[0], file, f"{DOCS}/{app.env.doc2path(name, base=False)}")
