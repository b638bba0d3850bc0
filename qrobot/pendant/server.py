"""The pendant's server: pages, live socket and arms in one process, behind the gate."""

from __future__ import annotations

import asyncio
import logging
import secrets
import socket
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, suppress
from functools import partial
from typing import Any, Final

import uvicorn
from fastapi import FastAPI
from starlette.websockets import WebSocket
from uvicorn.protocols.http.auto import AutoHTTPProtocol

from qrobot.errors import LinkBusy
from qrobot.pendant.answering_process import LOGS, SCOPE, AnsweringProcess
from qrobot.pendant.arm_station import close_all
from qrobot.pendant.door import Door
from qrobot.pendant.floor import DriveFloor
from qrobot.pendant.gate import TOKEN_PARAMETER, AsgiApp, Gate
from qrobot.pendant.live_socket import serve_page
from qrobot.pendant.log_queries import add_log_queries
from qrobot.pendant.log_shelf import LogShelf
from qrobot.pendant.pages import add_pages
from qrobot.pendant.queries import add_queries
from qrobot.pendant.scope_queries import add_scope_queries
from qrobot.realtime.acceptor import BACKLOG, BURST

LOOPBACK: Final = "127.0.0.1"  # nothing is encrypted: from elsewhere through a tunnel
TOKEN_BYTES: Final = 24
LEASE_LOOK_S: Final = 1.0
LIVE_PATH: Final = "/live"
CLOSED_WHILE_LOADED: Final = "No response returned."  # of Starlette's BaseHTTPMiddleware


def make_app(floor: DriveFloor, token: str, logs: LogShelf | None = None) -> Gate:
    """Everything that answers, behind the gate. Once a process: NiceGUI has one application."""
    reader, scope = AnsweringProcess(*LOGS), AnsweringProcess(*SCOPE)
    app = FastAPI(openapi_url=None, lifespan=partial(_watch_arms, floor, reader, scope))

    async def live(websocket: WebSocket) -> None:
        await serve_page(floor, websocket)

    app.add_api_websocket_route(LIVE_PATH, live)
    add_queries(app, floor)
    add_log_queries(app, logs or LogShelf(), reader)
    add_scope_queries(app, floor, scope)
    add_pages(app)
    return Gate(app, token)


def make_token() -> str:
    """A secret of this run."""
    return secrets.token_urlsafe(TOKEN_BYTES)


def open_port(port: int) -> socket.socket:
    """A listening socket of this machine, 0 for any port. Raises LinkBusy: somebody has that port."""
    listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listener.bind((LOOPBACK, port))
        listener.listen()
    except OSError as error:
        listener.close()
        raise LinkBusy(f"cannot listen at port {port}: {error.strerror}; choose another one with --port") from None
    return listener


def address_of(listener: socket.socket, token: str) -> str:
    """Address that a browser is to open."""
    return f"http://{LOOPBACK}:{listener.getsockname()[1]}/?{TOKEN_PARAMETER}={token}"


def server_config(app: AsgiApp, door: Door) -> uvicorn.Config:
    """Settings of the server. The kernel says who is at the far end (`is_of_this_account`), no header of a proxy."""
    return uvicorn.Config(
        app, http=_watched_by(door), backlog=BURST, log_config=None, log_level="error", access_log=False,
        ws="websockets-sansio", ws_max_size=1 << 16, ws_ping_interval=5.0, ws_ping_timeout=5.0,
        timeout_graceful_shutdown=1, lifespan="on", proxy_headers=False,
    )  # fmt: skip


def serve(app: Gate, listener: socket.socket, began: Callable[[], None]) -> None:
    """Serve until Ctrl-C; `began` is called when pages are answered."""
    config = server_config(app, app.door)
    logging.getLogger("uvicorn.error").addFilter(tell_in_one_line)
    server = PendantServer(config, began)
    with suppress(KeyboardInterrupt):
        asyncio.run(server.serve([listener]))


def tell_in_one_line(record: logging.LogRecord) -> bool:
    """Shorten what uvicorn tells of an exception to a line; False for that of a page closed while it was loaded."""
    error = record.exc_info[1] if record.exc_info else None
    if error is not None:
        record.msg, record.args = "pendant: %s: %s", (type(error).__name__, error)
        record.exc_info = record.exc_text = None
    return str(error) != CLOSED_WHILE_LOADED


def _watched_by(door: Door) -> type[asyncio.Protocol]:
    """Connections as uvicorn serves them, of which a door is told."""
    base: Any = AutoHTTPProtocol

    class WatchedConnection(base):  # type: ignore[misc]
        def connection_made(self, transport: asyncio.Transport) -> None:
            super().connection_made(transport)
            door.come(transport)

        def connection_lost(self, error: Exception | None) -> None:
            door.go(self.transport)
            super().connection_lost(error)

    return WatchedConnection


class PendantServer(uvicorn.Server):
    """Accepts as many connections in a row as `uvicorn.Config.backlog` says; more of them wait in the kernel.

    Args:
        config: of `server_config`.
        began: called when pages are answered.
    """

    def __init__(self, config: uvicorn.Config, began: Callable[[], None]) -> None:
        super().__init__(config)
        self._began = began

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Begin to answer, and say so."""
        await super().startup(sockets)
        for listener in sockets or []:
            listener.listen(BACKLOG)
        self._began()


@asynccontextmanager
async def _watch_arms(
    floor: DriveFloor, reader: AnsweringProcess, scope: AnsweringProcess, _app: FastAPI
) -> AsyncIterator[None]:
    """Watch every arm while the server runs; at its end arms that are under command are brought to rest."""
    for arm in floor.arms:
        arm.worker.start()  # it takes seconds
    reader.start()
    tasks = [asyncio.create_task(arm.watch.run()) for arm in floor.arms]
    tasks.append(asyncio.create_task(_look_at_lease(floor)))
    try:
        yield
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        await asyncio.to_thread(close_all, floor.arms)
        for process in (reader, scope):
            await asyncio.to_thread(process.close)


async def _look_at_lease(floor: DriveFloor) -> None:
    while True:
        await asyncio.sleep(LEASE_LOOK_S)
        floor.look_at_lease()
        floor.changed()  # a page that hears nothing takes the pendant for one that does not answer
