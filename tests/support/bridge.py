"""A bridge in a thread of this process, with a servo that tracks perfectly, and a short client of it."""

from __future__ import annotations

import asyncio
import socket
import threading

from qrobot.rccl_bridge import BridgeServer, BridgeSettings
from qrobot.rccl_bridge.listener import precise_loop
from qrobot.wire import ClientRole, Connection, Hello, Side, Welcome, WireEvent
from tests.support.fake_port import FakePort
from tests.support.patience import PATIENCE_S

COMMANDER = Hello(ClientRole.COMMANDER, "puma560", "test", period_us=5_000)
PATIENT = dict.fromkeys(("handshake_ns", "silence_ns", "blocked_ns"), round(PATIENCE_S * 1e9))
OBSERVER = Hello(ClientRole.OBSERVER, "", "test", period_us=5_000)


class Bridge:
    """A bridge in a thread of this process, patient with clients unless it is told not to be."""

    def __init__(self, **settings: int) -> None:
        self.port = FakePort()
        self.server = BridgeServer(self.port, BridgeSettings(**{"port": 0, **PATIENT, **settings}))
        self._ready, self._loop = threading.Event(), precise_loop()
        self._stop = asyncio.Event()
        self._thread = threading.Thread(target=self._run)

    def _run(self) -> None:
        self._loop.run_until_complete(self._serve())
        self._loop.close()

    async def _serve(self) -> None:
        await self.server.start()
        self._ready.set()
        await self._stop.wait()
        await self.server.close()

    def __enter__(self) -> Bridge:
        self._thread.start()
        assert self._ready.wait(PATIENCE_S)
        return self

    def __exit__(self, *error: object) -> None:
        self.begin_to_end()
        self._thread.join(PATIENCE_S)
        assert not self._thread.is_alive()

    def begin_to_end(self) -> None:
        if not self._loop.is_closed():
            self._loop.call_soon_threadsafe(self._stop.set)

    def stall(self, seconds: float, told_at: str) -> None:
        """It stands still with its arm, beginning soon; see `FakePort.stall`."""
        self._loop.call_soon_threadsafe(self.port.stall, seconds, told_at)

    def connect(self, source: str = "") -> Client:
        """A client, from another address of this machine where one is given."""
        return Client(self.server.address, source)


class Client:
    """A blocking client, as short as can be."""

    def __init__(self, address: tuple[str, int], source: str = "") -> None:
        self.socket = socket.socket()
        if source:
            self.socket.bind((source, 0))
        self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 16_384)  # so that a sleeper is found out soon
        self.socket.settimeout(PATIENCE_S)
        self.socket.connect(address)
        self.wire = Connection(Side.CLIENT)

    def say(self, packet) -> None:
        self.socket.sendall(self.wire.send(packet))

    def hear(self) -> WireEvent | None:
        """Next event; None when the bridge has hung up."""
        while (event := self.wire.next_event()) is None:
            data = self.socket.recv(65_536)
            if not data:
                return None
            self.wire.receive_data(data)
        return event

    def join(self, hello: Hello = COMMANDER) -> Client:
        self.say(hello)
        assert isinstance(self.hear(), Welcome)
        return self

    def __enter__(self) -> Client:
        return self

    def __exit__(self, *error: object) -> None:
        self.socket.close()
