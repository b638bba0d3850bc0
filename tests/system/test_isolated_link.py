"""An isolated link: programs of the other host command the arm, nobody else does, and a pulled cable stops it."""

from __future__ import annotations

import json
import os
import socket
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from qrobot.errors import ConfigError, LinkError
from qrobot.rccl_bridge.isolated_link import IsolatedLink, read_link_token
from qrobot.rci import TcpLink, hello_for, tcp
from qrobot.units import NS_PER_S
from qrobot.wire import Command, JointMode
from tests.support.bridge import Bridge
from tests.support.cable import HERE, INTERFACE, STRANGER, THERE, leave_the_network, plug
from tests.support.patience import PATIENCE_S, wait_until

LINK_TOKEN, BRIDGE_TOKEN = b"k" * 44, b"0" * 64
ROOT = Path(__file__).parents[2]


def attempt(action: Callable[[], object]) -> str:
    """What came of it, as text."""
    try:
        return str(action())
    except LinkError as error:
        return str(error)


def command_from(source: str, address: tuple[str, int], token: bytes) -> str:
    """Command the arm as a program of a host: joints to 0.1 rad, as far as one can tell by STATE."""
    os.environ["QROBOT_TOKEN"] = token.decode()
    link = TcpLink(hello_for("puma560"), address, lambda there: socket.create_connection(there, 3.0, (source, 0)))
    try:
        link.open()
        state = link.exchange(None)
        for _ in range(3):
            state = link.exchange(Command(state.seq, (JointMode.POSITION,) * 6, (0.1,) * 6, power=True))
        return f"joint 1 at {state.robot.q[0]}"
    finally:
        with suppress(LinkError):
            link.close()


def who_may_come() -> dict[str, Any]:
    """Inside a network of one's own: what programs of three hosts meet, and what a pulled cable does."""
    tcp.ANSWER_TIMEOUT_S = tcp.LINGER_S = PATIENCE_S  # type: ignore[misc]
    plug(connected=True)
    link = IsolatedLink(INTERFACE, HERE, (THERE,), LINK_TOKEN)
    with Bridge(link=link) as bridge:
        bridge.server.token = BRIDGE_TOKEN
        near = bridge.server.address
        far = HERE, near[1]
        told = {
            "peer": attempt(lambda: command_from(THERE, far, LINK_TOKEN)),
            "peer without": attempt(lambda: command_from(THERE, far, b"")),
            "peer with the bridge's": attempt(lambda: command_from(THERE, far, BRIDGE_TOKEN)),
            "stranger": attempt(lambda: command_from(STRANGER, far, LINK_TOKEN)),
            "here": attempt(lambda: command_from("127.0.0.1", near, BRIDGE_TOKEN)),
            "here with the link's": attempt(lambda: command_from("127.0.0.1", near, LINK_TOKEN)),
        }
        os.environ["QROBOT_TOKEN"] = LINK_TOKEN.decode()
        program = TcpLink(hello_for("puma560"), far, lambda at: socket.create_connection(at, 3.0, (THERE, 0)))
        program.open()
        state = program.exchange(None)
        program.exchange(Command(state.seq, (JointMode.POSITION,) * 6, (0.2,) * 6, power=True))
        before = bridge.port.stops
        for client in list(bridge.server.clients):
            client.session._settings = replace(client.session._settings, silence_ns=NS_PER_S)
        plug(connected=False)
        wait_until(lambda: bridge.port.stops > before, "the arm is stopped")
        plug(connected=True)
        wait_until(lambda: not bridge.server.clients, "the silent program's place is free")
        return told | {"after": attempt(lambda: command_from(THERE, far, LINK_TOKEN))}


def test_programs_of_the_other_host_command_the_arm_and_a_pulled_cable_stops_it() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "tests.system.test_isolated_link"], cwd=ROOT, capture_output=True, text=True, check=False
    )
    if "no network of one's own" in done.stderr:
        pytest.skip("this account may not make a network of its own (continuous integration may)")
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout)
    assert told["peer"] == told["after"] == told["here"] == "joint 1 at 0.1"
    assert "no token; give it the token of the link, from its file, in QROBOT_TOKEN" in told["peer without"]
    assert "another bridge's token" in told["peer with the bridge's"]
    assert f"{STRANGER} is no peer of this link; {THERE} may come" in told["stranger"]
    assert "another bridge's token" in told["here with the link's"]


@pytest.mark.parametrize(
    ("content", "mode", "says"),
    [
        (None, 0o600, r"No such file.*head -c 32 /dev/urandom"),
        (b"x" * 40, 0o640, "chmod 600"),
        (b"", 0o600, "32 to 128 letters"),
        (b"x" * 31, 0o600, "32 to 128 letters"),
        (b"x" * 129, 0o600, "32 to 128 letters"),
        (b"\xff" * 40, 0o600, "32 to 128 letters"),
        (b"two words " * 4, 0o600, "32 to 128 letters"),
    ],
)
def test_a_file_that_is_no_token_is_refused(tmp_path: Path, content: bytes | None, mode: int, says: str) -> None:
    path = tmp_path / "link.token"
    if content is not None:
        path.write_bytes(content)
        path.chmod(mode)
    with pytest.raises(ConfigError, match=says):
        read_link_token(path)
    path.write_bytes(b" " + b"x" * 44 + b"\n")
    path.chmod(0o600)
    assert read_link_token(path) == b"x" * 44


if __name__ == "__main__":
    leave_the_network()
    print(json.dumps(who_may_come()))
