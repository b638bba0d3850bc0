"""One client of the bridge, without I/O: bytes and the time in, actions out.

Rules:

* STATE goes out on an absolute grid of the session's period; a grid point that was missed is left out, never made good;
* its `seq` is the number of the grid point, so that a client that copies it into its COMMAND counts sample periods;
* the grid begins with the session, or with the arm's clock for a client that wants samples in step with other arms';
* setpoints are the commander's alone, and the lease is given back, with a stop, however the session ends;
* whoever is in may ask for a stop or for no power, the commander or an observer, and the bridge's log says who did;
* while the servo is away the client is told once, stays connected, and what it commands is dropped;
* another servo than before is told as such; unless it has power already it hears nothing but stops until the power
  request was dropped once.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from qrobot.errors import RemoteProtocolError
from qrobot.rccl_bridge.actions import (
    Action,
    BareRequest,
    Close,
    ForgetCollision,
    Forward,
    NameSignals,
    Note,
    SendBytes,
    StopArm,
    TakeAnalog,
    TakeCollision,
    TakePayload,
    TakePowerAway,
)
from qrobot.rccl_bridge.frames import FrameMaker
from qrobot.rccl_bridge.handshake import HandshakeRequest, judge
from qrobot.rccl_bridge.lease import Lease
from qrobot.rccl_bridge.places import Places
from qrobot.rccl_bridge.rate_limit import RateLimit
from qrobot.rccl_bridge.servo_interface import RobotState
from qrobot.rccl_bridge.settings import BridgeSettings
from qrobot.wire import (
    VERSION,
    AnalogOutputs,
    Bye,
    ClientRole,
    Collision,
    Command,
    Connection,
    ErrorCode,
    Hello,
    InvalidSetpoint,
    Payload,
    Side,
    Signals,
    State,
    Stop,
    Welcome,
    WireError,
    WireEvent,
)
from qrobot.wire.sequence import wrapped


@dataclass(frozen=True)
class Peer:
    """The far end of a socket; `by_link`: on the isolated link of the settings, not on the loopback interface."""

    host: str
    port: int
    by_link: bool = False

    def __str__(self) -> str:
        return f"{self.host}:{self.port}"


class Session:
    """State machine of one client: its rights, its commands, and the answers to them.

    Args:
        robot_name, n: of the robot. lease: to command it. peer: the client's end. now_ns: the time.
        places: of observers; None keeps no count. token: what a client has to show; empty asks for none.
        judge_payload: tells why the arm cannot carry a payload, "" when it can.
        judge_collision: tells why it does not take thresholds of a collision, "" when it does.
        judge_analog: tells why its analogue outputs cannot be so, "" when they can.
        shared_clock: other arms' bridges go by the same clock; False for an arm on a virtual time of its own.
        arm: its name, for people; that of the robot where it has none.

    Attributes:
        label: the client in words for people.
        due_ns: when `tick` wants to be called next.
        invalid: COMMANDs with impossible setpoints.
        left_out: STATEs not sent because the client did not read.
    """

    def __init__(
        self,
        robot_name: str,
        n: int,
        lease: Lease,
        settings: BridgeSettings,
        peer: Peer,
        now_ns: int,
        places: Places | None = None,
        token: bytes = b"",
        judge_payload: Callable[[Payload], str] = lambda _payload: "",
        judge_collision: Callable[[Collision], str] = lambda _collision: "",
        judge_analog: Callable[[AnalogOutputs], str] = lambda _analog: "",
        shared_clock: bool = True,
        arm: str = "",
    ) -> None:
        self.label = str(peer)
        self.due_ns = now_ns + settings.handshake_ns
        self.invalid = 0
        self.left_out = 0
        self._robot_name, self._n, self._arm = robot_name, n, arm or robot_name
        self._lease, self._settings, self._peer = lease, settings, peer
        self._places, self._token = places or Places(settings.max_clients), token
        self._connection = Connection(Side.SERVER)
        self._frames: FrameMaker | None = None  # the commander's
        self._shared_clock, self._in_step = shared_clock, False
        self._origin_ns = 0
        self._period_ns = 0
        self._heard_ns = now_ns
        self._blocked_since_ns: int | None = None
        self._servo_gone = ""  # what was said of a servo that is away
        self._servo: int | None = None  # number of the one whose STATEs are told
        self._warnings, self._stops = RateLimit(), RateLimit()
        self._judge_payload, self._judge_collision = judge_payload, judge_collision
        self._judge_analog = judge_analog

    @property
    def ended(self) -> bool:
        """Whether the session is over."""
        return self._connection.ended

    @property
    def greeted(self) -> bool:
        """The client has been welcomed."""
        return self._period_ns != 0

    def receive(self, data: bytes, now_ns: int) -> list[Action]:
        """Bytes came from the client."""
        actions: list[Action] = []
        try:
            self._connection.receive_data(data)
            while (event := self._connection.next_event()) is not None:
                actions += self._take(event, now_ns)
        except RemoteProtocolError as error:
            foreign = self._connection.peer_version not in (None, VERSION)
            actions += self.refuse(ErrorCode.VERSION if foreign else ErrorCode.MALFORMED, str(error), now_ns)
        return actions

    def tick(self, now_ns: int, robot: RobotState | None, mismatch: str = "", servo: int = 1) -> list[Action]:
        """Time has come to `now_ns`; `robot` is the newest sample of `servo`, None without one: see `RobotPort`."""
        if self.ended or now_ns < self.due_ns:
            return []
        if self._period_ns == 0:
            return self.refuse(ErrorCode.TIMEOUT, "no HELLO in time", now_ns)
        number = (now_ns - self._origin_ns) // self._period_ns + 1
        self.due_ns = self._origin_ns + number * self._period_ns
        if robot is None:
            self._heard_ns = now_ns  # a commander that answers STATEs has nothing to answer
            return self._miss_servo(now_ns, mismatch)
        if self._frames is not None and now_ns - self._heard_ns > self._settings.silence_ns:
            return self.refuse(ErrorCode.TIMEOUT, "the commander has fallen silent", now_ns)
        met = self._meet(servo, robot.powered, now_ns)
        if self._blocked_since_ns is not None:
            return [*met, *self._leave_out(now_ns, self._blocked_since_ns)]
        return [*met, *self._tell(number, robot)]

    def block(self, now_ns: int) -> None:
        """The client does not read: leave out STATEs from now on."""
        self._blocked_since_ns = now_ns

    def unblock(self) -> None:
        """The client reads again."""
        self._blocked_since_ns = None

    def lose(self) -> list[Action]:
        """The client's socket is gone."""
        self._places.leave(self)
        return self._give_up_command("the commander's connection was lost")

    def dismiss(self, reason: str, now_ns: int) -> list[Action]:
        """End the session from our side in good order."""
        if self.ended:
            return []
        farewell = SendBytes(self._connection.send(Bye(reason, now_ns)))
        return [*self._give_up_command(reason), farewell, Close(reason)]

    def refuse(self, code: ErrorCode, text: str, now_ns: int) -> list[Action]:
        """End the session because of something the client did, or did not do."""
        if self.ended:
            return []
        complaint = SendBytes(self._connection.send(WireError(code, text, True, now_ns)))
        return [*self._give_up_command(text), complaint, Close(text)]

    def _take(self, event: WireEvent, now_ns: int) -> list[Action]:
        actions: list[Action] = []
        match event:
            case Command():
                actions = self._take_command(event, now_ns)
            case InvalidSetpoint():
                actions = self._take_invalid(event, now_ns)
            case Stop():
                actions = self._take_stop(event, now_ns)
            case Signals() | Payload() | Collision() | AnalogOutputs():
                actions = self._take_change(event, now_ns)
            case Hello():
                actions = self._greet(event, now_ns)
            case Bye():
                reason = event.text or "the client said BYE"
                actions = [*self._give_up_command(reason), Close(reason)]
        return actions

    def _greet(self, hello: Hello, now_ns: int) -> list[Action]:
        link = self._settings.link if self._peer.by_link else None
        token, peers = (self._token, None) if link is None else (link.token, link.peers)
        refusal = judge(HandshakeRequest(hello, self._peer.host, self._robot_name, token, peers))
        if refusal is not None:
            return self.refuse(refusal.code, refusal.text, now_ns)
        self.label = f"{hello.program or 'a program'} at {self._peer}"
        commands = hello.role is ClientRole.COMMANDER
        if commands and not self._lease.take(self, self.label):
            busy = f"{self._arm} {self._lease.refusal}"
            return self.refuse(ErrorCode.COMMANDER_BUSY, busy, now_ns)
        if not commands and not self._places.take(self):
            full = f"this bridge serves {self._places.max_observers} observers at most, beside the commander"
            return self.refuse(ErrorCode.FULL, full, now_ns)
        period_us = hello.period_us or self._settings.period_us
        self._period_ns = period_us * 1000
        self._heard_ns = now_ns
        self._begin_grid(hello.in_step and self._shared_clock, now_ns)
        self._frames = FrameMaker(self._lease, self._period_ns) if commands else None
        welcome = Welcome(hello.role, self._robot_name, self._n, period_us, now_ns)
        forgotten = [ForgetCollision()] if commands else []  # by a bridge that was killed
        return [*forgotten, SendBytes(self._connection.send(welcome))]

    def _begin_grid(self, in_step: bool, now_ns: int) -> None:
        """Let the first STATE leave at the next point of the grid: now, or at a multiple of the period."""
        self._in_step, self._origin_ns = in_step, 0 if in_step else now_ns
        self.due_ns = now_ns + (self._origin_ns - now_ns) % self._period_ns

    def _take_command(self, command: Command, now_ns: int) -> list[Action]:
        self._heard_ns = now_ns
        if self._frames is None or self._servo_gone:
            return []
        self._lease.path_waits = command.path_waits
        frame = self._frames.make(command, self._connection.received.newest or 0, now_ns)
        return [Forward(frame)] if frame is not None else _stop_if_asked(command)

    def _take_invalid(self, event: InvalidSetpoint, now_ns: int) -> list[Action]:
        """Drop the setpoints of a COMMAND that has an impossible one, and obey its requests."""
        self.invalid += 1
        self._heard_ns = now_ns
        actions = self._take_requests(event.command, now_ns)
        if self._warnings.allows(now_ns):
            setpoint = event.command.setpoints[event.joint]
            text = f"setpoint {setpoint} of joint {event.joint + 1} in frame {event.command.seq}"
            warning = WireError(ErrorCode.INVALID_SETPOINT, text, False, now_ns)
            actions.append(SendBytes(self._connection.send(warning)))
        return actions

    def _take_stop(self, stop: Stop, now_ns: int) -> list[Action]:
        """Hand over a stop, each of them; of a flood the log has the first ten of a second."""
        done = "took arm power away" if stop.power_off else "asked for a stop"
        action = TakePowerAway(self.label) if stop.power_off else StopArm(self.label)
        return [action, Note(f"{self.label} {done}")] if self._stops.allows(now_ns) else [action]

    def _take_change(self, change: Signals | Payload | Collision | AnalogOutputs, now_ns: int) -> list[Action]:
        """Take a change the commander makes now and then: of names, of the payload, of collisions, of outputs."""
        self._heard_ns = now_ns
        match change:
            case Signals():
                return [NameSignals(change.names)]
            case Payload():
                return self._take_payload(change, now_ns)
            case Collision():
                return self._take_collision(change, now_ns)
            case AnalogOutputs():
                return self._take_analog(change, now_ns)

    def _take_payload(self, change: Payload, now_ns: int) -> list[Action]:
        refusal = self._judge_payload(change)
        if refusal or self._servo_gone:
            return self._object(ErrorCode.PAYLOAD_REFUSED, refusal, now_ns)
        return [TakePayload(change), Note(f"{self.label} set a payload of {change.mass:g} kg")]

    def _take_collision(self, change: Collision, now_ns: int) -> list[Action]:
        refusal = self._judge_collision(change)
        if refusal or self._servo_gone:
            return self._object(ErrorCode.COLLISION_REFUSED, refusal, now_ns)
        told = " ".join(f"{threshold:g}" for threshold in change.thresholds)
        return [TakeCollision(change), Note(f"{self.label} set thresholds of a collision: {told}")]

    def _take_analog(self, change: AnalogOutputs, now_ns: int) -> list[Action]:
        refusal = self._judge_analog(change)
        if refusal or self._servo_gone:
            return self._object(ErrorCode.ANALOG_REFUSED, refusal, now_ns)
        return [TakeAnalog(change)]

    def _object(self, code: ErrorCode, refusal: str, now_ns: int) -> list[Action]:
        """Answer what cannot be, each time, unless the client does not read."""
        if self._blocked_since_ns is not None:
            return []
        text = "the servo is away" if self._servo_gone else refusal
        return [SendBytes(self._connection.send(WireError(code, text, False, now_ns)))]

    def _take_requests(self, command: Command, now_ns: int) -> list[Action]:
        if self._frames is None or self._servo_gone:
            return []
        request = self._frames.make_request(command, now_ns)
        return [BareRequest(request)] if request is not None else _stop_if_asked(command)

    def _tell(self, number: int, robot: RobotState) -> list[Action]:
        state = State(
            seq=wrapped(number),
            robot=robot,
            ack=0 if self._frames is None else self._frames.acknowledged,
            dropped=self._connection.received.refused + self.invalid,
            you_command=self._frames is not None,
            commanded=self._lease.taken,
            path_waits=self._lease.path_waits,
            in_step=self._in_step,
        )
        return [SendBytes(self._connection.send(state))]

    def _miss_servo(self, now_ns: int, mismatch: str) -> list[Action]:
        text = mismatch or f"the servo of {self._arm} does not run; this connection waits for it"
        if self._servo_gone == text:
            return []
        self._servo_gone = text
        return [SendBytes(self._connection.send(WireError(ErrorCode.SERVO_GONE, text, False, now_ns)))]

    def _meet(self, servo: int, powered: bool, now_ns: int) -> list[Action]:
        """Tell STATEs of a servo from now on. One that is not known to this connection knows nothing of it either."""
        known, was_away = self._servo, bool(self._servo_gone)
        self._servo, self._servo_gone = servo, ""
        if servo == known or (known is None and not was_away):
            return []
        if self._frames is not None:
            self._frames.meet(powered)
        text = f"the servo of {self._arm} has started anew"
        return [SendBytes(self._connection.send(WireError(ErrorCode.SERVO_NEW, text, False, now_ns)))]

    def _leave_out(self, now_ns: int, since_ns: int) -> list[Action]:
        self.left_out += 1
        if now_ns - since_ns <= self._settings.blocked_ns:
            return []
        return self.refuse(ErrorCode.SLOW_READER, "the client does not read", now_ns)

    def _give_up_command(self, reason: str) -> list[Action]:
        if not self._lease.release(self):
            return []
        return [StopArm(reason), NameSignals(()), ForgetCollision()]


def _stop_if_asked(command: Command) -> list[Action]:
    """The stop of a COMMAND of which nothing else may pass."""
    return [StopArm("asked for")] if command.stop else []
