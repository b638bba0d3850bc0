"""The way to the servo: its shared memory, followed through restarts."""

from __future__ import annotations

import contextlib
import time
from dataclasses import replace
from typing import Any, Final

from qrobot.arrays import Words
from qrobot.config.collision import threshold_objection
from qrobot.errors import LinkError, LinkMismatch
from qrobot.faultcodes import NO_JOINT
from qrobot.model.payload_judge import PayloadJudge
from qrobot.rccl_bridge.servo_interface import SetpointFrame
from qrobot.realtime.shared_memory import SharedMemory
from qrobot.servo.memory.mailbox import ServoMailbox
from qrobot.servo.memory.servo_memory import ServoMemory, attach_servo_memory, local_servo_memory
from qrobot.servo.memory.telemetry import SMALLEST_RING
from qrobot.units import NS_PER_S, NS_PER_US
from qrobot.wire import AnalogOutputs, Collision, Payload, RobotState
from qrobot.wire.packets import NO_SIGNALS
from qrobot.wire.robot_state import rows_of
from qrobot.wire.vocabulary import LONGEST_PERIOD_US

_MASKS: Final = {"B": 0xFF, "H": 0xFFFF, "I": 0xFFFFFFFF}  # by code of the field, as `struct` has it
STALLED_NS: Final = 20_000_000  # a servo whose last cycle is older waits for its emulated board, or was stopped [A]
NEW_SERVO_NS: Final = LONGEST_PERIOD_US * NS_PER_US  # a new servo counts as away so long: each session sees it
STALE_NS: Final = 250_000_000  # a servo whose last cycle is older does not run, whatever its guardian says


def warm_up() -> None:
    """Compile, or load from the cache, what a port calls: it would take longer than a sample period."""
    port = MailboxPort(local_servo_memory("warm-up", "", 1, NS_PER_S, SMALLEST_RING))
    port.read_state()
    port.write_setpoint(SetpointFrame(0, 0, 0, 0, (0,), (0.0,), False, False, False, 0, 0))


def shows_life(memory: ServoMemory, silence_ns: int) -> bool:
    """Whether a servo runs whose last cycle was so long ago.

    One that its guardian has taken the board from, for silence, has to show sooner that it runs again: after two
    periods, where its cycles are that long.
    """
    soon_ns = min(max(STALLED_NS, 2 * int(memory.info.period_ns)), STALE_NS)
    return abs(silence_ns) < (soon_ns if memory.guardian.takeover else STALE_NS)


class MailboxPort:
    """`RobotPort` over servo memory in this process: lock-step and tests, where the servo is always there.

    Args:
        words: the memory. judge: of payloads; None takes each.
    """

    mismatch = ""
    servo = 1

    def __init__(self, words: Words, judge: PayloadJudge | None = None) -> None:
        self._judge = judge
        self._mailbox = ServoMailbox(words)

    @property
    def robot_name(self) -> str:
        """Name of the robot, as clients have to give it."""
        return self._mailbox.info.robot_name

    @property
    def n(self) -> int:
        """Number of joints."""
        return self._mailbox.info.n

    def alive(self) -> bool:
        """The servo is part of this process."""
        return True

    def slipped_ns(self) -> int:
        """Virtual time never slips."""
        return 0

    def stalled(self) -> bool:
        """Nor does it stand still."""
        return False

    def read_state(self) -> RobotState:
        """Newest state of the robot."""
        return _to_wire(self._mailbox)

    def write_setpoint(self, frame: SetpointFrame) -> None:
        """Hand a frame and its requests to the servo."""
        _pass_on(self._mailbox, frame)

    def write_requests(self, frame: SetpointFrame) -> None:
        """Hand over what a frame requests, without its setpoints."""
        _pass_on_requests(self._mailbox, frame)

    def request_stop(self) -> None:
        """Ask for a controlled stop on the path."""
        self._mailbox.request_stop()

    def request_power_off(self) -> None:
        """Take arm power away after a controlled stop."""
        self._mailbox.request_power_off()

    def name_signals(self, names: tuple[str, ...]) -> None:
        """Names of the program's numbers from now on; there are none yet."""
        _name_signals(self._mailbox, names)

    def judge_payload(self, payload: Payload) -> str:
        """Reason for which the arm cannot carry `payload`; "" when it can."""
        return "" if self._judge is None else self._judge.objection(payload)

    def write_payload(self, payload: Payload) -> None:
        """Reckon with `payload` from now on."""
        self._mailbox.request_payload(payload)

    def judge_collision(self, collision: Collision) -> str:
        """Reason for which the arm does not take such thresholds; "" when it does."""
        return "" if self._judge is None else threshold_objection(self._judge.robot, collision.thresholds)

    def write_collision(self, collision: Collision) -> None:
        """Tell collisions so from now on."""
        self._mailbox.request_collision(collision.thresholds, collision.reaction, by_program=True)

    def forget_collision(self) -> None:
        """Let the robot file's thresholds count again where a program told others."""
        self._mailbox.forget_collision()

    def judge_analog(self, analog: AnalogOutputs) -> str:
        """Reason for which the arm's analogue outputs cannot be so; "" when they can."""
        return self._mailbox.analog_objection(analog.volts)

    def write_analog(self, analog: AnalogOutputs) -> None:
        """Let analogue outputs be so from now on."""
        self._mailbox.request_analog(analog.volts)


class ServoPort:
    """`RobotPort` to the servo process of one arm, which may die, restart or not be there yet.

    Args:
        arm: instance name.
        robot_name, n: what the deployment says of it; a servo of another robot counts as gone.
        judge: of payloads; None takes each.

    Attributes:
        mismatch: why the servo that runs cannot be used; "" for one that can, or that is not there.
    """

    def __init__(self, arm: str, robot_name: str, n: int, judge: PayloadJudge | None = None) -> None:
        self._judge = judge
        self.arm = arm
        self.robot_name = robot_name
        self.n = n
        self._segment: SharedMemory | None = None
        self._mailbox: ServoMailbox | None = None
        self._generation = self._servos = self._slipped_ns = 0
        self._new_until_ns = 0
        self.mismatch = ""
        self._power_locked = False  # a servo that has just started is not powered by a request made to the one before

    @property
    def servo(self) -> int:
        """Number of the servo that is followed: how many there have been; a new file may begin its generations anew."""
        return self._servos

    def alive(self) -> bool:
        """The servo runs and its state is fresh."""
        try:
            memory = self._follow().memory
        except LinkError as error:
            self.mismatch = str(error) if isinstance(error, LinkMismatch) else ""
            return False
        self.mismatch = ""
        noticed = time.monotonic_ns() >= self._new_until_ns  # also by a bridge that stood still while it was away
        return noticed and bool(memory.info.ready) and shows_life(memory, self._silence_ns(memory))

    def slipped_ns(self) -> int:
        """Delay of the arm's time behind CLOCK_MONOTONIC, as a servo said last in a cycle; 0 before one did."""
        with contextlib.suppress(LinkError):
            heartbeat = self._follow().memory.heartbeat
            said = int(heartbeat.slipped_ns)
            if heartbeat.t_ns != 0:  # one that has just started has said nothing yet
                self._slipped_ns = said if 0 <= said < time.monotonic_ns() else 0
        return self._slipped_ns

    def stalled(self) -> bool:
        """An emulated arm's servo has not run of late: `slipped_ns` may be about to change."""
        try:
            memory = self._follow().memory
        except LinkError:
            return False
        return bool(memory.heartbeat.slips) and self._silence_ns(memory) > STALLED_NS

    def _silence_ns(self, memory: ServoMemory) -> int:
        return time.monotonic_ns() - self.slipped_ns() - int(memory.heartbeat.t_ns)

    def read_state(self) -> RobotState:
        """Newest state of the robot. Raises LinkError when the servo is gone."""
        return _to_wire(self._follow())

    def write_setpoint(self, frame: SetpointFrame) -> None:
        """Hand a frame and its requests to the servo. Raises LinkError when the servo is gone."""
        _pass_on(self._follow(), self._allowed(frame))

    def write_requests(self, frame: SetpointFrame) -> None:
        """Hand over what a frame requests, without its setpoints. Raises LinkError when the servo is gone."""
        _pass_on_requests(self._follow(), self._allowed(frame))

    def request_stop(self) -> None:
        """Ask for a controlled stop on the path. Raises LinkError when the servo is gone."""
        self._follow().request_stop()

    def request_power_off(self) -> None:
        """Take arm power away after a controlled stop. Raises LinkError when the servo is gone."""
        self._follow().request_power_off()

    def name_signals(self, names: tuple[str, ...]) -> None:
        """Names of the program's numbers from now on; there are none yet. Raises LinkError when the servo is gone."""
        _name_signals(self._follow(), names)

    def judge_payload(self, payload: Payload) -> str:
        """Reason for which the arm cannot carry `payload`; "" when it can."""
        return "" if self._judge is None else self._judge.objection(payload)

    def write_payload(self, payload: Payload) -> None:
        """Reckon with `payload` from now on. Raises LinkError when the servo is gone."""
        self._follow().request_payload(payload)

    def judge_collision(self, collision: Collision) -> str:
        """Reason for which the arm does not take such thresholds; "" when it does."""
        return "" if self._judge is None else threshold_objection(self._judge.robot, collision.thresholds)

    def write_collision(self, collision: Collision) -> None:
        """Tell collisions so from now on. Raises LinkError when the servo is gone."""
        self._follow().request_collision(collision.thresholds, collision.reaction, by_program=True)

    def forget_collision(self) -> None:
        """Let the robot file's thresholds count again where a program told others. Raises LinkError: no servo."""
        self._follow().forget_collision()

    def judge_analog(self, analog: AnalogOutputs) -> str:
        """Reason for which the arm's analogue outputs cannot be so; "" when they can."""
        try:
            return self._follow().analog_objection(analog.volts)
        except LinkError as error:
            return str(error)

    def write_analog(self, analog: AnalogOutputs) -> None:
        """Let analogue outputs be so from now on. Raises LinkError when the servo is gone."""
        self._follow().request_analog(analog.volts)

    def _allowed(self, frame: SetpointFrame) -> SetpointFrame:
        """The frame, without a request for power that was made to the servo before this one.

        Such a request is none to take power away either, from an arm that somebody else has powered since.
        """
        if not frame.power:
            self._power_locked = False
        if not self._power_locked:
            return frame
        return replace(frame, power=bool(self._follow().memory.command.power))

    def _follow(self) -> ServoMailbox:
        """The mailbox of the servo that runs now."""
        segment = self._segment
        if segment is None or not segment.is_current:
            if segment is not None:
                segment.close()
                self._segment = self._mailbox = None
            segment = self._segment = attach_servo_memory(self.arm)
        generation = int(segment.header.generation)
        if self._mailbox is None or generation != self._generation:
            mailbox, self._generation = ServoMailbox(segment.words), generation
            info = mailbox.info
            if (info.robot_name, info.n) != (self.robot_name, self.n):
                self._mailbox = None
                raise LinkMismatch(f"the servo of {self.arm} drives {info.robot_name!r}, not {self.robot_name!r}")
            if self._servos > 0:
                self._power_locked, self._new_until_ns = True, time.monotonic_ns() + NEW_SERVO_NS
            self._servos += 1
            self._mailbox = mailbox
        return self._mailbox


def _name_signals(mailbox: ServoMailbox, names: tuple[str, ...]) -> None:
    mailbox.tell_signals(NO_SIGNALS)  # first: the old numbers must not stand under the new names
    mailbox.name_signals(names)


def _to_wire(mailbox: ServoMailbox) -> RobotState:
    """The state as packets carry it, cut to the width of its fields there: what stands in memory may be spoilt."""
    snapshot, told = mailbox.snapshot(), dict[str, Any]()
    for row in rows_of(RobotState):
        value = getattr(snapshot, row.name)
        if row.count != 1:
            told[row.name] = tuple(value.tolist())
        else:
            told[row.name] = value if row.code == "d" else value & _MASKS.get(row.code, -1)
    if not 0 <= told["event_joint"] < mailbox.info.n:
        told["event_joint"] = NO_JOINT
    return RobotState(**told)


def tell_key(mailbox: ServoMailbox, stream: int, held_ns: int | None) -> None:
    """Let `stream` move the arm only while a key is held; it was at `held_ns`, None when it is not.

    What moves is stopped when nothing has been said of the key for `servo.checks.hold_to_run.PATIENCE_NS`.
    """
    if held_ns is not None:
        mailbox.memory.command.held_ns = held_ns  # first: what begins now must not be judged by what was before
    mailbox.memory.command.held_stream = stream + 1


def _pass_on(mailbox: ServoMailbox, frame: SetpointFrame) -> None:
    mailbox.request_power(frame.power)
    if frame.hold_to_run:
        tell_key(mailbox, frame.stream, frame.t_ns if frame.key_held else None)
    _pass_on_requests(mailbox, frame)
    mailbox.tell_signals(frame.signals)
    mailbox.push_setpoint(frame.stream, frame.seq, frame.t_ns, frame.period_ns, frame.modes, frame.setpoints)


def _pass_on_requests(mailbox: ServoMailbox, frame: SetpointFrame) -> None:
    """Pass on the requests beside setpoints; power may be taken away, but not asked for."""
    if not frame.power:
        mailbox.request_power(False)
    mailbox.request_hand(frame.hand)
    mailbox.request_outputs(frame.outputs, frame.t_ns)
    mailbox.tell_path_waits(frame.t_ns if frame.path_waits else 0)
    if frame.clear_fault:
        mailbox.request_clear()
    if frame.stop:
        mailbox.request_stop()
