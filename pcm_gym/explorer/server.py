"""The page and its socket, on this machine alone."""

import asyncio
import json
import logging
import socket
from collections.abc import Callable
from contextlib import suppress
from http import HTTPStatus
from importlib.resources import files

from websockets.asyncio.server import ServerConnection, serve
from websockets.datastructures import Headers
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response
from websockets.typing import Origin

from pcm_gym.explorer.messages import LENGTHY, PASSING, Message, MessageError, message_of
from pcm_gym.explorer.session import Session
from pcm_gym.explorer.views import Data
from pcm_gym.mechanism import Mechanism

HOST = "127.0.0.1"
_LOG = logging.getLogger(__name__)
_NAMES = (HOST, "localhost")
_LARGEST_MESSAGE, _MOST_SESSIONS = 1 << 16, 16
# Lengthy searches at a time, of all sessions: drags need the processor, too.
_SEARCHES = 1
# Messages, and lengthy ones, of one session that may wait.
_MOST_WAITING, _MOST_LENGTHY = 64, 4
_TOO_MANY = 1013  # the code of the protocol for "try again later"

_PAGES = {
    "/": ("index.html", "text/html; charset=utf-8"),
    "/explorer.js": ("explorer.js", "text/javascript; charset=utf-8"),
    "/drawing.js": ("drawing.js", "text/javascript; charset=utf-8"),
    "/explorer.css": ("explorer.css", "text/css; charset=utf-8"),
}
_SECURITY = {
    "Content-Security-Policy": "default-src 'self'; img-src 'self' data: blob:; frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-store",
}


def run(mechanism: Mechanism, port: int, started: Callable[[str], None]) -> None:
    """Serve the explorer until it is interrupted.

    Parameters
    ----------
    mechanism : Mechanism
        With which each session begins.
    port : int
        0 for any that is free.
    started : callable
        Called with the address of the page once it is served.
    """
    asyncio.run(serve_explorer(mechanism, port, started))


async def serve_explorer(mechanism: Mechanism, port: int, started: Callable[[str], None]) -> None:
    """Serve the explorer until it is cancelled; see `run`."""
    own = socket.create_server((HOST, port))
    port = own.getsockname()[1]
    hosts = {f"{name}:{port}" for name in _NAMES}
    explorer = _Explorer(mechanism, hosts)
    quiet = logging.getLogger(f"{__name__}.sockets")
    quiet.setLevel(logging.CRITICAL)  # a browser that goes away, or is refused, is no news
    await asyncio.to_thread(Session, mechanism)  # which fails now if it has no home, and compiles what is needed
    async with serve(
        explorer.talk,
        sock=own,
        origins=[Origin(f"http://{host}") for host in sorted(hosts)],
        process_request=explorer.page,
        max_size=_LARGEST_MESSAGE,
        logger=quiet,
    ) as server:
        started(f"http://{HOST}:{port}/")
        await server.serve_forever()


class _Explorer:
    """What all connections share."""

    def __init__(self, mechanism: Mechanism, hosts: set[str]) -> None:
        self._mechanism, self._hosts = mechanism, hosts
        self._searches = asyncio.Semaphore(_SEARCHES)
        self._count = 0

    def page(self, connection: ServerConnection, request: Request) -> Response | None:
        """Return a file of the page, or a refusal; None lets the socket be opened."""
        if request.headers.get("Host") not in self._hosts:  # a foreign name that leads here
            return _response(HTTPStatus.FORBIDDEN)
        path = request.path.partition("?")[0]
        if path == "/socket":
            return None
        if path not in _PAGES:
            return _response(HTTPStatus.NOT_FOUND)
        name, kind = _PAGES[path]
        return _response(HTTPStatus.OK, (files("pcm_gym.explorer") / "static" / name).read_bytes(), kind)

    async def talk(self, connection: ServerConnection) -> None:
        """Serve one browser until it goes away."""
        if self._count >= _MOST_SESSIONS:
            await connection.close(_TOO_MANY, "too many sessions")
            return
        self._count += 1
        try:
            session = await asyncio.to_thread(Session, self._mechanism)
            await _Talk(connection, session, self._searches).run()
        finally:
            self._count -= 1


class _Talk:
    """One browser's messages, answered in their order, but for lengthy ones, which are answered when they are done."""

    def __init__(self, connection: ServerConnection, session: Session, searches: asyncio.Semaphore) -> None:
        self._connection, self._session, self._searches = connection, session, searches
        self._waiting: asyncio.Queue[Message] = asyncio.Queue(_MOST_WAITING)
        self._lengthy: set[asyncio.Task[None]] = set()

    async def run(self) -> None:
        await self._send(self._session.greeting())
        async with asyncio.TaskGroup() as tasks:
            answering = tasks.create_task(self._answer(tasks))
            try:
                async for text in self._connection:
                    await self._take(text)
            except ConnectionClosed:  # also where a message was too large
                pass
            for task in (answering, *self._lengthy):
                task.cancel()

    async def _take(self, text: str | bytes) -> None:
        try:
            message = message_of(text)
        except MessageError as error:
            await self._refuse(str(error))
        else:
            await self._waiting.put(message)

    async def _answer(self, tasks: asyncio.TaskGroup) -> None:
        following: Message | None = None
        while True:
            message = following or await self._waiting.get()
            following = None
            while isinstance(message, PASSING) and following is None and not self._waiting.empty():
                following = self._waiting.get_nowait()
                if type(following) is type(message):
                    message, following = following, None
            if not isinstance(message, LENGTHY):
                await self._send(await self._answered(message))
            elif len(self._lengthy) >= _MOST_LENGTHY:
                await self._refuse("earlier searches are not done yet", message.id)
            else:
                task = tasks.create_task(self._search(message))
                self._lengthy.add(task)
                task.add_done_callback(self._lengthy.discard)

    async def _search(self, message: Message) -> None:
        async with self._searches:
            await self._send(await self._answered(message))

    async def _answered(self, message: Message) -> Data:
        try:
            return await asyncio.to_thread(self._session.answer, message)
        except Exception:  # others, and this one, are to go on
            _LOG.exception("a mistake of the package, at %r", message)
            return {"kind": "refused", "reason": "a mistake of the package", "answers": message.id}

    async def _refuse(self, reason: str, number: int | None = None) -> None:
        await self._send({"kind": "refused", "reason": reason, "answers": number})

    async def _send(self, content: Data) -> None:
        with suppress(ConnectionClosed):
            await self._connection.send(json.dumps(content, allow_nan=False, separators=(",", ":")))


def _response(status: HTTPStatus, body: bytes | None = None, kind: str = "text/plain; charset=utf-8") -> Response:
    body = status.phrase.encode() if body is None else body
    headers = Headers({**_SECURITY, "Content-Type": kind, "Content-Length": str(len(body)), "Connection": "close"})
    return Response(status.value, status.phrase, headers, body)
