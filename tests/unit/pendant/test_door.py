"""A crowd at the pendant's port: a page with STOP opens all the same, and stays open."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable, Coroutine
from contextlib import asynccontextmanager, suppress
from typing import Any

import pytest

from qrobot.pendant.door import Door
from qrobot.pendant.gate import Gate, cookie_name
from qrobot.pendant.server import PendantServer, open_port, server_config
from tests.support.patience import PATIENCE_S

TOKEN, MOST, CROWD = "right", 4, 40
OWN = "Host: 127.0.0.1\r\nOrigin: http://127.0.0.1\r\n"
COOKIE = f"Cookie: {cookie_name(TOKEN)}={TOKEN}\r\n"
ENTRY = f"GET /?token={TOKEN} HTTP/1.1\r\n{OWN}\r\n"
PAGE = f"GET /page HTTP/1.1\r\n{OWN}{COOKIE}\r\n"
STRANGE = f"GET /page HTTP/1.1\r\n{OWN}\r\n"
LAST = f"GET /page HTTP/1.1\r\n{OWN}Connection: close\r\n\r\n"
LIVE = (
    f"GET /live HTTP/1.1\r\n{OWN}{COOKIE}Connection: Upgrade\r\nUpgrade: websocket\r\n"
    "Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n"
)
PING, PONG = b"\x89\x80\x00\x00\x00\x00", b"\x8a\x00"  # RFC 6455, section 5.5

Visit = Callable[["Port"], Coroutine[Any, Any, None]]


async def answer(scope: Any, receive: Any, send: Any) -> None:
    """A page of the pendant, or its live socket."""
    if scope["type"] == "websocket":
        await receive()
        await send({"type": "websocket.accept"})
        await receive()  # until it is closed
        return
    await send({"type": "http.response.start", "status": 204, "headers": []})
    await send({"type": "http.response.body", "body": b""})


class Visitor:
    """One connection to the pendant."""

    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._reader, self._writer = reader, writer

    def say(self, text: str) -> None:
        self._writer.write(text.encode())

    async def ask(self, request: str) -> int:
        """Status of the answer."""
        self.say(request)
        head = await self._reader.readuntil(b"\r\n\r\n")
        if b"transfer-encoding: chunked" in head:
            await self._reader.readuntil(b"0\r\n\r\n")
        return int(head.split()[1])

    async def is_answered(self) -> bool:
        """A live socket: somebody is there."""
        self._writer.write(PING)
        return await self._reader.readexactly(len(PONG)) == PONG

    async def sent_away(self) -> None:
        """Until the pendant has closed it."""
        with suppress(ConnectionResetError):
            while await self._reader.read(1 << 16):
                pass

    def go(self) -> None:
        self._writer.close()


class Port:
    """The pendant's port, and who has come to it."""

    def __init__(self, number: int, door: Door) -> None:
        self._number, self.door = number, door
        self.visitors: list[Visitor] = []

    async def come(self) -> Visitor:
        self.visitors.append(Visitor(*await asyncio.open_connection("127.0.0.1", self._number)))
        return self.visitors[-1]

    async def crowd(self) -> list[Visitor]:
        """Many that say nothing, and the pendant has seen that there are too many."""
        mute = [await self.come() for _ in range(CROWD)]
        for visitor in mute[:-MOST]:
            await visitor.sent_away()
        return mute[-MOST:]


@asynccontextmanager
async def pendant(door: Door) -> AsyncIterator[Port]:
    listener = open_port(0)
    gate = Gate(answer, TOKEN, door=door)
    config, began = server_config(gate, gate.door), asyncio.Event()
    config.lifespan = "off"
    server = PendantServer(config, began.set)
    serving = asyncio.create_task(server.serve([listener]))
    await began.wait()
    port = Port(listener.getsockname()[1], door)
    try:
        yield port
    finally:
        for visitor in port.visitors:
            visitor.go()
        server.should_exit = True
        await serving


def at_the_pendant(visit: Visit) -> None:
    """Raises TimeoutError: what has to come does not."""

    async def run() -> None:
        async with asyncio.timeout(PATIENCE_S), pendant(Door(MOST, PATIENCE_S)) as port:
            await visit(port)

    asyncio.run(run())


@pytest.mark.parametrize(("asked", "status"), [(ENTRY, 200), (PAGE, 204), (LIVE, 101)])
def test_a_page_opens_however_many_say_nothing(asked: str, status: int) -> None:
    async def visit(port: Port) -> None:
        mute = await port.crowd()
        page = await port.come()
        assert await page.ask(asked) == status
        await mute[0].sent_away()  # for the page has come, and it was the first of them

    at_the_pendant(visit)


def test_who_was_let_in_stays_whoever_comes() -> None:
    async def visit(port: Port) -> None:
        page, live = await port.come(), await port.come()
        assert await page.ask(PAGE) == 204
        assert await live.ask(LIVE) == 101
        await port.crowd()
        assert await live.is_answered()
        assert await page.ask(PAGE) == 204

    at_the_pendant(visit)


@pytest.mark.parametrize("said", ["", PAGE[:20], STRANGE])
def test_who_is_not_let_in_has_to_go_after_a_while_and_who_is_let_in_has_not(said: str) -> None:
    async def visit(port: Port) -> None:
        live = await port.come()
        assert await live.ask(LIVE) == 101
        port.door.patience_s = 0.1
        stranger = await port.come()
        stranger.say(said)
        await stranger.sent_away()
        assert await live.is_answered()

    at_the_pendant(visit)


def test_one_that_goes_by_itself_makes_room_for_another() -> None:
    async def visit(port: Port) -> None:
        first = [await port.come() for _ in range(MOST)]
        for visitor in first:  # whoever is refused is a stranger still
            assert await visitor.ask(STRANGE) == 403
        assert await first[-1].ask(LAST) == 403
        await first[-1].sent_away()
        other = await port.come()
        assert await other.ask(STRANGE) == 403
        assert await first[0].ask(STRANGE) == 403

    at_the_pendant(visit)
