"""One `qrobot pendant` for all tests of its page: to start it, and the processes it keeps ready, takes seconds."""

from __future__ import annotations

import http.client
import signal
import subprocess
from pathlib import Path

import pytest
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from qrobot.pendant.gate import cookie_name
from tests.support.patience import PATIENCE_S
from tests.support.processes import RunningArm, free_port, qrobot
from tests.support.relay import Relay

PROGRAM = "back_and_forth.py"
SOURCE = """from qrobot import rccl

with rccl.control("puma560") as arm:
    arm.keep_path()
    arm.setjvel(0.3)
    waist, *others = arm.joints
    while True:
        for degrees in (-30.0, 0.0):
            arm.move(arm.jposition("swing", [waist + degrees, *others]))
            arm.waitfor(arm.completed)
"""
ONCE = "once.py"
SOURCE_OF_ONCE = """from qrobot import rccl

with rccl.control("puma560") as arm:
    arm.setjvel(0.2)
    waist, *others = arm.joints
    for degrees in (-30.0, 0.0):
        arm.move(arm.jposition("swing", [waist + degrees, *others]))
    arm.waitfor(arm.completed)
"""
FENCES = """
[arm.fences]
self_collision = true
shape = [
  { name = "bench", shape = "box", size_m = [0.6, 1.2, 0.1], position_m = [0.6, 0.0, -0.35], rpy_deg = [20, 5, 0] },
  { name = "pole", shape = "cylinder", radius_m = 0.1, length_m = 0.6, position_m = [0.4, 0.5, 0.2], bodies = "links" },
  { name = "cell", shape = "box", keep = "in", bodies = "tool", size_m = [1.6, 1.8, 2.4] },
  { name = "window", shape = "plane", position_m = [0.9, 0.0, 0.0], rpy_deg = [0, -90, 0] },
]
"""


class Pendant:
    """`qrobot pendant` of two arms, and what its address tells.

    The servo of the first one does not know its fences; the second one is not there.
    """

    def __init__(self, arm: RunningArm, folder: Path) -> None:
        self.deployment = folder / "two.toml"
        table = Path(arm.deployment).read_text()
        absent = table.replace(arm.name, "absent").replace(str(arm.arm.bridge.port), str(free_port()))
        self.deployment.write_text(table + FENCES + absent)
        programs = folder / "programs"
        programs.mkdir()
        (programs / PROGRAM).write_text(SOURCE)
        (programs / ONCE).write_text(SOURCE_OF_ONCE)
        self.process = qrobot(
            "pendant", "--deployment", self.deployment, "--port", "0", "--taught", folder / "t.db",
            "--programs", programs, stderr=subprocess.DEVNULL,
        )  # fmt: skip
        assert self.process.stdout is not None
        self.address = self.process.stdout.readline().strip()
        self.host, _, query = self.address.removeprefix("http://").partition("/?")
        token = query.removeprefix("token=")
        self.cookie = f"{cookie_name(token)}={token}"

    def address_by(self, relay: Relay) -> str:
        """Its address through something between."""
        return self.address.replace(self.host, f"127.0.0.1:{relay.port}")

    def status_of(self, path: str, **headers: str) -> int:
        """Status with which a request is answered."""
        connection = http.client.HTTPConnection(self.host, timeout=PATIENCE_S)
        connection.request("GET", path, headers={"Host": self.host, **headers})
        status = connection.getresponse().status
        connection.close()
        return status

    def status_of_socket(self, path: str, origin: str, cookie: str) -> int:
        """The same of a WebSocket; 101 when it opens."""
        try:
            with connect(f"ws://{self.host}{path}", origin=origin, additional_headers={"Cookie": cookie}):  # type: ignore[arg-type]
                return 101
        except InvalidStatus as refusal:
            return refusal.response.status_code

    def close(self) -> None:
        """End it as Ctrl-C does."""
        self.process.send_signal(signal.SIGINT)
        self.process.communicate(timeout=PATIENCE_S)


class SharedPendant:
    """Starts when it is first asked for, and anew when it has died or the arm is another one than before."""

    def __init__(self) -> None:
        self._pendant: Pendant | None = None
        self._arm: RunningArm | None = None

    def of(self, arm: RunningArm, folders: pytest.TempPathFactory) -> Pendant:
        """The pendant of an arm; it keeps its files in a folder of its own."""
        if self._pendant is None or self._arm is not arm or self._pendant.process.poll() is not None:
            self.close()
            self._pendant, self._arm = Pendant(arm, folders.mktemp("pendant")), arm
        return self._pendant

    def close(self) -> None:
        """End it, if it runs."""
        pendant, self._pendant = self._pendant, None
        if pendant is not None:
            pendant.close()
