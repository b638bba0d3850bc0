"""One running arm for every test that needs none of its own: starting its processes takes longer than most tests."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import numpy as np

from qrobot.config import load_robot
from qrobot.hwif.board_memory import attach_board_memory
from qrobot.modecodes import Mode
from qrobot.servo.memory.mailbox import ServoMailbox
from qrobot.servo.memory.servo_memory import attach_servo_memory
from qrobot.sim_board.injection import FaultPanel
from tests.support.patience import wait_until
from tests.support.processes import RunningArm, running_arms

BOARD = """outputs = [{ output = 1, bit = 3, name = "glue" }, { output = 2, bit = 5, on_stop = "hold" }], \
scene = { kind = "table", position_m = [0.5, 0.0, -0.4] }"""  # deep enough that only who means to touches it
START = load_robot("puma560").poses["park"]
THERE_RAD = 0.01


class SharedArm:
    """Starts when it is first asked for. What leaves it in disorder is told, and the next test gets a new one."""

    def __init__(self, directory: Path) -> None:
        self._directory = directory
        self._processes = ExitStack()
        self._arm: RunningArm | None = None
        self._starts = 0

    def running(self) -> RunningArm:
        """The arm, started if need be."""
        if self._arm is None:
            self._starts += 1
            directory = self._directory / str(self._starts)
            directory.mkdir()
            (self._arm,) = self._processes.enter_context(running_arms(directory, board=BOARD))
        return self._arm

    def put_in_order(self) -> None:
        """Everything runs, nothing is broken, no fault, no power. Raises what it fails by; the arm is given up then."""
        with self._or_give_up():
            settle(self.running())

    def park(self) -> None:
        """The same, and the arm stands where it was when it started."""
        with self._or_give_up():
            settle(self.running())
            if np.abs(self.running().snapshot().q - START).max() > THERE_RAD:
                return_to_start(self.running())

    def close(self) -> None:
        """End the processes."""
        self._arm = None
        self._processes.close()

    @contextmanager
    def _or_give_up(self) -> Iterator[None]:
        try:
            yield
        except BaseException:
            self.close()
            raise


def settle(arm: RunningArm) -> None:
    """Start what has ended, repair the board, clear the fault, take power away, let the wrist fall; at full speed."""
    arm.start_missing()
    with attach_servo_memory(arm.name) as servo:
        ServoMailbox(servo.words).request_override(1.0)
        ServoMailbox(servo.words).request_pause(False)
    with attach_board_memory(arm.name) as board:
        FaultPanel(board.memory).clear()
    wait_until(lambda: _off(arm), "the arm is off, without a fault")
    wait_until(lambda: not arm.powered, "brakes closed")
    arm.wait_for_rest()


def _off(arm: RunningArm) -> bool:
    """Ask again: a fault stays while its cause does. A new servo finds in its first cycle that the board is taken."""
    if arm.mode is Mode.OFF and not arm.word("guardian", "takeover"):
        return True
    with attach_servo_memory(arm.name) as servo:
        ServoMailbox(servo.words).request_power_off()
        ServoMailbox(servo.words).request_clear()
    return False


def return_to_start(arm: RunningArm) -> None:
    """Move to the pose it started in, and take power away."""
    with arm.control() as channel:
        channel.move(channel.pose("park"))
        channel.waitfor(channel.completed)
        channel.release(power_off=True)
    arm.wait_for(Mode.OFF)
    assert np.abs(arm.snapshot().q - START).max() < THERE_RAD
