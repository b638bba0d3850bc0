"""What is wrong is told in one line on stderr, the exit status is not 0, there is no traceback, and nothing moves."""

from __future__ import annotations

import socket
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from qrobot.errors import LinkError
from qrobot.modecodes import Mode
from qrobot.rig.processes import ProcessPlan, ProcessRig
from qrobot.wire import Connection, ErrorCode, Side, WireError
from tests.support.patience import PATIENCE_S
from tests.support.processes import CREEP_COUNTS, RunningArm, free_port, qrobot, shared_starter

pytestmark = pytest.mark.realtime

# ---------------------------------------------------------------------------------------------------- beside a live arm


@pytest.fixture
def undisturbed(arm: RunningArm) -> Iterator[None]:
    """The arm stands where it stood, in the mode it had, and all its processes live."""
    encoders, mode, running = arm.encoders(), arm.mode, arm.running()
    yield
    assert np.abs(np.subtract(arm.encoders(), encoders)).max() <= CREEP_COUNTS
    assert (arm.mode, arm.running()) == (mode, running)


def one_line(process: subprocess.Popen[str]) -> str:
    """What a command that fails says: one line, behind what it has told of the compiler."""
    _, told = process.communicate(timeout=PATIENCE_S)
    complaint = "".join(line for line in told.splitlines(True) if not line.startswith("compiling kernel "))
    assert process.returncode == 1
    assert complaint.startswith("qrobot: ")
    assert complaint.count("\n") == 1
    return complaint


@pytest.mark.parametrize(
    ("command", "complaint"),
    [
        ("board", "-board' belongs to a running process"),
        ("servo", " has a controller already, a servo or another program"),
        ("guardian", "-guardian' belongs to a running process"),
    ],
)
@pytest.mark.usefixtures("undisturbed")
def test_a_second_process_of_its_kind_is_refused(arm: RunningArm, command: str, complaint: str) -> None:
    assert f"{arm.name}{complaint}" in one_line(qrobot(command, arm.deployment))


@pytest.mark.usefixtures("undisturbed")
def test_a_second_bridge_is_refused(arm: RunningArm) -> None:
    assert f"127.0.0.1:{arm.arm.bridge.port} is in use" in one_line(qrobot("bridge", arm.deployment))


@pytest.mark.usefixtures("undisturbed")
def test_a_second_set_of_processes_is_refused(arm: RunningArm, tmp_path: Path) -> None:
    other_port = edit_port(arm.deployment, tmp_path / "again.toml")
    with qrobot("up", other_port, "--out-dir", tmp_path) as process:
        _, complaint = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 1
    assert f"{arm.name}-board is not started: another process does its work already" in complaint


def edit_port(deployment: Path, copy: Path) -> Path:
    before, after = deployment.read_text().split("port = ")
    copy.write_text(f"{before}port = {free_port()} }}\n{after.split(chr(10), 1)[1]}")
    return copy


def run_text(arm: RunningArm, tmp_path: Path, text: str) -> subprocess.Popen[str]:
    program = tmp_path / "program.py"
    program.write_text(text)
    return qrobot("run", "--deployment", arm.deployment, program)


@pytest.mark.usefixtures("undisturbed")
def test_a_program_for_another_robot_is_refused(arm: RunningArm, tmp_path: Path) -> None:
    complaint = one_line(run_text(arm, tmp_path, 'from qrobot import rccl\nrccl.control("stanford")\n'))
    assert "this is 'puma560', not 'stanford'" in complaint


@pytest.mark.usefixtures("undisturbed")
def test_a_malformed_packet_is_answered_and_the_bridge_lives(arm: RunningArm) -> None:
    with socket.create_connection(("127.0.0.1", arm.arm.bridge.port), PATIENCE_S) as vandal:
        vandal.sendall(b"GET / HTTP/1.1\r\nHost: robot\r\n\r\n" * 100)
        answer = b"".join(iter(lambda: vandal.recv(65_536), b""))
    client = Connection(Side.CLIENT)
    client.receive_data(answer)
    error = client.next_event()
    assert isinstance(error, WireError)
    assert (error.code, error.fatal) == (ErrorCode.MALFORMED, True)


RAISES = """
from qrobot import rccl

arm = rccl.control("puma560", period_ms=100)
arm.move(arm.pose("end"))
arm.waitas(lambda: max(map(abs, arm.how.v)) > 0.1)
raise RuntimeError("mine")
"""


def test_a_program_that_raises_ends_with_its_own_traceback_and_leaves_the_arm_at_rest(
    arm: RunningArm, tmp_path: Path
) -> None:
    begin = arm.encoders()
    with run_text(arm, tmp_path, RAISES) as process:
        _, complaint = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 1
    assert complaint.splitlines()[-1] == "RuntimeError: mine"
    assert arm.mode is Mode.HOLDING
    assert np.abs(np.subtract(arm.encoders(), begin)).max() > 100
    arm.wait_for_rest()


HOLDS = """
from qrobot import rccl

arm = rccl.control("puma560", period_ms=100)
print("ready", flush=True)
arm.waitas(lambda: False)
"""


def test_a_second_commander_is_refused_by_name_and_the_first_goes_on(arm: RunningArm, tmp_path: Path) -> None:
    first = run_text(arm, tmp_path, HOLDS)
    try:
        assert first.stdout is not None
        assert first.stdout.readline() == "ready\n"
        second = tmp_path / "second.py"
        second.write_text(HOLDS)
        complaint = one_line(qrobot("run", "--deployment", arm.deployment, second))
        assert "commanded by program.py" in complaint
        assert arm.mode is Mode.TRACKING
    finally:
        first.terminate()
        first.communicate(timeout=PATIENCE_S)


def has_ended(pid: int) -> bool:
    """As if another one served meanwhile, that the process has found in its place."""
    return pid != 0 and not Path(f"/proc/{pid}").exists()  # its parent, the fork server, has taken note


@pytest.mark.parametrize("ready", [lambda _: False, has_ended])
def test_the_rig_tells_why_a_process_did_not_start(ready: Callable[[int], bool], tmp_path: Path) -> None:
    with (
        ProcessRig(tmp_path, shared_starter()) as rig,
        pytest.raises(LinkError, match=r"did not start: no program missing\.py"),
    ):
        rig.start(ProcessPlan("broken", ["run", "missing.py"], ready))
