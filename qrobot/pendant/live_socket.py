"""The WebSocket between a page and the pendant: samples and changes one way, messages the other."""

from __future__ import annotations

import asyncio
import logging
from contextlib import suppress
from typing import TYPE_CHECKING

from qrobot.errors import QRobotError, error_text
from qrobot.pendant.floor import DriveFloor, PageView
from qrobot.pendant.messages import decode_message

if TYPE_CHECKING:
    from starlette.websockets import WebSocket

_log = logging.getLogger(__name__)


async def serve_page(floor: DriveFloor, socket: WebSocket) -> None:
    """Serve one page until it has gone."""
    from starlette.websockets import WebSocketDisconnect

    await socket.accept()
    due = asyncio.Event()
    loop = asyncio.get_running_loop()
    page = floor.enter(lambda: _wake(loop, due))
    teller = asyncio.create_task(_tell(floor, page, socket, due))
    try:
        while True:
            _obey(floor, page, await socket.receive_text())
    except (WebSocketDisconnect, RuntimeError, KeyError):  # gone, or it has sent bytes
        pass
    finally:
        floor.leave(page)
        teller.cancel()
        with suppress(asyncio.CancelledError, WebSocketDisconnect, RuntimeError):
            await teller


def _wake(loop: asyncio.AbstractEventLoop, due: asyncio.Event) -> None:
    """Wake the teller, from whichever thread."""
    with suppress(RuntimeError):  # the loop is closed: the server ends
        loop.call_soon_threadsafe(due.set)


def _obey(floor: DriveFloor, page: PageView, text: str) -> None:
    """Do what a page says; what is no message is refused and ends nothing."""
    try:
        floor.obey(page, decode_message(text))
    except QRobotError as error:
        page.complain(str(error))
    except Exception as error:  # a full disk, say: a page that drives would lose its arms by the end of its connection
        _log.exception("what page %s asks for failed", page.number)
        page.complain(f"not done: {error_text(error) if isinstance(error, OSError) else type(error).__name__}")


async def _tell(floor: DriveFloor, page: PageView, socket: WebSocket, due: asyncio.Event) -> None:
    await socket.send_text(floor.hello(page))
    while True:
        await due.wait()
        due.clear()
        while page.status_due or page.frames:  # the status first, also where samples come faster than they leave
            if page.status_due:
                await socket.send_text(floor.status(page))
            else:
                await socket.send_bytes(page.frames.popleft())
