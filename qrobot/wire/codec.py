"""Packets to bytes and back. What cannot be sent raises LocalProtocolError, what cannot be read RemoteProtocolError."""

from __future__ import annotations

import struct
from collections.abc import Callable
from struct import Struct
from typing import Any, Final
from zlib import crc32

from qrobot.errors import LocalProtocolError, RemoteProtocolError
from qrobot.wire import layout
from qrobot.wire.layout import CRC_BYTES, HEADER_BYTES, MAGIC, MAX_PACKET_BYTES, NAME_BYTES, Layout
from qrobot.wire.packets import (
    LONGEST_PERIOD_US,
    MAX_JOINTS,
    SHORTEST_PERIOD_US,
    VERSION,
    Bye,
    ClientRole,
    Command,
    Hand,
    Hello,
    JointMode,
    Packet,
    Request,
    RobotFlag,
    RobotState,
    State,
    Welcome,
    WireError,
)

LONGEST_AUTH: Final = 1024
LONGEST_TEXT: Final = 512  # longer texts are cut: they are for people

_START: Final = Struct("<4sBBH")  # magic, version, kind, length
_CRC: Final = Struct("<I")
_FIRST: Final = 7  # fields of the header
_POWER, _CLEAR, _STOP = int(Request.POWER), int(Request.CLEAR_FAULT), int(Request.STOP)
_YOU, _SOMEBODY = int(RobotFlag.YOU_COMMAND), int(RobotFlag.COMMANDED)
_U32: Final = 0xFFFFFFFF
_SERVO_FLAGS: Final = _U32 & ~(_YOU | _SOMEBODY)


def frame_length(start: bytes | bytearray) -> int | None:
    """Length of the packet that begins here; None while fewer than 8 bytes are there.

    Raises RemoteProtocolError when no packet begins so, or one of impossible length.
    """
    if len(start) < _START.size:
        return None
    magic, _, _, length = _START.unpack_from(start)
    if magic != MAGIC:
        raise RemoteProtocolError(f"no packet begins with {bytes(magic)!r}; {MAGIC!r} expected")
    if not HEADER_BYTES + CRC_BYTES <= length <= MAX_PACKET_BYTES or length % 4:
        raise RemoteProtocolError(f"impossible packet length {length}: a multiple of 4, 28 to {MAX_PACKET_BYTES}")
    return int(length)


def frame_version(frame: bytes) -> int:
    """Protocol version that a packet claims."""
    return frame[4]


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
    _, version, kind, length = _START.unpack_from(frame)
    if crc32(frame[:-CRC_BYTES]) != _CRC.unpack_from(frame, length - CRC_BYTES)[0]:
        raise RemoteProtocolError("packet with a wrong checksum")
    if version != VERSION and kind != layout.ERROR.kind:
        raise RemoteProtocolError(f"far end speaks version {version} of the protocol, this is version {VERSION}")
    decoder = _DECODERS.get(kind)
    if decoder is None:
        raise RemoteProtocolError(f"unknown kind of packet: {kind}")
    return decoder(frame)


# ---------------------------------------------------------------------------------------------------- shared pieces


def _pack(shape: Layout, n: int, seq: int, ack: int, t_ns: int, *payload: Any, rest: bytes = b"") -> bytes:
    """Header, payload, rest (padded) and checksum."""
    rest += bytes(-len(rest) % 4)
    body = shape.struct(n)
    length = body.size + len(rest) + CRC_BYTES
    data = body.pack(MAGIC, VERSION, shape.kind, length, seq, ack, t_ns, *payload) + rest
    return data + _CRC.pack(crc32(data))


def _unpack(shape: Layout, n: int, frame: bytes) -> tuple[Any, ...]:
    """Header and payload of a packet whose length is fixed by its joint count."""
    if len(frame) != shape.size(n):
        raise RemoteProtocolError(f"{shape.name} for {n} joints has {shape.size(n)} bytes, not {len(frame)}")
    return shape.struct(n).unpack_from(frame)


def _unpack_with_rest(shape: Layout, frame: bytes) -> tuple[tuple[Any, ...], bytes]:
    if len(frame) < shape.size(0):
        raise RemoteProtocolError(f"{shape.name} has at least {shape.size(0)} bytes, not {len(frame)}")
    body = shape.struct(0)
    # a rest field yields an empty string of its own, which is left out here
    return body.unpack_from(frame)[:-1], frame[body.size : -CRC_BYTES]


def _joint_count(shape: Layout, frame: bytes) -> int:
    """The joint count, first byte of the payload in COMMAND and STATE."""
    n = frame[HEADER_BYTES] if len(frame) > HEADER_BYTES + CRC_BYTES else 0
    if not 1 <= n <= MAX_JOINTS:
        raise RemoteProtocolError(f"{shape.name} for {n} joints: 1 to {MAX_JOINTS} are possible")
    return n


def _name_bytes(name: str) -> bytes:
    data = name.encode()
    if len(data) > NAME_BYTES or b"\0" in data:
        raise LocalProtocolError(f"name {name!r}: at most {NAME_BYTES} bytes of UTF-8, none of them 0")
    return data


def _text_bytes(text: str) -> bytes:
    cut = text.replace("\0", " ").encode()[:LONGEST_TEXT]
    return cut.decode(errors="ignore").encode()


def _text(data: bytes) -> str:
    """Text up to the first 0, as C reads it."""
    try:
        return data.split(b"\0", 1)[0].decode()
    except UnicodeDecodeError as error:
        raise RemoteProtocolError("text that is not UTF-8") from error


def _role(value: int) -> ClientRole:
    try:
        return ClientRole(value)
    except ValueError as error:
        raise RemoteProtocolError(f"unknown role {value}: 1 commander, 2 observer") from error


# ------------------------------------------------------------------------------------------------------- handshake


def _encode_hello(packet: Hello) -> bytes:
    if len(packet.auth) > LONGEST_AUTH:
        raise LocalProtocolError(f"authentication of {len(packet.auth)} bytes: at most {LONGEST_AUTH}")
    return _pack(
        layout.HELLO, 0, 0, 0, packet.t_ns, packet.role, len(packet.auth), packet.period_us,
        _name_bytes(packet.robot), _name_bytes(packet.program), b"", rest=packet.auth,
    )  # fmt: skip


def _decode_hello(frame: bytes) -> Hello:
    values, rest = _unpack_with_rest(layout.HELLO, frame)
    t_ns, role, auth_length, period_us, robot, program = values[_FIRST - 1 :]
    if auth_length > LONGEST_AUTH or len(rest) != auth_length + -auth_length % 4:
        raise RemoteProtocolError(f"HELLO claims {auth_length} bytes of authentication and brings {len(rest)}")
    return Hello(_role(role), _text(robot), _text(program), period_us, rest[:auth_length], t_ns)


def _encode_welcome(packet: Welcome) -> bytes:
    return _pack(
        layout.WELCOME, 0, 0, 0, packet.t_ns, packet.role, packet.n, packet.period_us, _name_bytes(packet.robot)
    )


def _decode_welcome(frame: bytes) -> Welcome:
    t_ns, role, n, period_us, robot = _unpack(layout.WELCOME, 0, frame)[_FIRST - 1 :]
    if not 1 <= n <= MAX_JOINTS:
        raise RemoteProtocolError(f"WELCOME to {n} joints: 1 to {MAX_JOINTS} are possible")
    if not SHORTEST_PERIOD_US <= period_us <= LONGEST_PERIOD_US:
        raise RemoteProtocolError(f"WELCOME to a period of {period_us} µs")
    return Welcome(_role(role), _text(robot), n, period_us, t_ns)


# -------------------------------------------------------------------------------------------------- sample periods


def _encode_command(packet: Command) -> bytes:
    n = len(packet.modes)
    if not 1 <= n <= MAX_JOINTS or len(packet.setpoints) != n:
        raise LocalProtocolError(f"COMMAND with {n} modes and {len(packet.setpoints)} setpoints")
    if max(packet.modes) > JointMode.TORQUE or packet.hand > Hand.CLOSED:
        raise LocalProtocolError(f"COMMAND with joint modes {packet.modes} and hand {packet.hand}: 0 to 2 exist")
    requests = _POWER * packet.power | _CLEAR * packet.clear_fault | _STOP * packet.stop
    return _pack(
        layout.COMMAND, n, packet.seq, packet.ack, packet.t_ns, n, packet.hand, requests, packet.stream,
        packet.outputs, *packet.setpoints, *packet.modes,
    )  # fmt: skip


def _decode_command(frame: bytes) -> Command:
    n = _joint_count(layout.COMMAND, frame)
    values = _unpack(layout.COMMAND, n, frame)
    seq, ack, t_ns, _, hand, requests, stream, outputs = values[4:12]
    setpoints, modes = values[12 : 12 + n], values[12 + n :]
    if max(modes) > JointMode.TORQUE or hand > Hand.CLOSED:
        raise RemoteProtocolError(f"COMMAND with joint modes {modes} and hand {hand}: 0 to 2 exist")
    return Command(
        seq, modes, setpoints, bool(requests & _POWER), bool(requests & _CLEAR), bool(requests & _STOP),
        stream, hand, outputs, ack, t_ns,
    )  # fmt: skip


def _encode_state(packet: State) -> bytes:
    robot = packet.robot
    n = len(robot.q)
    if (
        not 1 <= n <= MAX_JOINTS
        or {len(robot.v), len(robot.tau), len(robot.q_setpoint)} != {n}
        or len(robot.force) != 6
    ):
        raise LocalProtocolError(f"STATE whose vectors are not all of {n} joints, or whose force is not of 6 axes")
    flags = robot.flags & _SERVO_FLAGS | _YOU * packet.you_command | _SOMEBODY * packet.commanded
    counters = robot.late_cycles & _U32, robot.missed_frames & _U32, packet.dropped & _U32
    return _pack(
        layout.STATE, n, packet.seq, packet.ack, robot.t_ns, n, robot.mode, robot.fault, robot.event,
        robot.event_joint, flags, *counters, robot.inputs, robot.hand,
        *robot.q, *robot.v, *robot.tau, *robot.q_setpoint, *robot.force,
    )  # fmt: skip


def _decode_state(frame: bytes) -> State:
    n = _joint_count(layout.STATE, frame)
    values = _unpack(layout.STATE, n, frame)
    seq, ack, t_ns, _, mode, fault, event, joint, flags, late, missed, dropped, inputs, hand = values[4:18]
    q, v, tau, q_setpoint = (values[k : k + n] for k in range(18, 18 + 4 * n, n))
    robot = RobotState(
        t_ns, mode, q, v, tau, q_setpoint, fault, event, joint, flags & _SERVO_FLAGS, late, missed, inputs, hand,
        values[18 + 4 * n :],
    )  # fmt: skip
    return State(seq, robot, ack, dropped, bool(flags & _YOU), bool(flags & _SOMEBODY))


def _encode_error(packet: WireError) -> bytes:
    return _pack(layout.ERROR, 0, 0, 0, packet.t_ns, packet.code, packet.fatal, b"", rest=_text_bytes(packet.text))


def _decode_error(frame: bytes) -> WireError:
    values, rest = _unpack_with_rest(layout.ERROR, frame)
    t_ns, code, fatal = values[_FIRST - 1 :]
    return WireError(code, _text(rest), bool(fatal), t_ns)


def _encode_bye(packet: Bye) -> bytes:
    return _pack(layout.BYE, 0, 0, 0, packet.t_ns, b"", rest=_text_bytes(packet.text))


def _decode_bye(frame: bytes) -> Bye:
    values, rest = _unpack_with_rest(layout.BYE, frame)
    return Bye(_text(rest), values[_FIRST - 1])


_ENCODERS: Final[dict[type, Callable[[Any], bytes]]] = {
    Hello: _encode_hello,
    Welcome: _encode_welcome,
    Command: _encode_command,
    State: _encode_state,
    WireError: _encode_error,
    Bye: _encode_bye,
}
_DECODERS: Final[dict[int, Callable[[bytes], Packet]]] = {
    layout.HELLO.kind: _decode_hello,
    layout.WELCOME.kind: _decode_welcome,
    layout.COMMAND.kind: _decode_command,
    layout.STATE.kind: _decode_state,
    layout.ERROR.kind: _decode_error,
    layout.BYE.kind: _decode_bye,
}
