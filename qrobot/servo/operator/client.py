"""The control interface from a program: `with ServoClient("puma560") as servo: servo.power_on()`."""

from __future__ import annotations

import socket
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from math import inf
from types import TracebackType
from typing import Final

from qrobot.errors import LinkError, LinkLost, LinkTimeout, QRobotError
from qrobot.realtime.deadline import Deadline, sleep_between_looks
from qrobot.realtime.runtime_folder import runtime_path
from qrobot.servo.operator.messages import (
    MAX_LINE_BYTES,
    Calibrate,
    ChangeCollision,
    ChangeGains,
    ChangeLaw,
    ChangeOverride,
    ChangePayload,
    Clear,
    FencesRequest,
    FenceStatus,
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
    decode_reply,
    encode,
    make_request,
)
from qrobot.servo.operator.sockets import arms_that_run, connect_to_servo

TIMEOUT_S: Final = 30.0
AT_ONCE_S: Final = 6.0  # [A] with an answer to what a servo does whatever else it is asked: stop, power-off, status
COMPILE_PATIENCE_S: Final = 300.0  # with a law that has to be compiled, on a busy machine
POWER_PATIENCE_S: Final = 6.0
STOP_PATIENCE_S: Final = 6.0
POLL_S: Final = 0.02
RESUMED_S: Final = 0.5  # [A] twice as long as a servo tells of a pause that ends
_OTHERS: Final = (
    "the servo of {arm} obeys the account that serves it, and root: stop the arm by its program, by a pendant of your"
    " own, or by its emergency stop"
)
POWERED_MODES: Final = ("HOLDING", "UNCALIBRATED", "CALIBRATING", "TRACKING")


def _nobody(arm: str) -> str:
    """Sentence about an arm without a servo, which names those that run."""
    told = f"no servo of {arm} runs here: start it with `qrobot up` or `qrobot servo` (looked in {runtime_path()})"
    if not (others := arms_that_run()):
        return told
    return f"{told}; servos of {', '.join(others)} run: --arm chooses one, of the file that --deployment names"


def _silence(arm: str) -> str:
    """Sentence about a servo that hangs, with what its guardian has done meanwhile."""
    # here, for its layout rests on kernels: half a second
    from qrobot.servo.memory.servo_memory import TAKEN, attach_servo_memory

    told = f"the servo of {arm} does not answer"
    with suppress(LinkError), attach_servo_memory(arm) as memory:
        if memory.front.guardian.takeover == TAKEN:
            return f"{told}; its guardian has taken torque and power away"
    return f"{told}: press the emergency stop if the arm moves"


class ServoClient:
    """A connection to the servo of one arm, on this machine.

    The first command that moves or changes something takes the authority over the arm, and the connection keeps it
    until it is closed; to look, to stop and to take power away needs none. Arm power stays as it is when the
    connection ends. After a request that was broken off, by LinkTimeout or KeyboardInterrupt, the next one is made by
    a new connection: whatever is still said to the one before is never heard. Where that fails, the next one tries it.

    Args:
        arm: instance name of the deployment.
        timeout_s: patience with one reply.

    Raises:
        LinkError: no servo of that arm runs here; LinkTimeout: it takes no connection any more. Every method too, and
            LinkTimeout, LinkLost when it does not answer; QRobotError with the servo's own words when it refuses;
            ConfigError when no such request can be made.
    """

    def __init__(self, arm: str, timeout_s: float = TIMEOUT_S) -> None:
        self.arm = arm
        self._patience_s = timeout_s
        self._connect()

    def status(self) -> ServoStatus:
        """Status of the servo."""
        return self._ask(StatusRequest(), AT_ONCE_S)

    def fences(self) -> tuple[FenceStatus, ...]:
        """Fences that the servo guards, and how far off each is; none at all for an arm without fences."""
        return self._reply(FencesRequest(), AT_ONCE_S).fences or ()

    def power_on(self, patience_s: float = POWER_PATIENCE_S) -> ServoStatus:
        """Ask for arm power and wait until the arm is held. Raises QRobotError with what prevents it."""
        self._ask(PowerOn())
        status = self._wait(lambda s: s.mode in POWERED_MODES or _refused(s), patience_s)
        if status.mode not in POWERED_MODES:
            raise QRobotError(f"no arm power: {status.text or f'the servo stays in {status.mode}'}")
        return status

    def power_off(self) -> ServoStatus:
        """Stop the arm, take power away, and wait for it. Raises LinkTimeout when it keeps power."""
        self._ask(PowerOff(), AT_ONCE_S)
        return self._insist(("OFF", "FAULT"))

    def stop(self) -> ServoStatus:
        """Stop the arm on its path, and wait until it holds. Raises LinkTimeout when it goes on."""
        self._ask(StopRequest(), AT_ONCE_S)
        return self._insist(("OFF", "UNCALIBRATED", "HOLDING", "FAULT"))

    def change_override(self, factor: float) -> ServoStatus:
        """Let motions go at `factor` times their programmed speed, 0 to 1."""
        return self._ask(make_request(ChangeOverride, factor=factor))

    def change_payload(
        self, mass: float, centre: Sequence[float] = (0.0, 0.0, 0.0), inertia: Sequence[float] = (0.0,) * 6
    ) -> ServoStatus:
        """Reckon with a payload of `mass` kg; it is in force on return. See `wire.packets.Payload`.

        Raises QRobotError where the arm cannot carry it.
        """
        return self._ask(make_request(ChangePayload, mass=mass, centre=tuple(centre), inertia=tuple(inertia)))

    def pause(self) -> ServoStatus:
        """Let motions stand still on their path; the status does not wait until they do."""
        return self._ask(PauseRequest())

    def resume(self) -> ServoStatus:
        """Let motions that were paused go on, and an arm that has left its path go back to it.

        A program hears of it as of the end of a pause; while no setpoints are followed the servo tells of a short one.
        The status waits for its end; it tells a pause that somebody else has asked for meanwhile.
        """
        self._ask(ResumeRequest())
        return self._wait(lambda status: not status.paused, RESUMED_S)

    def clear(self) -> ServoStatus:
        """Leave FAULT for OFF. Raises QRobotError while its cause persists."""
        if self._ask(Clear()).mode == "FAULT":
            sleep_between_looks(10 * POLL_S)  # the servo itself tries for a tenth of a second
        status = self.status()
        if status.mode == "FAULT":
            raise QRobotError(f"the fault stays: {status.text}")
        return status

    def calibrate(self, indexes: int = 0) -> ServoStatus:
        """Begin a calibration; `status` tells its mode, `qrobot calibrate` follows it to the end.

        Raises QRobotError with what prevents it.
        """
        status = self._ask(make_request(Calibrate, indexes=indexes))
        if status.mode == "UNCALIBRATED":
            raise QRobotError(f"no calibration: {status.text or 'it has ended already'}")
        return status

    def zero_force(self) -> ServoStatus:
        """Count what the force sensor shows now as no load. Raises QRobotError unless the arm is at rest."""
        return self._ask(ZeroForce())

    def change_law(self, name: str, settings: Mapping[str, float] | None = None) -> ServoStatus:
        """Swap the control law, holding or without power; its `settings` that are left out have their default.

        Of a law in a file, give the whole path: the servo may run in another folder.
        """
        patience_s, self._patience_s = self._patience_s, COMPILE_PATIENCE_S
        try:
            return self._ask(make_request(ChangeLaw, name=name, settings=dict(settings or {})))
        finally:
            self._patience_s = patience_s

    def change_collision(self, thresholds: Sequence[float] = (), reaction: str = "stop") -> ServoStatus:
        """Tell collisions sooner, N m (N) of each joint, and choose what follows: "stop" or "comply".

        Needs no authority, so a program may say it of the arm that it commands. Without thresholds those of the robot
        file count. Raises ConfigError or QRobotError for what cannot be.
        """
        return self._ask(make_request(ChangeCollision, thresholds=tuple(thresholds), reaction=reaction))

    def change_gains(
        self,
        kp: Sequence[float] | None = None,
        kv: Sequence[float] | None = None,
        inertia: Sequence[float] | None = None,
        force: bool = False,
    ) -> ServoStatus:
        """Change gains, holding or without power; what is left out stays. Shapes (n,), see `ChangeGains`."""
        rows = {"kp": _maybe(kp), "kv": _maybe(kv), "inertia": _maybe(inertia)}
        return self._ask(make_request(ChangeGains, **rows, force=force))

    def watch(self, seconds: float = float("inf")) -> Iterator[ServoStatus]:
        """The status now, and again whenever mode, fault, event, law or commander change."""
        end, last = Deadline(seconds), None
        while not end.passed:
            status = self.status()
            seen = (status.mode, status.fault, status.event, status.law, status.commander)
            if seen != last:
                last = seen
                yield status
            sleep_between_looks(POLL_S)

    def close(self) -> None:
        """End the connection, and with it the authority it may have."""
        self._socket.close()

    def __enter__(self) -> ServoClient:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _connect(self) -> None:
        self._broken_off, self._unread = True, b""  # until it is connected
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self._socket.settimeout(self._patience_s)
        try:
            self._await_room()
            self._broken_off = False
        except PermissionError:
            raise LinkError(_OTHERS.format(arm=self.arm)) from None
        except OSError:
            raise LinkError(_nobody(self.arm)) from None
        finally:
            if self._broken_off:
                self._socket.close()

    def _await_room(self) -> None:
        """Connect, once the servo has let in those who came before.

        Raises LinkTimeout for one that lets in nobody, OSError where none listens.
        """
        patience = Deadline(min(self._patience_s, AT_ONCE_S))
        while True:
            try:
                return connect_to_servo(self.arm, self._socket)
            except BlockingIOError:  # as many wait as the kernel keeps for it
                if patience.passed:
                    raise LinkTimeout(_silence(self.arm)) from None
            sleep_between_looks(POLL_S)

    def _ask(self, request: OperatorRequest, most_s: float = inf) -> ServoStatus:
        reply = self._reply(request, most_s)
        if reply.status is None:
            raise QRobotError(f"the servo of {self.arm} tells no status")
        return reply.status

    def _reply(self, request: OperatorRequest, most_s: float = inf) -> Reply:
        """Reply to a request that was done, within the client's patience and `most_s`.

        Raises QRobotError with the servo's words for one that was refused.
        """
        reply = decode_reply(self._exchange(encode(request), min(self._patience_s, most_s)))
        if not reply.ok:
            raise QRobotError(reply.error)
        return reply

    def _exchange(self, request: bytes, patience_s: float) -> bytes:
        if self._broken_off:
            self._socket.close()
            self._connect()
        self._broken_off = True
        try:
            self._socket.settimeout(patience_s)
            self._socket.sendall(request)
            line = self._line()
        except TimeoutError:
            raise LinkTimeout(_silence(self.arm)) from None
        except OSError:
            self._broken_off = False  # lost for good
            raise LinkLost(f"the servo of {self.arm} has gone") from None
        except LinkLost:
            self._broken_off = False
            raise
        self._broken_off = False
        return line

    def _line(self) -> bytes:
        while b"\n" not in self._unread:
            data = self._socket.recv(MAX_LINE_BYTES)
            if not data:
                raise LinkLost(f"the servo of {self.arm} has hung up")
            self._unread += data
        line, self._unread = self._unread.split(b"\n", 1)
        return line

    def _wait(self, condition: Callable[[ServoStatus], bool], patience_s: float) -> ServoStatus:
        patience = Deadline(patience_s)
        while True:
            last = patience.passed
            if condition(status := self.status()) or last:
                return status
            sleep_between_looks(POLL_S)

    def _insist(self, modes: tuple[str, ...]) -> ServoStatus:
        status = self._wait(lambda s: s.mode in modes, STOP_PATIENCE_S)
        if status.mode not in modes:
            raise LinkTimeout(f"{self.arm} is still {status.mode} after {STOP_PATIENCE_S:g} s: use the emergency stop")
        return status


def _maybe(row: Sequence[float] | None) -> tuple[float, ...] | None:
    return None if row is None else tuple(row)


def _refused(status: ServoStatus) -> bool:
    return status.mode == "FAULT" or (status.mode == "OFF" and status.event != 0)
