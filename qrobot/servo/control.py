"""What the control interface does to a servo: requests in, replies out; the loop is never kept waiting."""

from __future__ import annotations

import math
import time
import traceback
from collections.abc import Callable
from typing import Any, Final, Protocol

import numpy as np
from numpy.typing import NDArray

from qrobot.config import Robot
from qrobot.errors import ConfigError, LinkBusy, LinkTimeout, QRobotError
from qrobot.faultcodes import FaultCode, explain
from qrobot.hwif.arm_clock import arm_time_ns
from qrobot.realtime.segment import Segment
from qrobot.servo.authority import Authority
from qrobot.servo.board_status import board_status
from qrobot.servo.control_messages import (
    ANYBODY,
    Calibrate,
    ChangeGains,
    ChangeLaw,
    Clear,
    PowerOff,
    PowerOn,
    Reply,
    Request,
    ServoStatus,
    Stop,
    decode_request,
    encode,
)
from qrobot.servo.control_socket import Visitor
from qrobot.servo.incident import Incident
from qrobot.servo.journal import LawInForce, settings_text, write_entry
from qrobot.servo.law import KP, KV, M0, Law
from qrobot.servo.law_trial import prove
from qrobot.servo.laws import find_law, law_label
from qrobot.servo.mailbox import (
    FLAG_CALIBRATED,
    FLAG_ESTOP_OK,
    FLAG_GUARDED,
    FLAG_POWERED,
    ServoMailbox,
    describe_law,
    journal_base,
)
from qrobot.servo.modes import Mode, mode_name
from qrobot.servo.settings import ServoSettings
from qrobot.servo.stability import check_gains
from qrobot.servo.swap import DONE_T_NS, DONE_TICK, NO_TORQUE, NOT_NOW, SwapState, ask_for_law, maybe_swap_result

MOST_GAIN: Final = 4.0  # times the robot file's, without force
LEAST_GAIN: Final = {KP: 0.0, KV: 0.25, M0: 0.0}  # the same: a soft arm is wanted at times, an undamped one never
LOOP_PATIENCE_S: Final = 0.5
HANDS: Final = ("relaxed", "open", "closed")  # by COMMAND_HAND
INPUTS: Final = range(1, 6)  # input 0 is the emergency stop's
_POLL_S: Final = 0.002
_EDGE_TICKS: Final = 2  # then the servo has looked

Matrix = NDArray[np.float64]


class Controlled(Protocol):
    """What of a servo process the control interface touches."""

    arm: str
    robot: Robot
    settings: ServoSettings
    law: Law
    law_name: str
    board: Segment

    @property
    def mailbox(self) -> ServoMailbox:
        """The servo memory, from the commander's side."""

    @property
    def swap(self) -> SwapState:
        """Where a swap is asked for."""

    @property
    def incident(self) -> Incident | None:
        """Why the servo last left a mode, see `servo.incident`."""

    def say(self, message: str) -> None:
        """Tell people."""


class Controls:
    """Answers one servo's visitors. The authority over the arm goes to the first that needs it, until they leave."""

    def __init__(self, servo: Controlled) -> None:
        self._servo = servo
        self._authority = Authority(servo.arm)
        self._commander: Visitor | None = None
        self._kept_laws = [servo.law]  # the loop may still be in one: none is ever let go
        self._note_law()

    def answer(self, visitor: Visitor, line: bytes) -> bytes:
        """The reply to a request line; whatever is wrong with it becomes a reply too."""
        try:
            request = decode_request(line)
            if not isinstance(request, ANYBODY):
                self._authorise(visitor)
            self._obey(request)
            return encode(Reply(ok=True, status=self.status()))
        except QRobotError as error:
            return encode(Reply(ok=False, error=str(error)))
        except Exception as error:  # our mistake: it must not take the servo away from under an arm
            self._servo.say(traceback.format_exc())
            return encode(Reply(ok=False, error=f"a mistake of this program, told by the servo: {error!r}"))

    def farewell(self, visitor: Visitor) -> None:
        """Somebody has gone, and their authority with them."""
        if self._commander is visitor:
            self._commander = None
            self._authority.release()

    def status(self) -> ServoStatus:
        """How the servo is now. Raises LinkError when it died."""
        servo, snapshot = self._servo, self._servo.mailbox.snapshot()
        gains = servo.swap.gains
        code = snapshot.fault or snapshot.event
        return ServoStatus(
            arm=servo.arm,
            robot=servo.robot.name,
            rate_hz=servo.mailbox.info.rate_hz,
            law=servo.law_name,
            law_settings=servo.law.chosen,
            mode=mode_name(snapshot.mode),
            fault=snapshot.fault,
            event=snapshot.event,
            event_joint=snapshot.joint,
            text=self._text(code),
            powered=bool(snapshot.flags & FLAG_POWERED),
            calibrated=bool(snapshot.flags & FLAG_CALIBRATED),
            estop_ok=bool(snapshot.flags & FLAG_ESTOP_OK),
            guarded=bool(snapshot.flags & FLAG_GUARDED),
            commander=self._authority.maybe_holder() or "",
            tick=snapshot.tick,
            late_cycles=snapshot.late_cycles,
            missed_frames=snapshot.missed_frames,
            hand=HANDS[snapshot.hand] if 0 <= snapshot.hand < len(HANDS) else "",
            inputs=tuple(k for k in INPUTS if snapshot.inputs >> k & 1),
            outputs={wire.name: bool(snapshot.outputs & wire.mask) for wire in servo.settings.outputs},
            q=_floats(snapshot.q),
            v=_floats(snapshot.v),
            tau=_floats(snapshot.tau),
            kp=_floats(gains[KP]),
            kv=_floats(gains[KV]),
            inertia=_floats(gains[M0]),
            board=board_status(servo.board.words, lambda: arm_time_ns(servo.board.words, servo.settings.board_slips)),
        )

    def _text(self, code: int) -> str:
        """What a code means, with what was measured when it is why the servo last left a mode."""
        incident = self._servo.incident
        if incident is not None and incident.code == code:
            return incident.why(self._servo.robot.prismatic)
        return explain(code) if code else ""

    def _authorise(self, visitor: Visitor) -> None:
        if self._commander not in (None, visitor):
            raise LinkBusy(f"{self._servo.arm} is commanded by {self._authority.maybe_holder()}")
        self._authority.take(visitor.label)
        self._commander = visitor

    def _obey(self, request: Request) -> None:
        mailbox = self._servo.mailbox
        match request:
            case PowerOn():
                self._power_on()
            case PowerOff():
                mailbox.request_power_off()
                self._wait_for_loop()
            case Stop():
                mailbox.request_stop()
                self._wait_for_loop()
            case Clear():
                mailbox.request_clear()
                self._wait_for_loop()
            case Calibrate():
                self._calibrate(request)
            case ChangeLaw() | ChangeGains() if self._servo.settings.position_drives:
                raise QRobotError(f"drives close the position loop of {self._servo.arm}: it has no law and no gains")
            case ChangeLaw():
                self._change_law(request)
            case ChangeGains():
                self._swap(self._servo.law, self._servo.law_name, self._gains(request))

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
        """Until the loop has seen what was requested, so that the reply tells what it did."""
        mailbox = self._servo.mailbox
        tick = mailbox.snapshot().tick
        _poll(lambda: mailbox.snapshot().tick >= tick + _EDGE_TICKS)

    def _change_law(self, request: ChangeLaw) -> None:
        """Load and try the law beside the loop, which goes on, then ask for the swap."""
        servo = self._servo
        mode = servo.mailbox.snapshot().mode
        if mode not in (Mode.OFF, Mode.HOLDING):  # before the law is loaded: that may take seconds
            raise _not_now(mode)
        law = find_law(request.name, servo.robot, request.settings)
        prove(law, request.name, servo.robot, servo.mailbox.info.period_ns)
        self._swap(law, request.name, np.array(servo.swap.gains))

    def _gains(self, request: ChangeGains) -> Matrix:
        control, gains = self._servo.robot.control, np.array(self._servo.swap.gains)
        rows = ((KP, "kp", request.kp, control.kp), (KV, "kv", request.kv, control.kv))
        for row, name, wanted, usual in (*rows, (M0, "inertia", request.inertia, control.inertia)):
            if wanted is not None:
                least, most = (0.0, math.inf) if request.force else (LEAST_GAIN[row], MOST_GAIN)
                gains[row] = _checked(name, wanted, usual, least, most)
        return gains

    def _swap(self, law: Law, name: str, gains: Matrix) -> None:
        servo = self._servo
        mode = servo.mailbox.snapshot().mode
        if mode not in (Mode.OFF, Mode.HOLDING):  # before the gains are judged: that takes a moment
            raise _not_now(mode)
        check_gains(servo.robot, servo.settings, name, gains)
        self._kept_laws.append(law)
        ask_for_law(servo.swap, law, gains)
        result = _wait_for_swap(servo.swap)
        if result == NOT_NOW:
            raise _not_now(servo.mailbox.snapshot().mode)
        if result == NO_TORQUE:
            raise QRobotError(f"law {name} gives no finite torque where the arm stands: it has not been taken")
        servo.law, servo.law_name = law, name
        describe_law(servo.mailbox.words, law_label(name))
        self._note_law()
        servo.say(f"law {name}, gains Kp {_listed(gains[KP])} Kv {_listed(gains[KV])}")

    def _note_law(self) -> None:
        """Tell whoever keeps a log what is in force since the last swap, or from the start."""
        servo, swap = self._servo, self._servo.swap
        kp, kv, inertia = (_floats(swap.gains[row]) for row in (KP, KV, M0))
        t_ns, tick, label = int(swap.i[DONE_T_NS]), int(swap.i[DONE_TICK]), law_label(servo.law_name)
        entry = LawInForce(t_ns, tick, label, settings_text(servo.law.chosen), kp, kv, inertia)
        write_entry(servo.mailbox.words, journal_base(servo.mailbox.info.n), entry)


def _not_now(mode: int) -> QRobotError:
    return QRobotError(f"not in mode {mode_name(mode)}: laws and gains change while the arm holds, or without power")


def _wait_for_swap(swap: SwapState) -> int | None:
    _poll(lambda: maybe_swap_result(swap) is not None)
    return maybe_swap_result(swap)


def _poll(condition: Callable[[], bool]) -> None:
    """Wait for the loop. Raises LinkTimeout when it does not run."""
    until = time.monotonic() + LOOP_PATIENCE_S
    while not condition():
        if time.monotonic() > until:
            raise LinkTimeout("the servo's loop does not run")
        time.sleep(_POLL_S)


def _checked(name: str, wanted: tuple[float, ...], usual: Any, least: float, most: float) -> Matrix:
    if len(wanted) != usual.size:
        raise ConfigError(f"{name}: {len(wanted)} numbers for {usual.size} joints")
    for j, (value, file) in enumerate(zip(wanted, usual.tolist(), strict=True)):
        if not least * file <= value <= most * file:
            beyond = f"more than {most:g}" if value > most * file else f"less than {least:g}"
            raise ConfigError(
                f"{name} of joint {j + 1}: {value:g} is {beyond} times the robot file's {file:g}; if meant, force it"
            )
    return np.array(wanted)


def _floats(vector: Any) -> tuple[float, ...]:
    return tuple(np.asarray(vector).tolist())


def _listed(vector: Any) -> str:
    return " ".join(f"{value:g}" for value in np.asarray(vector).tolist())
