"""Packets to bytes and back. What cannot be sent raises LocalProtocolError, what cannot be read RemoteProtocolError."""

from __future__ import annotations

import struct
from collections.abc import Callable
from math import isnan, nan
from typing import Any, Final

from qrobot.errors import LocalProtocolError, RemoteProtocolError
from qrobot.wire import layout
from qrobot.wire.framing import (
    check_frame,
    joint_count,
    name_bytes,
    pack,
    text_bytes,
    text_of,
    unpack,
    unpack_with_rest,
)
from qrobot.wire.packets import (
    AnalogOutputs,
    Bye,
    Collision,
    Command,
    Hello,
    Packet,
    Payload,
    RobotState,
    Signals,
    State,
    Stop,
    Welcome,
    WireError,
)
from qrobot.wire.robot_state import StateTable, rows_of
from qrobot.wire.vocabulary import (
    LONGEST_PERIOD_US,
    LONGEST_SIGNAL,
    MAX_JOINTS,
    N_ANALOG_OUTPUTS,
    N_SIGNALS,
    SHORTEST_PERIOD_US,
    ClientRole,
    CollisionReaction,
    Hand,
    HelloFlag,
    JointMode,
    Request,
    RobotFlag,
)

LONGEST_AUTH: Final = 1024

_FIRST: Final = 7  # fields of the header
_POWER, _CLEAR, _STOP = int(Request.POWER), int(Request.CLEAR_FAULT), int(Request.STOP)
_HOLD_TO_RUN, _KEY_HELD = int(Request.HOLD_TO_RUN), int(Request.KEY_HELD)
_PATH_WAITS = int(Request.PATH_WAITS)
_YOU, _SOMEBODY, _WAITS = int(RobotFlag.YOU_COMMAND), int(RobotFlag.COMMANDED), int(RobotFlag.PATH_WAITS)
_IN_STEP, _WANTS_STEP = int(RobotFlag.IN_STEP), int(HelloFlag.IN_STEP)
_U32: Final = 0xFFFFFFFF
_SERVO_FLAGS: Final = _U32 & ~(_YOU | _SOMEBODY | _WAITS | _IN_STEP)
_WRAPPING: Final = frozenset(row.name for row in rows_of(StateTable) if row.wraps)


def encode(packet: Packet) -> bytes:
    """One packet as bytes. Raises LocalProtocolError when a value does not fit its field."""
    try:
        return _ENCODERS[type(packet)](packet)
    except struct.error as error:
        raise LocalProtocolError(f"{type(packet).__name__}: {error}") from error


def decode(frame: bytes) -> Packet:
    """The packet in `frame`, one whole packet as cut out by `frame_length`.

    Raises RemoteProtocolError for a wrong checksum, version, kind, size or value.
    """
    kind = check_frame(frame)
    decoder = _DECODERS.get(kind)
    if decoder is None:
        raise RemoteProtocolError(f"unknown kind of packet: {kind}")
    return decoder(frame)


def _role(value: int) -> ClientRole:
    try:
        return ClientRole(value)
    except ValueError as error:
        raise RemoteProtocolError(f"unknown role {value}: 1 commander, 2 observer") from error


# ------------------------------------------------------------------------------------------------------- handshake


def _encode_hello(packet: Hello) -> bytes:
    if len(packet.auth) > LONGEST_AUTH:
        raise LocalProtocolError(f"authentication of {len(packet.auth)} bytes: at most {LONGEST_AUTH}")
    return pack(
        layout.HELLO, 0, 0, 0, packet.t_ns, packet.role, _WANTS_STEP * packet.in_step, len(packet.auth),
        packet.period_us, name_bytes(packet.robot), name_bytes(packet.program), b"", rest=packet.auth,
    )  # fmt: skip


def _decode_hello(frame: bytes) -> Hello:
    values, rest = unpack_with_rest(layout.HELLO, frame)
    t_ns, role, flags, auth_length, period_us, robot, program = values[_FIRST - 1 :]
    if auth_length > LONGEST_AUTH or len(rest) != auth_length + -auth_length % 4:
        raise RemoteProtocolError(f"HELLO claims {auth_length} bytes of authentication and brings {len(rest)}")
    in_step = bool(flags & _WANTS_STEP)
    return Hello(_role(role), text_of(robot), text_of(program), period_us, rest[:auth_length], t_ns, in_step)


def _encode_welcome(packet: Welcome) -> bytes:
    return pack(layout.WELCOME, 0, 0, 0, packet.t_ns, packet.role, packet.n, packet.period_us, name_bytes(packet.robot))


def _decode_welcome(frame: bytes) -> Welcome:
    t_ns, role, n, period_us, robot = unpack(layout.WELCOME, 0, frame)[_FIRST - 1 :]
    if not 1 <= n <= MAX_JOINTS:
        raise RemoteProtocolError(f"WELCOME to {n} joints: 1 to {MAX_JOINTS} are possible")
    if not SHORTEST_PERIOD_US <= period_us <= LONGEST_PERIOD_US:
        raise RemoteProtocolError(f"WELCOME to a period of {period_us} µs")
    return Welcome(_role(role), text_of(robot), n, period_us, t_ns)


# -------------------------------------------------------------------------------------------------- sample periods


def _encode_command(packet: Command) -> bytes:
    n = len(packet.modes)
    if not 1 <= n <= MAX_JOINTS or len(packet.setpoints) != n:
        raise LocalProtocolError(f"COMMAND with {n} modes and {len(packet.setpoints)} setpoints")
    lowest, highest = min(*packet.modes, packet.hand), max(packet.modes)
    if lowest < 0 or highest > JointMode.TORQUE or packet.hand > Hand.CLOSED:
        modes = tuple(map(int, packet.modes))
        raise LocalProtocolError(f"COMMAND with joint modes {modes} and hand {packet.hand}: 0 to 2 exist")
    if not 0 <= packet.outputs <= _U32:
        raise LocalProtocolError(f"COMMAND with outputs {packet.outputs:#x}: 32 bits, output 1 in bit 0")
    if len(packet.signals) != N_SIGNALS:
        raise LocalProtocolError(f"COMMAND with {len(packet.signals)} signals: {N_SIGNALS} numbers, NaN for none")
    requests = _POWER * packet.power | _CLEAR * packet.clear_fault | _STOP * packet.stop
    requests |= _HOLD_TO_RUN * packet.hold_to_run | _KEY_HELD * packet.key_held | _PATH_WAITS * packet.path_waits
    return pack(
        layout.COMMAND, n, packet.seq, packet.ack, packet.t_ns, n, packet.hand, requests, packet.stream,
        packet.outputs, *packet.signals, *packet.setpoints, *packet.modes,
    )  # fmt: skip


def _decode_command(frame: bytes) -> Command:
    n = joint_count(layout.COMMAND, frame)
    values = unpack(layout.COMMAND, n, frame)
    seq, ack, t_ns, _, hand, requests, stream, outputs = values[4:12]
    signals = tuple(nan if isnan(number) else number for number in values[12 : 12 + N_SIGNALS])
    values = values[12 + N_SIGNALS :]
    setpoints, modes = values[:n], values[n:]
    if max(modes) > JointMode.TORQUE or hand > Hand.CLOSED:
        raise RemoteProtocolError(f"COMMAND with joint modes {modes} and hand {hand}: 0 to 2 exist")
    return Command(
        seq, modes, setpoints, bool(requests & _POWER), bool(requests & _CLEAR), bool(requests & _STOP),
        stream, hand, outputs, ack, t_ns, bool(requests & _HOLD_TO_RUN), bool(requests & _KEY_HELD), signals,
        bool(requests & _PATH_WAITS),
    )  # fmt: skip


def _encode_state(packet: State) -> bytes:
    robot, n = packet.robot, packet.robot.n
    values: list[Any] = []
    for field in layout.STATE.fields:
        if field.code == "x":
            continue
        if field.count == 1:
            values.append(_number(packet, field.name))
        else:
            values += _vector(getattr(robot, field.name), field, n)
    return pack(layout.STATE, n, packet.seq, packet.ack, robot.t_ns, *values)


def _vector(values: tuple[float, ...], field: layout.Field, n: int) -> tuple[float, ...]:
    if not 1 <= n <= MAX_JOINTS or len(values) != field.length(n):
        raise LocalProtocolError(
            f"STATE of {n} joints whose {field.name} has {len(values)} numbers: its vectors are not all of {n} joints, "
            "or its force is not of 6 axes"
        )
    return values


def _number(packet: State, name: str) -> float:
    """A number of STATE: of the connection, or of the robot; counters wrap."""
    if name == "joints":
        return packet.robot.n
    if name == "dropped":
        return packet.dropped & _U32
    if name == "flags":
        bridge = _YOU * packet.you_command | _SOMEBODY * packet.commanded | _WAITS * packet.path_waits
        return packet.robot.flags & _SERVO_FLAGS | bridge | _IN_STEP * packet.in_step
    number: float = getattr(packet.robot, name)
    return int(number) & _U32 if name in _WRAPPING else number


def _decode_state(frame: bytes) -> State:
    n = joint_count(layout.STATE, frame)
    seq, ack, t_ns, *rest = unpack(layout.STATE, n, frame)[4:]
    told, at = dict[str, Any](), 0
    for field in layout.STATE.fields:
        if field.code != "x":
            end = at + field.length(n)
            told[field.name] = rest[at] if field.count == 1 else tuple(rest[at:end])
            at = end
    _, dropped, flags = told.pop("joints"), told.pop("dropped"), told.pop("flags")
    robot = RobotState(t_ns=t_ns, flags=flags & _SERVO_FLAGS, **told)
    return State(seq, robot, ack, dropped, *(bool(flags & each) for each in (_YOU, _SOMEBODY, _WAITS, _IN_STEP)))


def _encode_error(packet: WireError) -> bytes:
    return pack(layout.ERROR, 0, 0, 0, packet.t_ns, packet.code, packet.fatal, b"", rest=text_bytes(packet.text))


def _decode_error(frame: bytes) -> WireError:
    values, rest = unpack_with_rest(layout.ERROR, frame)
    t_ns, code, fatal = values[_FIRST - 1 :]
    return WireError(code, text_of(rest), bool(fatal), t_ns)


def _encode_bye(packet: Bye) -> bytes:
    return pack(layout.BYE, 0, 0, 0, packet.t_ns, b"", rest=text_bytes(packet.text))


def _decode_bye(frame: bytes) -> Bye:
    values, rest = unpack_with_rest(layout.BYE, frame)
    return Bye(text_of(rest), values[_FIRST - 1])


# -------------------------------------------------------------------------------------------------- beside the periods


def _encode_stop(packet: Stop) -> bytes:
    return pack(layout.STOP, 0, 0, 0, packet.t_ns, packet.power_off)


def _decode_stop(frame: bytes) -> Stop:
    t_ns, power_off = unpack(layout.STOP, 0, frame)[_FIRST - 1 :]
    return Stop(bool(power_off), t_ns)


def check_signal_names(names: tuple[str, ...]) -> str:
    """Objection to the names of signals; "" for none."""
    if len(names) > N_SIGNALS:
        return f"{len(names)} signals: {N_SIGNALS} at most"
    if len(set(names)) < len(names):
        return f"two signals of one name in {', '.join(names)}"
    odd = next((name for name in names if not _is_signal_name(name)), None)
    return (
        "" if odd is None else f"signal {odd!r}: letters, digits and underscores are allowed, at most {LONGEST_SIGNAL}"
    )


def _is_signal_name(name: str) -> bool:
    return name.isascii() and name.isidentifier() and len(name) <= LONGEST_SIGNAL


def _encode_signals(packet: Signals) -> bytes:
    if wrong := check_signal_names(packet.names):
        raise LocalProtocolError(wrong)
    return pack(layout.SIGNALS, 0, 0, 0, packet.t_ns, " ".join(packet.names).encode())


def _decode_signals(frame: bytes) -> Signals:
    t_ns, data = unpack(layout.SIGNALS, 0, frame)[_FIRST - 1 :]
    names = tuple(text_of(data).split())
    if wrong := check_signal_names(names):
        raise RemoteProtocolError(wrong)
    return Signals(names, t_ns)


def _encode_payload(packet: Payload) -> bytes:
    if (len(packet.centre), len(packet.inertia)) != (3, 6):
        raise LocalProtocolError("PAYLOAD: a centre has 3 numbers and an inertia 6, xx yy zz xy xz yz")
    return pack(layout.PAYLOAD, 0, 0, 0, packet.t_ns, packet.mass, *packet.centre, *packet.inertia)


def _decode_payload(frame: bytes) -> Payload:
    t_ns, mass, *rest = unpack(layout.PAYLOAD, 0, frame)[_FIRST - 1 :]
    return Payload(mass, tuple(rest[:3]), tuple(rest[3:]), t_ns)


def _encode_collision(packet: Collision) -> bytes:
    n = len(packet.thresholds)
    if not 1 <= n <= MAX_JOINTS or not 0 <= packet.reaction <= max(CollisionReaction):
        raise LocalProtocolError(f"COLLISION with {n} thresholds and reaction {packet.reaction}: 0 and 1 exist")
    return pack(layout.COLLISION, n, 0, 0, packet.t_ns, n, packet.reaction, *packet.thresholds)


def _decode_collision(frame: bytes) -> Collision:
    n = joint_count(layout.COLLISION, frame)
    t_ns, _, reaction, *thresholds = unpack(layout.COLLISION, n, frame)[_FIRST - 1 :]
    if reaction > max(CollisionReaction):
        raise RemoteProtocolError(f"COLLISION with reaction {reaction}: 0 and 1 exist")
    return Collision(tuple(thresholds), reaction, t_ns)


def _encode_analog(packet: AnalogOutputs) -> bytes:
    if len(packet.volts) != N_ANALOG_OUTPUTS:
        raise LocalProtocolError(f"ANALOG with {len(packet.volts)} outputs: {N_ANALOG_OUTPUTS} numbers, NaN for none")
    return pack(layout.ANALOG, 0, 0, 0, packet.t_ns, *packet.volts)


def _decode_analog(frame: bytes) -> AnalogOutputs:
    t_ns, *volts = unpack(layout.ANALOG, 0, frame)[_FIRST - 1 :]
    return AnalogOutputs(tuple(nan if isnan(volt) else volt for volt in volts), t_ns)


_ENCODERS: Final[dict[type, Callable[[Any], bytes]]] = {
    Hello: _encode_hello,
    Welcome: _encode_welcome,
    Command: _encode_command,
    State: _encode_state,
    WireError: _encode_error,
    Bye: _encode_bye,
    Stop: _encode_stop,
    Signals: _encode_signals,
    Payload: _encode_payload,
    Collision: _encode_collision,
    AnalogOutputs: _encode_analog,
}
_DECODERS: Final[dict[int, Callable[[bytes], Packet]]] = {
    layout.HELLO.kind: _decode_hello,
    layout.WELCOME.kind: _decode_welcome,
    layout.COMMAND.kind: _decode_command,
    layout.STATE.kind: _decode_state,
    layout.ERROR.kind: _decode_error,
    layout.BYE.kind: _decode_bye,
    layout.STOP.kind: _decode_stop,
    layout.SIGNALS.kind: _decode_signals,
    layout.PAYLOAD.kind: _decode_payload,
    layout.COLLISION.kind: _decode_collision,
    layout.ANALOG.kind: _decode_analog,
}
