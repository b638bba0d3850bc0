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
from numbers import Integral
from typing import Final, NamedTuple

import numpy as np

from qrobot.config.outputs import ALL_OUTPUTS
from qrobot.errors import MotionError
from qrobot.rci.blackboard import Chg
from qrobot.rci.descriptor import TaskDescriptor
from qrobot.rci.fenced_setpoints import check_setpoints
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
        self._said = Asked((), ())  # in the command before
        self._heard: deque[RobotState] = deque(maxlen=TRACE_SAMPLES)

    def stop(self, power_off: bool = False) -> None:
        """Begin a controlled stop from whatever phase, after which the arm holds its position or loses power.

        A stop that has begun already ends without power when this one is to.
        """
        if self.phase not in (CyclePhase.STOPPING, CyclePhase.LEFT):
            self._power_down = PowerDown(self._period_s, power_off)
            self._td.chg.hold()
            self.phase = CyclePhase.STOPPING
        elif power_off:
            self._power_down.ask_off()

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
        return self._say(chg, state, now_ns)

    def _say(self, chg: Chg, state: State, now_ns: int) -> Command:
        command = chg.command(state, now_ns)
        self._said = Asked(tuple(command.modes), tuple(command.setpoints))
        return command

    def answer(self, state: State, now_ns: int) -> Command:
        """Answer a STATE that was taken in already, after something went wrong."""
        if self.phase is CyclePhase.STOPPING:
            self._stop(state.robot, self._td.chg)
        return self._say(self._td.chg, state, now_ns)

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
        lines, stream = (chg.hand, chg.outputs), chg.stream
        try:
            control()
            chg.modes, chg.setpoints = check_chg(self._td.name, chg, self._data, self._said, self._period_s)
        except BaseException:
            chg.hand, chg.outputs = lines
            raise
        finally:
            chg.stream = stream  # which names this run of setpoints, for the servo

    def _stop(self, robot: RobotState, chg: Chg) -> None:
        if self._power_down.step(robot, chg):
            self.phase = CyclePhase.LEFT


class Asked(NamedTuple):
    """Modes and setpoints of one command, which nobody can change in place."""

    modes: tuple[int, ...]
    setpoints: tuple[float, ...]


def check_chg(name: str, chg: Chg, data: RobotData, before: Asked, period_s: float) -> Asked:
    """Judge what a control function asks for, `before` being what went out at the sample before; returns its copy.

    Raises:
        MotionError: no setpoints of this arm, no such hand or outputs, a torque beyond its limit, a number that is
            none, or a joint that would be too fast.
        JointLimit: a position outside the range. FenceCrossed: one from which the arm could not stop before a fence.
    """
    whole = all(isinstance(number, Integral) for number in (chg.hand, chg.outputs))
    if not whole or chg.hand not in list(Hand) or not 0 <= chg.outputs <= ALL_OUTPUTS:
        raise MotionError(f"task {name}: hand {chg.hand!r} and outputs {chg.outputs!r}, 0 to 2 and 16 bits exist")
    modes, setpoints = np.array(chg.modes), np.array(chg.setpoints, dtype=np.float64)  # copies, which are judged
    if (
        modes.dtype.kind not in "iu"
        or modes.shape != (data.n,)
        or setpoints.shape != (data.n,)
        or not np.isin(modes, list(JointMode)).all()
    ):
        raise MotionError(f"task {name}: chg needs a mode and a setpoint for each of {data.n} joints")
    positions, torques = modes == JointMode.POSITION, modes == JointMode.TORQUE
    data.limits.check_position(np.where(positions, setpoints, data.limits.q_min), f"task {name}")
    excess = torques & ~(np.abs(setpoints) <= data.tau_max)
    if excess.any():
        j = int(excess.argmax())
        raise MotionError(f"task {name}: {setpoints[j]:.4g} on joint {j + 1}, at most {data.tau_max[j]:.4g} allowed")
    if not np.isfinite(setpoints).all():
        raise MotionError(f"task {name}: setpoints {setpoints.tolist()} are no finite numbers")
    went_on = positions & (np.asarray(before.modes) == JointMode.POSITION)
    step = np.where(went_on, setpoints - np.asarray(before.setpoints), 0.0)
    data.limits.check_velocity(step / period_s, f"task {name}", "make smaller steps from sample to sample")
    if data.fences is not None and went_on.all():
        stop = data.limits.a_stop
        check_setpoints(data.fences, f"task {name}", setpoints - step, setpoints, stop, period_s)
    return Asked(tuple(modes.tolist()), tuple(setpoints.tolist()))
