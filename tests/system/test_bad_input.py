"""What is wrong is told in one line on stderr, the exit status is not 0, there is no traceback, and nothing moves."""

from __future__ import annotations

import socket
import subprocess
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from qrobot.cli.console import run_app
from qrobot.cli.main import make_app
from qrobot.errors import LinkError
from qrobot.rig.processes import Plan, ProcessRig
from qrobot.servo.modes import Mode
from qrobot.wire import Connection, ErrorCode, Side, WireError
from tests.support.processes import PATIENCE_S, RunningArm, free_port, qrobot, running_arms, write_deployment

pytestmark = pytest.mark.realtime

STILL_COUNTS = 2

# ------------------------------------------------------------------------------------------------- before anything runs


@pytest.fixture
def deployment(tmp_path: Path) -> Path:
    return write_deployment(tmp_path)


def complaint_of(capsys: pytest.CaptureFixture[str], *tokens: str | Path, status: int = 1) -> str:
    """The one line `qrobot TOKENS` says before it fails."""
    assert run_app(make_app(), [str(token) for token in tokens]) == status
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.startswith("qrobot: ")
    assert captured.err.count("\n") == 1
    return captured.err


def edit(path: Path, old: str, new: str) -> Path:
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))
    return path


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("[[arm]]", "[[arm]", ["arms.toml", "line 2"]),
        ("rate_hz", "rate_herz", ["arm.0.servo.rate_herz: unknown key; did you mean 'rate_hz'?", "1 mistake"]),
        ("rate_hz = 1000", "rate_hz = 7", ["rate_hz", "100"]),
        ("rate_hz = 1000", "rate_hz = nan", ["rate_hz"]),
        ('robot = "puma560"', 'robot = "puma650"', ["puma650", "puma560"]),
        ("rate_hz = 1000", 'law = "pid"', ["pid", "pd"]),
    ],
    ids=["broken", "unknown key", "rate", "nan", "robot", "law"],
)
def test_a_wrong_deployment_is_refused_before_anything_starts(
    deployment: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], old: str, new: str, words: list[str]
) -> None:
    edit(deployment, old, new)
    complaint = complaint_of(capsys, "up", deployment, "--out-dir", tmp_path / "processes")
    assert all(word in complaint for word in words), complaint
    assert not (tmp_path / "processes").exists()


@pytest.mark.parametrize(
    ("tokens", "status", "words"),
    [
        (["up", "nowhere.toml"], 1, ["nowhere.toml"]),
        (["servo", "{deployment}", "--rate", "7"], 1, ["7", "50 to 20000 Hz"]),
        (["servo", "{deployment}", "--rate", "0"], 1, ["0", "50 to 20000 Hz"]),
        (["servo", "{deployment}", "--law", "pid"], 1, ["pid", "pd"]),
        (["servo", "{deployment}", "--arm", "third"], 1, ["third"]),
        (["servo", "{deployment}"], 1, ["no shared memory", "-board"]),
        (["guardian", "{deployment}"], 1, ["no shared memory", "-servo"]),
        (["run", "missing.py"], 1, ["missing.py"]),
        (["log", "info", "missing.mcap"], 1, ["missing.mcap"]),
        (["demo", "--law", "pid"], 1, ["pid", "pd"]),
        (["demo", "--rate", "3000"], 2, ["--rate", "3000"]),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else None,
)
def test_a_wrong_command_is_one_line(
    deployment: Path, capsys: pytest.CaptureFixture[str], tokens: list[str], status: int, words: list[str]
) -> None:
    tokens = [token.format(deployment=deployment) for token in tokens]
    complaint = complaint_of(capsys, *tokens, status=status)
    assert all(word in complaint for word in words), complaint


def test_a_busy_port_is_told_before_anything_starts(
    deployment: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    port = int(deployment.read_text().split("port = ")[1].split()[0])
    with socket.create_server(("127.0.0.1", port)):
        complaint = complaint_of(capsys, "up", deployment, "--out-dir", tmp_path / "processes")
    assert f"127.0.0.1:{port} is in use" in complaint
    assert not (tmp_path / "processes").exists()


def test_a_program_without_a_bridge_is_told_how_to_start_one(
    deployment: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("QROBOT_BRIDGE", f"127.0.0.1:{free_port()}")
    program = tmp_path / "program.py"
    program.write_text('from qrobot import rccl\nrccl.control("puma560")\n')
    assert "qrobot up" in complaint_of(capsys, "run", program)


# ---------------------------------------------------------------------------------------------------- beside a live arm


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningArm]:
    with running_arms(tmp_path_factory.mktemp("bad")) as arms:
        yield arms[0]


@pytest.fixture
def undisturbed(arm: RunningArm) -> Iterator[None]:
    """The arm stands where it stood, in the mode it had, and all its processes live."""
    encoders, mode, running = arm.encoders(), arm.mode, arm.running()
    yield
    assert np.abs(np.subtract(arm.encoders(), encoders)).max() <= STILL_COUNTS
    assert (arm.mode, arm.running()) == (mode, running)


def one_line(process: subprocess.Popen[str]) -> str:
    """What a command that fails says: one line."""
    _, complaint = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 1
    assert complaint.startswith("qrobot: ")
    assert complaint.count("\n") == 1
    return complaint


@pytest.mark.parametrize("command", ["board", "servo", "guardian"])
@pytest.mark.usefixtures("undisturbed")
def test_a_second_process_of_its_kind_is_refused(arm: RunningArm, command: str) -> None:
    assert f"{arm.name}-{command}' belongs to a running process" in one_line(qrobot(command, arm.deployment))


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

arm = rccl.control("puma560")
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
    assert np.abs(arm.snapshot().v).max() < 0.01


HOLDS = """
from qrobot import rccl

arm = rccl.control("puma560")
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


def test_the_rig_tells_why_a_process_did_not_start(tmp_path: Path) -> None:
    with ProcessRig(tmp_path) as rig, pytest.raises(LinkError, match=r"did not start: no program missing\.py"):
        rig.start(Plan("broken", ["run", "missing.py"], lambda: False))
