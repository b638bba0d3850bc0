"""A task of RCI in C with a robot: how long from a STATE that is sent to it until its COMMAND is here.

The other end is a bridge of an ideal arm in this process. It looks for the answer all the time, so that its own
wake-up is no part of the figure; two crossings of the loopback interface, the wake-up of the task, its control
function and the check of what that asks for are.
"""

from __future__ import annotations

import socket
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from qrobot.rccl.offline import OfflineLink
from qrobot.wire import Command, Connection, Hello, Side
from qrobot.wire.connection import WireEvent

RATE_HZ: Final = 1000
PERIOD_NS: Final = 1_000_000
CHUNK: Final = 4096
PATIENCE_NS: Final = 10_000_000_000


def answers(program: Path, runs: int) -> tuple[NDArray[np.float64], int]:
    """Round trips, us, of so many samples, and what the task missed. Raises OSError when the program gives up."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        server.settimeout(PATIENCE_NS * 1e-9)
        bridge = f"127.0.0.1:{server.getsockname()[1]}"
        command = [program, "answers", str(RATE_HZ), "1", str(runs), bridge]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as task:
            client, _ = server.accept()
            with client:
                took = np.array(list(_round_trips(client)), float) / 1e3
            said, _ = task.communicate(timeout=PATIENCE_NS * 1e-9)
    return took[-runs:], int(said)


def _round_trips(client: socket.socket) -> Iterator[int]:
    """Nanoseconds of each sample until the client says goodbye."""
    client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    client.setblocking(False)
    connection = Connection(Side.SERVER)
    heard, came_ns = _heard(client, connection)
    assert isinstance(heard, Hello)
    arm = OfflineLink(heard)
    client.sendall(connection.send(arm.open()))
    asked: Command | None = None
    while True:
        packet = connection.send(arm.exchange(asked))
        time.sleep(max(0, came_ns + PERIOD_NS - time.monotonic_ns()) * 1e-9)
        sent_ns = time.monotonic_ns()
        client.sendall(packet)
        heard, came_ns = _heard(client, connection)
        if not isinstance(heard, Command):
            return
        asked = heard
        yield came_ns - sent_ns


def _heard(client: socket.socket, connection: Connection) -> tuple[WireEvent | None, int]:
    """The next packet, None at the end of all, and the instant at which its last bytes came, ns."""
    until = time.monotonic_ns() + PATIENCE_NS
    came_ns = until
    while (event := connection.next_event()) is None:
        try:
            data = client.recv(CHUNK)
        except BlockingIOError:
            if time.monotonic_ns() > until:
                raise TimeoutError("the task does not answer") from None
            continue
        came_ns = time.monotonic_ns()
        if not data:
            return None, came_ns
        connection.receive_data(data)
    return event, came_ns
