"""A robot that follows perfectly and speaks the wire protocol: in lock-step, or over a socket in its own thread."""

from __future__ import annotations

import select
import socket
import sys
import threading
from collections.abc import Callable
from contextlib import suppress

import numpy as np

from qrobot.errors import LinkLost
from qrobot.faultcodes import FaultCode
from qrobot.rci import TcpLink
from qrobot.wire import (
    Bye,
    ClientRole,
    Collision,
    Command,
    Connection,
    ErrorCode,
    Hello,
    JointMode,
    Mode,
    Payload,
    RobotFlag,
    RobotState,
    Side,
    Signals,
    State,
    Welcome,
    WireError,
    WireEvent,
)

START_NS = 1_000_000_000
POWERING_PERIODS = 3
START_TOLERANCE = 0.02
USUAL_PATIENCE = 2
HALT_TOLD_PERIODS = 9  # of a stream that is followed: until then the robot tells of a stop that was asked for before it
SERVO_GONE = WireError(ErrorCode.SERVO_GONE, "the servo does not run; this connection waits for it", False)
SERVO_NEW = WireError(ErrorCode.SERVO_NEW, "the servo has started anew", False)


class FakeRobot:
    """The server of one commander. Time passes by one period per STATE.

    Args:
        patience: periods without a command after which it stops. Without it, `USUAL_PATIENCE` of those that pass when
            it is asked, and any number of those that pass by the wall clock.

    Attributes:
        commands: everything the commander said.
        told: what they said beside commands, and how many commands came before.
        payload_mass: kg, in force.
        path: setpoints followed, one per period. Shape (periods, n) as an array.
    """

    def __init__(self, q: tuple[float, ...], name: str = "puma560", period_us: int = 28_000, patience: int = 0) -> None:
        self.name, self.period_us = name, period_us
        self.q = tuple(float(x) for x in q)
        self.mode = Mode.OFF
        self.fault, self.event, self.hand = 0, 0, 0
        self.override, self.paused = 1.0, False  # as the operator wants it
        self.refuse_power = False
        self.calibrated = True
        self.commands: list[Command] = []
        self.path: list[tuple[float, ...]] = []
        self.told: list[tuple[int, Payload | Collision | Signals]] = []
        self.payload_mass = 0.0
        self.goodbyes = 0
        self.before_period: Callable[[int], object] | None = None
        self.seq = 0
        self._t_ns = START_NS
        self._connection = Connection(Side.SERVER)
        self._patience = patience
        self._powering = self._halt_told = 0
        self._stream = self._dead_stream = -1
        self._heard = 0
        self._power_seen = False
        self._complaints: tuple[WireError, ...] = ()  # that come before the next STATE

    # ------------------------------------------------------------------------------------------- what tests do to it

    def break_down(self, code: FaultCode) -> None:
        """Latch a fault."""
        self.mode, self.fault, self.event = Mode.FAULT, code, code

    def halt(self, code: FaultCode) -> None:
        """Stop the arm as the servo does when it refuses to go on, without a fault."""
        self.mode, self.event, self._dead_stream = Mode.HOLDING, code, self._stream

    def meet(self, code: FaultCode = FaultCode.COLLISION) -> None:
        """Begin such a stop, which does not come to rest by itself."""
        self.halt(code)
        self.mode = Mode.STOPPING

    def rest(self) -> None:
        """End a stop that has begun."""
        self.mode = Mode.HOLDING if self.mode is Mode.STOPPING else self.mode

    def stop_by_hand(self) -> None:
        """Be told to stop, by somebody beside the program or by itself."""
        if self.mode is Mode.TRACKING:
            self.mode, self._dead_stream = Mode.HOLDING, self._stream
        self._halt_told = HALT_TOLD_PERIODS

    def tell_stop_before_stream(self) -> None:
        """Follow a stream whose first frame was under way when somebody told it to stop."""
        self._halt_told = HALT_TOLD_PERIODS

    def lose_power_by_hand(self) -> None:
        """Be told by somebody beside the program to go without power, until it is asked for anew."""
        self.mode, self._dead_stream = Mode.OFF, self._stream
        self._halt_told = HALT_TOLD_PERIODS

    def script(self, *acts: tuple[int, Callable[[FakeRobot], object]]) -> int:
        """Let things happen so many periods after the next one, in this order; the number of the next one."""
        first = self.seq + 1

        def happens(seq: int) -> None:
            for after, act in acts:
                if seq == first + after:
                    act(self)

        self.before_period = happens
        return first

    def lose_stream_and(self, act: Callable[[FakeRobot], object]) -> None:
        """Refuse to follow whatever streams begin, and let something happen while the arm comes to rest."""

        def happens(_: int) -> None:
            if self.mode is Mode.STOPPING:
                act(self)
                self.rest()
            if self.mode is Mode.TRACKING:
                self.meet(FaultCode.STREAM_LOST)

        self.before_period = happens

    @property
    def streams(self) -> set[int]:
        """Numbers of the streams whose setpoints have come."""
        return {command.stream for command in self.commands if any(command.modes)}

    def start_anew(self) -> None:
        """Be another servo from the next period on, without power and without a pause; the client is told of it."""
        self.mode, self.fault, self.event, self.paused = Mode.OFF, 0, 0, False
        self.payload_mass = 0.0
        self._complaints = (SERVO_GONE, SERVO_NEW)

    def be_away(self) -> None:
        """Have been silent for a moment before the next period; the client is told of it."""
        self._complaints = (SERVO_GONE,)

    def forget_client(self) -> None:
        """Wait for a greeting, as after a connection that has broken."""
        self._connection = Connection(Side.SERVER)

    def be_patient(self) -> None:
        """Wait for commands as long as it takes, unless it was told for how long."""
        self._patience = self._patience or sys.maxsize

    # --------------------------------------------------------------------------------------------------- its one port

    def transfer(self, data: bytes) -> bytes:
        """Take the client's bytes, let a period pass, answer."""
        greeting = self.hear(data)
        return greeting or self.tell()

    def hear(self, data: bytes) -> bytes:
        """Take the client's bytes; the answer to a greeting, which may follow on a goodbye."""
        if data and self._connection.ended:
            self._connection = Connection(Side.SERVER)
        self._connection.receive_data(data)
        answers = b""
        while (event := self._connection.next_event()) is not None:
            answers += self._take(event)
        return answers

    def tell(self) -> bytes:
        """Let a period pass; its STATE."""
        if self._connection.ended or not self._connection.n:
            return b""
        self.seq += 1
        self._t_ns += self.period_us * 1000
        if self.before_period is not None:
            self.before_period(self.seq)
        self._live()
        said, self._complaints = b"".join(map(self._connection.send, self._complaints)), ()
        state = State(self.seq % (1 << 32), self._state(), len(self.commands), you_command=True)
        return said + self._connection.send(state)

    # ---------------------------------------------------------------------------------------------------- inside

    def _take(self, event: WireEvent) -> bytes:
        match event:
            case Hello() if event.robot != self.name:
                complaint = f"this is {self.name!r}, not {event.robot!r}"
                return self._connection.send(WireError(ErrorCode.WRONG_ROBOT, complaint, True))
            case Hello():
                period_us = self.period_us = event.period_us or self.period_us
                return self._connection.send(
                    Welcome(ClientRole.COMMANDER, self.name, len(self.q), period_us, self._t_ns)
                )
            case Command():
                self._obey(event)
            case Payload() | Collision() | Signals():
                self.told.append((len(self.commands), event))
                self.payload_mass = event.mass if isinstance(event, Payload) else self.payload_mass
            case Bye():
                self.goodbyes += 1
        return b""

    def _obey(self, command: Command) -> None:
        self.commands.append(command)
        self._heard, self.hand = self.seq, command.hand
        asked_now, self._power_seen = command.power and not self._power_seen, command.power
        if command.clear_fault and self.mode is Mode.FAULT:
            self.mode, self.fault = Mode.OFF, 0
        elif not command.power and self.mode is not Mode.FAULT:
            self.mode = Mode.OFF
        elif self.mode is Mode.OFF and asked_now:
            self.mode, self._powering = Mode.POWERING, 0
        if command.stop:
            self.stop_by_hand()
        self._follow(command)

    def _follow(self, command: Command) -> None:
        if command.modes != (JointMode.POSITION,) * len(self.q) or command.stream == self._dead_stream:
            return
        if self.mode is Mode.HOLDING:
            if np.abs(np.subtract(command.setpoints, self.q)).max() > START_TOLERANCE:
                self.event, self._dead_stream = FaultCode.START_POSE, command.stream
                return
            self.mode, self._stream = Mode.TRACKING, command.stream
        if self.mode is Mode.TRACKING and command.stream == self._stream:
            self.q = command.setpoints
            self._halt_told = max(0, self._halt_told - 1)
            self.path.append(self.q)

    def _live(self) -> None:
        if self.mode is Mode.POWERING:
            self._powering += 1
            if self.refuse_power:
                self.mode, self.event = Mode.OFF, FaultCode.POWER_NO_ACK
            elif self._powering >= POWERING_PERIODS:
                self.mode = Mode.HOLDING if self.calibrated else Mode.UNCALIBRATED
        if self.mode is Mode.TRACKING and self.seq - self._heard > (self._patience or USUAL_PATIENCE):
            self.halt(FaultCode.STREAM_LOST)

    def _state(self) -> RobotState:
        still = (0.0,) * len(self.q)
        powered = self.mode not in (Mode.OFF, Mode.POWERING, Mode.FAULT)
        flags = (RobotFlag.POWERED if powered else 0) | (RobotFlag.PAUSED if self.paused else 0)
        flags |= RobotFlag.HALTED if self._halt_told else 0
        return RobotState(
            t_ns=self._t_ns,
            mode=self.mode,
            q=self.q,
            v=still,
            tau=still,
            q_setpoint=self.q,
            fault=self.fault,
            event=self.event,
            flags=flags,
            hand=self.hand,
            override=self.override,
            payload_mass=self.payload_mass,
        )


INTERVENTIONS: dict[str, Callable[[FakeRobot], object]] = {
    "a fault": lambda fake: fake.break_down(FaultCode.RUNAWAY),
    "power off": FakeRobot.lose_power_by_hand,
    "a stop": FakeRobot.stop_by_hand,
}
"""What may come between a collision and the way back, and leaves the arm where it is."""


class SocketRobot:
    """Serves a `FakeRobot` at the far end of a socket pair, period by period of the wall clock, in a thread.

    Its time stands still while the client, which may have no turn, leaves no room for another STATE.
    """

    def __init__(self, robot: FakeRobot) -> None:
        self.robot = robot
        robot.be_patient()
        self.socket, self._near = socket.socketpair()
        self._near.setblocking(False)
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._serve)

    def __enter__(self) -> SocketRobot:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.hang_up()
        self._thread.join()
        self.socket.close()

    @property
    def over(self) -> bool:
        """One of both ends has closed the connection."""
        return self._over.is_set()

    def hang_up(self) -> None:
        """Break the connection without a word."""
        self._over.set()

    def _serve(self) -> None:
        with suppress(OSError), self._near as near:
            while not self._over.wait(self.robot.period_us * 1e-6):
                self._talk(near)

    def _talk(self, near: socket.socket) -> None:
        with suppress(BlockingIOError):
            data = near.recv(1 << 16)
            if not data:
                self._over.set()
            near.sendall(self.robot.hear(data))
        if select.select([], [near], [], 0.0)[1]:
            near.sendall(self.robot.tell())


class PassingBridge:
    """A bridge to one `FakeRobot` that is there inside `with`, as often as one likes, and away before and after."""

    def __init__(self, robot: FakeRobot) -> None:
        self._robot = robot
        self._server: SocketRobot | None = None

    def __enter__(self) -> None:
        self._server = SocketRobot(self._robot).__enter__()

    def __exit__(self, *_: object) -> None:
        server, self._server = self._server, None
        assert server is not None
        server.__exit__()
        self._robot.forget_client()

    def link(self, hello: Hello) -> TcpLink:
        """A link to it."""
        return TcpLink(hello, ("test", 0), self._connect)

    def _connect(self, _: object) -> socket.socket:
        if self._server is None:
            raise LinkLost("no bridge")
        return self._server.socket


class TcpRobot:
    """Serves a `FakeRobot` at a port of this machine, one client after another, in a thread: each STATE when the one
    before was answered, and `period_s` later.

    Attributes:
        address: host and port.
    """

    def __init__(self, robot: FakeRobot, period_s: float = 0.0) -> None:
        self.robot = robot
        self._listening = socket.create_server(("127.0.0.1", 0))
        self.address = self._listening.getsockname()
        self._period_s = period_s
        self._over = threading.Event()
        self._near: socket.socket | None = None
        self._thread = threading.Thread(target=self._serve)

    def __enter__(self) -> TcpRobot:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        with suppress(OSError):
            self._listening.shutdown(socket.SHUT_RDWR)
        self.hang_up()
        self._thread.join()
        self._listening.close()

    def hang_up(self) -> None:
        """Break the connection without a word."""
        with suppress(OSError, AttributeError):
            self._near.shutdown(socket.SHUT_RDWR)

    def _serve(self) -> None:
        with suppress(OSError):
            while not self._over.is_set():
                near, _ = self._listening.accept()
                with near:
                    self._near = near
                    near.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                    self._talk(near)
                self.robot.forget_client()

    def _talk(self, near: socket.socket) -> None:
        with suppress(OSError):
            while data := near.recv(1 << 16):
                near.sendall(self.robot.hear(data))
                self._over.wait(self._period_s)
                near.sendall(self.robot.tell())
