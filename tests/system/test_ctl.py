"""`qrobot ctl` against running processes: by hand what programs do over the bridge, and one commander only."""

from __future__ import annotations

import io
import json
import os
import signal
import socket
import threading
from contextlib import redirect_stderr, redirect_stdout, suppress
from pathlib import Path
from typing import IO, Any

import pytest

from qrobot.cli.console import run_app
from qrobot.cli.main import make_app
from qrobot.errors import QRobotError
from qrobot.log.events import log_events
from qrobot.log.read import read_log
from qrobot.modecodes import Mode
from qrobot.servo.memory.commander_lock import Authority
from qrobot.servo.operator.client import ServoClient
from tests.support.patience import PATIENCE_S, wait_until
from tests.support.processes import RunningArm, qrobot, write_deployment
from tests.support.signals import default_signals

pytestmark = pytest.mark.realtime

HOLDER = """
import time
from qrobot import rccl

arm = rccl.control("puma560", period_ms=100, clear_fault=True)
print("in command", flush=True)
time.sleep(60)
"""


def ctl(arm: RunningArm, *words: str) -> tuple[int, Any, str]:
    """Exit status, JSON printed, complaint."""
    printed, complaint = io.StringIO(), io.StringIO()
    command = ["ctl", *words, "--deployment", str(arm.deployment), "--arm", arm.name, "--json"]
    with redirect_stdout(printed), redirect_stderr(complaint):
        status = run_app(make_app("ctl"), command)
    return status, json.loads(printed.getvalue()) if printed.getvalue() else None, complaint.getvalue()


def test_an_arm_is_powered_changed_and_put_away_by_hand(arm: RunningArm) -> None:
    status, now, _ = ctl(arm, "power", "on")
    assert (status, now["mode"], now["powered"]) == (0, "HOLDING", True)
    before = arm.encoders()
    status, now, _ = ctl(arm, "law", "pd")
    assert (status, now["law"], now["mode"], now["commander"]) == (0, "pd", "HOLDING", "")  # it has let go
    status, now, _ = ctl(arm, "gains", "--kp", *(f"{0.8 * kp}" for kp in now["kp"]))
    assert (status, now["mode"]) == (0, "HOLDING")
    assert max(abs(a - b) for a, b in zip(arm.encoders(), before, strict=True)) <= 1
    assert ctl(arm, "law", "qrobot")[0] == 0
    status, now, _ = ctl(arm, "power", "off")
    assert (status, now["mode"], arm.powered) == (0, "OFF", False)
    wait_until(lambda: {"law qrobot -> pd", "law pd -> qrobot", "OFF -> POWERING"} <= in_the_log(arm), "in the log")
    assert any(text.startswith("Kp ") for text in in_the_log(arm))


def in_the_log(arm: RunningArm) -> set[str]:
    """What the log of a running arm tells so far."""
    return {event.text for event in log_events(read_log(arm.newest_log()))}


def test_a_program_in_command_keeps_the_hand_away_but_not_from_the_switch(arm: RunningArm, tmp_path: Any) -> None:
    program = tmp_path / "holder.py"
    program.write_text(HOLDER)
    with arm.program(program) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "in command\n"
        status, _, complaint = ctl(arm, "law", "pd")
        assert status == 1
        assert "is commanded by the bridge for " in complaint
        assert "holder.py" in complaint
        assert ctl(arm, "power", "off")[0] == 0
        arm.wait_for(Mode.OFF)
        assert process.poll() is None or process.returncode != 0
    wait_until(lambda: Authority(arm.name).maybe_holder() is None, "authority given back")


def test_the_hand_keeps_a_program_away_and_a_killed_bridge_keeps_nothing(arm: RunningArm, tmp_path: Path) -> None:
    program = tmp_path / "holder.py"
    program.write_text(HOLDER)
    authority = Authority(arm.name)
    authority.take("somebody at the terminal")
    try:
        process = qrobot("run", "--deployment", arm.deployment, "--arm", arm.name, program)
        _, complaint = process.communicate(timeout=PATIENCE_S)
    finally:
        authority.release()
    assert process.returncode == 1
    assert "somebody at the terminal" in complaint
    with arm.program(program):
        wait_until(lambda: Authority(arm.name).maybe_holder() is not None, "the bridge holds it")
        arm.kill("bridge")
        wait_until(lambda: Authority(arm.name).maybe_holder() is None, "the kernel gave it back")
    arm.processes.start("bridge")
    assert ctl(arm, "power", "off")[0] == 0


def test_watch_follows_what_happens(arm: RunningArm) -> None:
    watch = qrobot("ctl", "watch", "--seconds", f"{PATIENCE_S}", "--deployment", arm.deployment, "--arm", arm.name)
    try:
        assert watch.stdout is not None
        assert f"{arm.name}: OFF" in watch.stdout.readline()
        assert ctl(arm, "power", "on")[0] == 0
        read_until(watch.stdout, f"{arm.name}: HOLDING")  # it looks every 20 ms: on and off may lie between two looks
        assert ctl(arm, "power", "off")[0] == 0
        read_until(watch.stdout, f"{arm.name}: OFF")
    finally:
        watch.send_signal(signal.SIGINT)
        watch.communicate(timeout=PATIENCE_S)
    assert watch.returncode in (0, 130)


def read_until(printed: IO[str], wanted: str) -> None:
    """Read lines up to the one that tells what is wanted."""
    assert any(wanted in line for line in printed), f"ended without {wanted!r}"


def test_a_servo_whose_terminal_is_closed_puts_the_arm_away(arm: RunningArm) -> None:
    if signal.getsignal(signal.SIGHUP) is signal.SIG_IGN:  # as of `nohup make test`, which its servo obeys
        arm.signal("servo", signal.SIGTERM)
        wait_until(lambda: "servo" not in arm.running(), "the deaf servo has ended")
        with default_signals(signal.SIGHUP):
            arm.processes.start("servo")
    assert ctl(arm, "power", "on")[0] == 0
    assert arm.powered
    os.kill(arm.pid("servo"), signal.SIGHUP)
    wait_until(lambda: "servo" not in arm.running(), "the servo has ended")
    wait_until(lambda: not arm.powered, "brakes closed")
    arm.processes.start("servo")


def test_without_a_servo_the_command_says_what_to_start(tmp_path: Path) -> None:
    process = qrobot("ctl", "status", "--deployment", write_deployment(tmp_path))
    _, complaint = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 1
    assert "start it with" in complaint
    assert "Traceback" not in complaint


def test_stop_and_power_off_are_obeyed_while_a_law_is_tried_for_ever(arm: RunningArm, tmp_path: Path) -> None:
    endless = tmp_path / "endless.py"
    endless.write_text("import time\ntime.sleep(1e5)\n")
    with ServoClient(arm.name) as commander:
        commander.power_on()

        def change_law() -> None:
            with suppress(QRobotError):
                commander.change_law(f"{endless}:mine")

        waiting = threading.Thread(target=change_law)
        waiting.start()
        assert ctl(arm, "status")[1]["mode"] == "HOLDING"
        status, now, _ = ctl(arm, "stop")
        assert (status, now["mode"]) == (0, "HOLDING")
        status, now, _ = ctl(arm, "power", "off")
        assert (status, now["mode"], arm.powered) == (0, "OFF", False)
        assert waiting.is_alive()
        commander._socket.shutdown(socket.SHUT_RDWR)  # as when its process ends
        waiting.join(PATIENCE_S)
    wait_until(lambda: ctl(arm, "power", "on")[0] == 0, "the arm is free for the next one")
    assert ctl(arm, "power", "off")[0] == 0
