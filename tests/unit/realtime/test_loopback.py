"""The account at the far end of a connection: the kernel's answer about one socket, and what its tables say."""

from __future__ import annotations

import os
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from qrobot.realtime import loopback
from qrobot.realtime.loopback import is_loopback, maybe_account_between, maybe_peer_account
from qrobot.realtime.socket_diag import is_answered
from tests.support.accounts import OTHER, as_other_account, needs_root

WAYS = ("tables", "kernel") if is_answered() else ("tables",)
PLACES = [(socket.AF_INET, "127.0.0.1"), (socket.AF_INET, "127.3.2.1"), (socket.AF_INET6, "::1")]


@pytest.fixture(params=WAYS, autouse=True)
def way(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """One way to the answer, and none to the other."""
    monkeypatch.setattr(loopback, "is_answered", lambda: request.param == "kernel")
    if request.param == "kernel":
        monkeypatch.setattr(loopback, "TABLES", (Path("/no/table"),))
    return str(request.param)


@pytest.mark.parametrize(
    ("host", "inside"),
    [
        ("127.0.0.1", True),
        ("127.9.8.7", True),
        ("::1", True),
        ("::ffff:127.0.0.1", True),
        ("10.0.0.1", False),
        ("::", False),
        ("robot", False),
        ("", False),
    ],
)
def test_which_addresses_are_of_the_loopback_interface(host: str, inside: bool) -> None:
    assert is_loopback(host) == inside


@contextmanager
def met(server: socket.socket, client: socket.socket, address: tuple[str, int]) -> Iterator[socket.socket]:
    """The server's end of a connection of `client`."""
    client.connect(address)
    connection, _ = server.accept()
    with connection:
        yield connection


@pytest.mark.parametrize(("family", "host"), PLACES)
def test_a_peer_is_known_by_its_account_until_it_hangs_up(family: socket.AddressFamily, host: str) -> None:
    try:
        server = socket.create_server((host, 0), family=family)
    except OSError:
        assert family == socket.AF_INET6  # a machine without IPv6
        return
    with server, socket.socket(family) as client, met(server, client, server.getsockname()) as connection:
        assert maybe_peer_account(connection) == os.geteuid()
        client.close()
        assert maybe_peer_account(connection) is None


def test_who_is_not_connected_has_no_peer() -> None:
    with socket.socket() as unconnected:
        assert maybe_peer_account(unconnected) is None


@pytest.mark.parametrize("family", [socket.AF_INET, socket.AF_INET6])
def test_an_address_of_ipv4_that_is_written_as_one_of_ipv6_is_the_same(family: socket.AddressFamily) -> None:
    try:
        server = socket.create_server(("::", 0), family=socket.AF_INET6, dualstack_ipv6=True)
    except OSError:  # a machine without IPv6
        return
    host = "127.0.0.1" if family == socket.AF_INET else "::ffff:127.0.0.1"
    address = (host, server.getsockname()[1])
    with server, socket.socket(family) as client, met(server, client, address) as connection:
        assert connection.getpeername()[0] == "::ffff:127.0.0.1"
        assert maybe_peer_account(connection) == os.geteuid()


def test_a_peer_that_is_tied_to_the_interface_is_known_too() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server, socket.socket() as client:
        client.setsockopt(socket.SOL_SOCKET, socket.SO_BINDTODEVICE, b"lo")
        with met(server, client, server.getsockname()) as connection:
            assert maybe_peer_account(connection) == os.geteuid()


def test_who_listens_at_an_address_is_nobody_s_peer() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        assert maybe_account_between(server.getsockname(), ("127.0.0.1", 1)) is None
        assert maybe_account_between(server.getsockname(), ("::1", 1)) is None
        assert maybe_account_between(server.getsockname(), ("nowhere", 1)) is None


@needs_root
def test_a_peer_of_another_account_is_known_by_that_and_by_none_once_it_has_gone() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:

        def visit() -> int | None:
            with socket.socket() as client, met(server, client, server.getsockname()) as connection:
                return maybe_peer_account(connection)

        def leave() -> None:
            with socket.socket() as client:
                client.connect(server.getsockname())

        assert as_other_account(visit) == str(OTHER)
        assert as_other_account(leave) == "None"
        connection, _ = server.accept()
        with connection:
            assert maybe_peer_account(connection) is None


@pytest.mark.parametrize("said", [OSError("no memory"), None])
def test_of_a_peer_that_the_kernel_does_not_tell_nobody_is_known(
    way: str, monkeypatch: pytest.MonkeyPatch, said: OSError | None
) -> None:
    def tell(*_: object) -> None:
        if said is not None:
            raise said

    monkeypatch.setattr(loopback, "maybe_socket", tell)
    server = socket.create_server(("127.0.0.1", 0))
    with server, socket.socket() as client, met(server, client, server.getsockname()) as connection:
        assert maybe_peer_account(connection) == (None if way == "kernel" else os.geteuid())
