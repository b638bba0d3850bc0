"""Hypothesis strategies for every packet, and a pair of connected ends."""

from __future__ import annotations

from math import nan

from hypothesis import strategies as st

from qrobot.printable import printable
from qrobot.wire import (
    AnalogOutputs,
    Bye,
    ClientRole,
    Collision,
    Command,
    Connection,
    ErrorCode,
    Hello,
    Mode,
    Payload,
    RobotState,
    Side,
    Signals,
    State,
    Stop,
    Welcome,
    WireError,
)
from qrobot.wire.layout import NAME_BYTES
from qrobot.wire.vocabulary import N_ANALOG_OUTPUTS, N_SIGNALS

U8, U16, U32 = (st.integers(0, (1 << bits) - 1) for bits in (8, 16, 32))
T_NS = st.integers(-(1 << 63), (1 << 63) - 1)
TEXTS = st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\0"), max_size=100).map(printable)
NAMES = TEXTS.filter(lambda name: len(name.encode()) <= NAME_BYTES)
JOINTS = st.integers(1, 32)
NUMBERS = st.floats(allow_nan=False)
SETPOINTS = st.floats(-1e6, 1e6)
ROLES = st.sampled_from(ClientRole)


def vectors(n: int, numbers: st.SearchStrategy[float] = NUMBERS) -> st.SearchStrategy[tuple[float, ...]]:
    return st.tuples(*[numbers] * n)


def robot_states(n: int) -> st.SearchStrategy[RobotState]:
    vector = vectors(n)
    return st.builds(
        RobotState, t_ns=T_NS, mode=U8, q=vector, v=vector, tau=vector, q_setpoint=vector, fault=U16, event=U16,
        event_joint=st.integers(-1, 31), flags=st.integers(0, 0xFF), late_cycles=U32, missed_frames=U32,
        inputs=U32, hand=U8, force=vectors(6), outputs=U16,
        speed_limit=NUMBERS, tool_speed_limit=NUMBERS, override=NUMBERS, payload_mass=NUMBERS, sensors=vectors(8),
    )  # fmt: skip


def states(n: int) -> st.SearchStrategy[State]:
    return st.builds(
        State, seq=U32, robot=robot_states(n), ack=U32, dropped=U32, you_command=st.booleans(), commanded=st.booleans(),
        in_step=st.booleans(),
    )  # fmt: skip


def commands(n: int) -> st.SearchStrategy[Command]:
    return st.builds(
        Command, seq=U32, modes=st.tuples(*[st.integers(0, 2)] * n), setpoints=vectors(n, SETPOINTS),
        power=st.booleans(), clear_fault=st.booleans(), stop=st.booleans(), stream=U32, hand=st.integers(0, 2),
        outputs=U32, ack=U32, t_ns=T_NS, signals=vectors(N_SIGNALS, NUMBERS | st.just(nan)),
    )  # fmt: skip


HELLOS = st.builds(
    Hello, role=ROLES, robot=NAMES, program=NAMES, period_us=U32, auth=st.binary(max_size=1024), t_ns=T_NS,
    in_step=st.booleans(),
)  # fmt: skip
WELCOMES = st.builds(Welcome, role=ROLES, robot=NAMES, n=JOINTS, period_us=st.integers(1_000, 100_000), t_ns=T_NS)
ERRORS = st.builds(
    WireError, code=st.sampled_from(ErrorCode).map(int) | U16, text=TEXTS, fatal=st.booleans(), t_ns=T_NS
)
BYES = st.builds(Bye, text=TEXTS, t_ns=T_NS)
STOPS = st.builds(Stop, power_off=st.booleans(), t_ns=T_NS)
SIGNAL_NAMES = st.from_regex(r"[A-Za-z_][A-Za-z0-9_]{0,30}", fullmatch=True)
SIGNALS = st.builds(Signals, names=st.lists(SIGNAL_NAMES, max_size=N_SIGNALS, unique=True).map(tuple), t_ns=T_NS)
PAYLOADS = st.builds(Payload, mass=NUMBERS, centre=vectors(3), inertia=vectors(6), t_ns=T_NS)
COLLISIONS = JOINTS.flatmap(
    lambda n: st.builds(Collision, thresholds=vectors(n), reaction=st.integers(0, 1), t_ns=T_NS)
)
ANALOGS = st.builds(AnalogOutputs, volts=vectors(N_ANALOG_OUTPUTS, NUMBERS | st.just(nan)), t_ns=T_NS)
PACKETS = st.one_of(
    HELLOS,
    WELCOMES,
    JOINTS.flatmap(commands),
    JOINTS.flatmap(states),
    ERRORS,
    BYES,
    STOPS,
    SIGNALS,
    PAYLOADS,
    COLLISIONS,
    ANALOGS,
)


def resting(q: tuple[float, ...], t_ns: int = 0, mode: int = Mode.HOLDING, **others: int) -> RobotState:
    """A robot that stands at `q`."""
    still = (0.0,) * len(q)
    return RobotState(t_ns=t_ns, mode=mode, q=q, v=still, tau=still, q_setpoint=q, **others)


def connected(
    n: int = 6, role: ClientRole = ClientRole.COMMANDER, period_us: int = 28_000
) -> tuple[Connection, Connection]:
    """(client, server) after the handshake."""
    client, server = Connection(Side.CLIENT), Connection(Side.SERVER)
    server.receive_data(client.send(Hello(role, "puma560", "test")))
    assert isinstance(server.next_event(), Hello)
    client.receive_data(server.send(Welcome(role, "puma560", n, period_us)))
    assert isinstance(client.next_event(), Welcome)
    return client, server
