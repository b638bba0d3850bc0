"""The bridge on real loopback sockets, with a servo that tracks perfectly."""

from __future__ import annotations

import asyncio
import errno
import fcntl
import os
import resource
import selectors
import signal
import socket
import struct
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pytest

from qrobot.config.deployment import load_deployment
from qrobot.errors import ConfigError, LinkBusy, LinkError
from qrobot.rccl_bridge import BridgeServer, BridgeSettings
from qrobot.rccl_bridge.listener import PreciseSelector
from qrobot.rccl_bridge.server import MAX_LINGERING, WRITE_BUFFER_BYTES, run_bridge
from qrobot.realtime.bridge_token import token_for
from qrobot.units import NS_PER_S
from qrobot.wire import Bye, ClientRole, Command, ErrorCode, Hello, JointMode, State, WireError
from tests.support.bridge import COMMANDER, OBSERVER, Bridge, Client
from tests.support.fake_port import FakePort
from tests.support.flood import flood
from tests.support.full_pipe import fill
from tests.support.patience import PATIENCE_S, wait_until
from tests.support.processes import FIRST_START_S, qrobot, write_deployment
from tests.support.signals import default_signals

PERIOD_NS = 1_000_000  # the shortest


def move_to(q: float, seq: int) -> Command:
    return Command(seq, (JointMode.POSITION,) * 6, (q,) * 6, power=True)


def test_a_program_moves_the_robot_by_answering_states() -> None:
    with Bridge() as bridge, bridge.connect() as client:
        client.join()
        for k in range(20):
            state = client.hear()
            client.say(move_to(0.01 * k, state.seq))
        client.say(Bye("done"))
        assert client.hear() is None
        assert bridge.port.state.q == (0.19,) * 6
        wait_until(lambda: bridge.port.stops == 1, "a BYE leaves a stop behind")


@pytest.mark.realtime
def test_states_keep_their_grid_over_a_second_at_one_kilohertz() -> None:
    with Bridge() as bridge, bridge.connect() as client:
        start_ns = time.monotonic_ns()  # before the grid begins, so that no stall can make a STATE look early
        client.join(Hello(ClientRole.OBSERVER, "", period_us=1_000))
        first = client.hear().seq

        def behind() -> float:
            """Periods by which the next STATE is heard after its point of a grid that began at the start."""
            points = client.hear().seq - first
            return (time.monotonic_ns() - start_ns) / PERIOD_NS - points

        until_first = (time.monotonic_ns() - start_ns) / PERIOD_NS
        while client.hear().seq < first + 1_000:
            pass
        most_punctual = min(behind() for _ in range(1_000))
        assert 0 <= most_punctual < 100 + until_first, f"{most_punctual} periods off the grid"


@pytest.mark.realtime
@pytest.mark.parametrize("told_at", ["asked", "read"])
def test_a_machine_that_stood_still_leaves_no_gap_in_the_grid_whenever_the_arm_tells_of_it(told_at: str) -> None:
    """The arm's time stood still as well, which it tells later: what the clock says meanwhile lies in the future."""
    stall_s = 0.5
    with Bridge() as bridge, bridge.connect() as client:
        client.join()
        numbers = [client.hear().seq]
        for stalls in (1, 2):  # the second one while the bridge is patient still
            bridge.stall(stall_s, told_at)
            while bridge.port.slipped < stalls * stall_s * NS_PER_S:
                numbers.append(client.hear().seq)
        numbers += [client.hear().seq for _ in range(20)]
        assert max(np.diff(numbers)) * COMMANDER.period_us < 0.5 * stall_s * 1e6


def test_a_servo_that_seems_to_be_away_at_one_look_is_looked_at_again() -> None:
    with Bridge() as bridge, bridge.connect() as client:
        client.join()
        client.hear()
        bridge.port.blind = 1
        assert all(isinstance(client.hear(), State) for _ in range(5))
        assert bridge.port.blind == 0


def test_a_socket_that_breaks_leaves_a_stop_and_a_free_lease() -> None:
    with Bridge() as bridge, bridge.connect() as client:
        client.join().say(move_to(0.1, 1))
        wait_until(lambda: bridge.port.frames, "the frame arrives")
        client.socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        client.socket.close()
        wait_until(lambda: bridge.port.stops == 1, "a reset leaves a stop behind")
        with bridge.connect() as heir:
            heir.join()


@pytest.mark.realtime
def test_a_half_open_commander_is_closed_after_a_second_of_silence() -> None:
    with Bridge(silence_ns=NS_PER_S) as bridge, bridge.connect() as client:
        start_ns = time.monotonic_ns()
        client.join().say(move_to(0.1, 1))
        while isinstance(event := client.hear(), State):
            pass
        assert isinstance(event, WireError)
        assert event.code == ErrorCode.TIMEOUT
        assert NS_PER_S < time.monotonic_ns() - start_ns < PATIENCE_S * 1e9
        assert client.hear() is None
        assert bridge.port.stops == 1


def test_a_malformed_packet_closes_that_client_only_with_one_clear_error() -> None:
    with Bridge() as bridge, bridge.connect() as watcher, bridge.connect() as vandal:
        watcher.join(OBSERVER)
        vandal.socket.sendall(b"GET / HTTP/1.1\r\nHost: robot\r\n\r\n" * 1_000)
        error = vandal.hear()
        assert isinstance(error, WireError)
        assert (error.code, error.fatal) == (ErrorCode.MALFORMED, True)
        assert "no packet begins with" in error.text
        assert vandal.hear() is None
        assert isinstance(watcher.hear(), State)


def test_a_second_commander_is_refused_and_the_first_goes_on() -> None:
    with Bridge() as bridge, bridge.connect() as first, bridge.connect() as second:
        first.join()
        second.say(COMMANDER)
        refusal = second.hear()
        assert (refusal.code, second.hear()) == (ErrorCode.COMMANDER_BUSY, None)
        first.say(move_to(0.1, first.hear().seq))
        wait_until(lambda: bridge.port.frames, "the lease holder still commands")


def test_the_eighth_observer_is_turned_away_and_the_place_of_the_commander_is_kept() -> None:
    with Bridge() as bridge, ExitStack() as crowd:
        clients = [crowd.enter_context(bridge.connect()).join(OBSERVER) for _ in range(7)]
        with bridge.connect() as eighth:
            eighth.say(OBSERVER)
            refusal = eighth.hear()
            assert (refusal.code, eighth.hear()) == (ErrorCode.FULL, None)
        crowd.enter_context(bridge.connect()).join(COMMANDER)
        clients[0].socket.close()
        wait_until(lambda: len(bridge.server.clients) == 7, "the place falls free")
        with bridge.connect() as another:
            another.join(OBSERVER)


def test_whoever_does_not_greet_gives_way_to_whoever_comes_after() -> None:
    with Bridge() as bridge, ExitStack() as crowd:
        mute = [crowd.enter_context(bridge.connect()) for _ in range(50)]
        with bridge.connect() as commander:
            commander.join(COMMANDER)
            refusals = [client.hear() for client in mute[:34]]  # sixteen may wait, and the commander came after
            assert {refusal.code for refusal in refusals} == {ErrorCode.FULL}
            assert isinstance(commander.hear(), State)
        wait_until(lambda: len(bridge.server.clients) <= 16 + MAX_LINGERING, "the others are gone")


def test_a_crowd_of_one_address_takes_no_time_to_greet_from_whoever_came_before_it_from_another() -> None:
    """Of those who have not greeted, the first to come of the most frequent address gives way, not the first of all."""
    with Bridge() as bridge, ExitStack() as crowd, bridge.connect("127.0.0.2") as slow:
        mute = [crowd.enter_context(bridge.connect("127.0.0.3")) for _ in range(40)]
        assert {client.hear().code for client in mute[:24]} == {ErrorCode.FULL}
        slow.join(COMMANDER)
        assert isinstance(slow.hear(), State)


@pytest.mark.realtime
def test_a_crowd_that_never_greets_is_gone_after_the_handshake_time() -> None:
    with Bridge(handshake_ns=200_000_000) as bridge, ExitStack() as crowd:
        silent = [crowd.enter_context(bridge.connect()) for _ in range(12)]
        assert {client.hear().code for client in silent} == {ErrorCode.TIMEOUT}
        assert [client.hear() for client in silent] == [None] * 12
        crowd.close()
        wait_until(lambda: not bridge.server.clients, "the places fall free")
        with bridge.connect() as client:
            client.join(OBSERVER)


def test_more_connections_than_select_can_count_leave_the_bridge_and_its_commander_alone() -> None:
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (min(hard, 4096), hard))
    try:
        with Bridge() as bridge, ExitStack() as crowd, bridge.connect() as commander:
            commander.join()
            for _ in range(1_050):
                crowd.enter_context(bridge.connect())
            commander.say(move_to(0.1, commander.hear().seq))
            wait_until(lambda: bridge.port.frames, "the commander still commands")
            with bridge.connect() as observer:
                observer.join(OBSERVER)
            assert bridge.port.stops == 0
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))


@pytest.mark.realtime
def test_connections_opened_at_full_speed_do_not_keep_the_bridge_from_its_commander() -> None:
    with Bridge() as bridge, bridge.connect() as commander:
        commander.join()
        with flood(bridge.server.address):
            for _ in range(200):
                commander.say(move_to(0.1, commander.hear().seq))
        assert bridge.port.stops == 0
        wait_until(lambda: len(bridge.port.frames) >= 190, "frames were forwarded all the while")


def test_a_client_without_the_token_is_sent_away_with_what_to_do() -> None:
    with Bridge() as bridge:
        bridge.server.token = b"secret"
        for role, auth in product(ClientRole, (b"", b"secre", b"secrets")):
            with bridge.connect() as client:
                client.say(Hello(role, "puma560", auth=auth))
                refusal = client.hear()
                assert (refusal.code, client.hear()) == (ErrorCode.AUTHENTICATION, None)
                assert "QROBOT_TOKEN" in refusal.text
        with bridge.connect() as client:
            client.join(Hello(ClientRole.COMMANDER, "puma560", auth=b"secret"))


def test_a_file_beyond_those_of_select_is_waited_for() -> None:
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (min(hard, 4096), hard))
    near, far = socket.socketpair()
    with near, far, PreciseSelector() as selector:
        high = fcntl.fcntl(near, fcntl.F_DUPFD, 1_500)
        try:
            selector.register(high, selectors.EVENT_READ, "high")
            assert selector.select(0.0) == []
            far.sendall(b"x")
            assert [key.data for key, _ in selector.select(PATIENCE_S)] == ["high"]
        finally:
            os.close(high)
            resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))


def test_a_reader_that_does_not_read_costs_bounded_memory_and_disturbs_nobody() -> None:
    with Bridge() as bridge, bridge.connect() as sleeper, bridge.connect() as watcher:
        sleeper.join(Hello(ClientRole.OBSERVER, "", period_us=1_000))
        watcher.join(OBSERVER)
        wait_until(lambda: any(c.session.left_out > 50 for c in list(bridge.server.clients)), "STATEs are left out")
        before = watcher.hear().seq
        assert watcher.hear().seq > before
        waiting = [client.transport.get_write_buffer_size() for client in list(bridge.server.clients)]
        assert max(waiting) < 2 * WRITE_BUFFER_BYTES
        last = sleeper.hear().seq
        while (seq := sleeper.hear().seq) < last + 50:  # what was left out shows as a gap
            last = seq


def test_a_servo_that_goes_and_comes_back_keeps_its_clients() -> None:
    with Bridge() as bridge, bridge.connect() as client:
        client.join(OBSERVER)
        assert isinstance(client.hear(), State)
        bridge.port.running = False
        while isinstance(event := client.hear(), State):
            pass
        assert (event.code, event.fatal) == (ErrorCode.SERVO_GONE, False)
        bridge.port.restart()
        assert client.hear().code == ErrorCode.SERVO_NEW
        assert isinstance(client.hear(), State)


def test_a_bridge_that_ends_says_bye_and_stops_the_arm() -> None:
    with Bridge() as bridge, bridge.connect() as client:
        client.join()
        bridge.begin_to_end()
        while isinstance(event := client.hear(), State):
            pass
        assert event.text == "the bridge ends"
        assert client.hear() is None
    assert bridge.port.stops == 1


def test_a_client_that_has_just_gone_does_not_keep_the_end_of_the_bridge_from_the_commander(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def not_connected() -> None:
        raise OSError(errno.ENOTCONN, "Transport endpoint is not connected")

    with Bridge() as bridge, bridge.connect() as watcher, bridge.connect() as commander:
        watcher.join(OBSERVER)
        monkeypatch.setattr(next(iter(bridge.server.clients)).transport, "write_eof", not_connected)
        commander.join()
        bridge.begin_to_end()
        while isinstance(event := commander.hear(), State):
            pass
        assert event.text == "the bridge ends"
    assert bridge.port.stops == 1


def test_a_taken_port_is_one_clear_line() -> None:
    with Bridge() as bridge:
        host, port = bridge.server.address
        second = BridgeServer(FakePort(), BridgeSettings(host, port))
        with pytest.raises(LinkBusy, match=f"{host}:{port} is in use"):
            asyncio.run(second.start())


def test_an_address_that_is_not_ours_is_one_clear_line() -> None:
    with pytest.raises(LinkError, match=r"cannot listen on 192\.0\.2\.1:0"):
        asyncio.run(BridgeServer(FakePort(), BridgeSettings("192.0.2.1", 0)).start())


def test_a_period_nobody_can_keep_is_refused_in_the_settings() -> None:
    with pytest.raises(ConfigError, match="999 µs"):
        BridgeSettings(period_us=999)


def test_nobody_can_connect_before_the_token_is_there(monkeypatch: pytest.MonkeyPatch) -> None:
    """Who connects has looked for the token: one that came later, in place of a killed bridge's, would be refused."""
    seen = []

    @contextmanager
    def offered(port: int, arm: str) -> Iterator[bytes]:
        with pytest.raises(ConnectionRefusedError):
            socket.create_connection(("127.0.0.1", port))
        yield b"secret"

    def ready(host: str, port: int) -> None:
        with socket.create_connection((host, port)):
            seen.append(port)
        os.kill(os.getpid(), signal.SIGTERM)

    monkeypatch.setattr("qrobot.rccl_bridge.server.offered_token", offered)
    run_bridge(FakePort(), BridgeSettings(port=0), ready)
    assert len(seen) == 1


PROCESS = """
from qrobot.rccl_bridge import BridgeSettings, run_bridge
from tests.support.fake_port import FakePort

class Port(FakePort):
    def request_stop(self):
        print("stop", flush=True)

run_bridge(Port(), BridgeSettings(port=0), lambda host, port: print(port, flush=True))
print("ended", flush=True)
"""


@pytest.mark.sampled(1)
@pytest.mark.realtime
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT, signal.SIGHUP])
def test_the_process_ends_cleanly_on_a_signal(number: int) -> None:
    with default_signals(signal.SIGHUP):
        process = subprocess.Popen([sys.executable, "-c", PROCESS], stdout=subprocess.PIPE, text=True)
    address = "127.0.0.1", int(process.stdout.readline())
    with process, Client(address) as client:
        client.join(replace(COMMANDER, auth=token_for(*address)))
        process.send_signal(number)
        while not isinstance(event := client.hear(), Bye):
            assert isinstance(event, State)
        client.socket.close()
        assert process.stdout.read().split() == ["stop", "ended"]
        assert process.wait(PATIENCE_S) == 0


@pytest.mark.realtime
def test_a_terminal_that_is_held_holds_up_no_client(tmp_path: Path) -> None:
    (arm,) = load_deployment(write_deployment(tmp_path)).arm
    address = arm.bridge.host, arm.bridge.port
    source, sink = os.pipe()
    fill(sink)
    with qrobot("bridge", tmp_path / "arms.toml", stderr=sink) as process, open(source, "rb") as terminal:
        os.close(sink)
        wait_until(lambda: token_for(*address), "the bridge's token", FIRST_START_S)
        for _ in range(2):
            with Client(address) as client:
                client.join(replace(OBSERVER, auth=token_for(*address)))
                client.say(Bye())
                assert client.hear() is None
        address_told = f"listens on {address[0]}:{address[1]}".encode()
        assert any(address_told in line for line in terminal)  # while it runs: its end waits a second for its lines
        process.terminate()
        terminal.read()
    assert process.returncode == 0


def test_a_client_that_was_sent_away_and_goes_on_talking_is_cut() -> None:
    """Its bytes are read, so that the last words arrive; reading without end would cost every arm's bridge time."""
    with Bridge() as bridge, bridge.connect() as client:
        client.socket.sendall(b"no packet at all" * 8)
        with pytest.raises((ConnectionResetError, BrokenPipeError)):
            client.socket.sendall(bytes(16 << 20))
