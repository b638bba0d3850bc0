"""A robot that a program has opened: ARCL's type `ROBOT`. Degrees, millimetres, milliseconds."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from copy import copy
from typing import Any, Final

from qrobot.arcl.errors import answer_of, goes_on
from qrobot.arcl.events import ArclEvent, CallbackAnswer
from qrobot.arcl.generator import MotionQueue
from qrobot.arcl.joint_units import units_of
from qrobot.arcl.kept_motions import KeptMotions
from qrobot.arcl.kinematics import ManipulatorKinematics
from qrobot.arcl.line_calls import LineCalls
from qrobot.arcl.machine import MachineSample, RobotMachine
from qrobot.arcl.motion import Motion, MotionFeedback
from qrobot.arcl.opened import forget
from qrobot.arcl.options import MotionOptions
from qrobot.arcl.path_calls import PathCalls
from qrobot.arcl.positions import Pos, joints_of
from qrobot.arcl.standstill import ArclStandstill
from qrobot.arcl.stream import RecordKind
from qrobot.arcl.switches import switches
from qrobot.arcl.teaching import Teaching
from qrobot.arcl.trace import exec_line, request_line
from qrobot.arcl.trace_output import say, settle
from qrobot.arcl.trans import Trans, new_trans_value
from qrobot.arrays import Floats
from qrobot.config import Robot
from qrobot.errors import ConfigError, LinkError, MotionError, QRobotError, ServoFault, letting_go
from qrobot.fences.in_force import fences_for
from qrobot.motion import Trsf, whole_samples
from qrobot.rci.forked_child import keep_from_children
from qrobot.rci.listening import GivesWay, heard, heard_on_leaving
from qrobot.rci.machine_choice import machine_choice
from qrobot.rci.sample_drivers import refuse_at_samples
from qrobot.units import MM_PER_M, S_PER_MS

STOP_MS: Final = 300.0  # Tseg of STOP in Figure 5


class ArclRobot(PathCalls, LineCalls):
    """One arm under control of this program.

    Args:
        robot: the arm.
        aki: its kinematics.
        ami: the way to it, not yet open.
        bridge: its address, where the program names it by that; else empty.

    Attributes:
        name: of the arm.
        aki: as given, with the limits that motions have on this machine.
        ami, bridge: as given.
    """

    def __init__(self, robot: Robot, aki: ManipulatorKinematics, ami: RobotMachine, bridge: str = "") -> None:
        self.name, self.bridge = robot.name, bridge
        self.aki, self.ami = aki, ami
        self._full_aki = aki
        self._robot = robot
        self._units = units_of(robot)
        self._options = MotionOptions()
        self._error: QRobotError | None = None
        self._gave_way: ArclStandstill | None = None
        self._one_by_one = False
        self._closed = self._loss_told = self._given_up = False
        self._ticks = 0
        self._kept = KeptMotions(robot)
        LineCalls.__init__(self)
        self._begin_at(ami.open())
        keep_from_children(self)

    def forget_in_child(self) -> None:
        """See `Owned`: the robot is the parent's."""
        self._closed = True
        forget(self)

    def _begin_at(self, q: Floats) -> None:
        """Begin to move the arm from where it is held, within the limits that the machine has now."""
        self.aki = _on_machine(self._full_aki, self.ami)
        fences = fences_for(self.name, self.bridge)
        fences = None if fences is None else fences.seen_from(self.aki.zero)
        self._motions = MotionQueue(self.aki, self.ami.period_s, q, self, fences, self._one_by_one)
        self._kept.serve(self._motions, self.aki)
        self.ami.start(self._sample)

    # -------------------------------------------------------------------------------------------------- positions

    def pose(self, name: str, tool: Trsf | None = None) -> Pos:
        """The pose of that name in the robot file, in capitals, as PARK. Raises ConfigError: there is none."""
        poses = self._robot.poses
        if name.lower() not in poses:
            raise ConfigError(f"{self.name} has no pose {name!r}; it has {', '.join(poses)}")
        return Pos(name.upper(), poses[name.lower()] - self.aki.zero, tool)

    def joint_pos(self, name: str, degs: Sequence[float], tool: Trsf | None = None) -> Pos:
        """A position given by its joints, degrees (mm). Raises MotionError: not n finite numbers."""
        return Pos(name, joints_of(f"position {name}", degs, self._units), tool)

    def fkine(self, degs: Sequence[float], name: str = "T6") -> Trans:
        """T6 at joint positions, degrees (mm)."""
        return new_trans_value(name, self.aki.forward(joints_of("fkine", degs, self._units)))

    @property
    def n(self) -> int:
        """Number of its joints."""
        return self._robot.n

    @property
    def joints(self) -> Floats:
        """Measured joint positions, degrees (mm). Shape (n,)."""
        q: Floats = self._seen.q / self._units
        return q

    @property
    def setpoint(self) -> Floats:
        """The newest joint setpoint of its motions, rad or m, counted as those of `aki`. Shape (n,)."""
        with self._lock():
            return self._motions.engine.newest.copy()

    def where(self, name: str = "HERE") -> Trans:
        """T6 at the measured joint positions."""
        return new_trans_value(name, self.aki.forward(self._seen.q))

    @property
    def treal(self) -> float:
        """Time since the first sample, ms."""
        return self.ami.treal()

    # ---------------------------------------------------------------------------------------------------- motions

    def move(self, pos: Pos, *attributes: Any, announce: Callable[[Motion], None] | None = None) -> Motion:
        """Queue a motion and return at once, or with MOV_SYNC when it is nearly complete.

        `announce` is called with the motion before it can begin.

        Raises:
            MotionError: an attribute is unknown or impossible, the queue is full, or a motion before this one failed
                (with the kind of that error).
            LinkError, ServoFault: control of the arm is lost.
        """
        if not isinstance(pos, Pos):
            raise MotionError(f"move: a position is needed, from makeposition or joint_pos, not {pos!r}")
        options = self._options.changed_by("move", attributes)
        with self._lock():
            motion = Motion(pos, options)
            if announce is not None:
                announce(motion)
            self._motions.push(motion)
            self._options = options.sticky()
            self._trace_request(motion.name, options)
        settle()
        if options.sync:
            self.wait(lambda: motion.over)
        return motion

    def judge(self, pos: Pos, *attributes: Any) -> None:
        """Raise what `move` raises, or the motion would end with; it is not queued.

        One behind others that wait is judged when its turn comes, and so is a goal that moves.
        """
        options = self._options.changed_by("move", attributes)
        with self._lock():
            self._motions.judge(Motion(pos, options))

    def stop(self, *attributes: Any) -> None:
        """Drop all motions and come to rest on the path, in at least Tseg (300 ms, or MOV_TIME) or at its goal.

        The arm stops as soon as its joints can where they cannot follow a straight line so, and on the way to a frame
        that moves.
        """
        options = self._options.changed_by("stop", attributes)
        ms = options.tseg_ms or STOP_MS
        with self._lock():
            self._trace_stop(ms)
            self._motions.stop(ms * S_PER_MS)
        settle()

    def expect_more(self) -> None:
        """Let no motion be shortened because nothing waits behind it: the next one is given when it has begun."""
        with self._lock():
            self._one_by_one = self._motions.one_by_one = True

    def skip(self) -> None:
        """End the motion under way, and go on to the next one, or stop if none waits."""
        with self._lock():
            self._motions.skip()

    @property
    def waiting(self) -> int:
        """Motions that wait in the queue."""
        with self._lock():
            return self._motions.waiting

    @property
    def busy(self) -> bool:
        """Motions wait or are under way."""
        with self._lock():
            return self._motions.busy

    @property
    def moving(self) -> bool:
        """A motion is under way, or comes to its end."""
        return self._motions.moving

    @property
    def held(self) -> bool:
        """Motions wait in the queue."""
        return self._motions.waiting > 0

    def wait(self, predicate: Callable[[], object] | None = None) -> None:
        """Wait until `predicate`, called at every sample, is true; without one until all motions are done.

        Raises:
            MotionError: a motion could not be done; or, on virtual time, nothing is left that could make it true; or
                the arm was given up before.
            Exception: what a call-back raised, once.
        """
        if predicate is not None and not callable(predicate):
            raise MotionError(f"arcl_wait: a function is needed, or nothing, not {predicate!r}")
        standstill, self._gave_way = self._gave_way or ArclStandstill(self), None

        def done() -> bool:
            self._raise_error()
            return not self._motions.busy if predicate is None else bool(predicate())

        has_ended = heard(done)

        def watched() -> bool:
            if has_ended():
                return True
            standstill.check()
            return False

        try:
            self.ami.wait(watched)
        except GivesWay:  # another wait that passes no more than this one ends as this one
            self._gave_way = standstill
            raise
        except (LinkError, ServoFault) as error:
            self._tell_loss(error)
            raise

    # ---------------------------------------------------------------------------------------------------- teaching

    def teach(self, function: Callable[..., object]) -> int:
        """Wait until all motions are done, and let a person move the arm by its teach pendant until he has done.

        Args:
            function: called with T6, a transform of its own each time, and the robot at each press of ENTER, with the
                arm at rest; MOVE_STOP ends it. It must not move the arm.

        Returns:
            How many presses there were.

        Raises:
            ConfigError: there is no pendant, or nobody can use it.
            MotionError: a motion could not be done, or the machine has no arm to move.
            LinkError, ServoFault: the arm is lost.
            Exception: what `function` raises; the robot has the arm again then.
        """
        if not callable(function):
            raise MotionError(f"teach: a function is needed, not {function!r}")
        if (pendant := machine_choice().pendant) is None:
            raise ConfigError("teach: there is no teach pendant; start the program with `qrobot run` in a terminal")
        self.wait()
        teaching = Teaching(self, function)
        self._begin_at(self.ami.lend(lambda links: teaching.give(pendant, links, self._robot)))
        before = self.ami.sample
        self.ami.wait(heard(lambda: self.ami.sample is not before))
        return teaching.end()

    # ------------------------------------------------------------------------------------------------------- end

    def close(self, power_off: bool = False) -> None:
        """Wait until all motions are done, and let go of the arm; a second call does nothing.

        Raises:
            MotionError: one of them could not be done; the arm is let go all the same. Or it is called by a function
                that is itself called at a sample; then nothing happens.
        """
        if self._closed:
            return
        refuse_at_samples()
        with letting_go(lambda: self.abandon(power_off)):
            self.finish()

    def finish(self) -> None:
        """Wait until all motions are done, and stop; does nothing after `close`. Raises what that raises."""
        if not self._closed and not self._given_up:
            self.wait()
            self.stop()

    def begin_stop(self) -> None:
        """Begin to come to rest, and drop what waits; waits for nothing."""
        with suppress(Exception):  # of an arm that is lost, or of a function that hears of its motions
            if not self._closed and self.ami.error is None:
                with self.ami.lock():
                    self._motions.stop(0.0)

    def abandon(self, power_off: bool = False) -> None:
        """Stop, and let go of the arm; what waits is not done. Does nothing after `close`.

        Raises MotionError, and nothing happens, where a function calls it that is itself called at a sample.
        """
        if self._closed:
            return
        refuse_at_samples()
        self._closed = True
        try:
            if self.ami.error is None:
                with letting_go(lambda: self.ami.wait(heard_on_leaving(self._rests))), self.ami.lock():
                    self._motions.stop(0.0)  # at rest it may still follow a frame that moves
        finally:
            with letting_go(self._forgotten):
                self.ami.close(power_off)

    def _rests(self) -> bool:
        return not self._motions.busy

    def _forgotten(self) -> None:
        """The program has it no more: what asks for the robots that are open does not find it."""
        forget(self)
        if farewell := self.ami.farewell():
            say(farewell)
        settle()

    # --------------------------------------------------------------------- what the generator tells (MotionReporter)

    def notify(self, event: ArclEvent, motion: Motion) -> CallbackAnswer:
        """See `MotionReporter.notify`."""
        if self.ami.stream is not None and event is not ArclEvent.EVENT_DEQ:
            self.ami.stream.event(event, motion.name, self.treal)
        if event is ArclEvent.EVENT_DONE and motion.options.doneproc is not None:
            motion.options.doneproc(self, motion)
        answer = None if motion.options.notify is None else motion.options.notify(event, self)
        return answer_of(answer) if event is ArclEvent.EVENT_DEQ else CallbackAnswer.OK

    def failed(self, event: ArclEvent, error: MotionError) -> bool:
        """See `MotionReporter.failed`."""
        if self.ami.stream is not None:
            self.ami.stream.text(RecordKind.ERROR, f"{event.name} {error}", self.treal)
        answer = goes_on(event, self, error)
        if answer is None:
            self._error = self._error or error
        return bool(answer)

    def executes(self, motion: Motion, following: Motion | None) -> None:
        """See `MotionReporter.executes`."""
        ta1, ta2 = motion.options.ta_ms, (following or motion).options.ta_ms
        tseg = motion.options.tseg_ms
        letter = "c" if motion.options.traj != 1 else "j"
        begin_s, dt_ms = self.treal * S_PER_MS, self.ami.period_s * MM_PER_M
        times = self._rounded_ms(ta1), self._rounded_ms(ta2), self._rounded_ms(tseg)
        line = exec_line(motion.name, begin_s, 0, letter, *times, dt_ms)
        self._trace(RecordKind.EXEC, line)

    def feedback(self, motion: Motion, share: float, seen: MachineSample, q: Floats) -> object:
        """See `MotionReporter.feedback`."""
        if motion.options.feedback is None:
            return None
        told = MotionFeedback(seen.t_ms, share, seen.q / self._units, seen.v / self._units, q / self._units, seen.tau)
        return motion.options.feedback(told)

    def ended(self, motion: Motion, seen: MachineSample) -> None:
        """See `MotionReporter.ended`: solve for what MOV_UPDATE names."""
        if (trans := motion.options.update) is not None and motion.begun:
            trans.set(motion.pos.equation.solve(trans, self.aki.forward(seen.q), self._ticks))

    # ---------------------------------------------------------------------------------------------------- helpers

    def _sample(self, seen: MachineSample) -> Floats:
        """Make the setpoints of one sample; the machine calls this."""
        self._ticks += 1
        q = self._motions.sample(seen)
        if self.ami.stream is not None:
            self.ami.stream.pose(self.aki.forward(q), seen.t_ms)
        return q

    @property
    def _seen(self) -> MachineSample:
        if self.ami.sample is None:
            self.ami.wait(heard(lambda: self.ami.sample is not None))
        if self.ami.sample is None:
            raise LinkError(f"{self.name}: nothing was heard of the robot yet")
        return self.ami.sample

    def _lock(self) -> Any:
        self._raise_error()
        if self._closed:
            raise LinkError(f"{self.name} was closed; call arcl_open first")
        return self.ami.lock()

    def _tell_loss(self, error: QRobotError) -> None:
        """Control of the arm is lost: tell the program's handler, once; its answer does not matter."""
        if not self._loss_told:
            self._loss_told = True
            goes_on(ArclEvent.EVENT_FAULT, self, error)

    def _raise_error(self) -> None:
        error, self._error = self._error, None
        if error is not None:
            raise error
        if (lost := self.ami.error) is not None:
            self._raise_lost(lost)

    def _raise_lost(self, lost: BaseException) -> None:
        """Raise what ended control of the arm: the loss of the arm at each call, the error of a call-back once."""
        if isinstance(lost, LinkError | ServoFault):
            raise lost
        if self._given_up:
            raise MotionError(f"{self.name} was given up after {type(lost).__name__}: {lost}; call arcl_open") from lost
        self._given_up = True
        raise lost

    def _rounded_ms(self, ms: float) -> float:
        """Whole samples of a time that was asked for; nothing stays nothing."""
        period_ms = self.ami.period_s * MM_PER_M
        return whole_samples(ms * S_PER_MS, self.ami.period_s) * period_ms if ms > 0.0 else 0.0

    def _trace_request(self, name: str, options: MotionOptions) -> None:
        times = options.ta_ms, options.tseg_ms
        line = request_line(name, self.treal, options.traj, *times, options.vt, options.vr, options.config)
        self._trace(RecordKind.REQUEST, line)

    def _trace_stop(self, ms: float) -> None:
        options = self._options
        line = request_line("STOP", self.treal, options.traj, options.ta_ms, ms, options.vt, options.vr, None)
        self._trace(RecordKind.REQUEST, line)

    def _trace(self, kind: RecordKind, line: str) -> None:
        if switches.motions:
            say(line, waited_for=not self.ami.virtual_time)
        if self.ami.stream is not None:
            self.ami.stream.text(kind, line, self.treal)


def _on_machine(aki: ManipulatorKinematics, ami: RobotMachine) -> ManipulatorKinematics:
    """The kinematics of an arm with the limits that it has on a machine."""
    if (narrowed := ami.narrow(aki.limits)) is aki.limits:
        return aki
    aki = copy(aki)
    aki.limits = narrowed
    return aki
