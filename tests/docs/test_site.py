"""The site builds without a warning, its tutorials run, its links hold, and every public name is described."""

import importlib.util
import os
import re
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest

import pcm_gym
from docs.site.links import PAGES, within_site
from pcm_gym import references

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
DESCRIBED = [
    name
    for page in sorted((DOCS / "api").glob("*.md"))
    for name in re.findall(r"^\.\. auto\w+:: (\w+)$", page.read_text(encoding="utf-8"), flags=re.MULTILINE)
]
NEEDED = ("furo", "matplotlib", "myst_nb", "PIL", "sphinx", "sphinx_copybutton")


@pytest.fixture
def site(tmp_path: Path) -> Path:
    """Return the site, built as `make docs` builds it."""
    if absent := [name for name in NEEDED if importlib.util.find_spec(name) is None]:
        pytest.skip(f"the extra `site` is not installed: {', '.join(absent)}")
    out = tmp_path / "site"
    command = [sys.executable, "-m", "sphinx", "-W", "--keep-going", "-q", "docs", str(out)]
    folders = os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])
    environment = {**os.environ, "PYTHONPATH": folders}
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-5000:]
    return out


class _Page(HTMLParser):
    """What a page links to, and the places in it that can be linked to."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.links: set[str] = set()
        self.places: set[str] = set()
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        for name, value in attrs:
            if name in ("href", "src") and value:
                self.links.add(value)
            if name == "id" and value:
                self.places.add(value)


@pytest.mark.slow
def test_the_site_is_whole(site: Path) -> None:
    """In one test, so that it is built once: without a warning, its tutorials run, and all its links lead somewhere."""
    assert_that_no_link_is_dead(site)
    assert_that_tutorials_have_run(site)
    assert_that_every_page_can_be_searched(site)


def assert_that_no_link_is_dead(site: Path) -> None:
    pages = {path: _Page(path) for path in site.rglob("*.html")}
    dead, count = [], 0
    for path, page in pages.items():
        for link in page.links:
            parts = urlsplit(link)
            if parts.scheme or parts.netloc:
                continue
            target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            found = target.exists() and (
                not parts.fragment or target not in pages or unquote(parts.fragment) in pages[target].places
            )
            count += 1
            if not found:
                dead.append(f"{path.relative_to(site)}: {link}")
    assert dead == []
    assert count > 1000


def assert_that_tutorials_have_run(site: Path) -> None:
    for source in (DOCS / "tutorials").glob("*.md"):
        page = (site / "tutorials" / f"{source.stem}.html").read_text(encoding="utf-8")
        assert page.count('class="cell_output') >= 5
        assert "<img" in page


def assert_that_every_page_can_be_searched(site: Path) -> None:
    index = (site / "searchindex.js").read_text(encoding="utf-8")
    for source in DOCS.rglob("*.md"):
        name = source.relative_to(DOCS).with_suffix("")
        if name.parts[0] != "_build":
            assert (site / name).with_suffix(".html").is_file(), name
            assert f'"{name}"' in index, name


def test_every_public_name_is_described_once() -> None:
    of_rooms = {"FrameRenderer", "Style", "equilibrium_svg"} | set(references.__all__) - {"REFERENCES"}
    of_rooms |= {"BranchStates", "advance", "start"}  # of `differentiable`, which takes torch
    assert sorted(DESCRIBED) == sorted({*pcm_gym.__all__, *of_rooms} - {"__version__"})


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("[a](../CHANGELOG.md#x)", "[a](changelog.md#x)"),
        ("[a](environments/README.md)", "[a](environments/README.md)"),
        ("[the catalogue](../pcm_gym/mechanism)", "the catalogue (`pcm_gym/mechanism`)"),
        ("[a](https://example.org)", "[a](https://example.org)"),
        ("```\n[a](../Makefile)\n```", "```\n[a](../Makefile)\n```"),
    ],
)
def test_links_of_the_repository_lead_within_the_site(text: str, shown: str) -> None:
    assert within_site(text, "docs/page.md", "docs/page.md") == shown


def test_links_of_a_file_beside_docs_count_from_there() -> None:
    assert within_site("[a](docs/start.md)", "README.md", "docs/index.md") == "[a](start.md)"


def test_pages_that_hold_files_beside_docs_are_there() -> None:
    for file, page in PAGES.items():
        assert (ROOT / file).is_file()
        assert (ROOT / page).is_file()
