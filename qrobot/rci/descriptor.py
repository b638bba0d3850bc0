"""The task descriptor: what every task of a program knows of every other (Lloyd, Parker and McClain 1987, 4.3.3)."""

from __future__ import annotations

from enum import IntEnum
from typing import Final

import numpy as np

from qrobot.arrays import Words
from qrobot.errors import LinkError
from qrobot.rci.blackboard import Chg
from qrobot.rci.mail_lane import LANE_WORDS
from qrobot.rci.robot_data import RobotData
from qrobot.units import NS_PER_S
from qrobot.wire import Mode, RobotState

PARENT: Final = 1  # the bit of the planning task
NO_BIT: Final = 0  # of the task by which a library moves an arm: no mask names it
HOST: Final = "host"  # its processor, and that of tasks that ask for none
ALLOWED_S: Final = 0.5  # [A] for a control function; a robot stops by itself after two periods without a setpoint
MOST_TASKS: Final = 30  # [A] the papers expect 1 to 5; masks fit 32 bits with the parent's


class TaskState(IntEnum):
    """States of a task."""

    CREATED = 0
    ATTACHING = 1
    READY = 2
    ACTIVE = 3
    RELEASING = 4
    RELEASED = 5
    ENDED = 6


class TaskWord(IntEnum):
    """Words of a descriptor in shared memory; each has one writer, the task's processor, but ALLOWED_NS the program."""

    STATE = 0
    WOKEN = 1
    SERVED = 2
    RUNS = 3
    MISSED = 4
    BEGAN_NS = 5
    LONGEST_NS = 6
    ALLOWED_NS = 7


_LANES_AT: Final = 8
AREA_WORDS: Final = _LANES_AT + (MOST_TASKS + 1) * LANE_WORDS


class TaskDescriptor:
    """One control task, or the parent.

    Attributes:
        name: of the task; that of a robot connects it to the robot.
        bit: stands for the task in masks.
        processor: name of the processor it runs on.
        priority: of tasks of one processor that are due together the highest goes first.
        robot: parameters of its robot, None for a task without one.
        error: what ended it before its time.
        starts: times that it was started, by which an end that is told late is known for one of before.
    """

    def __init__(
        self, name: str, bit: int, processor: str, words: Words, robot: RobotData | None = None, priority: int = 0
    ) -> None:
        self.name, self.bit, self.processor, self.robot, self.priority = name, bit, processor, robot, priority
        self.words = words
        self.error: BaseException | None = None
        self.starts = 0
        if not words[TaskWord.ALLOWED_NS]:  # otherwise another processor knows the task already
            words[TaskWord.ALLOWED_NS] = round(ALLOWED_S * NS_PER_S)
        self._how: RobotState | None = None
        self._chg = None if robot is None else Chg(robot.n)

    @property
    def state(self) -> TaskState:
        """State of the task."""
        return TaskState(int(self.words[TaskWord.STATE]))

    @property
    def active(self) -> bool:
        """True when it is woken and runs."""
        return self.state is TaskState.ACTIVE

    def begin(self) -> None:
        """Forget how it ended: it is started anew."""
        self.error, self.starts = None, self.starts + 1

    @property
    def run_count(self) -> int:
        """Wake-ups that it has still to answer: the scheduler counts them up, the monitor down."""
        return int(self.words[TaskWord.WOKEN] - self.words[TaskWord.SERVED])

    @property
    def runs(self) -> int:
        """Number of calls of its control functions."""
        return int(self.words[TaskWord.RUNS])

    @property
    def missed(self) -> int:
        """Wake-ups that came before the one in front of them was answered."""
        return int(self.words[TaskWord.MISSED])

    @property
    def longest_ms(self) -> float:
        """The longest that its control functions took, ms; 0 on virtual time."""
        return float(self.words[TaskWord.LONGEST_NS]) * 1e-6

    @property
    def how(self) -> RobotState:
        """The robot as it was heard last. Raises LinkError when there is none, or nothing was heard here."""
        if self._how is None:
            what = "has no robot" if self.robot is None else f"has heard nothing of its robot on {self.processor}"
            raise LinkError(f"task {self.name} {what}")
        return self._how

    @how.setter
    def how(self, how: RobotState) -> None:
        self._how = how

    @property
    def heard(self) -> RobotState | None:
        """The robot as it was heard last, None when nothing was."""
        return self._how

    @property
    def left_with_power(self) -> bool:
        """True when its robot had power, or was about to have it, when it was heard last."""
        return self._how is not None and self._how.mode not in (Mode.OFF, Mode.FAULT)

    @property
    def chg(self) -> Chg:
        """Its next command. Raises LinkError for a task without robot."""
        if self._chg is None:
            raise LinkError(f"task {self.name} has no robot: give it the name of one to connect it")
        return self._chg

    def lane_from(self, bit: int) -> Words:
        """Words of the messages that the task with that bit sends to this one."""
        start = _LANES_AT + (bit.bit_length() - 1) * LANE_WORDS
        return self.words[start : start + LANE_WORDS]

    def __repr__(self) -> str:
        return f"<task {self.name}, bit {self.bit:#x}, {self.state.name.lower()} on {self.processor}>"


def local_area() -> Words:
    """Words of a descriptor that only this process sees."""
    return np.zeros(AREA_WORDS, np.int64)
