"""One client of the bridge on virtual time: who may do what, and what is left behind when it goes."""

from __future__ import annotations

from dataclasses import replace
from math import nan

import pytest

from qrobot.errors import LocalProtocolError
from qrobot.rccl_bridge import (
    BridgeSettings,
    Close,
    Forward,
    Lease,
    SendBytes,
    Session,
    SetpointFrame,
    StopArm,
    carry_out,
)
from qrobot.rccl_bridge.mailbox_port import MailboxPort
from qrobot.rccl_bridge.places import Places
from qrobot.rccl_bridge.session import Peer
from qrobot.wire import (
    AnalogOutputs,
    Bye,
    ClientRole,
    Collision,
    CollisionReaction,
    Command,
    Connection,
    ErrorCode,
    Hello,
    JointMode,
    Mode,
    Payload,
    RobotFlag,
    Side,
    Signals,
    State,
    Stop,
    Welcome,
    WireError,
)
from qrobot.wire.codec import encode
from tests.support.fake_port import FakePort
from tests.support.servo_bench import ServoBench

MS = 1_000_000
PERIOD_NS = 28 * MS
START_NS = 5_000 * MS
COMMANDER = Hello(ClientRole.COMMANDER, "puma560", "boxes")
OBSERVER = Hello(ClientRole.OBSERVER, "", "eyes")
MOVE = Command(0, (JointMode.POSITION,) * 6, (0.1,) * 6, power=True)


class Client:
    """A client and its session, joined without a socket, on virtual time."""

    def __init__(
        self,
        port: FakePort | MailboxPort,
        lease: Lease,
        host: str = "127.0.0.1",
        shared_clock: bool = True,
        **settings: int,
    ) -> None:
        self.port = port
        self.now_ns = START_NS
        self.wire = Connection(Side.CLIENT)
        self.session = Session(
            "puma560",
            6,
            lease,
            BridgeSettings(**settings),
            Peer(host, 40_000),
            START_NS,
            judge_payload=port.judge_payload,
            judge_collision=port.judge_collision,
            judge_analog=port.judge_analog,
            shared_clock=shared_clock,
            arm="left",
        )
        self.closed = ""
        self.notes: list[str] = []

    def exchange(self, actions):
        outcome = carry_out(actions, self.port)
        self.closed = self.closed or outcome.closed
        self.notes += outcome.notes
        self.wire.receive_data(outcome.data)
        events = []
        while (event := self.wire.next_event()) is not None:
            events.append(event)
        return events

    def say(self, packet):
        return self.exchange(self.session.receive(self.wire.send(packet), self.now_ns))

    def say_bytes(self, data: bytes):
        return self.exchange(self.session.receive(data, self.now_ns))

    def wait(self, duration_ns: int):
        self.now_ns += duration_ns
        state = self.port.read_state() if self.port.alive() else None
        return self.exchange(self.session.tick(self.now_ns, state, self.port.mismatch, self.port.servo))

    def join(self, hello: Hello = COMMANDER):
        (welcome,) = self.say(hello)
        assert isinstance(welcome, Welcome), welcome
        self.wait(0)
        return self


@pytest.fixture
def port() -> FakePort:
    return FakePort()


@pytest.fixture
def lease() -> Lease:
    return Lease()


@pytest.fixture
def client(port: FakePort, lease: Lease) -> Client:
    return Client(port, lease)


def test_a_commander_is_welcomed_with_robot_joints_and_period(client: Client) -> None:
    assert client.say(COMMANDER) == [Welcome(ClientRole.COMMANDER, "puma560", 6, 28_000, START_NS)]


def test_a_client_chooses_its_period(client: Client) -> None:
    assert client.say(replace(COMMANDER, period_us=1_000)) == [
        Welcome(ClientRole.COMMANDER, "puma560", 6, 1_000, START_NS)
    ]


@pytest.mark.parametrize(
    ("hello", "code", "words"),
    [
        (replace(COMMANDER, robot="stanford"), ErrorCode.WRONG_ROBOT, "'puma560', not 'stanford'"),
        (replace(COMMANDER, robot=""), ErrorCode.WRONG_ROBOT, "not ''"),
        (replace(OBSERVER, robot="stanford"), ErrorCode.WRONG_ROBOT, "not 'stanford'"),
        (replace(COMMANDER, period_us=999), ErrorCode.BAD_PERIOD, "999 µs"),
        (replace(OBSERVER, period_us=100_001), ErrorCode.BAD_PERIOD, "1000 to 100000"),
    ],
)
def test_a_wrong_greeting_is_refused_with_its_reason(client: Client, hello, code, words) -> None:
    (refusal,) = client.say(hello)
    assert (refusal.code, refusal.fatal) == (code, True)
    assert words in refusal.text
    assert words in client.closed


@pytest.mark.parametrize("host", ["192.168.1.7", "::ffff:10.0.0.1", "nonsense"])
def test_nobody_comes_in_from_another_machine(port: FakePort, lease: Lease, host: str) -> None:
    (refusal,) = Client(port, lease, host).say(OBSERVER)
    assert refusal.code == ErrorCode.AUTHENTICATION


@pytest.mark.parametrize("host", ["127.0.0.1", "127.3.2.1", "::1", "::ffff:127.0.0.1"])
def test_loopback_in_every_form_comes_in(port: FakePort, lease: Lease, host: str) -> None:
    assert isinstance(Client(port, lease, host).say(OBSERVER)[0], Welcome)


def test_a_client_that_does_not_greet_is_sent_away_after_two_seconds(client: Client) -> None:
    assert client.wait(1_999 * MS) == []
    (refusal,) = client.wait(MS)
    assert (refusal.code, client.closed) == (ErrorCode.TIMEOUT, "no HELLO in time")


def test_a_slow_loris_is_sent_away_although_it_keeps_talking(client: Client) -> None:
    for byte in encode(COMMANDER)[:20]:
        assert client.say_bytes(bytes([byte])) == []
        answers = client.wait(100 * MS)
    assert [answer.code for answer in answers] == [ErrorCode.TIMEOUT]


# ------------------------------------------------------------------------------------------------------- STATE


def test_states_flow_on_the_grid_and_count_the_sample_periods(client: Client) -> None:
    client.say(COMMANDER)
    (first,) = client.wait(0)
    told = [client.wait(PERIOD_NS) for _ in range(3)]
    assert [first.seq, *(state.seq for (state,) in told)] == [1, 2, 3, 4]


def test_a_stalled_bridge_leaves_grid_points_out_instead_of_bursting(client: Client) -> None:
    client.join(OBSERVER)
    (late,) = client.wait(10 * PERIOD_NS + PERIOD_NS // 3)
    assert late.seq == 11
    assert client.wait(0) == []
    assert client.session.due_ns == START_NS + 11 * PERIOD_NS
    (next_one,) = client.wait(PERIOD_NS - PERIOD_NS // 3)
    assert next_one.seq == 12


def test_nothing_is_told_before_its_time(client: Client) -> None:
    client.join()
    assert client.wait(PERIOD_NS - 1) == []
    assert len(client.wait(1)) == 1


def test_sessions_in_step_are_told_of_the_same_instants_by_the_same_numbers(port: FakePort) -> None:
    first, second = Client(port, Lease()), Client(port, Lease())
    second.now_ns += 11 * MS
    heard: list[dict[int, State]] = []
    for client in (first, second):
        client.join(replace(COMMANDER, in_step=True))
        told = [(state, client.now_ns) for _ in range(4 * 28) for state in client.wait(MS)]
        heard.append({t_ns: state for state, t_ns in told})
    common = heard[0].keys() & heard[1].keys()
    assert len(common) >= 3
    for t_ns in common:
        assert t_ns % PERIOD_NS == 0
        assert heard[0][t_ns].seq == heard[1][t_ns].seq
        assert heard[0][t_ns].in_step
    numbers = [heard[0][t_ns].seq for t_ns in sorted(heard[0])]
    assert numbers == list(range(numbers[0], numbers[0] + len(numbers)))


def test_a_session_on_a_time_of_its_own_and_one_that_does_not_ask_for_it_begin_their_own_grid(port: FakePort) -> None:
    asked, alone = Client(port, Lease()), Client(port, Lease(), shared_clock=False)
    for client, hello in ((asked, COMMANDER), (alone, replace(COMMANDER, in_step=True))):
        client.say(hello)
        (state,) = client.wait(0)
        assert (state.seq, state.in_step) == (1, False)


def test_a_state_says_who_commands_and_whether_their_path_waits(port: FakePort, lease: Lease) -> None:
    observer = Client(port, lease).join(OBSERVER)
    (alone,) = observer.wait(PERIOD_NS)
    commander = Client(port, lease).join()
    (watched,) = observer.wait(PERIOD_NS)
    (own,) = commander.wait(PERIOD_NS)
    assert [(state.you_command, state.commanded) for state in (alone, watched, own)] == [
        (False, False), (False, True), (True, True),
    ]  # fmt: skip
    commander.say(replace(MOVE, seq=1, path_waits=True))
    (waits,) = observer.wait(PERIOD_NS)
    commander.exchange(commander.session.lose())
    (gone,) = observer.wait(PERIOD_NS)
    assert [state.path_waits for state in (watched, waits, gone)] == [False, True, False]


def test_a_state_carries_the_sample_and_what_became_of_the_commands(client: Client, port: FakePort) -> None:
    client.join()
    client.say(replace(MOVE, seq=7))
    client.say_bytes(encode(replace(MOVE, seq=6)) + encode(replace(MOVE, seq=8, setpoints=(nan,) * 6)))
    (state,) = client.wait(PERIOD_NS)
    assert isinstance(state, State)
    assert state.robot == port.state
    assert (state.ack, state.dropped) == (7, 2)


# ----------------------------------------------------------------------------------------------------- COMMAND


def test_a_command_becomes_a_frame_with_the_time_of_its_arrival(client: Client, port: FakePort) -> None:
    client.join()
    client.now_ns += 3 * MS
    client.say(replace(MOVE, seq=1, hand=2, outputs=5, t_ns=-1))
    assert port.frames == [
        SetpointFrame(
            stream=client.now_ns,
            seq=1,
            t_ns=client.now_ns,
            period_ns=PERIOD_NS,
            modes=MOVE.modes,
            setpoints=MOVE.setpoints,
            power=True,
            clear_fault=False,
            stop=False,
            hand=2,
            outputs=5,
        )
    ]


def test_requests_act_when_they_are_raised_not_while_they_stay(client: Client, port: FakePort) -> None:
    client.join()
    for seq, raised in enumerate([True, True, False, True], start=1):
        client.say(replace(MOVE, seq=seq, stop=raised, clear_fault=not raised))
    assert [frame.stop for frame in port.frames] == [True, False, False, True]
    assert [frame.clear_fault for frame in port.frames] == [False, False, True, False]


def test_a_new_stream_of_the_client_is_one_never_used_before(client: Client, port: FakePort) -> None:
    client.join()
    for seq, stream in enumerate([0, 0, 1, 0], start=1):
        client.say(replace(MOVE, seq=seq, stream=stream))
    streams = [frame.stream for frame in port.frames]
    assert streams[0] == streams[1] < streams[2] < streams[3]


def test_the_next_commander_gets_another_stream(client: Client, port: FakePort, lease: Lease) -> None:
    client.join().say(replace(MOVE, seq=1))
    client.say(Bye())
    Client(port, lease).join().say(replace(MOVE, seq=1))
    assert port.frames[0].stream < port.frames[1].stream


def test_a_restarted_bridge_uses_later_streams_than_the_old_one(port: FakePort) -> None:
    for start in (0, 1):
        client = Client(port, Lease())
        client.now_ns += start
        client.join().say(replace(MOVE, seq=1))
    assert port.frames[0].stream < port.frames[1].stream


def test_sequence_numbers_go_on_where_the_wire_wraps(client: Client, port: FakePort) -> None:
    client.join()
    for seq in (0xFFFFFFFF, 0, 1):
        client.say(replace(MOVE, seq=seq))
    assert [frame.seq for frame in port.frames] == [0xFFFFFFFF, 1 << 32, (1 << 32) + 1]


def test_an_impossible_setpoint_is_a_missing_frame_and_a_warning(client: Client, port: FakePort) -> None:
    client.join()
    bad = replace(MOVE, seq=1, setpoints=(0.0, nan, 0.0, 0.0, 0.0, 0.0))
    (warning,) = client.say_bytes(encode(bad))
    assert (warning.code, warning.fatal) == (ErrorCode.INVALID_SETPOINT, False)
    assert "joint 2" in warning.text
    client.say(replace(MOVE, seq=2))
    assert [frame.seq for frame in port.frames] == [2]


@pytest.mark.parametrize("wrong", [nan, float("inf"), -float("inf")])
def test_what_is_requested_counts_whatever_the_setpoint_beside_it(client: Client, port: FakePort, wrong: float) -> None:
    client.join()
    for seq, asked in enumerate(({"stop": True}, {"clear_fault": True}, {"hand": 2, "outputs": 5}, {}), start=1):
        client.say_bytes(encode(replace(MOVE, seq=seq, setpoints=(wrong,) * 6, **asked)))
    assert port.frames == []
    requests = [(r.stop, r.clear_fault, r.hand, r.outputs) for r in port.requests]
    assert requests == [(True, False, 0, 0), (False, True, 0, 0), (False, False, 2, 5), (False, False, 0, 0)]


def test_a_stop_raised_and_held_beside_impossible_setpoints_is_one_stop(client: Client, port: FakePort) -> None:
    client.join()
    for seq in (1, 2, 3):
        client.say_bytes(encode(replace(MOVE, seq=seq, setpoints=(nan,) * 6, stop=True)))
    assert [request.stop for request in port.requests] == [True, False, False]


@pytest.mark.parametrize("modes", [(1,) * 6, (0, 1, 0, 0, 0, 0), (2,) * 6])
def test_an_impossible_setpoint_takes_no_power_off_down_with_it(modes: tuple[int, ...]) -> None:
    rig = ServoBench().hold()
    client = Client(MailboxPort(rig.mailbox.words), Lease())
    client.join()
    client.say(replace(MOVE, seq=1, modes=(0,) * 6, power=True))
    client.say_bytes(encode(replace(MOVE, seq=2, modes=modes, setpoints=(nan,) * 6, power=True)))
    rig.run(0.05)
    assert rig.mode is Mode.HOLDING
    client.say_bytes(encode(replace(MOVE, seq=3, modes=modes, setpoints=(nan,) * 6, power=False)))
    rig.run(0.05)
    assert rig.mode is Mode.OFF
    client.say_bytes(encode(replace(MOVE, seq=4, modes=modes, setpoints=(nan,) * 6, power=True)))
    rig.run(0.05)
    assert rig.mode is Mode.OFF  # and no power-on either: nothing begins with a COMMAND that is wrong


IMPOSSIBLE = (nan, float("inf"), -float("inf"), 1e300)  # no frame at all
BEYOND = (1e6, -9.0, 0.6)  # out of range, out of range, too far away: the servo's to refuse
FLAGS = ("power", "clear_fault", "stop", "hold_to_run", "key_held")


@pytest.mark.sampled(60)
@pytest.mark.parametrize("wrong", IMPOSSIBLE + BEYOND)
@pytest.mark.parametrize("bits", range(1 << len(FLAGS)))
def test_beside_every_wrong_setpoint_stop_and_power_off_are_obeyed_and_nothing_else_moves(
    bits: int, wrong: float
) -> None:
    asked = {name: bool(bits >> k & 1) for k, name in enumerate(FLAGS)}
    rig = ServoBench(rate_hz=500.0).hold()  # slow: there are hundreds of cases, and half a second in each
    client = Client(MailboxPort(rig.mailbox.words), Lease())
    client.join()
    at = tuple(rig.q.tolist())
    moving = tuple(angle + 0.002 for angle in at)
    for seq, setpoints in enumerate((at, at, at, moving), start=1):
        client.now_ns = rig.now_ns
        client.say(replace(MOVE, seq=seq, setpoints=setpoints))
        rig.run(0.028)
    assert rig.mode is Mode.TRACKING
    client.now_ns = rig.now_ns
    client.say_bytes(encode(replace(MOVE, seq=5, setpoints=(*at[:3], wrong, *at[4:]), **asked)))
    rig.run(0.028)
    if asked["stop"] or not asked["power"]:
        assert rig.mode is not Mode.TRACKING
    rig.run(0.5)  # nothing more is said: the stream is lost at the latest
    assert rig.mode is (Mode.HOLDING if asked["power"] else Mode.OFF)
    assert abs(rig.q - at).max() < 0.02  # it has come to rest on its path, and the wrong one left no trace


def test_a_commander_whose_power_request_is_locked_may_still_stop(client: Client, port: FakePort) -> None:
    client.join()
    client.say(replace(MOVE, seq=1, power=True))
    port.running = False
    client.wait(2 * PERIOD_NS)
    port.restart()
    client.wait(2 * PERIOD_NS)
    stops = port.stops
    client.say(replace(MOVE, seq=2, power=True, stop=True))
    client.say_bytes(encode(replace(MOVE, seq=3, power=True, stop=True, setpoints=(nan,) * 6)))
    assert port.stops == stops + 2


def test_a_flood_of_impossible_setpoints_is_not_answered_by_a_flood_of_warnings(client: Client) -> None:
    client.join()
    flood = b"".join(encode(replace(MOVE, seq=seq, setpoints=(nan,) * 6)) for seq in range(1, 501))
    assert len(client.say_bytes(flood)) == 10
    assert client.session.invalid == 500


def test_observers_cannot_command(port: FakePort, lease: Lease) -> None:
    observer = Client(port, lease).join(OBSERVER)
    (refusal,) = observer.say_bytes(encode(replace(MOVE, seq=1)))
    assert (refusal.code, refusal.fatal) == (ErrorCode.MALFORMED, True)
    assert (port.frames, port.stops) == ([], 0)


# ------------------------------------------------------------------------------------------------------- lease


def test_a_second_commander_is_refused_and_told_who_commands(port: FakePort, lease: Lease) -> None:
    first = Client(port, lease).join()
    second = Client(port, lease)
    (refusal,) = second.say(replace(COMMANDER, program="burglar"))
    assert refusal.code == ErrorCode.COMMANDER_BUSY
    assert "boxes at 127.0.0.1:40000" in refusal.text
    assert port.stops == 0
    first.say(replace(MOVE, seq=1))
    assert len(port.frames) == 1


def end_by_bye(client: Client) -> None:
    client.say(Bye("done"))


def end_by_a_lost_socket(client: Client) -> None:
    client.exchange(client.session.lose())


def end_by_silence(client: Client) -> None:
    client.wait(1_001 * MS)


def end_by_garbage(client: Client) -> None:
    client.say_bytes(b"GET / HTTP/1.1\r\n")


def end_by_the_bridge(client: Client) -> None:
    client.exchange(client.session.dismiss("the bridge ends", client.now_ns))


ENDS = [end_by_bye, end_by_a_lost_socket, end_by_silence, end_by_garbage, end_by_the_bridge]


@pytest.mark.parametrize("end", ENDS)
def test_however_a_commander_goes_the_arm_is_stopped_once_and_the_lease_is_free(
    client: Client, port: FakePort, lease: Lease, end
) -> None:
    client.join().say(replace(MOVE, seq=1))
    end(client)
    client.exchange(client.session.lose())
    assert (port.stops, lease.taken) == (1, False)
    Client(port, lease).join()


@pytest.mark.parametrize("end", [end_by_bye, end_by_a_lost_socket, end_by_garbage, end_by_the_bridge])
def test_observers_come_and_go_without_a_trace(client: Client, port: FakePort, lease: Lease, end) -> None:
    commander = Client(port, lease).join()
    end(client.join(OBSERVER))
    assert (port.stops, lease.taken) == (0, True)
    assert len(commander.wait(PERIOD_NS)) == 1


def test_a_commander_that_keeps_sending_is_not_silent(client: Client) -> None:
    client.join()
    for _ in range(100):
        (state,) = client.wait(PERIOD_NS)
        client.say(replace(MOVE, seq=state.seq))
    assert client.closed == ""


def test_a_servo_that_does_not_fit_is_told_as_such_and_each_reason_once(client: Client) -> None:
    client.join()
    client.port.running = False
    (gone,) = client.wait(PERIOD_NS)
    assert client.wait(PERIOD_NS) == []
    client.port.mismatch = "its owner runs other code; restart both"
    (other,) = client.wait(PERIOD_NS)
    assert client.wait(PERIOD_NS) == []
    assert (gone.code, gone.text) == (
        ErrorCode.SERVO_GONE, "the servo of left does not run; this connection waits for it",
    )  # fmt: skip
    assert (other.code, other.text, other.fatal) == (ErrorCode.SERVO_GONE, client.port.mismatch, False)
    client.port.running, client.port.mismatch = True, ""
    assert isinstance(client.wait(PERIOD_NS)[0], State)


def test_an_observer_may_be_silent_for_ever(client: Client) -> None:
    client.join(OBSERVER)
    assert isinstance(client.wait(3_600_000 * MS)[0], State)


def test_garbage_gets_one_clear_error_and_no_second_one(client: Client) -> None:
    client.join()
    (error,) = client.say_bytes(b"x" * 5_000)
    assert isinstance(error, WireError)
    assert (error.code, error.fatal) == (ErrorCode.MALFORMED, True)
    assert client.session.receive(b"y" * 5_000, client.now_ns) == []
    assert client.session.tick(client.now_ns + PERIOD_NS, client.port.state) == []


# ------------------------------------------------------------------------------------------------ slow readers


def test_a_reader_that_does_not_read_misses_states_and_then_the_connection(client: Client) -> None:
    client.join(OBSERVER)
    client.session.block(client.now_ns)
    for _ in range(5):
        assert client.wait(PERIOD_NS) == []
    client.session.unblock()
    (state,) = client.wait(PERIOD_NS)
    assert (state.seq, client.session.left_out) == (7, 5)
    client.session.block(client.now_ns)
    (error,) = client.wait(10_001 * MS)
    assert error.code == ErrorCode.SLOW_READER


# ----------------------------------------------------------------------------------------- the servo goes away


def test_a_servo_that_goes_away_is_reported_once_and_its_commands_go_nowhere(client: Client, port: FakePort) -> None:
    client.join().say(replace(MOVE, seq=1))
    port.running = False
    (warning,) = client.wait(PERIOD_NS)
    assert (warning.code, warning.fatal) == (ErrorCode.SERVO_GONE, False)
    for seq in range(2, 60):
        assert client.wait(PERIOD_NS) == []
        client.say(replace(MOVE, seq=seq))
    assert (len(port.frames), client.closed) == (1, "")


def test_a_commander_may_be_silent_while_there_is_no_servo_and_is_given_a_second_after_it(
    client: Client, port: FakePort
) -> None:
    client.join()
    port.running = False
    client.wait(60_000 * MS)
    assert client.closed == ""
    port.running = True
    client.wait(900 * MS)
    assert client.closed == ""
    client.wait(200 * MS)
    assert "silent" in client.closed


def test_a_servo_that_comes_back_moves_only_after_the_power_request_was_dropped(client: Client, port: FakePort) -> None:
    client.join().say(replace(MOVE, seq=1))
    port.running = False
    client.wait(PERIOD_NS)
    port.restart()
    new, state = client.wait(PERIOD_NS)
    assert (new.code, new.fatal, new.text) == (ErrorCode.SERVO_NEW, False, "the servo of left has started anew")
    assert state.robot.mode == Mode.OFF
    client.say(replace(MOVE, seq=2))
    assert len(port.frames) == 1
    client.say(replace(MOVE, seq=3, power=False))
    client.say(replace(MOVE, seq=4))
    assert [(frame.seq, frame.power) for frame in port.frames[1:]] == [(3, False), (4, True)]
    assert port.frames[1].stream > port.frames[0].stream


def test_a_servo_that_was_away_for_a_moment_keeps_its_power_and_hears_what_is_left_of_the_stream_as_that(
    client: Client, port: FakePort
) -> None:
    client.join().say(replace(MOVE, seq=1))
    client.wait(PERIOD_NS)
    port.running = False
    client.wait(PERIOD_NS)
    port.running = True
    (state,) = client.wait(PERIOD_NS)
    assert state.robot.powered
    client.say(replace(MOVE, seq=2))
    client.say(replace(MOVE, seq=3, stream=MOVE.stream + 1))
    assert [(frame.seq, frame.power) for frame in port.frames] == [(1, True), (2, True), (3, True)]
    assert port.frames[0].stream == port.frames[1].stream < port.frames[2].stream


@pytest.mark.parametrize("powered", [True, False])
def test_a_servo_that_comes_after_the_client_powers_nothing_by_a_request_from_before(
    client: Client, port: FakePort, powered: bool
) -> None:
    port.running = False
    client.join()
    client.wait(PERIOD_NS)
    port.restart()
    port.state = replace(port.state, flags=port.state.flags | (RobotFlag.POWERED if powered else 0))
    new, _ = client.wait(PERIOD_NS)
    assert new.code == ErrorCode.SERVO_NEW
    client.say(replace(MOVE, seq=1))
    assert len(port.frames) == powered  # one that has power is asked for none


def test_a_servo_that_restarts_unseen_between_two_ticks_is_another_one(client: Client, port: FakePort) -> None:
    client.join().say(replace(MOVE, seq=1))
    client.wait(PERIOD_NS)
    port.restart()
    new, _ = client.wait(PERIOD_NS)
    assert new.code == ErrorCode.SERVO_NEW
    client.say(replace(MOVE, seq=2))
    assert len(port.frames) == 1
    assert len(client.wait(PERIOD_NS)) == 1  # told once


def test_a_servo_that_restarts_while_the_commander_does_not_read_is_noticed_all_the_same(
    client: Client, port: FakePort
) -> None:
    client.join().say(replace(MOVE, seq=1))
    client.session.block(client.now_ns)
    port.running = False
    client.wait(PERIOD_NS)
    port.restart()
    client.session.unblock()
    client.wait(PERIOD_NS)
    client.say(replace(MOVE, seq=2))
    assert len(port.frames) == 1


def test_a_client_that_joins_while_the_servo_is_away_is_told_so(client: Client, port: FakePort) -> None:
    port.running = False
    (welcome,) = client.say(OBSERVER)
    (warning,) = client.wait(0)
    assert isinstance(welcome, Welcome)
    assert warning.code == ErrorCode.SERVO_GONE


def test_a_servo_that_dies_between_two_ticks_does_not_take_the_bridge_along(client: Client, port: FakePort) -> None:
    client.join()
    port.running = False
    assert client.say(replace(MOVE, seq=1)) == []
    assert client.say(Bye()) == []


def test_actions_are_carried_out_in_their_order(port: FakePort) -> None:
    frame = SetpointFrame(1, 1, 0, PERIOD_NS, (0,) * 6, (0.0,) * 6, False, False, False, 0, 0)
    outcome = carry_out([SendBytes(b"a"), Forward(frame), StopArm("why"), SendBytes(b"b"), Close("end")], port)
    assert (outcome.data, outcome.closed) == (b"ab", "end")
    assert (port.frames, port.stops) == ([frame], 1)


@pytest.mark.parametrize("power_off", [False, True])
def test_an_observer_stops_the_arm_and_the_log_says_who_did(port: FakePort, lease: Lease, power_off: bool) -> None:
    Client(port, lease).join()
    observer = Client(port, lease).join(Hello(ClientRole.OBSERVER, "", "onlooker"))
    assert [observer.say(Stop(power_off)) for _ in range(25)] == [[]] * 25
    assert (port.stops, port.power_offs) == ((0, 25) if power_off else (25, 0))
    done = "took arm power away" if power_off else "asked for a stop"
    assert observer.notes == [f"onlooker at 127.0.0.1:40000 {done}"] * 10
    with pytest.raises(LocalProtocolError, match="may not send PAYLOAD"):
        observer.say(Payload(1.0))


@pytest.mark.parametrize(
    "packet",
    [Signals(("a",)), Payload(1.0), Collision((1.0,) * 6), AnalogOutputs((1.0, *(nan,) * 7)), replace(MOVE, seq=1)],
    ids=lambda packet: type(packet).__name__,
)
def test_of_an_observer_the_bridge_takes_a_stop_and_nothing_else(
    port: FakePort, lease: Lease, packet: Signals | Payload | Collision | AnalogOutputs | Command
) -> None:
    Client(port, lease).join()
    observer = Client(port, lease).join(OBSERVER)
    (refusal,) = observer.say_bytes(encode(packet))
    assert (refusal.code, refusal.fatal) == (ErrorCode.MALFORMED, True)
    assert (port.frames, port.requests, port.names) == ([], [], ())
    assert (port.state.payload_mass, port.collision_told, hasattr(port, "analog")) == (0.0, False, False)


def test_names_of_signals_last_as_long_as_the_commander(port: FakePort, lease: Lease) -> None:
    client = Client(port, lease).join()
    client.say(Signals(("depth", "load")))
    assert port.names == ("depth", "load")
    client.say(replace(MOVE, seq=1, signals=(1.5, *(nan,) * 7)))
    assert port.frames[-1].signals[0] == 1.5
    client.say(Bye())
    assert port.names == ()


def test_a_payload_is_taken_or_refused_with_the_reason(port: FakePort, lease: Lease) -> None:
    client = Client(port, lease).join()
    assert client.say(Payload(2.0)) == []
    assert client.wait(PERIOD_NS)[0].robot.payload_mass == 2.0
    (refusal,) = client.say(Payload(nan))
    assert (refusal.code, refusal.fatal) == (ErrorCode.PAYLOAD_REFUSED, False)
    assert "no load for this arm" in refusal.text
    answers = [client.say(Payload(9.0)) for _ in range(25)]
    assert all(len(answer) == 1 for answer in answers)
    client.session.block(client.now_ns)
    assert client.say(Payload(9.0)) == []  # it does not read
    client.session.unblock()
    port.running = False
    client.wait(PERIOD_NS)
    client.wait(1_000_000_000)
    assert "the servo is away" in client.say(Payload(1.0))[0].text


def test_analogue_outputs_are_taken_or_refused_with_the_reason(port: FakePort, lease: Lease) -> None:
    client = Client(port, lease).join()
    asked = AnalogOutputs((nan, 2.5) + (nan,) * 6)
    assert client.say(asked) == []
    assert str(port.analog) == str(asked)  # NaN is not equal to itself
    (refusal,) = client.say(AnalogOutputs((6.0, *(nan,) * 7)))
    assert (refusal.code, refusal.fatal) == (ErrorCode.ANALOG_REFUSED, False)
    assert str(port.analog) == str(asked)
    port.running = False
    client.wait(PERIOD_NS)
    client.wait(1_000_000_000)
    assert "the servo is away" in client.say(asked)[0].text


def test_thresholds_of_a_collision_are_taken_or_refused_until_the_commander_leaves(
    port: FakePort, lease: Lease
) -> None:
    client = Client(port, lease).join()
    asked = Collision((10.0, 20.0, 5.0, 1.0, 1.0, 1.0), CollisionReaction.COMPLY)
    assert client.say(asked) == []
    assert port.collision == asked
    (refusal,) = client.say(Collision((60.0,) * 6))
    assert (refusal.code, refusal.fatal) == (ErrorCode.COLLISION_REFUSED, False)
    assert port.collision == asked
    client.say(Bye())
    assert port.collision == Collision((0.0,) * 6)
    port.collision = asked  # of an operator
    Client(port, lease).join().say(Bye())
    assert port.collision == asked


def test_thresholds_that_a_program_left_behind_with_a_killed_bridge_are_forgotten(port: FakePort) -> None:
    asked = Collision((10.0, 20.0, 5.0, 1.0, 1.0, 1.0), CollisionReaction.COMPLY)
    Client(port, Lease()).join().say(asked)  # and this bridge says no more
    Client(port, Lease()).join(OBSERVER)
    assert port.collision == asked
    Client(port, Lease()).join()
    assert port.collision == Collision((0.0,) * 6)


def test_control_characters_of_a_client_reach_neither_log_nor_terminal(port: FakePort, lease: Lease) -> None:
    client = Client(port, lease).join(Hello(ClientRole.COMMANDER, "puma560", "\x1b[2Jwipe\nfake: line"))
    assert client.session.label == "?[2Jwipe?fake: line at 127.0.0.1:40000"
    client.say(Bye("so\x07 long\r\x9b31m"))
    assert client.closed == "so? long??31m"


def test_a_client_has_to_show_the_token_of_the_bridge(port: FakePort, lease: Lease) -> None:
    for shown, welcome in ((b"", False), (b"tokem", False), (b"token", True)):
        client = Client(port, lease)
        client.session = Session("puma560", 6, lease, BridgeSettings(), Peer("127.0.0.1", 1), START_NS, token=b"token")
        (answer,) = client.say(replace(OBSERVER, auth=shown))
        assert isinstance(answer, Welcome) == welcome
        assert welcome or answer.code == ErrorCode.AUTHENTICATION


def test_observers_cannot_take_the_place_of_the_commander(port: FakePort, lease: Lease) -> None:
    places = Places(max_clients=3)
    clients = [Client(port, lease) for _ in range(4)]
    for client in clients:
        client.session = Session("puma560", 6, lease, BridgeSettings(), Peer("127.0.0.1", 1), START_NS, places=places)
    answers = [client.say(hello)[0] for client, hello in zip(clients, [OBSERVER] * 3 + [COMMANDER], strict=True)]
    assert [isinstance(answer, Welcome) for answer in answers] == [True, True, False, True]
    assert answers[2].code == ErrorCode.FULL
    clients[0].session.lose()
    assert places.take("another")
