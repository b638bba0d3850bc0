"""Execution of operator requests: requests in, replies out; the loop is never kept waiting.

A stop and a power-off are done in the thread that reads them (`Controls.begin`), which waits for no lock, no loop and
no file. Whatever may wait - for the loop, for a law to be tried - is left to other threads, one command at a time; a
second one is refused meanwhile.
"""

from __future__ import annotations

import math
import threading
import traceback
from collections.abc import Callable
from functools import partial
from typing import Any, Final, Protocol, TypeVar

import numpy as np

from qrobot.arrays import Floats
from qrobot.config import Robot
from qrobot.errors import LinkBusy, LinkLost, LinkTimeout, QRobotError
from qrobot.faultcodes import NO_JOINT, FaultCode, explain
from qrobot.hwif.arm_clock import arm_time_ns
from qrobot.hwif.board_memory import BoardSegment
from qrobot.modecodes import Mode
from qrobot.realtime.deadline import Deadline, sleep_between_looks
from qrobot.servo.laws import law_label
from qrobot.servo.laws.law import KP, KV, M0, Law
from qrobot.servo.laws.law_swap import (
    NO_TORQUE,
    NOT_NOW,
    OUT_OF_BOUNDS,
    SwapState,
    ask_for_law,
    ask_for_settings,
    maybe_swap_result,
)
from qrobot.servo.laws.stability import check_gains
from qrobot.servo.laws.trial_process import tried_law
from qrobot.servo.memory.commander_lock import Authority
from qrobot.servo.memory.law_history import LawInForce, settings_text, write_entry
from qrobot.servo.memory.mailbox import ServoMailbox
from qrobot.servo.memory.published_state import FLAG_CALIBRATED, FLAG_ESTOP_OK, FLAG_GUARDED, FLAG_POWERED
from qrobot.servo.memory.servo_memory import describe_law, journal_base
from qrobot.servo.memory.stop_record import Incident
from qrobot.servo.modes import mode_name
from qrobot.servo.operator.board_status import board_status
from qrobot.servo.operator.fence_status import fence_status
from qrobot.servo.operator.force_zero import zero_force
from qrobot.servo.operator.gain_rows import Matrix, changed_gains
from qrobot.servo.operator.messages import (
    Calibrate,
    ChangeCollision,
    ChangeGains,
    ChangeLaw,
    ChangeOverride,
    ChangePayload,
    Clear,
    FencesRequest,
    OperatorRequest,
    PauseRequest,
    PowerOff,
    PowerOn,
    Reply,
    ResumeRequest,
    ServoStatus,
    StatusRequest,
    StopRequest,
    ZeroForce,
    decode_request,
    encode,
)
from qrobot.servo.operator.motion_requests import set_collision, set_payload, set_speed
from qrobot.servo.operator.sockets import OperatorConnection
from qrobot.servo.payload import PayloadJudge
from qrobot.servo.settings import ServoSettings

LOOP_PATIENCE_S: Final = 0.5
GUARD_TRIP: Final = int(FaultCode.GUARD_TRIP)
HANDS: Final = ("relaxed", "open", "closed")  # by COMMAND_HAND
INPUTS: Final = range(1, 6)  # input 0 is the emergency stop's
HANGS: Final = (
    "the servo's loop does not run, as in a law that never comes back; the guardian has taken torque and power. "
    "End the servo of {arm} (SIGTERM, or Ctrl-C of `qrobot up`) and start it again"
)
_POLL_S: Final = 0.002
_READING_S: Final = 0.005  # between two readings of a sensor
_EDGE_TICKS: Final = 2  # then the servo has looked

T = TypeVar("T")


class Controlled(Protocol):
    """Parts of a servo process that operator requests touch."""

    arm: str
    robot: Robot
    settings: ServoSettings
    law: Law
    law_name: str
    board: BoardSegment

    @property
    def mailbox(self) -> ServoMailbox:
        """The servo memory, from the commander's side."""

    @property
    def swap(self) -> SwapState:
        """State of the law swap, through which one is asked for."""

    @property
    def volts(self) -> Floats:
        """Volts at the converter's channels. Shape (8,)."""

    @property
    def force_zero(self) -> Floats:
        """Volts of the force sensor without a load, shape (8,); the loop reads what is written here."""

    @property
    def incident(self) -> Incident | None:
        """Reason for which the servo last left a mode, see `servo.memory.stop_record`."""

    @property
    def page_faults(self) -> int:
        """Page faults of the loop's thread since it began."""

    def say(self, message: str) -> None:
        """Tell people."""


class Controls:
    """Answers one servo's visitors. The authority over the arm goes to the first that needs it, until they leave."""

    def __init__(self, servo: Controlled) -> None:
        self._servo = servo
        self._authority = Authority(servo.arm)
        self._commander: OperatorConnection | None = None
        self._commanding = threading.Lock()  # never waited for
        self._kept_laws = [(servo.law, servo.law_name)]  # the loop may still be in one: none is ever let go
        self._judge = PayloadJudge(servo.robot)
        self._names_told = 0
        self._note_law()
        self._told(), self._told_fences()  # compiles, or loads, what a request must not wait for

    def answer(self, visitor: OperatorConnection, line: bytes) -> bytes:
        """The reply to a request line; whatever is wrong with it becomes a reply too."""
        reply = self.begin(visitor, line)
        return reply if isinstance(reply, bytes) else reply()

    def begin(self, visitor: OperatorConnection, line: bytes) -> bytes | Callable[[], bytes]:
        """Do what must not wait. The reply, or what is left to do for it, which may wait and belongs to another thread.

        To be called from one thread only.
        """
        return self._replying(lambda: self._begin(visitor, line))

    def _begin(self, visitor: OperatorConnection, line: bytes) -> bytes | Callable[[], bytes]:
        mailbox = self._servo.mailbox
        match request := decode_request(line):
            case StatusRequest() | FencesRequest():
                return partial(self._replying, self._told if request.command == "status" else self._told_fences)
            case StopRequest():
                mailbox.request_stop()
                return partial(self._replying, self._told_by_loop)
            case PowerOff():
                mailbox.request_power_off()
                return partial(self._replying, self._told_by_loop)
            case ChangeCollision():
                set_collision(mailbox, request, self._servo.robot, self._servo.say)
                return partial(self._replying, self._told_by_loop)
            case ChangeOverride() | PauseRequest() | ResumeRequest():
                set_speed(mailbox, request, self._servo.say)
                return partial(self._replying, self._told_by_loop)
        self._authorise(visitor)
        if not self._commanding.acquire(blocking=False):
            raise LinkBusy("another command is still being done; only stop, power off and status need not wait for it")
        return partial(self._replying, lambda: self._command(request, visitor.gone))

    def _command(self, request: OperatorRequest, given_up: threading.Event) -> bytes:
        try:
            self._obey(request, given_up)
        finally:
            self._commanding.release()
        return self._told()

    def _replying(self, act: Callable[[], T]) -> T | bytes:
        """Reply with the result of `act`, or with the reason for which it failed."""
        try:
            return act()
        except QRobotError as error:
            return encode(Reply(ok=False, error=str(error)))
        except Exception as error:  # our mistake: it must not take the servo away from under an arm
            self._servo.say(traceback.format_exc())
            return encode(Reply(ok=False, error=f"a mistake of this program, told by the servo: {error!r}"))

    def _told(self) -> bytes:
        return encode(Reply(ok=True, status=self.status()))

    def _told_fences(self) -> bytes:
        servo = self._servo
        return encode(Reply(ok=True, fences=fence_status(servo.settings.fences, servo.mailbox.snapshot().q)))

    def _told_by_loop(self) -> bytes:
        """Status of the servo once its loop has seen the request, or the guardian has taken its place."""
        if not self._guardian_acts:
            self._wait_for_loop()
        return self._told()

    @property
    def _guardian_acts(self) -> bool:
        """The guardian has taken torque and power away, and the servo writes nothing any more."""
        return bool(self._servo.mailbox.memory.guardian.takeover)

    def farewell(self, visitor: OperatorConnection) -> None:
        """Somebody has gone, and their authority with them."""
        if self._commander is visitor:
            self._commander = None
            self._authority.release()

    def status(self) -> ServoStatus:
        """Status of the servo now. Raises LinkError when it died."""
        servo, snapshot = self._servo, self._servo.mailbox.snapshot()
        gains = servo.swap.gains
        mode, fault = (Mode.FAULT, GUARD_TRIP) if self._guardian_acts else (snapshot.mode, snapshot.fault)
        code = fault or snapshot.event
        joint = snapshot.event_joint if code == snapshot.event else NO_JOINT
        return ServoStatus(
            arm=servo.arm,
            robot=servo.robot.name,
            rate_hz=servo.mailbox.info.rate_hz,
            law=servo.law_name,
            law_settings=servo.law.chosen,
            mode=mode_name(mode),
            fault=fault,
            event=snapshot.event,
            event_joint=snapshot.event_joint,
            text=self._text(code, joint),
            powered=bool(snapshot.flags & FLAG_POWERED) and not self._guardian_acts,
            calibrated=bool(snapshot.flags & FLAG_CALIBRATED),
            estop_ok=bool(snapshot.flags & FLAG_ESTOP_OK),
            guarded=bool(snapshot.flags & FLAG_GUARDED),
            commander=self._authority.maybe_holder() or "",
            tick=snapshot.tick,
            late_cycles=snapshot.late_cycles,
            page_faults=servo.page_faults,
            missed_frames=snapshot.missed_frames,
            hand=HANDS[snapshot.hand] if 0 <= snapshot.hand < len(HANDS) else "",
            inputs=tuple(k for k in INPUTS if snapshot.inputs >> k & 1),
            outputs={wire.name: bool(snapshot.outputs & wire.mask) for wire in servo.settings.outputs},
            force=tuple(None if math.isnan(value) else value for value in snapshot.force.tolist()),
            override=snapshot.override,
            paused=snapshot.paused,
            path_waits=servo.mailbox.path_waits(snapshot.t_ns),
            speed_limit=snapshot.speed_limit,
            tool_speed_limit=snapshot.tool_speed_limit,
            payload_mass=snapshot.payload_mass,
            q=_floats(snapshot.q),
            v=_floats(snapshot.v),
            tau=_floats(snapshot.tau),
            kp=_floats(gains[KP]),
            kv=_floats(gains[KV]),
            inertia=_floats(gains[M0]),
            board=board_status(servo.board.memory, lambda: arm_time_ns(servo.board.memory, servo.settings.board_slips)),
        )

    def _text(self, code: int, joint: int) -> str:
        """Meaning of a code, with the value measured if it is the reason for which the servo last left a mode."""
        incident = self._servo.incident
        if incident is not None and incident.code == code:
            return incident.why(self._servo.robot.prismatic)
        return explain(code, joint) if code else ""

    def _authorise(self, visitor: OperatorConnection) -> None:
        if self._commander not in (None, visitor):
            raise LinkBusy(f"{self._servo.arm} is commanded by {self._authority.maybe_holder()}")
        self._authority.take(visitor.label)
        self._commander = visitor

    def _obey(self, request: OperatorRequest, given_up: threading.Event | None = None) -> None:
        match request:
            case PowerOn():
                self._power_on()
            case Clear():
                self._servo.mailbox.request_clear()
                self._clear_by_loop()
            case Calibrate():
                self._calibrate(request)
            case ZeroForce():
                self._zero_force()
            case ChangePayload():
                in_force = set_payload(self._servo.mailbox, request, self._judge, self._servo.say)
                _poll(lambda: in_force() or self._guardian_acts)
            case ChangeLaw() | ChangeGains() if self._servo.settings.position_drives:
                raise QRobotError(f"drives close the position loop of {self._servo.arm}: it has no law and no gains")
            case ChangeLaw():
                self._change_law(request, given_up or threading.Event())
            case ChangeGains():
                self._swap_gains(request)

    def _power_on(self) -> None:
        mailbox = self._servo.mailbox
        snapshot = mailbox.snapshot()
        if snapshot.mode == Mode.FAULT:
            raise QRobotError(f"clear the fault first: {explain(snapshot.fault)}")
        if snapshot.mode == Mode.OFF:  # a request is an edge: the servo has to see the level go down and up
            mailbox.request_power(False)
            self._wait_for_loop()
            mailbox.request_power(True)
            self._wait_for_loop()

    def _calibrate(self, request: Calibrate) -> None:
        mailbox = self._servo.mailbox
        snapshot = mailbox.snapshot()
        contradicted = snapshot.mode == Mode.OFF and snapshot.event == FaultCode.CAL_MISMATCH
        if snapshot.mode != Mode.UNCALIBRATED and not contradicted:
            mode = mode_name(snapshot.mode)
            raise QRobotError(f"not in mode {mode}: an arm calibrates under power, while it is UNCALIBRATED")
        mailbox.request_calibration(request.indexes)
        self._wait_for_loop()

    def _wait_for_loop(self) -> None:
        """Wait until the loop has seen the request, so that the reply tells its effect."""
        seen = self._seen_by_loop()
        _poll(lambda: seen() or self._guardian_acts)

    def _clear_by_loop(self) -> None:
        """Likewise, beside a guardian too: it gives the board back to a loop that runs, and to no other."""
        try:
            _poll(self._seen_by_loop())
        except LinkTimeout as error:
            if self._guardian_acts:
                raise LinkTimeout(HANGS.format(arm=self._servo.arm)) from error
            raise

    def _seen_by_loop(self) -> Callable[[], bool]:
        """Tells whether the loop has seen what has been requested until now."""
        mailbox = self._servo.mailbox
        tick = mailbox.snapshot().tick
        return lambda: bool(mailbox.snapshot().tick >= tick + _EDGE_TICKS)

    def _change_law(self, request: ChangeLaw, given_up: threading.Event) -> None:
        """Try the law beside the loop, which goes on, then ask for the swap, unless whoever wanted it has gone."""
        servo = self._servo
        if servo.law.compliant and request.name == servo.law_name:
            self._change_settings(request)
            return
        mode = servo.mailbox.snapshot().mode
        if mode not in (Mode.OFF, Mode.HOLDING):  # before the law is loaded: that may take seconds
            raise _not_now(mode)
        law = tried_law(request.name, servo.robot, request.settings, servo.mailbox.info.period_ns, given_up)
        if given_up.is_set():
            raise LinkLost("whoever asked for the law has gone: it has not been taken")
        self._swap(law, request.name, np.array(servo.swap.gains))

    def _change_settings(self, request: ChangeLaw) -> None:
        """Give a compliant law other settings, in any mode; those left out stay."""
        servo = self._servo
        law = servo.law.with_settings(request.settings)
        check_gains(servo.robot, servo.settings, servo.law_name, np.array(servo.swap.gains), law.chosen)
        ask_for_settings(servo.swap, law.values)
        _wait_for_swap(servo.swap)
        servo.law = law
        self._kept_laws.append((law, servo.law_name))
        self._note_law()
        servo.say(f"law {servo.law_name}: {settings_text(law.chosen)}")

    def _zero_force(self) -> None:
        zero = zero_force(self._servo, partial(sleep_between_looks, _READING_S))
        self._wait_for_loop()
        listed = ", ".join(f"channel {channel} {volts:.4g} V" for channel, volts in zero.items())
        self._servo.say(f"force sensor zeroed: {listed}")

    def _swap_gains(self, request: ChangeGains) -> None:
        servo = self._servo
        gains = changed_gains(servo.robot.control, np.array(servo.swap.gains), request)
        self._swap(servo.law, servo.law_name, gains)

    def _swap(self, law: Law, name: str, gains: Matrix) -> None:
        servo = self._servo
        mode = servo.mailbox.snapshot().mode
        if mode not in (Mode.OFF, Mode.HOLDING):  # before the gains are judged: that takes a moment
            raise _not_now(mode)
        check_gains(servo.robot, servo.settings, name, gains, law.chosen)
        self._kept_laws.append((law, name))
        ask_for_law(servo.swap, law, gains)
        result = _wait_for_swap(servo.swap)
        if result == NOT_NOW:
            raise _not_now(servo.mailbox.snapshot().mode)
        if result == NO_TORQUE:
            raise QRobotError(f"law {name} gives no finite torque where the arm stands: it has not been taken")
        if result == OUT_OF_BOUNDS:
            raise QRobotError(f"law {name} writes past the end of an array where the arm stands: it has not been taken")
        servo.law, servo.law_name = law, name
        describe_law(servo.mailbox.words, law_label(name))
        self._note_law()
        servo.say(f"law {name}, gains Kp {_listed(gains[KP])} Kv {_listed(gains[KV])}")

    def note_fallback(self) -> None:
        """Tell people and readers once the servo has gone back to the law before, because the one in force failed.

        Readers also hear of new names of a program's numbers.
        """
        told = int(self._servo.mailbox.memory.command.names_told)
        if told != self._names_told and not self._commanding.locked():
            self._names_told = told
            self._note_law()
        servo, address = self._servo, int(self._servo.swap.law_at)
        if address == servo.law.address or self._commanding.locked():
            return
        servo.law, servo.law_name = next(kept for kept in reversed(self._kept_laws) if kept[0].address == address)
        describe_law(servo.mailbox.words, law_label(servo.law_name))
        self._note_law()
        servo.say(f"law {servo.law_name} is in force again: the one after it has failed")

    def _note_law(self) -> None:
        """Tell whoever keeps a log what is in force since the last swap, or from the start."""
        servo, swap = self._servo, self._servo.swap
        kp, kv, inertia = (_floats(swap.gains[row]) for row in (KP, KV, M0))
        t_ns, tick, label = int(swap.done_t_ns), int(swap.done_tick), law_label(servo.law_name)
        settings = settings_text(servo.law.chosen)
        signals, program = " ".join(servo.law.signals), " ".join(servo.mailbox.signal_names())
        entry = LawInForce(t_ns, tick, label, settings, kp, kv, inertia, signals, program)
        write_entry(servo.mailbox.words, journal_base(servo.mailbox.info.n), entry)


def _not_now(mode: int) -> QRobotError:
    return QRobotError(f"not in mode {mode_name(mode)}: laws and gains change while the arm holds, or without power")


def _wait_for_swap(swap: SwapState) -> int | None:
    _poll(lambda: maybe_swap_result(swap) is not None)
    return maybe_swap_result(swap)


def _poll(condition: Callable[[], bool]) -> None:
    """Wait for the loop. Raises LinkTimeout when it does not run."""
    patience = Deadline(LOOP_PATIENCE_S)
    while not condition():
        if patience.passed:
            raise LinkTimeout("the servo's loop does not run: if the arm is not at rest, use the emergency stop")
        sleep_between_looks(_POLL_S)


def _floats(vector: Any) -> tuple[float, ...]:
    return tuple(np.asarray(vector).tolist())


def _listed(vector: Any) -> str:
    return " ".join(f"{value:g}" for value in np.asarray(vector).tolist())
