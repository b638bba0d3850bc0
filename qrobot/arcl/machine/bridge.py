"""The machine of QRobot's arms: a session with the bridge, over the wire or in lock-step (QRobot paper, section 7).

The conversation with the robot, from power-up to the goodbye, is that of RCI (`RobotCycle`); this machine puts the
trajectory generator's setpoints into it. Over the wire a thread answers every STATE; in lock-step samples pass while
the program waits. The hand is pneumatic: it opens, closes and relaxes.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from functools import partial
from typing import Final

import numpy as np

from qrobot.arcl.events import Grip
from qrobot.arcl.machine import shared_time
from qrobot.arcl.machine.digital import set_bits
from qrobot.arcl.machine.interface import MachineSample, MachineSettings, SetpointCycle
from qrobot.arcl.machine.stream_start import open_stream
from qrobot.arcl.stream import RecordKind, StreamWriter
from qrobot.arrays import Floats
from qrobot.errors import LinkError, LinkLost, MotionError
from qrobot.motion import MotionLimits
from qrobot.rci.descriptor import HOST, TaskDescriptor, local_area
from qrobot.rci.environment import environment
from qrobot.rci.link import Link, LinkFactory, hello_for
from qrobot.rci.robot_cycle import CyclePhase, RobotCycle
from qrobot.rci.robot_data import KnownRobot, RobotData
from qrobot.realtime.interpreter import InterpreterShare, prepare_interpreter
from qrobot.realtime.setup import set_fifo
from qrobot.units import NS_PER_MS, US_PER_MS
from qrobot.wire import Command, RobotState, Welcome
from qrobot.wire.vocabulary import LONGEST_PERIOD_US, SHORTEST_PERIOD_US, Hand

_HANDS: Final = {Grip.GRIP_OPEN: Hand.OPEN, Grip.GRIP_CLOSE: Hand.CLOSED, Grip.GRIP_RELAX: Hand.RELAXED}
_TASK_BIT: Final = 2  # the first behind the program's own
_PRIORITY: Final = 20  # ahead of ordinary programs where that is allowed, behind bridge and servo
_LOOK_S: Final = 0.5  # a waiting program looks up so often


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
        self.error: BaseException | None = None
        self.sampling = False
        self._settings = settings
        self._hello = hello_for(settings.robot.name, _period_us(settings.period_ms))
        self._links = partial(environment().links, KnownRobot(settings.robot.name, settings.robot.name))
        self._link: Link = self._links(self._hello)
        self.virtual_time = self._link.virtual_time
        self.period_s = 0.0  # as the bridge says when it is greeted
        self._data = RobotData(settings.robot)
        self._td = TaskDescriptor(settings.robot.name, _TASK_BIT, HOST, local_area(), self._data)
        self._cycle: SetpointCycle | None = None
        self._command: Command | None = None
        self._first_ns: int | None = None
        self._left_out = 0
        self._changed = threading.Condition()
        self._thread = self._new_thread()
        self._share = InterpreterShare()

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
        self._cycle = self._command = None
        self._left_out = 0
        self._thread = self._new_thread()
        try:
            self._link = self._links(self._hello)
            return self._hold()
        except BaseException as error:
            self.error = error
            raise

    def _new_thread(self) -> threading.Thread:
        return threading.Thread(target=self._run, name="arcl-trajectory", daemon=True)

    def _hold(self) -> Floats:
        """Take the arm. Gives the joint positions at which it is held. Shape (n,)."""
        if not self.virtual_time:
            prepare_interpreter()
        try:
            self._take(self._link.open())
            if self.virtual_time:
                shared_time.join(self)
            else:
                self._share.begin()
                self._thread.start()
            self.wait(lambda: self._robot.phase is CyclePhase.FOLLOWING)
        except BaseException as error:
            shared_time.leave(self)
            self._share.end()
            self._link.close(str(error))
            raise
        return np.array(self._td.chg.setpoints) - self._settings.zero

    def narrow(self, limits: MotionLimits) -> MotionLimits:
        """See `RobotMachine.narrow`: the servo has those of the robot file."""
        return limits

    def start(self, cycle: SetpointCycle) -> None:
        """See `RobotMachine.start`."""
        with self.lock():
            self._cycle = cycle

    def treal(self) -> float:
        """See `RobotMachine.treal`."""
        return 0.0 if self.sample is None else self.sample.t_ms

    def lock(self) -> AbstractContextManager[object]:
        """See `RobotMachine.lock`."""
        if self.error is not None:
            raise self.error
        return nullcontext() if self.virtual_time else self._changed

    def wait(self, predicate: Callable[[], bool]) -> None:
        """See `RobotMachine.wait`."""
        if self.virtual_time:
            shared_time.wait(self, predicate)
            return
        if threading.current_thread() is self._thread:
            raise MotionError(shared_time.NO_WAIT)
        with self._changed:
            while not predicate():
                if self.error is not None:
                    raise self.error
                if not self._thread.is_alive():
                    raise LinkLost("the robot was closed: nothing can happen any more")
                self._changed.wait(_LOOK_S)

    def grip(self, command: int, value: float) -> None:
        """See `RobotMachine.grip`."""
        if command not in _HANDS:
            name = Grip(command).name
            raise MotionError(f"{name}: this hand opens, closes and relaxes; it has no positions to go to")
        self._td.chg.hand = _HANDS[Grip(command)]
        self._write(RecordKind.GRIPPER, np.array([command, value]))

    def write_outputs(self, first: int, count: int, value: int) -> None:
        """See `RobotMachine.write_outputs`."""
        self._td.chg.outputs = set_bits(self._td.chg.outputs, first, count, value)
        self._write(RecordKind.OUTPUT, np.array([first, count, value], dtype=np.float64))

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
                self.wait(lambda: self._robot.phase is CyclePhase.LEFT)
        finally:
            shared_time.leave(self)
            if self._thread.is_alive():
                self._thread.join()
            self._share.end()
            self._link.close(reason)

    def farewell(self) -> str:
        """See `RobotMachine.farewell`: nothing, the arm has shown what it did."""
        return ""

    # ------------------------------------------------------------------------------------------ once per sample

    @property
    def elapsed_ms(self) -> float:
        """See `SteppedMachine.elapsed_ms`."""
        return self.treal() + self.period_s * 1e3

    def step(self) -> None:
        """See `SteppedMachine.step`."""
        self.sampling = True
        try:
            self._exchange()
        except BaseException as error:
            self.error = error
            self._link.close(str(error))
        finally:
            self.sampling = False

    def _take(self, welcome: Welcome) -> None:
        """Begin the conversation. Raises LinkError: the bridge has another robot."""
        robot = self._settings.robot
        if (welcome.robot, welcome.n) != (robot.name, robot.n):
            here = f"{welcome.robot!r} with {welcome.n} joints"
            raise LinkError(f"the bridge drives {here}, the program wants {robot.name!r} with {robot.n}")
        self.period_s = welcome.period_us * 1e-6
        self._robot = RobotCycle(self._td, self._data, self.period_s, self._settings.clear_fault)

    def _run(self) -> None:
        """The thread: answer every STATE until the arm is left."""
        set_fifo(_PRIORITY)
        reason = "program ended"
        try:
            while self._robot.phase is not CyclePhase.LEFT:
                self._exchange()
        except BaseException as error:  # it belongs to the program, which gets it where it waits
            reason = str(error)
            with self._changed:
                self.error = error
        finally:
            with self._changed:
                self._changed.notify_all()
            self._link.close(reason)

    def _exchange(self) -> None:
        """Hear a STATE, and make up the command that answers it."""
        state = self._link.exchange(self._command)
        with self._changed:
            control = None if self._cycle is None else self._control
            self._command = self._robot.step(state, self._link.now_ns(), control)
            self._changed.notify_all()

    def _control(self) -> None:
        """Ask the generator for setpoints; the robot's cycle checks them."""
        if self._cycle is None:
            return
        self.sample = self._sample_of(self._td.how)
        q = self._cycle(self.sample)
        self._td.chg.go_to(tuple((q + self._settings.zero).tolist()))
        self._write(RecordKind.MEASURED, self.sample.q)
        self._write(RecordKind.JOINTS, q)

    def _sample_of(self, how: RobotState) -> MachineSample:
        self._first_ns = how.t_ns if self._first_ns is None else self._first_ns
        left_out, self._left_out = self._robot.left_out - self._left_out, self._robot.left_out
        return MachineSample(
            (how.t_ns - self._first_ns) / NS_PER_MS, np.array(how.q) - self._settings.zero, np.array(how.v),
            np.array(how.tau), how.inputs, how.outputs, how.hand, left_out if self.sample else 0,
            how.motion_override,
            np.array(how.sensors),
        )  # fmt: skip

    def _write(self, kind: RecordKind, values: Floats) -> None:
        if self.stream is not None:
            self.stream.numbers(kind, values, self.treal())


def _period_us(period_ms: float | None) -> int:
    """A sample period as the bridge takes it; 0 for its own. Raises MotionError: there is no such period."""
    if period_ms is None:
        return 0
    period_us = round(period_ms * US_PER_MS)
    if not SHORTEST_PERIOD_US <= period_us <= LONGEST_PERIOD_US:
        raise MotionError(f"ARCL_PERIOD: a sample period of {period_ms:g} ms; 1 to 100 ms are possible")
    return period_us
