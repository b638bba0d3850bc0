"""The cycle of a task that has a robot (Figure 4 of the paper), from power-up to release.

At each sample: read the robot - check - post `how` - control1 - check `chg` - send it - control2. Its phases:

    POWERING    power is asked for                            until the arm holds its position
    STARTING    its present setpoints stream                  until the servo follows them
    FOLLOWING   as above, once the task is active; at rest    until it is released, or something is wrong
                where it stands before that
    STOPPING    a controlled stop, on which the arm stays on its path
    LEFT        nothing more to say
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from enum import Enum
from typing import Final

import numpy as np

from qrobot.config.outputs import ALL_OUTPUTS
from qrobot.errors import MotionError
from qrobot.rci.blackboard import Chg
from qrobot.rci.descriptor import TaskDescriptor
from qrobot.rci.power import PowerDown, PowerUp, servo_fault
from qrobot.rci.robot_data import RobotData
from qrobot.wire import Command, JointMode, Mode, RobotState, State
from qrobot.wire.vocabulary import Hand

START_S: Final = 0.5  # for the servo to follow a stream that began
TRACE_SAMPLES: Final = 36  # a second at 28 ms, for the report of a fault
_SEQ_MODULUS: Final = 1 << 32


class CyclePhase(Enum):
    """Phases of a robot's task."""

    POWERING = "powering"
    STARTING = "starting"
    FOLLOWING = "following"
    STOPPING = "stopping"
    LEFT = "left"


class RobotCycle:
    """One task's hold of one robot; it knows no clock and no link.

    Args:
        td: the task, with the data of its robot.
        period_s: sample period.
        clear_fault: clear a latched fault at power-up instead of raising it.

    Attributes:
        phase: how far it is.
        left_out: samples that the robot told and nobody heard.
    """

    def __init__(self, td: TaskDescriptor, data: RobotData, period_s: float, clear_fault: bool = False) -> None:
        self.phase = CyclePhase.POWERING
        self.left_out = 0
        self._td, self._data, self._period_s = td, data, period_s
        self._power_up = PowerUp(period_s, clear_fault)
        self._power_down = PowerDown(period_s, power_off=False)
        self._waited_s = 0.0
        self._seq: int | None = None
        self._heard: deque[RobotState] = deque(maxlen=TRACE_SAMPLES)

    def stop(self, power_off: bool = False) -> None:
        """Begin a controlled stop from whatever phase, after which the arm holds its position or loses power."""
        if self.phase not in (CyclePhase.STOPPING, CyclePhase.LEFT):
            self._power_down = PowerDown(self._period_s, power_off)
            self._td.chg.hold()
            self.phase = CyclePhase.STOPPING

    def step(self, state: State, now_ns: int, control: Callable[[], object] | None) -> Command:
        """Answer a STATE. `control` is the first control function, None while the task is not active.

        Raises:
            ServoFault: the servo gave up, or power is refused.
            MotionError: the arm is not calibrated, or what `control` put into `chg` is not allowed.
            Exception: whatever `control` raises.
        """
        chg, robot = self._td.chg, state.robot
        if self._seq is None:  # what the hand holds stays held, and outputs that are kept stay as they are
            chg.hand, chg.outputs = robot.hand, robot.outputs
        self._count(state.seq)
        self._td.how = robot
        self._heard.append(robot)
        match self.phase:
            case CyclePhase.POWERING:
                self._power(robot, chg, now_ns)
            case CyclePhase.STARTING:
                self._start(robot)
            case CyclePhase.FOLLOWING:
                self._follow(robot, chg, control)
            case CyclePhase.STOPPING:
                self._stop(robot, chg)
        return chg.command(state, now_ns)

    def answer(self, state: State, now_ns: int) -> Command:
        """Answer a STATE that was taken in already, after something went wrong."""
        if self.phase is CyclePhase.STOPPING:
            self._stop(state.robot, self._td.chg)
        return self._td.chg.command(state, now_ns)

    def _count(self, seq: int) -> None:
        self.left_out += 0 if self._seq is None else (seq - self._seq - 1) % _SEQ_MODULUS
        self._seq = seq

    def _power(self, robot: RobotState, chg: Chg, now_ns: int) -> None:
        if self._power_up.step(robot, chg):
            chg.stream = (now_ns >> 20) % _SEQ_MODULUS  # any number that no earlier run had
            chg.go_to(robot.q_setpoint)
            self.phase = CyclePhase.STARTING

    def _start(self, robot: RobotState) -> None:
        self._waited_s += self._period_s
        if robot.mode == Mode.TRACKING:
            self.phase = CyclePhase.FOLLOWING
        elif robot.mode != Mode.HOLDING or self._waited_s > START_S:
            raise servo_fault(robot, "the servo does not follow the setpoints", self._heard)

    def _follow(self, robot: RobotState, chg: Chg, control: Callable[[], object] | None) -> None:
        if robot.mode != Mode.TRACKING:
            raise servo_fault(robot, "the servo stopped the arm", self._heard)
        if control is not None:
            self._control(chg, control)

    def _control(self, chg: Chg, control: Callable[[], object]) -> None:
        """Call the control function; what it says of hand and outputs is forgotten when it cannot be."""
        before, lines, stream = (chg.modes, chg.setpoints), (chg.hand, chg.outputs), chg.stream
        try:
            control()
            check_chg(self._td.name, chg, self._data, before, self._period_s)
        except BaseException:
            chg.hand, chg.outputs = lines
            raise
        finally:
            chg.stream = stream  # which names this run of setpoints, for the servo

    def _stop(self, robot: RobotState, chg: Chg) -> None:
        if self._power_down.step(robot, chg):
            self.phase = CyclePhase.LEFT


def check_chg(
    name: str, chg: Chg, data: RobotData, before: tuple[tuple[int, ...], tuple[float, ...]], period_s: float
) -> None:
    """Judge what a control function asks for, `before` being what the sample before it did.

    Raises:
        MotionError: no setpoints of this arm, no such hand or outputs, a torque beyond its limit, or a joint that would
            be too fast.
        JointLimit: a position outside the range.
    """
    if chg.hand not in list(Hand) or not 0 <= chg.outputs <= ALL_OUTPUTS:
        raise MotionError(f"task {name}: hand {chg.hand!r} and outputs {chg.outputs!r}, 0 to 2 and 16 bits exist")
    modes, setpoints = np.asarray(chg.modes), np.asarray(chg.setpoints, dtype=np.float64)
    if modes.shape != (data.n,) or setpoints.shape != (data.n,) or not np.isin(modes, list(JointMode)).all():
        raise MotionError(f"task {name}: chg needs a mode and a setpoint for each of {data.n} joints")
    positions, torques = modes == JointMode.POSITION, modes == JointMode.TORQUE
    data.limits.check_position(np.where(positions, setpoints, data.limits.q_min), f"task {name}")
    excess = torques & ~(np.abs(setpoints) <= data.tau_max)
    if excess.any():
        j = int(excess.argmax())
        raise MotionError(f"task {name}: {setpoints[j]:.4g} on joint {j + 1}, at most {data.tau_max[j]:.4g} allowed")
    went_on = positions & (np.asarray(before[0]) == JointMode.POSITION)
    step = np.where(went_on, setpoints - np.asarray(before[1]), 0.0)
    data.limits.check_velocity(step / period_s, f"task {name}", "make smaller steps from sample to sample")
