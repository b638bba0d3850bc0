"""CAN over multicast on this machine: nodes of one account hear each other, and nobody else is heard."""

from __future__ import annotations

import os
import socket
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from functools import partial

import can
import pytest
from can.interfaces.udp_multicast.utils import pack_message

from qrobot.errors import LinkBusy, LinkError
from qrobot.hwif.canbus.interface import open_interface
from qrobot.hwif.canbus.multicast import LocalMulticast
from tests.support.accounts import OTHER, as_other_account, needs_root
from tests.support.patience import PATIENCE_S
from tests.support.processes import free_port

GROUP = "239.74.163.2"
IP_MULTICAST_ALL = 49  # linux/in.h


@pytest.fixture
def port() -> int:
    return free_port()


@pytest.fixture
def bus(port: int) -> Iterator[LocalMulticast]:
    with LocalMulticast(f"{GROUP}/{port}") as opened:
        yield opened


def frame(can_id: int) -> can.Message:
    return can.Message(arbitration_id=can_id, data=bytes(8), is_extended_id=False)


def heard(bus: LocalMulticast) -> int:
    message = bus.recv(PATIENCE_S)
    assert message is not None
    return message.arbitration_id


@contextmanager
def sender(address: str, port: int, *options: int) -> Iterator[socket.socket]:
    """A socket that sends to the loopback interface, bound as it says."""
    family = socket.AF_INET6 if ":" in address else socket.AF_INET
    with socket.socket(family, socket.SOCK_DGRAM) as opened:
        for option in options:
            opened.setsockopt(socket.SOL_SOCKET, option, 1)
        opened.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton("127.0.0.1"))
        opened.bind((address, port))
        yield opened


@contextmanager
def account_of_others() -> Iterator[None]:
    """Sockets that are made inside belong to another account."""
    os.seteuid(OTHER)
    try:
        yield
    finally:
        os.seteuid(0)


def test_nodes_of_one_account_hear_each_other_and_themselves(bus: LocalMulticast, port: int) -> None:
    with LocalMulticast(f"{GROUP}/{port}") as another:
        another.send(frame(0x701))
        bus.send(frame(0x702))
        assert [heard(bus), heard(bus)] == [heard(another), heard(another)] == [0x701, 0x702]
    assert bus.refused == 0


def test_a_program_with_python_can_s_own_interface_is_heard(bus: LocalMulticast, port: int) -> None:
    with sender("", port, socket.SO_REUSEADDR, socket.SO_REUSEPORT) as theirs:  # as python-can binds its socket
        theirs.sendto(pack_message(frame(0x703)), (GROUP, port))
        assert heard(bus) == 0x703


def test_a_frame_from_another_port_is_passed_over_without_a_pause(bus: LocalMulticast, port: int) -> None:
    with sender("127.0.0.1", 0) as stranger:
        for _ in range(5):
            stranger.sendto(pack_message(frame(0x601)), (GROUP, port))
    bus.send(frame(0x704))
    message = bus.recv(0.0)
    assert message is not None
    assert (message.arbitration_id, bus.refused) == (0x704, 5)


@needs_root
def test_another_account_commands_no_board(bus: LocalMulticast, port: int) -> None:
    def join() -> str:
        with open_interface("udp_multicast", f"{GROUP}/{port}") as theirs:
            theirs.send(frame(0x601))
        return "sent"

    def send_from(address: str, *options: int) -> str:
        with sender(address, port, *options) as theirs:
            theirs.sendto(pack_message(frame(0x601)), (GROUP, port))
        return "sent"

    def send_from_elsewhere() -> str:
        with sender("", 0) as theirs:
            theirs.sendto(pack_message(frame(0x601)), (GROUP, port))
        return "sent"

    assert "LinkBusy" in as_other_account(join)
    for address in ("", "127.0.0.1", "127.0.0.2", GROUP, "::", "::1", "::ffff:127.0.0.1"):
        for options in ((), (socket.SO_REUSEADDR,), (socket.SO_REUSEPORT,), (socket.SO_REUSEADDR, socket.SO_REUSEPORT)):
            said = as_other_account(partial(send_from, address, *options))
            assert "Address already in use" in said or "family not supported" in said, (address, options)
    assert as_other_account(send_from_elsewhere) == "sent"
    bus.send(frame(0x705))
    assert (heard(bus), bus.refused) == (0x705, 1)


@needs_root
@pytest.mark.parametrize("with_ours", [False, True])
def test_a_port_that_another_account_has_is_told_and_not_used(port: int, with_ours: bool) -> None:
    """Also one that it shares with a program of ours, behind which the kernel looks no further."""
    with ExitStack() as open_sockets:
        with account_of_others():
            open_sockets.enter_context(sender("", port, socket.SO_REUSEADDR))
        if with_ours:
            open_sockets.enter_context(sender("", port, socket.SO_REUSEADDR, socket.SO_REUSEPORT))
        with pytest.raises(LinkBusy, match=f"UDP port {port} is in use by another account"):
            open_interface("udp_multicast", f"{GROUP}/{port}")


def test_a_port_of_a_program_that_does_not_share_it_is_told(port: int) -> None:
    with sender("127.0.0.1", port), pytest.raises(LinkBusy, match="choose another port"):
        LocalMulticast(f"{GROUP}/{port}")


def test_what_comes_by_other_interfaces_is_not_taken(bus: LocalMulticast) -> None:
    with socket.socket(fileno=os.dup(bus.fileno())) as shared:
        assert shared.getsockopt(socket.IPPROTO_IP, IP_MULTICAST_ALL) == 0


def test_a_socket_that_cannot_be_had_leaves_none_open(monkeypatch: pytest.MonkeyPatch, port: int) -> None:
    def refuse(*_: object) -> None:
        raise OSError("no such device")

    with monkeypatch.context() as patch:
        patch.setattr("qrobot.hwif.canbus.multicast._join", refuse)
        with pytest.raises(LinkError, match="no such device"):
            open_interface("udp_multicast", f"{GROUP}/{port}")
    with sender("", port):
        pass
