"""The machine of QRobot's arms: a session with the bridge, over the wire or in lock-step (QRobot paper, section 7).

The conversation with the robot, from power-up to the goodbye, is that of RCI (`RobotCycle`); this machine puts the
trajectory generator's setpoints into it, and a `SampleDriver` of RCI runs it: over the wire a thread answers every
STATE; in lock-step samples pass while the program waits. The hand is pneumatic: it opens, closes and relaxes.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from contextlib import AbstractContextManager
from functools import partial
from typing import Final

import numpy as np

from qrobot.arcl.events import Grip
from qrobot.arcl.machine.digital import set_bits
from qrobot.arcl.machine.interface import MachineSample, MachineSettings, PathKeeper, SetpointCycle
from qrobot.arcl.machine.stream_start import open_stream
from qrobot.arcl.stream import RecordKind, StreamWriter
from qrobot.arrays import Floats
from qrobot.errors import LinkError, LinkLost, MotionError, ServoFault
from qrobot.motion import MotionLimits
from qrobot.rci.arm_settings import ArmSettings
from qrobot.rci.descriptor import HOST, NO_BIT, TaskDescriptor, local_area
from qrobot.rci.environment import environment
from qrobot.rci.link import Link, LinkFactory, check_welcome, hello_for, sample_period_us
from qrobot.rci.listening import heard, heard_on_leaving
from qrobot.rci.robot_cycle import SERVO_AWAY, CycleHooks, CyclePhase, RobotCycle, may_go_back
from qrobot.rci.robot_data import KnownRobot, RobotData
from qrobot.rci.robot_samples import told_later
from qrobot.rci.sample_drivers import driver_for
from qrobot.rci.sampled_task import SampleDriver
from qrobot.realtime.interpreter import prepare_interpreter
from qrobot.units import NS_PER_MS
from qrobot.wire import AnalogOutputs, Collision, Command, Payload, RobotState, State, Welcome
from qrobot.wire.packets import analog_output
from qrobot.wire.vocabulary import Hand

_OFF_PATH: Final = frozenset({CyclePhase.STANDING, CyclePhase.POWERING, CyclePhase.STARTING})
SAMPLED: Final = threading.Condition()
"""The lock of all arms of a program in real time: a function that one of them calls may tell another one something."""

_HANDS: Final = {Grip.GRIP_OPEN: Hand.OPEN, Grip.GRIP_CLOSE: Hand.CLOSED, Grip.GRIP_RELAX: Hand.RELAXED}


class BridgeMachine:
    """See `RobotMachine`.

    Args:
        settings: what it is made with; `start` does not count.

    Raises:
        MotionError: no such sample period.
    """

    name = "bridge"

    def __init__(self, settings: MachineSettings) -> None:
        self.stream: StreamWriter | None = None
        self.sample: MachineSample | None = None
        self._settings = settings
        self._hello = hello_for(settings.robot.name, _period_us(settings.period_ms))
        named = "" if settings.bridge else settings.robot.name  # a file of several arms may call another one so
        known = KnownRobot(named, settings.robot.name, settings.bridge)
        self._links = partial(environment().links, known)
        self._link: Link = self._links(self._hello)
        self.virtual_time = self._link.virtual_time
        self.period_s = 0.0  # as the bridge says when it is greeted
        self._data = RobotData(settings.robot)
        self.td = TaskDescriptor(settings.robot.name, NO_BIT, HOST, local_area(), self._data)
        self._cycle: SetpointCycle | None = None
        self._driver: SampleDriver | None = None
        self._error: BaseException | None = None  # that no driver has met
        self._first_ns: int | None = None
        self._left_out = 0
        self._analog_told = False
        self._keeper: PathKeeper | None = None
        name = settings.robot.name
        self._arm_settings = ArmSettings(
            name, lambda: self._link, self.lock, self._wait_heard, lambda: self._robot.samples, lambda: self.td.heard
        )

    def open(self) -> Floats:
        """See `RobotMachine.open`. Raises LinkError, ServoFault, MotionError: the arm cannot be taken."""
        q = self._hold()
        self.stream = open_stream(self._settings, self.name, self.period_s * 1e3)
        return q

    def lend(self, borrower: Callable[[LinkFactory], None]) -> Floats:
        """See `RobotMachine.lend`: the stream of setpoints ends, and another one begins."""
        self._leave(power_off=False, reason="lent")
        try:
            borrower(self._links)
        finally:
            q = self._take_again()
        return q

    def _take_again(self) -> Floats:
        self._cycle = None
        self._left_out = 0
        try:
            self._link = self._links(self._hello)
            return self._hold()
        except BaseException as error:
            self._error = told_later(error)
            raise

    def _hold(self) -> Floats:
        """Take the arm. Gives the joint positions at which it is held. Shape (n,)."""
        if not self.virtual_time:
            prepare_interpreter()
        before, self._driver = self._driver, None
        try:
            self._take(self._link.open())
            tell_again = self._arm_settings.tell_again
            self._driver = driver_for(self._link, self, "arcl-trajectory", tell_again, SAMPLED, before)
            self._driver.start()
            self._arm_settings.tell_again()
            self.wait(heard(lambda: self._robot.phase is CyclePhase.FOLLOWING))
        except BaseException as error:
            self._link.close(str(error))
            if self._driver is not None:
                self._driver.end()
            raise
        return np.array(self.td.chg.setpoints) - self._settings.zero

    def keep_path(self, keeper: PathKeeper) -> None:
        """See `RobotMachine.keep_path`."""
        self._keeper = keeper

    def narrow(self, limits: MotionLimits) -> MotionLimits:
        """See `RobotMachine.narrow`: those of the robot file, slowed as the servo's reduced speed asks for."""
        return limits.slowed(self.td.how.speed_limit)

    def start(self, cycle: SetpointCycle) -> None:
        """See `RobotMachine.start`."""
        with self.lock():
            self._cycle = cycle

    def treal(self) -> float:
        """See `RobotMachine.treal`."""
        return 0.0 if self.sample is None else self.sample.t_ms

    @property
    def error(self) -> BaseException | None:
        """See `RobotMachine.error`."""
        return self._error or (None if self._driver is None else self._driver.error)

    def lock(self) -> AbstractContextManager[object]:
        """See `RobotMachine.lock`."""
        if self.error is not None:
            raise self.error
        return self._held.lock()

    def wait(self, predicate: Callable[[], bool]) -> None:
        """See `RobotMachine.wait`."""
        self._held.wait(predicate)

    def _wait_heard(self, predicate: Callable[[], bool]) -> None:
        self.wait(heard(predicate))

    @property
    def _held(self) -> SampleDriver:
        if self._driver is None:
            raise self._error or LinkError("the robot is not open")
        return self._driver

    def grip(self, command: int, value: float) -> None:
        """See `RobotMachine.grip`."""
        if command not in _HANDS:
            name = Grip(command).name
            raise MotionError(f"{name}: this hand opens, closes and relaxes; it has no positions to go to")
        self.td.chg.hand = _HANDS[Grip(command)]
        self._write(RecordKind.GRIPPER, np.array([command, value]))

    def write_outputs(self, first: int, count: int, value: int) -> None:
        """See `RobotMachine.write_outputs`."""
        self.td.chg.outputs = set_bits(self.td.chg.outputs, first, count, value)
        self._write(RecordKind.OUTPUT, np.array([first, count, value], dtype=np.float64))

    def write_analog(self, output: int, volts: float) -> None:
        """See `RobotMachine.write_analog`."""
        if self._analog_told and (refusal := self._link.refusal(AnalogOutputs)):
            self._analog_told = False
            raise MotionError(f"{self._settings.robot.name} has refused an analogue output: {refusal}")
        self._link.tell(analog_output(output, volts))
        self._analog_told = True
        self._write(RecordKind.ANALOG, np.array([output, volts]))

    def tell(self, setting: Payload | Collision) -> None:
        """See `RobotMachine.tell`."""
        self._arm_settings.tell(setting)

    def close(self, power_off: bool) -> None:
        """See `RobotMachine.close`."""
        try:
            self._leave(power_off, "program ended")
        finally:
            if self.stream is not None:
                self.stream.close(self.treal())

    def _leave(self, power_off: bool, reason: str) -> None:
        """End the conversation in good order; the link is closed whatever happens."""
        try:
            if self.error is None:
                with self.lock():
                    self._robot.stop(power_off)
                self.wait(heard_on_leaving(lambda: self._robot.phase is CyclePhase.LEFT))
        finally:
            if self._driver is not None:
                self._driver.end()
            self._link.close(reason)

    def farewell(self) -> str:
        """See `RobotMachine.farewell`: nothing, the arm has shown what it did."""
        return ""

    # ------------------------------------------------------------------------------------------ once per sample

    def _take(self, welcome: Welcome) -> None:
        """Begin the conversation. Raises LinkError: the bridge has another robot."""
        check_welcome(welcome, self._settings.robot, "the program")
        self.period_s = welcome.period_us * 1e-6
        hooks = CycleHooks(held=self._lead_back, stopped=self._stopped)
        self._robot = RobotCycle(self.td, self._data, self.period_s, self._settings.clear_fault, hooks)

    @property
    def left(self) -> bool:
        """See `SampledTask.left`."""
        return self._robot.phase is CyclePhase.LEFT

    def step(self, state: State, now_ns: int) -> Command:
        """See `SampledTask.step`."""
        command = self._robot.step(state, now_ns, None if self._cycle is None else self._control)
        if self._robot.phase in _OFF_PATH and self._cycle is not None and self._keeper is not None:
            self._wait_off_path(self._keeper)
        self._robot.describe()
        return command

    def lose_link(self, lost: LinkError) -> None:
        """See `SampledTask.lose_link`. Raises `lost`: the path is not kept."""
        self._stopped(lost)
        self._robot.count_anew()

    def lose_servo(self) -> None:
        """See `SampledTask.lose_servo`. Raises LinkLost, ServoFault: the arm is off a path that is not kept."""
        if self._keeper is not None and self._keeper.off_path and self._robot.phase is not CyclePhase.STOPPING:
            self._stopped(LinkLost(SERVO_AWAY))

    def insist(self) -> None:
        """See `SampledTask.insist`."""
        if self._keeper is not None:
            self._keeper.insist()

    def lost(self) -> None:
        """See `SampledTask.lost`: arms of one program are each other's strangers."""

    def _stopped(self, fault: ServoFault | LinkError) -> None:
        """The servo holds the arm, or none does. Raises `fault`: nobody keeps its path."""
        leaving = self._robot.phase is CyclePhase.STOPPING
        if leaving or self._cycle is None or self._keeper is None:
            raise fault
        if not self._keeper.keep(fault, held=not may_go_back(self.td.how)):
            raise fault
        self._robot.stand()
        self.td.chg.path_waits = True

    def _wait_off_path(self, keeper: PathKeeper) -> None:
        """One sample of an arm that stands off its path, or is taken again."""
        self.sample = self._sample_of(self.td.how)
        keeper.look(self.sample, self.td.how.paused)
        if self._robot.phase is CyclePhase.STANDING and keeper.may_return(self.sample):
            self._robot.take_again(self.td.how)
        self.td.chg.path_waits = bool(keeper.reason)

    def _lead_back(self) -> None:
        """The arm is held, and its setpoints are about to stream."""
        if self._cycle is not None and self._keeper is not None:
            self._keeper.lead_back(np.array(self.td.how.q_setpoint) - self._settings.zero)

    def _control(self) -> None:
        """Ask the generator for setpoints; the robot's cycle checks them."""
        if self._cycle is None:
            return
        self.sample = self._sample_of(self.td.how)
        q = self._cycle(self.sample)
        self.td.chg.go_to(tuple((q + self._settings.zero).tolist()))
        self._write(RecordKind.MEASURED, self.sample.q)
        self._write(RecordKind.JOINTS, q)
        if self._keeper is not None and (met := self._keeper.met) is not None:
            self._stopped(met)
            self.td.chg.stop = True  # this run of setpoints has ended

    def _sample_of(self, how: RobotState) -> MachineSample:
        self._first_ns = how.t_ns if self._first_ns is None else self._first_ns
        left_out, self._left_out = self._robot.left_out - self._left_out, self._robot.left_out
        return MachineSample(
            (how.t_ns - self._first_ns) / NS_PER_MS, np.array(how.q) - self._settings.zero, np.array(how.v),
            np.array(how.tau), how.inputs, how.outputs, how.hand, left_out if self.sample else 0,
            how.motion_override,
            np.array(how.sensors), how.torques_known,
        )  # fmt: skip

    def _write(self, kind: RecordKind, values: Floats) -> None:
        if self.stream is not None:
            self.stream.numbers(kind, values, self.treal())


def _period_us(period_ms: float | None) -> int:
    """A sample period as the bridge takes it; 0 for its own. Raises MotionError: there is no such period."""
    if period_ms is None:
        return 0
    return sample_period_us("ARCL_PERIOD", period_ms)
