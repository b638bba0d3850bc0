"""Both ways to a robot behave alike: lock-step and a socket."""

from __future__ import annotations

import socket
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager, suppress
from contextvars import copy_context
from dataclasses import replace

import pytest

from qrobot import arcl, multi_rccl, rccl
from qrobot.errors import (
    ConfigError,
    LinkBusy,
    LinkError,
    LinkLost,
    LinkTimeout,
    LocalProtocolError,
    RemoteProtocolError,
)
from qrobot.rci import Chg, Link, TcpLink, VirtualLink, bridge_address, hello_for
from qrobot.rci import tcp as tcp_module
from qrobot.rci.tcp import check_reachable
from qrobot.wire import Bye, ClientRole, Connection, ErrorCode, Hello, Payload, Side, State, Stop, Welcome, WireError
from tests.support.bridge import Bridge
from tests.support.fake_robot import FakeRobot, SocketRobot
from tests.support.packets import resting
from tests.support.patience import PATIENCE_S, give_time, wait_until

Q = (0.1, -0.2)
NOWHERE = ("127.0.0.1", 5600)


@contextmanager
def virtual_link(robot: FakeRobot, name: str) -> Iterator[Link]:
    yield VirtualLink(hello_for(name), robot.transfer)


@contextmanager
def socket_link(robot: FakeRobot, name: str) -> Iterator[Link]:
    with SocketRobot(robot) as server:
        yield TcpLink(hello_for(name), NOWHERE, lambda _: server.socket)


@pytest.fixture(params=[virtual_link, socket_link])
def make_link(request):
    with ExitStack() as stack:
        yield lambda robot, name="puma560": stack.enter_context(request.param(robot, name))


@pytest.mark.parametrize(
    "program",
    [
        lambda: rccl.control("puma560"),
        lambda: multi_rccl.rccl_control(multi_rccl.rccl_open("right", "puma560", ":5601")),
        lambda: arcl.arcl_open(arcl.ARCL_ROBOT, "puma560", arcl.ARCL_AMI, "bridge"),
    ],
    ids=["RCCL", "Multi-RCCL", "ARCL"],
)
def test_a_program_that_was_started_for_some_arms_reaches_no_other_one_but_to_look(
    monkeypatch: pytest.MonkeyPatch, program: Callable[[], object]
) -> None:
    monkeypatch.setenv("QROBOT_ONLY_BRIDGES", "127.0.0.1:5600,:5602")
    monkeypatch.setenv("QROBOT_BRIDGE", ":5601")
    with pytest.raises(ConfigError, match=r"the bridge at 127\.0\.0\.1:5601 is not for this program"):
        copy_context().run(program)
    for ours in (("127.0.0.1", 5600), ("127.0.0.1", 5602)):
        check_reachable(ours)
    with Bridge() as bridge:
        link = TcpLink(Hello(ClientRole.OBSERVER, "", "eyes", 5_000), bridge.server.address)
        link.open()
        link.close()


def test_what_is_told_goes_out_before_the_next_exchange_an_observers_stop_too() -> None:
    with Bridge() as bridge:
        link = TcpLink(Hello(ClientRole.OBSERVER, "", "eyes", 5_000), bridge.server.address)
        link.open()
        link.tell(Stop())
        link.tell(Stop(power_off=True))
        wait_until(lambda: link.exchange(None) and bridge.port.power_offs == 1)
        link.tell(Payload(1.0))
        with pytest.raises(LocalProtocolError, match="may not send PAYLOAD"):
            link.exchange(None)
        link.close()
    assert (bridge.port.stops, bridge.port.power_offs) == (1, 1)


@pytest.fixture
def robot() -> FakeRobot:
    return FakeRobot(Q, period_us=2_000)


def test_the_welcome_names_robot_joints_and_period(make_link, robot) -> None:
    link = make_link(robot)
    welcome = link.open()
    assert (welcome.robot, welcome.n, welcome.period_us) == ("puma560", 2, 2_000)
    link.close()


def test_each_exchange_brings_a_newer_state(make_link, robot) -> None:
    link = make_link(robot)
    link.open()
    seqs = [link.exchange(None).seq for _ in range(5)]
    assert seqs == sorted(set(seqs))
    link.close()


def test_a_command_reaches_the_robot_and_answers_its_state(make_link, robot) -> None:
    link, chg = make_link(robot), Chg(2)
    link.open()
    state = link.exchange(None)
    chg.hand = 2
    link.exchange(chg.command(state, link.now_ns()))
    wait_until(lambda: len(robot.commands) == 1)
    assert (robot.commands[0].seq, robot.commands[0].ack, robot.commands[0].hand) == (state.seq, state.seq, 2)
    link.close()


def test_closing_says_goodbye_once(make_link, robot) -> None:
    link = make_link(robot)
    link.open()
    link.close("done")
    link.close("done")
    wait_until(lambda: robot.goodbyes)
    give_time()  # for a second one
    assert robot.goodbyes == 1


def test_a_goodbye_arrives_though_states_were_left_unread() -> None:
    near, far = socket.socketpair()
    server = Connection(Side.SERVER)
    link = TcpLink(hello_for("puma560"), NOWHERE, lambda _: near)
    with far, ThreadPoolExecutor() as program:
        opening = program.submit(link.open)
        server.receive_data(far.recv(4096))
        assert isinstance(server.next_event(), Hello)
        far.sendall(server.send(Welcome(ClientRole.COMMANDER, "puma560", 2, 2_000)))
        opening.result()
        far.sendall(server.send(State(1, resting(Q))))
        closing = program.submit(link.close, "done")
        assert far.recv(4096, socket.MSG_PEEK)
        give_time()  # for a client that would not wait
        far.sendall(server.send(State(2, resting(Q))))
        server.receive_data(far.recv(4096))
        assert server.next_event() == Bye("done")
        far.close()
        closing.result()


def test_a_bridge_that_never_closes_its_end_is_left(monkeypatch) -> None:
    monkeypatch.setattr(tcp_module, "LINGER_S", 0.02)
    near, far = socket.socketpair()
    link = TcpLink(hello_for("puma560"), NOWHERE, lambda _: near)
    monkeypatch.setattr(tcp_module, "ANSWER_TIMEOUT_S", 0.02)
    with far:
        with pytest.raises(LinkTimeout):
            link.open()
        link.close()
        assert near.fileno() == -1


def test_a_refusal_arrives_with_the_servers_reason(make_link, robot) -> None:
    link = make_link(robot, "stanford")
    with pytest.raises(LinkError, match="refused: this is 'puma560', not 'stanford'"):
        link.open()
    link.close()


def refusing(code: ErrorCode):
    def transfer(data: bytes) -> bytes:
        server = Connection(Side.SERVER)
        server.receive_data(data)
        assert isinstance(server.next_event(), Hello)
        return server.send(WireError(code, "not you", True))

    return transfer


@pytest.mark.parametrize(
    ("code", "error"),
    [
        (ErrorCode.COMMANDER_BUSY, LinkBusy),
        (ErrorCode.FULL, LinkBusy),
        (ErrorCode.TIMEOUT, LinkTimeout),
        (ErrorCode.VERSION, LinkError),
    ],
)
def test_refusals_become_errors_a_program_can_tell_apart(code, error) -> None:
    with pytest.raises(error, match="the bridge in this process refused: not you"):
        VirtualLink(hello_for("puma560"), refusing(code)).open()


def test_a_far_end_that_talks_nonsense_is_said_to() -> None:
    with pytest.raises(RemoteProtocolError, match="does not speak our protocol"):
        VirtualLink(hello_for("puma560"), lambda _: b"HTTP/1.1 400 Bad Request").open()


def test_a_silent_server_is_given_up_and_its_last_warning_repeated() -> None:
    robot = FakeRobot(Q)
    link = VirtualLink(hello_for("puma560"), robot.transfer)
    link.open()
    warning = robot._connection.send(WireError(ErrorCode.SERVO_GONE, "the servo does not run", False))
    robot.tell = lambda: b""
    robot.hear = lambda _: warning
    with pytest.raises(LinkTimeout, match="fallen silent; its last words: the servo does not run"):
        link.exchange(None)


def exchange_often(link: Link) -> None:
    for _ in range(1000):
        link.exchange(None)


def test_a_server_that_vanishes_is_a_lost_link(robot) -> None:
    with SocketRobot(robot) as server:
        link = TcpLink(hello_for("puma560"), NOWHERE, lambda _: server.socket)
        link.open()
        server.hang_up()
        with pytest.raises(LinkLost, match=r"the bridge at 127\.0\.0\.1:5600"):
            exchange_often(link)
        link.close()


def test_a_socket_that_stays_silent_times_out(monkeypatch) -> None:
    monkeypatch.setattr(tcp_module, "ANSWER_TIMEOUT_S", 0.02)
    monkeypatch.setattr(tcp_module, "LINGER_S", 0.02)
    near, far = socket.socketpair()
    with far:
        link = TcpLink(hello_for("puma560"), NOWHERE, lambda _: near)
        with pytest.raises(LinkTimeout, match="fallen silent"):
            link.open()
        link.close()


def test_a_bridge_of_an_arm_in_step_may_be_silent_for_a_shorter_time_once_samples_come(robot, monkeypatch) -> None:
    monkeypatch.setattr(tcp_module, "STEP_TIMEOUT_S", 0.1)
    monkeypatch.setattr(tcp_module, "ANSWER_TIMEOUT_S", 10.0 * PATIENCE_S)
    with SocketRobot(robot) as server:
        link = TcpLink(replace(hello_for("puma560"), in_step=True), NOWHERE, lambda _: server.socket)
        link.open()
        link.exchange(None)
        robot.tell = lambda: b""
        with pytest.raises(LinkTimeout, match="fallen silent"):
            exchange_often(link)
        link.close()


def test_a_state_is_taken_when_it_has_come_whole_and_nobody_waits_for_the_rest(robot) -> None:
    """A warning, half of a packet, and nothing at all: a task that serves other robots goes on with them."""
    near, far = socket.socketpair()
    with far:
        far.sendall(robot.transfer(Connection(Side.CLIENT).send(hello_for("puma560"))))
        link = TcpLink(hello_for("puma560"), NOWHERE, lambda _: near)
        link.open()
        while link.take_state() is not None:  # that came with the greeting
            pass
        data = robot.tell()
        far.sendall(data[:20])
        assert link.take_state() is None
        far.sendall(data[20:] + robot.tell()[:7])
        first = link.take_state()
        assert first is not None
        assert link.take_state() is None
        far.close()
        with pytest.raises(LinkLost):
            link.take_state()
        link.close()


def test_nobody_at_the_address_is_one_clear_line() -> None:
    with socket.socket() as deaf:  # has the port, so that nobody else listens there
        deaf.bind(("127.0.0.1", 0))
        port = deaf.getsockname()[1]
        with pytest.raises(LinkLost, match=f"no bridge at 127.0.0.1:{port}: Connection refused; start one"):
            TcpLink(hello_for("puma560"), ("127.0.0.1", port)).open()


def test_a_link_that_was_closed_says_so(robot) -> None:
    link = TcpLink(hello_for("puma560"), NOWHERE, lambda _: socket.socketpair()[0])
    with pytest.raises(LinkLost, match="is closed"):
        link.exchange(None)


def test_a_real_connection_is_greeted() -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        link = TcpLink(hello_for("puma560"), listener.getsockname()[:2])
        listener.settimeout(PATIENCE_S)
        with suppress(LinkError), pytest.MonkeyPatch.context() as patch:
            patch.setattr(tcp_module, "ANSWER_TIMEOUT_S", 0.02)
            link.open()
        accepted, _ = listener.accept()
        with accepted:
            greeting = accepted.recv(4096)
        link.close()
    server = Connection(Side.SERVER)
    server.receive_data(greeting)
    hello = server.next_event()
    assert isinstance(hello, Hello)
    assert hello.robot == "puma560"


@pytest.mark.parametrize(
    ("text", "address"),
    [
        ("", ("127.0.0.1", 5600)),
        (":5601", ("127.0.0.1", 5601)),
        ("lab", ("lab", 5600)),
        ("lab:7000", ("lab", 7000)),
        ("::1:5601", ("::1", 5601)),
    ],
)
def test_the_bridges_address_may_be_given_in_parts(text, address, monkeypatch) -> None:
    assert bridge_address(text) == address
    monkeypatch.setenv("QROBOT_BRIDGE", text)
    assert bridge_address() == address


@pytest.mark.parametrize("text", ["lab:port", "lab:0", "lab:65536", "1:2:3", "::1"])
def test_an_impossible_address_is_refused_by_the_name_of_where_it_stands(text, monkeypatch) -> None:
    with pytest.raises(ConfigError, match=f"the address of a bridge is '{text}'; host:port is needed"):
        bridge_address(text)
    monkeypatch.setenv("QROBOT_BRIDGE", text)
    with pytest.raises(ConfigError, match=f"QROBOT_BRIDGE is '{text}'; host:port is needed"):
        bridge_address()


def test_the_blackboards_one_time_requests_go_out_once() -> None:
    robot = FakeRobot(Q)
    link, chg = VirtualLink(hello_for("puma560"), robot.transfer), Chg(2)
    link.open()
    state = link.exchange(None)
    chg.stop = chg.clear_fault = chg.key_held = True
    first, second = chg.command(state, 0), chg.command(state, 0)
    assert (first.stop, first.clear_fault, first.key_held) == (True, True, True)
    assert (second.stop, second.clear_fault, second.key_held) == (False, False, False)
    chg.go_to((0.3, 0.4))
    assert chg.command(state, 0).setpoints == (0.3, 0.4)
    assert set(chg.command(state, 0).modes) == {1}
    chg.hold()
    assert set(chg.command(state, 0).modes) == {0}
