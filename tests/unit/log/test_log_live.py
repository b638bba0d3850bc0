"""The live view: what a viewer receives, that it can ask for nothing, and what becomes of it when the servo goes.

Its server has threads of its own, which nobody here holds still: it belongs to the tests on the wall clock.
"""

from __future__ import annotations

import base64
import json
import os
import socket
import struct
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from qrobot.config import load_robot
from qrobot.config.fences import Fence
from qrobot.errors import LinkError
from qrobot.fences.told_fences import ToldFences
from qrobot.log.live import LiveServer
from qrobot.log.pace import Pace
from qrobot.servo.memory.telemetry import TelemetryLayout
from tests.support.log_samples import make_header, make_rows
from tests.support.patience import PATIENCE_S

N = 6
ROBOT = load_robot("puma560")


class Viewer:
    """A WebSocket client that speaks Foxglove's protocol no better than it must."""

    def __init__(self, port: int) -> None:
        self.socket = socket.create_connection(("127.0.0.1", port), timeout=PATIENCE_S)
        key = base64.b64encode(os.urandom(16)).decode()
        self.socket.sendall(
            f"GET / HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
            f"Sec-WebSocket-Key: {key}\r\nSec-WebSocket-Version: 13\r\n"
            "Sec-WebSocket-Protocol: foxglove.sdk.v1\r\n\r\n".encode()
        )
        self.stream = self.socket.makefile("rb")
        self.answer = self.stream.readline().decode()
        while self.stream.readline() not in (b"\r\n", b""):
            pass

    def __enter__(self) -> Viewer:
        return self

    def __exit__(self, *_: object) -> None:
        self.stream.close()
        self.socket.close()

    def frame(self) -> tuple[int, bytes]:
        """Operation code and content of the next frame."""
        first, second = self.stream.read(2)
        size = second & 0x7F
        if size == 126:
            (size,) = struct.unpack(">H", self.stream.read(2))
        elif size == 127:
            (size,) = struct.unpack(">Q", self.stream.read(8))
        return first & 0x0F, self.stream.read(size)

    def message(self, op: str) -> dict[str, Any]:
        """The next JSON message of that kind."""
        while True:
            code, content = self.frame()
            if code == 1 and (told := json.loads(content))["op"] == op:
                return dict(told)

    def send(self, **told: Any) -> None:
        content = json.dumps(told).encode()
        size = struct.pack(">BBH", 0x81, 0x80 | 126, len(content))
        self.socket.sendall(size + bytes(4) + content)  # masked with zeros

    def data(self) -> bytes:
        """The content of the next data message: operation 1, subscription, time, then the message."""
        while True:
            code, content = self.frame()
            if code == 2 and content[0] == 1:
                return content[13:]


@pytest.fixture
def server() -> Iterator[LiveServer]:
    floor = ToldFences(fences=(Fence(name="hall", shape="plane"),))
    server = LiveServer(0, make_header(N), 100, ROBOT, fences=floor)
    yield server
    server.close()


@pytest.mark.realtime
def test_a_viewer_gets_rows_to_the_byte_at_the_pace_asked_for(server: LiveServer) -> None:
    with Viewer(server.port) as viewer:
        look(viewer, server)


def look(viewer: Viewer, server: LiveServer) -> None:
    assert "101" in viewer.answer
    offered = viewer.message("serverInfo")
    assert offered["capabilities"] == []
    channels = {each["topic"]: each for each in viewer.message("advertise")["channels"]}
    assert {"/servo/tick", "/servo/law", "/arm/joint_states", "/tf"} <= set(channels)
    viewer.send(op="subscribe", subscriptions=[{"id": 7, "channelId": channels["/servo/tick"]["id"]}])
    viewer.send(op="subscribe", subscriptions=[{"id": 7, "channelId": channels["/servo/tick"]["id"]}])
    assert viewer.message("status")["level"] in (1, 2)  # the second one is refused: so the first one stands
    rows = make_rows(50, N)
    rows["t_ns"] = np.arange(50) * 1_000_000  # 1 kHz
    server.append(rows)
    row_bytes = TelemetryLayout(N).row_words * 8
    received = [viewer.data() for _ in range(5)]
    for content, wanted in zip(received, rows[::10], strict=True):
        assert content[4:] == wanted.tobytes()
        assert len(content) == row_bytes + 4
    viewer.send(op="subscribe", subscriptions=[{"id": 8, "channelId": channels["/arm/scene"]["id"]}])
    viewer.send(op="subscribe", subscriptions=[{"id": 8, "channelId": channels["/arm/scene"]["id"]}])
    assert viewer.message("status")["level"] in (1, 2)
    server.flush()  # draws all once more, for those who come late
    rows["t_ns"] += 50_000_000
    server.append(rows)
    while b"hall: keep out" not in viewer.data():
        pass


@pytest.mark.realtime
def test_a_second_server_on_one_port_is_refused_with_the_remedy(server: LiveServer) -> None:
    with pytest.raises(LinkError, match=f"{server.port}.*--port"):
        LiveServer(server.port, make_header(N), 100, ROBOT)


@pytest.mark.realtime
def test_its_end_ends_every_connection(server: LiveServer) -> None:
    with Viewer(server.port) as viewer:
        viewer.message("advertise")
        server.close()
        while viewer.stream.read(65536):
            pass
    with pytest.raises(ConnectionRefusedError):
        Viewer(server.port)


def test_a_pace_takes_the_first_row_of_each_period_over_batches_of_any_size() -> None:
    times = np.arange(0, 10_000) * 250_000
    whole = Pace(100).due(times)
    assert whole == list(range(0, 10_000, 40))
    pace, begin, taken = Pace(100), 0, []
    for size in np.random.default_rng(4).integers(0, 200, 200):
        taken += [begin + k for k in pace.due(times[begin : begin + size])]
        begin += int(size)
    assert taken == [k for k in whole if k < begin]
