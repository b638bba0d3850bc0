"""What is wrong is told in one line on stderr before any process starts, and the exit status is not 0."""

from __future__ import annotations

import os
import socket
from pathlib import Path

import numpy as np
import pytest

from qrobot.cli.console import run_app
from qrobot.cli.main import make_app
from qrobot.cli.run import bridge_links
from qrobot.config import load_robot
from qrobot.config.deployment import load_deployment
from qrobot.rccl.setpoints import Setpoints, write_setpoints
from qrobot.realtime.bridge_token import offered_token
from tests.support.processes import free_port, write_deployment


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
        (["servo", "{deployment}", "--rate", "7"], 2, ["7", "50 to 10000 Hz"]),
        (["servo", "{deployment}", "--rate", "0"], 2, ["0", "50 to 10000 Hz"]),
        (["servo", "{deployment}", "--law", "pid"], 1, ["pid", "pd"]),
        (["servo", "{deployment}", "--arm", "third"], 1, ["third"]),
        (["servo", "{deployment}"], 1, ["no shared memory", "-board", "`qrobot up`", "`qrobot board`"]),
        (["guardian", "{deployment}"], 1, ["no shared memory", "-servo", "`qrobot up`", "`qrobot servo`"]),
        (["run", "missing.py"], 1, ["missing.py"]),
        (["log", "info", "missing.mcap"], 1, ["missing.mcap"]),
        (["study", "identify", "--output", "arms.jsonl", "--stiction", "nan"], 2, ["nan", "1 to 3"]),
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


PROGRAM = 'from qrobot import rccl\nrccl.control("puma560")\n'


def test_a_program_without_a_bridge_is_told_how_to_start_one(
    deployment: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    program = tmp_path / "program.py"
    program.write_text(PROGRAM)
    assert "qrobot up" in complaint_of(capsys, "run", "--deployment", deployment, program)


@pytest.mark.parametrize("other", ["127.0.0.1:{}", "robot:abc", "localhost:5600:"])
@pytest.mark.parametrize(
    ("command", "name", "text"),
    [(["run"], "program.py", PROGRAM), (["val", "run"], "program.v2", ".PROGRAM main\n READY\n.END\n")],
)
def test_the_arm_of_the_deployment_file_is_moved_whatever_bridge_the_shell_names(
    deployment: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    command: list[str],
    name: str,
    text: str,
    other: str,
) -> None:
    own, other = f"127.0.0.1:{load_deployment(str(deployment)).arm[0].bridge.port}", other.format(free_port())
    monkeypatch.setenv("QROBOT_BRIDGE", other)
    program = tmp_path / name
    program.write_text(text)
    assert run_app(make_app(), [*command, "--deployment", str(deployment), str(program)]) == 1
    *_, told, complaint = capsys.readouterr().err.splitlines()
    assert own in told
    assert other in told
    assert f"no bridge at {own}" in complaint
    assert os.environ["QROBOT_BRIDGE"] == own


@pytest.mark.parametrize("named", ["localhost:{}", ":{}", "127.0.0.1:{}"])
def test_the_bridge_of_the_deployment_file_by_any_of_its_names_is_not_told_of(
    deployment: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, named: str
) -> None:
    arm = load_deployment(str(deployment)).arm[0]
    monkeypatch.setenv("QROBOT_BRIDGE", named.format(arm.bridge.port))
    bridge_links(arm)
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize(
    ("command", "name", "text"),
    [
        (["run"], "program.py", PROGRAM),
        (["run"], "apart.py", PROGRAM.replace('"puma560"', '"puma560", processor="aux"')),
        (["run"], "arcl.py", 'from qrobot.arcl import *\narm = arcl_open(ARCL_ROBOT, "puma560", 0)\n'),
        (["run"], "rci.py", "from qrobot import rci\nrci.rci_open()\n"),
        (["val", "run"], "program.v2", ".PROGRAM main\n READY\n.END\n"),
        (["teach", "places.db", "--script"], "script.txt", "where\n"),
        (["replay", "--approach"], "led.csv", ""),
    ],
)
def test_at_the_bridge_of_another_arm_than_is_looked_for_nothing_is_commanded(
    deployment: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    command: list[str],
    name: str,
    text: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    arm = load_deployment(str(deployment)).arm[0]
    given = tmp_path / name
    given.write_text(text or _resting_setpoints())
    command += [str(given), "--deployment", str(deployment)]
    with offered_token(arm.bridge.port, "cell"):
        with socket.create_server(("127.0.0.1", arm.bridge.port)):
            assert run_app(make_app(), command) == 1
        complaint = capsys.readouterr().err
        if name == "program.py":  # the token of a killed bridge is nobody's
            assert run_app(make_app(), command) == 1
            assert "no bridge at" in capsys.readouterr().err
    assert all(word in complaint for word in (f":{arm.bridge.port}", "'cell'", f"'{arm.name}'", "--deployment")), (
        complaint
    )


CELL = '[[arm.fences.shape]]\nname = "cell"\nshape = "cylinder"\nkeep = "in"\nradius_m = 0.6\nlength_m = 4.0\n'


@pytest.mark.parametrize(
    ("robot", "fences", "says"), [("stanford", "", "made for stanford, this is puma560"), ("puma560", CELL, "cell")]
)
def test_setpoints_are_judged_before_the_arm_goes_to_the_first_of_them(
    deployment: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], robot: str, fences: str, says: str
) -> None:
    deployment.write_text(deployment.read_text() + fences)
    poses, share = load_robot("puma560").poses, 0.5 - 0.5 * np.cos(np.linspace(0.0, np.pi, 150))
    led = Setpoints(robot, 28_000, poses["ready"] + np.outer(share, poses["stretched"] - poses["ready"]))
    write_setpoints(tmp_path / "led.csv", led)
    complaint = complaint_of(capsys, "replay", tmp_path / "led.csv", "--approach", "--deployment", deployment)
    assert says in complaint
    assert "no bridge" not in complaint


def _resting_setpoints() -> str:
    places = ",".join(f"{value:g}" for value in load_robot("puma560").poses["park"])
    return "t_s,q1,q2,q3,q4,q5,q6\n" + "".join(f"{0.028 * k:.3f},{places}\n" for k in range(4))
