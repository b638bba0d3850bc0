"""The cycle of a task that has a robot (Figure 4 of the paper), from power-up to release.

Tasks of RCI go through it, the trajectory tasks of RCCL, and the bridge machine of ARCL.

At each sample: read the robot - check - post `how` - control1 - check `chg` - send it - control2. Its phases:

    POWERING    power is asked for                            until the arm holds its position
    STARTING    its present setpoints stream                  until the servo follows them
    FOLLOWING   as above, once the task is active; at rest    until it is released, or something is wrong
                where it stands before that
    STANDING    the servo has stopped the arm, and the task      until it takes the arm again, or leaves it
                outlives that: all joints are on hold
    STOPPING    the last setpoints play out, or a controlled
                stop, on which the arm stays on its path
    LEFT        nothing more to say

A stream that is lost before the task has moved anything ends nothing: another one begins, from POWERING on.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from typing import Final

import numpy as np

from qrobot.errors import ServoFault
from qrobot.faultcodes import FaultCode
from qrobot.rci.blackboard import Chg
from qrobot.rci.chg_check import Asked, check_chg
from qrobot.rci.descriptor import TaskDescriptor, TaskState, TaskWord
from qrobot.rci.power import ARRIVED, CARRIED, PowerDown, PowerUp, servo_fault
from qrobot.rci.robot_data import RobotData
from qrobot.wire import Command, Mode, RobotState, State

START_S: Final = 0.5  # for the servo to follow a stream that began
MOST_STARTS: Final = 5  # [A] streams that begin one after another, because the arm has not moved in the one before
TRACE_SAMPLES: Final = 36  # a second at 28 ms, for the report of a fault
UNPOWERED: Final = frozenset({Mode.OFF, Mode.FAULT})
SERVO_AWAY: Final = "bridge or servo was away, or the program was held, while the arm was off its path"
STOPPED_BY_HAND: Final = "no fault; somebody told it to, or took its power away"
_SEQ_MODULUS: Final = 1 << 32


def may_go_back(robot: RobotState) -> bool:
    """Whether an arm that has met something may be led back: the servo carries it, and nobody wants it at rest."""
    return robot.mode in CARRIED and not (robot.paused or robot.halted)


class CyclePhase(Enum):
    """Phases of a robot's task."""

    POWERING = "powering"
    STARTING = "starting"
    FOLLOWING = "following"
    STANDING = "standing"
    STOPPING = "stopping"
    LEFT = "left"


_STATE, _MISSED, _RUNS = int(TaskWord.STATE), int(TaskWord.MISSED), int(TaskWord.RUNS)
_STATES: Final = {
    CyclePhase.POWERING: TaskState.ATTACHING,
    CyclePhase.STARTING: TaskState.ATTACHING,
    CyclePhase.FOLLOWING: TaskState.ACTIVE,
    CyclePhase.STANDING: TaskState.READY,
    CyclePhase.STOPPING: TaskState.RELEASING,
    CyclePhase.LEFT: TaskState.RELEASED,
}


def _nothing() -> None:
    """Do nothing."""


def _raise(fault: ServoFault) -> None:
    raise fault


@dataclass(frozen=True)
class CycleHooks:
    """Functions that a task is called by at certain samples of its robot, besides its control function.

    Attributes:
        held: the arm holds its position; its setpoints stream from this answer on.
        starting: they stream, and the servo begins to follow.
        standing: the arm stands where the servo has stopped it.
        stopped: told why the servo does not follow any more; raises that, or lets the arm stand (`RobotCycle.stand`).
        remark: what the task adds to the message of a stop.
    """

    held: Callable[[], object] = _nothing
    starting: Callable[[], object] = _nothing
    standing: Callable[[], object] = _nothing
    stopped: Callable[[ServoFault], object] = _raise
    remark: Callable[[], str] = str


class RobotCycle:
    """One task's hold of one robot; it knows no clock and no link.

    Args:
        td: the task, with the data of its robot.
        period_s: sample period.
        clear_fault: clear a latched fault at power-up instead of raising it.
        hooks: of the task.
        judged: what the control function puts into `chg` is judged before it goes out; False for one that has judged
            its setpoints itself.
        adopts: hand and outputs are at first as the robot tells; else as `chg` has them.

    Attributes:
        phase: how far it is.
        samples: of the robot since the first that was heard, those that nobody heard included.
        left_out: samples that the robot told and nobody heard.
    """

    def __init__(
        self,
        td: TaskDescriptor,
        data: RobotData,
        period_s: float,
        clear_fault: bool = False,
        hooks: CycleHooks = CycleHooks(),
        judged: bool = True,
        adopts: bool = True,
    ) -> None:
        self.phase = CyclePhase.POWERING
        self.samples = self.left_out = 0
        self._td, self._data, self._period_s, self._hooks = td, data, period_s, hooks
        self._judged, self._adopts = judged, adopts
        self._power_up = PowerUp(period_s, clear_fault)
        self._power_down = PowerDown(period_s, power_off=False)
        self._waited_s = 0.0
        self._heeds_stops = False  # that somebody asks for: the arm was taken, and none was told of since
        self._stop_said = False  # by the task itself, and the robot may not have told of it yet
        self._starts = 0  # streams begun since the arm was taken
        self._stands: tuple[float, ...] = ()  # setpoints that they begin with
        self._runs = 0  # of the control function, not told yet
        self._told_phase: CyclePhase | None = None
        self._told_left_out = 0
        self._words: memoryview | None = None  # of the descriptor, written in a tenth of NumPy's time
        self._seq: int | None = None
        self._said: Asked | Command = Asked((), ())  # in the command before
        self._heard: deque[RobotState] = deque(maxlen=TRACE_SAMPLES)

    def stop(self, power_off: bool = False) -> None:
        """Begin a controlled stop from whatever phase, after which the arm holds its position or loses power.

        A stop that has begun already ends without power when this one is to.
        """
        if self.phase not in (CyclePhase.STOPPING, CyclePhase.LEFT):
            self._td.chg.hold()
            self.leave(power_off)
        elif power_off:
            self._power_down.ask_off()

    def leave(self, power_off: bool) -> None:
        """Let the last setpoints play out, and go."""
        self._power_down = PowerDown(self._period_s, power_off)
        self.phase = CyclePhase.STOPPING

    def stand(self) -> None:
        """Put all joints on hold until the arm is taken again, or left."""
        self._td.chg.hold()
        self.phase = CyclePhase.STANDING

    def take_again(self, robot: RobotState) -> None:
        """Take an arm that stands, with all that `robot` tells of it: a fault is cleared, and power asked for anew.

        What comes later, until the arm follows, is not answered but told: a fault or an end of power of an arm that the
        servo carries, and a stop that somebody asks for.
        """
        carried = robot.mode in CARRIED and not robot.fault
        self._power_up = PowerUp(self._period_s, clear_fault=True, carried=carried)
        self._td.chg.power = carried or robot.powered
        self._heeds_stops = carried and not (robot.halted or self._stop_said or self._td.chg.stop)
        self._starts = 0
        self.phase = CyclePhase.POWERING

    def count_anew(self) -> None:
        """Another bridge, or the same one greeted again, numbers its samples from now on."""
        self._seq = None

    def step(self, state: State, now_ns: int, control: Callable[[], object] | None) -> Command:
        """Answer a STATE. `control` is the first control function, None while the task is not active.

        Raises:
            ServoFault: the servo gave up, or power is refused.
            MotionError: the arm is not calibrated, or what `control` put into `chg` is not allowed.
            Exception: whatever `control` raises.
        """
        chg, robot = self._td.chg, state.robot
        if self._adopts:  # what the hand holds stays held, and outputs that are kept stay as they are
            chg.hand, chg.outputs = robot.hand, robot.outputs
            self._adopts = False
        self._count(state.seq)
        self._td.how = robot
        self._heard.append(robot)
        match self.phase:
            case CyclePhase.FOLLOWING:  # nearly always
                self._follow(robot, chg, control)
            case CyclePhase.POWERING:
                self._power(robot, chg, now_ns)
            case CyclePhase.STARTING:
                self._start(robot, chg)
            case CyclePhase.STANDING:
                chg.power = chg.power and robot.mode not in UNPOWERED  # nobody asks another servo for it
                self._hooks.standing()
            case CyclePhase.STOPPING:
                self._stop(robot, chg)
        return self._say(chg, state, now_ns)

    def _say(self, chg: Chg, state: State, now_ns: int) -> Command:
        self._said = command = chg.command(state, now_ns)
        self._stop_said |= command.stop
        return command

    def describe(self) -> None:
        """Keep up the descriptor of a task that no processor of RCI runs."""
        words = self._words = self._words or self._td.words.data
        words[_RUNS] += self._runs
        self._runs = 0
        if self.phase is not self._told_phase or self.left_out != self._told_left_out:
            self._told_phase, self._told_left_out = self.phase, self.left_out
            words[_STATE], words[_MISSED] = _STATES[self.phase], self.left_out

    def answer(self, state: State, now_ns: int) -> Command:
        """Answer a STATE that was taken in already, after something went wrong."""
        if self.phase is CyclePhase.STOPPING:
            self._stop(state.robot, self._td.chg)
        return self._say(self._td.chg, state, now_ns)

    def _count(self, seq: int) -> None:
        """Samples that were left out count, and the number on the wire wraps."""
        passed = 1 if self._seq is None else (seq - self._seq) % _SEQ_MODULUS
        self.samples += passed
        self.left_out += (passed - 1) % _SEQ_MODULUS
        self._seq = seq

    def _heed_stop(self, robot: RobotState, chg: Chg) -> bool:
        """Whether somebody has asked for a stop since the arm was taken; then it is not to move.

        The servo may tell of an older one, or of the task's own: what comes after an answer without any is news.
        """
        halted = self._heeds_stops and robot.halted and robot.mode in CARRIED
        if halted:
            self._heeds_stops = False
            chg.stop |= self.phase is not CyclePhase.POWERING  # where a stream has begun
            what = "somebody has stopped the arm before it moved"
            self._hooks.stopped(servo_fault(robot, what, self._heard, STOPPED_BY_HAND))
        elif robot.mode is Mode.HOLDING or self.phase is not CyclePhase.POWERING:
            # The first answer may be older than the stop by which the program before has let go of the arm.
            self._heeds_stops = self.samples > 1 and not (robot.halted or self._stop_said)
        return halted

    def _power(self, robot: RobotState, chg: Chg, now_ns: int) -> None:
        if self._heed_stop(robot, chg):
            return
        try:
            holds = self._power_up.step(robot, chg)
        except ServoFault as fault:
            self._hooks.stopped(fault)
            return
        if holds:
            self._hooks.held()
            chg.stream = (now_ns >> 20) % _SEQ_MODULUS  # any number that no earlier run had
            chg.go_to(robot.q_setpoint)
            self._stands, self._waited_s = robot.q_setpoint, 0.0
            self._starts += 1
            self.phase = CyclePhase.STARTING

    def _start(self, robot: RobotState, chg: Chg) -> None:
        if self._heed_stop(robot, chg):
            return
        self._waited_s += self._period_s
        # A servo that still holds may not have heard of this stream.
        is_over = robot.mode == Mode.STOPPING or self._waited_s > START_S
        if robot.mode == Mode.TRACKING:
            self.phase = CyclePhase.FOLLOWING
        elif is_over and self._lost_at_rest(robot):
            self._start_again(chg)
            return
        elif robot.mode != Mode.HOLDING or self._waited_s > START_S:
            self._hooks.stopped(servo_fault(robot, "the servo does not follow the setpoints", self._heard))
            return
        self._hooks.starting()

    def _lost_at_rest(self, robot: RobotState) -> bool:
        """The stream was lost while the arm stood where it began, and another one may begin."""
        lost = robot.event == FaultCode.STREAM_LOST and robot.mode in (Mode.STOPPING, Mode.HOLDING)
        return lost and self._starts < MOST_STARTS and np.allclose(robot.q_setpoint, self._stands, 0.0, ARRIVED)

    def _start_again(self, chg: Chg) -> None:
        """Hold all joints until the servo does."""
        chg.hold()
        self.phase = CyclePhase.POWERING

    def _follow(self, robot: RobotState, chg: Chg, control: Callable[[], object] | None) -> None:
        if robot.mode != Mode.TRACKING and control is None and self._lost_at_rest(robot):
            if not self._heed_stop(robot, chg):
                self._start_again(chg)
        elif robot.mode != Mode.TRACKING:
            what = f"the servo stopped the arm{self._hooks.remark()}"
            self._hooks.stopped(servo_fault(robot, what, self._heard, STOPPED_BY_HAND))
        elif not self._heed_stop(robot, chg):
            self._stop_said = self._stop_said and robot.halted
            if control is not None:
                self._control(chg, control)

    def _control(self, chg: Chg, control: Callable[[], object]) -> None:
        """Call the control function; what it says of hand and outputs is forgotten when it cannot be."""
        lines, stream = (chg.hand, chg.outputs), chg.stream
        try:
            self._runs += 1
            control()
            if self._judged:
                self.judge()
        except BaseException:
            chg.hand, chg.outputs = lines
            raise
        finally:
            chg.stream = stream  # which names this run of setpoints, for the servo

    def judge(self) -> None:
        """Judge what `chg` asks for. Raises what `check_chg` does."""
        chg = self._td.chg
        chg.modes, chg.setpoints = check_chg(self._td.name, chg, self._data, self._said, self._period_s)

    def _stop(self, robot: RobotState, chg: Chg) -> None:
        if self._power_down.step(robot, chg):
            self.phase = CyclePhase.LEFT
