"""A running explorer, and browsers that are none: sockets that send what a page would, or what it never would."""

import asyncio
import json
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any
from urllib.parse import urlsplit

from websockets.sync.client import ClientConnection, connect
from websockets.typing import Origin

import pcm_gym
from pcm_gym.explorer.server import serve_explorer

_PATIENCE = 300.0  # s, kernels may have to be compiled


class Served:
    """An explorer in a thread of its own."""

    def __init__(self, mechanism: pcm_gym.Mechanism) -> None:
        self.address = ""
        self._is_served = threading.Event()
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._run, args=(mechanism,))

    def start(self) -> None:
        self._thread.start()
        assert self._is_served.wait(_PATIENCE)

    def stop(self) -> None:
        self._loop.call_soon_threadsafe(self._task.cancel)
        self._thread.join(_PATIENCE)
        assert not self._thread.is_alive()

    def _run(self, mechanism: pcm_gym.Mechanism) -> None:
        async def serve() -> None:
            await serve_explorer(mechanism, 0, self._started)

        self._task = self._loop.create_task(serve())
        try:
            self._loop.run_until_complete(self._task)
        except asyncio.CancelledError:
            pass
        finally:
            self._loop.run_until_complete(self._loop.shutdown_default_executor())
            self._loop.close()

    def _started(self, address: str) -> None:
        self.address = address
        self._is_served.set()

    @property
    def host(self) -> str:
        return urlsplit(self.address).netloc


class Browser:
    """One session."""

    def __init__(self, socket: ClientConnection) -> None:
        self.socket = socket
        self.greeting = self.receive()

    def receive(self) -> Any:
        return json.loads(self.socket.recv(timeout=_PATIENCE))

    def ask(self, kind: str, **content: Any) -> Any:
        return self.send(json.dumps({"kind": kind, "id": 1, **content}))

    def send(self, text: str | bytes) -> Any:
        self.socket.send(text)
        return self.receive()

    def timed(self, kind: str, **content: Any) -> tuple[Any, float]:
        begin = time.perf_counter()
        return self.ask(kind, **content), time.perf_counter() - begin


@contextmanager
def served(name: str) -> Iterator[Served]:
    explorer = Served(pcm_gym.get_mechanism(name))
    explorer.start()
    try:
        yield explorer
    finally:
        explorer.stop()


@contextmanager
def browser(explorer: Served) -> Iterator[Browser]:
    address = f"ws://{explorer.host}/socket"
    with connect(address, origin=Origin(f"http://{explorer.host}"), max_size=None) as socket:
        yield Browser(socket)
