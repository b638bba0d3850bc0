"""Execution of operator requests: requests in, replies out; the loop is never kept waiting.

A stop and a power-off are done in the thread that reads them (`Controls.begin`), which waits for no lock, no loop and
no file. Whatever may wait - for the loop, for a law to be tried - is left to other threads, one command at a time; a
second one is refused meanwhile.
"""

from __future__ import annotations

import threading
import traceback
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from typing import Final, TypeVar

from qrobot.errors import LinkBusy, LinkError, LinkLost, LinkTimeout, QRobotError
from qrobot.faultcodes import explain
from qrobot.modecodes import Mode, mode_name
from qrobot.model.payload_judge import PayloadJudge
from qrobot.realtime.deadline import sleep_between_looks
from qrobot.servo.calibration.state import IMPLAUSIBLE
from qrobot.servo.memory.commander_lock import Authority
from qrobot.servo.operator.controlled import Controlled
from qrobot.servo.operator.fence_status import fence_status
from qrobot.servo.operator.force_zero import zero_force
from qrobot.servo.operator.law_changes import LawChanges
from qrobot.servo.operator.loop_wait import await_loop, seen_by_loop
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
from qrobot.servo.operator.motion_requests import CARRIED_S, set_collision, set_payload, set_speed
from qrobot.servo.operator.sockets import OperatorConnection
from qrobot.servo.operator.status import HANGS, guardian_acts, servo_status

_READING_S: Final = 0.005  # between two readings of a sensor

T = TypeVar("T")


class Controls:
    """Answers one servo's visitors. The authority over the arm goes to the first that needs it, until they leave."""

    def __init__(self, servo: Controlled) -> None:
        self._servo = servo
        self._authority = Authority(servo.arm)
        self._commander: OperatorConnection | None = None
        self._commanding = threading.Lock()  # never waited for
        self._laws = LawChanges(servo)
        self._judge = PayloadJudge(servo.robot)
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
                told = set_collision(mailbox, request, self._servo.robot, not self._servo.settings.position_drives)
                return partial(self._replying, lambda: self._told_after(told))
            case ChangeOverride() | PauseRequest() | ResumeRequest():
                told = set_speed(mailbox, request)
                return partial(self._replying, lambda: self._told_after(told))
        self._authorise(visitor)
        return partial(self._replying, lambda: self._command(request, visitor.gone))

    def _command(self, request: OperatorRequest, given_up: threading.Event) -> bytes:
        if not self._commanding.acquire(blocking=False):
            raise LinkBusy("another command is still being done; only stop, power off and status need not wait for it")
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

    def _told_after(self, line: str) -> bytes:
        self._servo.say(line)
        return self._told_by_loop()

    def _told_by_loop(self) -> bytes:
        """Status of the servo once its loop has seen the request, or the guardian has taken its place."""
        if not self._guardian_acts:
            self._wait_for_loop()
        return self._told()

    @property
    def _guardian_acts(self) -> bool:
        """See `status.guardian_acts`."""
        return guardian_acts(self._servo.mailbox)

    def farewell(self, visitor: OperatorConnection) -> None:
        """Somebody has gone, and their authority with them."""
        if self._commander is visitor:
            self._commander = None
            self._authority.release()

    def status(self) -> ServoStatus:
        """Status of the servo now. Raises LinkError when it died."""
        return servo_status(self._servo, self._authority.maybe_holder() or "")

    def note_fallback(self) -> None:
        """Tell people and readers of a law that failed, unless one is being changed."""
        self._laws.note_fallback()

    def stop_abandoned_calibration(self) -> None:
        """Stop a calibration whose commander was killed: nobody follows what the joints do any more."""
        mailbox = self._servo.mailbox
        with suppress(LinkError):  # the loop was interrupted while it wrote: the next look will do
            if mailbox.snapshot().mode == Mode.CALIBRATING and self._authority.holder_was_killed:
                self._servo.say("the calibration is stopped: the program that followed it was killed")
                mailbox.request_stop()

    def _authorise(self, visitor: OperatorConnection) -> None:
        if self._commander not in (None, visitor):
            raise LinkBusy(f"{self._servo.arm} is commanded by {self._authority.maybe_holder()}")
        self._authority.take(visitor.label)
        self._commander = visitor

    def _obey(self, request: OperatorRequest, given_up: threading.Event | None = None) -> None:
        match request:
            case PowerOn():
                self._power_on(given_up or threading.Event())
            case Clear():
                self._servo.mailbox.request_clear()
                self._clear_by_loop()
                self.note_fallback()  # a law that failed is not in force any more, which the answer tells
            case Calibrate():
                self._calibrate(request)
            case ZeroForce():
                self._zero_force()
            case ChangePayload():
                in_force = set_payload(self._servo.mailbox, request, self._judge, self._servo.say)
                await_loop(lambda: in_force() or self._guardian_acts, CARRIED_S)
            case ChangeLaw() | ChangeGains() if self._servo.settings.position_drives:
                raise QRobotError(f"drives close the position loop of {self._servo.arm}: it has no law and no gains")
            case ChangeLaw():
                self._laws.change_law(request, given_up or threading.Event())
            case ChangeGains():
                self._laws.change_gains(request)

    def _power_on(self, given_up: threading.Event) -> None:
        mailbox = self._servo.mailbox
        snapshot = mailbox.snapshot()
        if snapshot.mode == Mode.FAULT:
            raise QRobotError(f"clear the fault first: {explain(snapshot.fault)}")
        if snapshot.mode == Mode.OFF:  # a cycle with the level down ends what was told of an earlier request
            halts = mailbox.halts
            mailbox.request_power(False)
            self._wait_for_loop()
            if given_up.is_set():
                raise LinkLost("whoever asked for arm power has gone: it stays off")
            if mailbox.halts == halts:
                mailbox.request_power(True)
            if mailbox.halts != halts:  # behind the request as well: a cycle may have seen one just before it
                mailbox.request_power(False)
                raise QRobotError("no arm power: somebody has asked for a stop, or for no power, meanwhile")
            try:
                self._wait_for_loop()
            except LinkError:  # a loop that goes on later must not release brakes after it was told that it cannot
                mailbox.request_power(False)
                raise

    def _calibrate(self, request: Calibrate) -> None:
        mailbox = self._servo.mailbox
        halts = mailbox.halts
        snapshot = mailbox.snapshot()
        contradicted = snapshot.mode == Mode.OFF and snapshot.pots_verdict == IMPLAUSIBLE
        if snapshot.mode != Mode.UNCALIBRATED and not contradicted:
            mode = mode_name(snapshot.mode)
            raise QRobotError(f"not in mode {mode}: an arm calibrates under power, while it is UNCALIBRATED")
        mailbox.request_calibration(request.indexes)
        if mailbox.halts != halts:
            mailbox.request_stop()
            raise QRobotError("no calibration: somebody has asked for a stop, or for no power, meanwhile")
        self._wait_for_loop()

    def _wait_for_loop(self) -> None:
        """Wait until the loop has seen the request, so that the reply tells its effect."""
        seen = seen_by_loop(self._servo.mailbox)
        await_loop(lambda: seen() or self._guardian_acts)

    def _clear_by_loop(self) -> None:
        """Likewise, beside a guardian too: it gives the board back to a loop that runs, and to no other."""
        try:
            await_loop(seen_by_loop(self._servo.mailbox))
        except LinkTimeout as error:
            if self._guardian_acts:
                raise LinkTimeout(HANGS.format(arm=self._servo.arm)) from error
            raise

    def _zero_force(self) -> None:
        zero = zero_force(self._servo, partial(sleep_between_looks, _READING_S))
        self._wait_for_loop()
        listed = ", ".join(f"channel {channel} {volts:.4g} V" for channel, volts in zero.items())
        self._servo.say(f"force sensor zeroed: {listed}")
