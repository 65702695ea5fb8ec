"""The explorer in a real browser: headless Chromium, driven by its own protocol, drags and clicks at random.

It is a check as much as a measurement: every interaction is made by pointer and keys, as a hand would, and whatever the
page reports as an error is counted.
"""

import base64
import itertools
import json
import math
import os
import random
import shutil
import subprocess
import sys
import tempfile
import time
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

BROWSERS = ("chromium", "chromium-browser", "google-chrome")
_PATIENCE = 120.0  # s
_DRAG_STEPS, _PAUSE = 8, 0.03
_KEYS = {"ArrowLeft": 37, "ArrowUp": 38, "ArrowRight": 39, "ArrowDown": 40}


@dataclass(frozen=True)
class Answers:
    """What was measured.

    Attributes
    ----------
    interactions : int
    answers : int
        Of drags and keys, from the message sent until its answer is there, in the page.
    median, percentile : float
        Of these times, ms; the 95th percentile.
    errors : list of str
        What scripts of the page threw, and what the session refused without being asked for something impossible.
    """

    interactions: int
    answers: int
    median: float
    percentile: float
    errors: list[str]


class Page:
    """One page of a browser."""

    def __init__(self, socket: Any) -> None:
        self._socket, self._numbers = socket, itertools.count(1)
        self.errors: list[str] = []
        for domain in ("Page", "Runtime"):
            self.call(f"{domain}.enable")

    def call(self, method: str, **parameters: Any) -> Any:
        number = next(self._numbers)
        self._socket.send(json.dumps({"id": number, "method": method, "params": parameters}))
        while True:
            content = json.loads(self._socket.recv(timeout=_PATIENCE))
            if content.get("method") == "Runtime.exceptionThrown":
                self.errors.append(json.dumps(content["params"]["exceptionDetails"])[:500])
            if content.get("id") == number:
                return content.get("result", {})

    def value(self, expression: str) -> Any:
        return self.call("Runtime.evaluate", expression=expression, returnByValue=True)["result"].get("value")

    def wait_for(self, expression: str) -> None:
        end = time.monotonic() + _PATIENCE
        while not self.value(expression):
            if time.monotonic() > end:
                raise TimeoutError(expression)
            time.sleep(0.05)

    def resize(self, width: int, height: int) -> None:
        self.call(
            "Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=width < 800
        )

    def screenshot(self, path: Path) -> None:
        shot = self.call("Page.captureScreenshot", format="png", captureBeyondViewport=True)
        path.write_bytes(base64.b64decode(shot["data"]))

    def mouse(self, kind: str, x: float, y: float) -> None:
        buttons = {} if kind == "mouseReleased" else {"buttons": 1}
        self.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", clickCount=1, **buttons)

    def click(self, x: float, y: float) -> None:
        self.mouse("mousePressed", x, y)
        self.mouse("mouseReleased", x, y)

    def key(self, name: str) -> None:
        for kind in ("keyDown", "keyUp"):
            self.call("Input.dispatchKeyEvent", type=kind, key=name, code=name, windowsVirtualKeyCode=_KEYS[name])

    def box(self, selector: str) -> tuple[float, float, float, float]:
        left, top, width, height = self.value(
            f"(() => {{ const own = document.querySelector({selector!r}); own.scrollIntoView({{block: 'center'}});"
            "const box = own.getBoundingClientRect(); return [box.left, box.top, box.width, box.height]; })()"
        )
        return left, top, width, height

    def middle(self, selector: str) -> tuple[float, float]:
        left, top, width, height = self.box(selector)
        return left + 0.5 * width, top + 0.5 * height


@contextmanager
def explored(name: str) -> Iterator[str]:
    """Return the address of an explorer that ``pcm-gym explore`` serves in a process of its own."""
    command = [sys.executable, "-m", "pcm_gym", "explore", name, "--port", "0", "--no-browser"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env={**os.environ, "PYTHONUNBUFFERED": "1"})
    try:
        assert process.stdout is not None
        said = process.stdout.readline()
        yield next(word for word in said.split() if word.startswith("http"))
    finally:
        process.terminate()
        process.communicate(timeout=_PATIENCE)


def has_browser() -> bool:
    """Return whether there is a browser to drive."""
    return any(map(shutil.which, BROWSERS))


@contextmanager
def browsed(address: str, width: int = 1280, height: int = 1000) -> Iterator[Page]:
    """Return a page of a headless browser at an address."""
    from websockets.sync.client import connect  # of the extra `explore`, which other benchmarks do not need

    name = next(filter(None, map(shutil.which, BROWSERS)), None)
    if name is None:
        raise RuntimeError(f"none of {', '.join(BROWSERS)} is installed")
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        options = ["--headless=new", "--no-sandbox", "--disable-gpu", "--remote-debugging-port=0"]
        process = subprocess.Popen(
            [name, *options, f"--user-data-dir={folder}", "about:blank"],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        try:
            port = _debugging_port(Path(folder))
            with connect(_page_address(port), max_size=None) as socket:
                page = Page(socket)
                page.resize(width, height)
                page.call("Page.navigate", url=address)
                page.wait_for("Boolean(window.explorer && window.explorer.own.state)")
                yield page
        finally:
            process.terminate()
            process.wait(_PATIENCE)


def _debugging_port(folder: Path) -> int:
    end = time.monotonic() + _PATIENCE
    while time.monotonic() < end:
        path = folder / "DevToolsActivePort"
        if path.exists() and path.read_text().strip():
            return int(path.read_text().split()[0])
        time.sleep(0.1)
    raise TimeoutError("the browser did not start")


def _page_address(port: int) -> str:
    with urllib.request.urlopen(f"http://127.0.0.1:{port}/json/list", timeout=_PATIENCE) as answer:
        pages = json.load(answer)
    return str(next(page["webSocketDebuggerUrl"] for page in pages if page["type"] == "page"))


def take_pictures(page: Page, folder: Path) -> None:
    """Write pictures of the page with a diagram on it, on a wide and on a narrow screen."""
    folder.mkdir(parents=True, exist_ok=True)
    page.wait_for("window.explorer.own.mechanism.dof === 3 || Boolean(window.explorer.own.folds)")
    page.value("document.getElementById('diagram-button').click()")
    page.wait_for("Boolean(window.explorer.own.diagram)")
    for width, height in ((390, 844), (1280, 1000)):
        page.resize(width, height)
        time.sleep(0.5)
        page.screenshot(folder / f"explorer-{width}.png")


def interact(page: Page, count: int, seed: int = 0) -> Answers:
    """Make random drags, keys, clicks and choices, and return what they came to."""
    rng = random.Random(seed)
    for _ in range(count):
        kind = rng.choices(["drag", "key", "pick", "slide"], [6, 2, 1, 1])[0]
        {"drag": _drag, "key": _key, "pick": _pick, "slide": _slide}[kind](page, rng)
        page.wait_for("!window.explorer.own.falling")
    times = sorted(each["ms"] for each in page.value("window.explorer.latencies"))
    if not times:
        raise RuntimeError("nothing was answered")
    at = min(len(times) - 1, math.ceil(0.95 * len(times)) - 1)
    return Answers(
        count, len(times), times[len(times) // 2], times[at], page.errors + page.value("window.explorer.errors")
    )


def _drag(page: Page, rng: random.Random) -> None:
    _, _, width, _ = page.box("#scene")
    x, y = page.value(
        "(() => { const box = explorer.own.handle.getBoundingClientRect();"
        " return [box.left + box.width / 2, box.top + box.height / 2]; })()"
    )
    angle, reach = rng.uniform(0.0, 2.0 * math.pi), rng.uniform(0.02, 0.2) * width
    page.mouse("mousePressed", x, y)
    for step in range(1, _DRAG_STEPS + 1):
        part = reach * step / _DRAG_STEPS
        page.mouse("mouseMoved", x + part * math.cos(angle), y + part * math.sin(angle))
        time.sleep(_PAUSE)
    page.mouse("mouseReleased", x + reach * math.cos(angle), y + reach * math.sin(angle))


def _key(page: Page, rng: random.Random) -> None:
    page.value("document.activeElement.blur()")
    page.key(rng.choice(list(_KEYS)))


def _pick(page: Page, rng: random.Random) -> None:
    count = page.value("document.querySelectorAll('#rows tr').length")
    page.click(*page.middle(f"#rows tr:nth-child({rng.randrange(count) + 1})"))


def _slide(page: Page, rng: random.Random) -> None:
    number = rng.randrange(page.value("document.querySelectorAll('#sliders input[type=range]').length")) + 1
    left, top, width, height = page.box(f"#sliders label:nth-child({number}) input[type=range]")
    page.click(left + rng.uniform(0.2, 0.8) * width, top + 0.5 * height)
    page.value("document.activeElement.blur()")
