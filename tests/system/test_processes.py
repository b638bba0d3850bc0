"""`qrobot up` and `qrobot demo` from outside: all comes up, works, and is gone afterwards, whenever it is ended."""

from __future__ import annotations

import os
import signal
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from qrobot.config.deployment import load_deployment
from qrobot.errors import LinkError
from qrobot.hwif.board_memory import Lane, attach_board_memory
from qrobot.hwif.registers import DAC, DAC_ZERO, DISCRETE, DISCRETE_POWER, N_DACS
from qrobot.hwif.trace import read_trace
from qrobot.log.read import read_log
from qrobot.modecodes import Mode
from qrobot.rig.experiment import program_path
from qrobot.rig.processes import board_ready, bridge_ready, guardian_ready, servo_ready
from qrobot.servo.memory.mailbox import ServoMailbox
from qrobot.servo.memory.servo_memory import attach_servo_memory
from tests.support.patience import PATIENCE_S, give_time, wait_until
from tests.support.processes import FIRST_START_S, left_behind, processes_of, qrobot, write_deployment
from tests.support.thorough import wide

pytestmark = pytest.mark.realtime


class Up:
    """A running `qrobot up` of one arm."""

    def __init__(self, directory: Path) -> None:
        self.deployment = write_deployment(directory)
        self.name = load_deployment(self.deployment).arm[0].name
        self.directory = directory
        self._said = directory / "up.txt"

    @contextmanager
    def running(self) -> Iterator[subprocess.Popen[Any]]:
        """Ends it hard if the test did not."""
        with self._said.open("w") as said:
            process = self._up = qrobot("up", self.deployment, "--out-dir", self.directory / "out", stderr=said)
            try:
                yield process
            finally:
                process.kill()
                process.communicate()

    def wait_for(self, words: str) -> None:
        wait_until(lambda: words in self._said.read_text(), f"up says {words!r}", FIRST_START_S)

    def wait_for_turn_of(self, command: str) -> None:
        """Until the processes before this one are ready."""
        conditions = {
            "board": (self.directory / "out" / f"{self.name}-board.txt").exists,
            "servo": lambda: board_ready(self.name),
            "guardian": lambda: servo_ready(self.name),
            "bridge": lambda: guardian_ready(self.name, 0),
        }
        up, its_turn = self._up, conditions[command]
        wait_until(lambda: its_turn() or up.poll() is not None, f"it is the turn of {command}", FIRST_START_S)
        assert up.poll() is None, self._said.read_text()

    def pid(self, command: str) -> int:
        """Of the process of this command."""
        (found,) = (pid for pid, line in processes_of(self.name).items() if f"qrobot {command} " in line)
        return found

    def wait_for_another(self, command: str) -> None:
        """Until a process of this command runs again, and is ready where one can see that."""
        wait_until(lambda: [line for line in processes_of(self.name).values() if f"qrobot {command} " in line], command)
        bridge = load_deployment(self.deployment).arm[0].bridge
        wait_until(lambda: bridge_ready(bridge.host, bridge.port), "the bridge listens")

    def hold(self) -> None:
        """Power on, without a program."""
        with attach_servo_memory(self.name) as servo:
            ServoMailbox(servo.words).request_power(True)
        wait_until(lambda: self.mode() is Mode.HOLDING, "the arm is held")

    def mode(self) -> Mode:
        with attach_servo_memory(self.name) as servo:
            return Mode(ServoMailbox(servo.words).snapshot().mode)

    def wait_for_process(self, command: str) -> None:
        """Until this one is there, however far it has come."""
        wait_until(lambda: any(f"qrobot {command}" in line for line in processes_of(self.name).values()), command)

    def wait_for_motion(self) -> None:
        """Until a program moves the arm."""
        wait_until(self._moves, "the arm follows a program", FIRST_START_S)

    def _moves(self) -> bool:
        try:
            with attach_servo_memory(self.name) as servo:
                return ServoMailbox(servo.words).snapshot().mode == Mode.TRACKING
        except LinkError:
            return False

    def assert_gone(self) -> None:
        wait_until(lambda: not left_behind(self.name), f"all of {self.name} is gone")


@pytest.fixture
def up(tmp_path: Path) -> Up:
    return Up(tmp_path)


def test_up_runs_a_program_and_ctrl_c_ends_everything_in_good_order(up: Up) -> None:
    with up.running() as process:
        up.wait_for("Ctrl-C ends everything")
        program = qrobot("run", "--deployment", up.deployment, program_path())
        printed, complaint = program.communicate(timeout=FIRST_START_S)
        assert program.returncode == 0, complaint
        assert printed.count("now at") == 3
        process.send_signal(signal.SIGINT)
        assert process.wait(PATIENCE_S) == 0
    assert left_behind(up.name) == []
    (path,) = (up.directory / "log").glob("*.mcap")
    log = read_log(path)
    assert not log.torn
    assert log.status.lost == 0
    assert log.rows.size > 5000


STARTS = [("board", signal.SIGINT), ("servo", signal.SIGTERM), ("bridge", signal.SIGINT)]


@pytest.mark.sampled(1)
@pytest.mark.parametrize(("command", "number"), STARTS)
def test_up_can_be_ended_while_its_processes_start(up: Up, command: str, number: signal.Signals) -> None:
    with up.running() as process:
        up.wait_for_turn_of(command)
        up.wait_for_process(command)
        process.send_signal(number)
        assert process.wait(PATIENCE_S) in (0, 130)  # 0 when all was up by then
    assert left_behind(up.name) == []


def test_up_can_be_ended_while_it_imports_what_it_needs(up: Up) -> None:
    with up.running() as process:
        told = Path(f"/proc/{process.pid}/task/{process.pid}/children")
        wait_until(lambda: told.read_text().split(), "its fork server runs")
        (fork_server,) = told.read_text().split()
        process.send_signal(signal.SIGTERM)
        assert process.wait(PATIENCE_S) == 130
    wait_until(lambda: not Path(f"/proc/{fork_server}").exists(), "the fork server has ended too")
    assert left_behind(up.name) == []


def test_impatience_leaves_nothing_behind(up: Up) -> None:
    """Ctrl-C again and again."""
    with up.running() as process:
        up.wait_for_turn_of("guardian")
        while process.poll() is None:
            process.send_signal(signal.SIGINT)
            give_time()
    up.assert_gone()


def test_a_held_arm_outlives_its_log_and_its_bridge_and_is_let_go_of_in_order_when_up_is_killed(up: Up) -> None:
    with up.running() as process:
        up.wait_for("Ctrl-C ends everything")
        up.hold()
        for command in ("log", "bridge"):
            os.kill(up.pid(command), signal.SIGKILL)
            up.wait_for(f"{up.name}-{command} has ended")
            up.wait_for_another(command)
        assert up.mode() is Mode.HOLDING
        with attach_board_memory(up.name) as board:  # what is mapped stays, also when its file is gone
            process.kill()
            process.wait()
            up.assert_gone()
            assert_let_go_by_the_servo(read_trace(board.memory))


def assert_let_go_by_the_servo(trace: Any) -> None:
    """The last words of a board: power off and zero torque, all by the servo; the guardian never had to act."""
    assert (trace[:, 1] == Lane.SERVO).all()
    driven = (trace[:, 2] != DISCRETE) & (trace[:, 3] != DAC_ZERO)
    last = trace[np.flatnonzero(driven)[-1] + 1 :]
    assert {DISCRETE, *(DAC + 2 * channel for channel in range(N_DACS))} <= set(last[:, 2].tolist())
    power = last[last[:, 2] == DISCRETE, 3] & DISCRETE_POWER  # the converter's bits stand in the same register
    assert power[-1] == 0
    assert (np.diff(power) <= 0).all()


def test_up_ends_the_rest_when_one_process_dies_and_says_which(up: Up) -> None:
    with up.running() as process:
        up.wait_for("Ctrl-C ends everything")
        os.kill(up.pid("guardian"), signal.SIGKILL)
        assert process.wait(PATIENCE_S) == 1
        up.wait_for(f"{up.name}-guardian has ended")
    assert left_behind(up.name) == []


@pytest.mark.parametrize("command", [*wide("servo"), "program"])
def test_ctrl_c_ends_a_demo_on_the_wall_clock(up: Up, command: str) -> None:
    """While its processes start, and while the program moves the arm."""
    options = ("--deployment", up.deployment, "--rate", "1000", "--out-dir", up.directory / "demo")
    with qrobot("demo", *options) as process:
        output = up.directory / "demo" / "processes" / f"{up.name}-{command}.txt"
        wait_until(output.exists, f"{command} is being started", FIRST_START_S)
        if command == "program":
            up.wait_for_motion()
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 130
    assert "Traceback" not in said
    assert left_behind(up.name) == []
