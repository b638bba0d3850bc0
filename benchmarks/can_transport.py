"""The transport over CAN for `benchmarks.transports`: between processes by UDP multicast, against python-can alone."""

from __future__ import annotations

import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Final

import can

from benchmarks.transports import BARE, OURS, Desk
from qrobot.hwif.bus import safe_operations
from qrobot.hwif.canbus.client import CanBus
from qrobot.hwif.canbus.frames import TPDO, encode_operations
from qrobot.hwif.canbus.interface import open_interface
from qrobot.hwif.canbus.node import BoardNode
from qrobot.hwif.image import make_image

GROUP: Final = "239.74.163.2"
PATIENCE_S: Final = 60.0
FRAMES_BACK: Final = len(TPDO)
_ASK, _ANSWER = 0x100, 0x200


@contextmanager
def our_can() -> Iterator[Callable[[], object]]:
    """What a gateway does each cycle, with the far end in another process."""
    with far_end(OURS) as channel:
        bus = CanBus("udp_multicast", channel, timeout_s=PATIENCE_S)
        operations, image = safe_operations(0), make_image()
        bus.connect()
        yield lambda: bus.exchange(operations, image)
        bus.close()


@contextmanager
def bare_frames() -> Iterator[Callable[[], object]]:
    """As many frames there and back by python-can alone; the last one there is answered."""
    frames_out = len(encode_operations(safe_operations(0))) + 1
    with far_end(BARE) as channel, open_interface("udp_multicast", channel) as bus:

        def exchange() -> None:
            for left in range(frames_out, 0, -1):
                bus.send(_message(_ASK, left))
            answers = 0
            while answers < FRAMES_BACK:
                message = bus.recv(PATIENCE_S)
                if message is None:
                    raise TimeoutError("the far end of the bare loop is silent")
                answers += message.arbitration_id == _ANSWER

        yield exchange


@contextmanager
def far_end(kind: str) -> Iterator[str]:
    """The far end in a process of its own, listening on the channel given."""
    channel = f"{GROUP}/{free_port()}"
    command = [sys.executable, "-m", "benchmarks.can_transport", kind, channel]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        process.stdout.readline()
        try:
            yield channel
        finally:
            process.terminate()


def free_port() -> int:
    """A UDP port of nobody's."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def serve_ours(channel: str) -> None:
    """A board of ours, until the end of the process."""
    desk = Desk()
    desk.apply(safe_operations(0))
    with open_interface("udp_multicast", channel) as bus:
        node = BoardNode(bus, desk, watchdog_ms=0)
        node.boot()
        print("listening", flush=True)
        while True:
            node.step(1.0)


def serve_bare(channel: str) -> None:
    """Answers, until the end of the process."""
    with open_interface("udp_multicast", channel) as bus:
        print("listening", flush=True)
        while True:
            message = bus.recv(1.0)
            if message is not None and message.arbitration_id == _ASK and message.data[0] == 1:
                for number in range(FRAMES_BACK):
                    bus.send(_message(_ANSWER, number))


def _message(can_id: int, first: int) -> can.Message:
    return can.Message(arbitration_id=can_id, data=bytes((first,)) + bytes(7), is_extended_id=False)


if __name__ == "__main__":
    {OURS: serve_ours, BARE: serve_bare}[sys.argv[1]](sys.argv[2])
