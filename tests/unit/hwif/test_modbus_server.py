"""The Modbus server: exception codes, rubbish of every kind, and the errors its client makes of answers."""

from __future__ import annotations

import socket
import struct
from collections.abc import Iterator
from contextlib import ExitStack

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from qrobot.errors import ConfigError, LinkBusy, LinkError, LinkLost, ProtocolError, RemoteProtocolError
from qrobot.hwif.bus import safe_operations
from qrobot.hwif.image import make_image
from qrobot.hwif.modbus import server
from qrobot.hwif.modbus.client import ModbusBus, ModbusLine
from qrobot.hwif.modbus.device import ModbusDevice
from qrobot.hwif.modbus.map import IDENTITY, IMAGE, MAILBOX, ROBOT, WINDOW_WORDS
from qrobot.hwif.modbus.server import MAX_CALLERS, ModbusServer, frames, split_address
from qrobot.hwif.operations import OP_WRITE
from qrobot.hwif.registers import DAC, ENC_COUNT, ENC_LOAD, STATUS_ESTOP_OK, STATUS_POWER
from tests.support.accounts import as_other_account, needs_root
from tests.support.paper_board import PaperBoard
from tests.support.patience import MOMENT_S, PATIENCE_S, wait_until
from tests.support.relay import Relay, as_it_came
from tests.support.thorough import examples
from tests.support.virtual_clock import VirtualClock

ILLEGAL_FUNCTION, ILLEGAL_ADDRESS, ILLEGAL_VALUE, DEVICE_FAILURE, DEVICE_BUSY = 1, 2, 3, 4, 6


class Far:
    """A server over a board of paper."""

    def __init__(self, server: ModbusServer, board: PaperBoard) -> None:
        self.server, self.board, self.device = server, board, server.device

    def line(self) -> ModbusLine:
        line = ModbusLine(*self.server.address, timeout_s=PATIENCE_S)
        line.connect()
        return line

    def socket(self) -> socket.socket:
        return socket.create_connection(self.server.address, timeout=PATIENCE_S)

    def until(self, counter: str, value: int) -> None:
        wait_until(lambda: getattr(self.device, counter) >= value, f"{counter} reaches {value}")


@pytest.fixture(scope="module")
def shared() -> Iterator[Far]:
    board = PaperBoard()
    with ModbusServer(ModbusDevice(board, watchdog_ms=0, now_ns=VirtualClock())) as served:
        yield Far(served, board)


@pytest.fixture
def far(shared: Far) -> Far:
    shared.board.gone = shared.board.full = False
    shared.board.applied.clear()
    return shared


def frame(request: bytes, transaction: int = 1, unit: int = 1) -> bytes:
    return struct.pack(">HHHB", transaction, 0, len(request) + 1, unit) + request


def ask(sock: socket.socket, request: bytes) -> bytes:
    sock.sendall(frame(request))
    return sock.recv(300)[7:]


# ------------------------------------------------------------------------------------------------------- who we serve


def test_any_client_reads_counts_and_bits_and_writes_converters(far: Far) -> None:
    far.board.inputs[ENC_COUNT // 2] = 4711
    far.board.status = STATUS_POWER | STATUS_ESTOP_OK
    line = far.line()
    client = line.client
    assert line.registers(client.read_input_registers, 6, address=ENC_COUNT // 2, count=6)[0] == 4711
    assert line.registers(client.read_holding_registers, 6, address=ENC_COUNT // 2, count=6)[0] == 4711
    bits = line.ask(client.read_discrete_inputs, address=0, count=16).bits
    assert [bit for bit in range(16) if bits[bit]] == [0, 15]
    line.ask(client.write_register, address=DAC // 2, value=0x123)
    line.ask(client.write_registers, address=ENC_LOAD // 2, values=[7, 8])
    line.ask(client.write_coil, address=0, value=True)
    line.ask(client.mask_write_register, address=DAC // 2, and_mask=0xFF0, or_mask=4)
    assert line.ask(client.read_coils, address=0, count=1).bits[0]
    values = [value for _, _, value in far.board.applied]
    assert values == [0x123, 7, 8, values[3], 0x124]
    assert values[3] & 1
    line.close()


@pytest.mark.parametrize(
    ("request_", "code"),
    [
        (bytes([6, 0, 3, 0, 1]), ILLEGAL_ADDRESS),  # an input word is not written
        (bytes([3, 0, WINDOW_WORDS, 0, 1]), ILLEGAL_ADDRESS),
        (bytes([3, 0, WINDOW_WORDS - 1, 0, 2]), ILLEGAL_ADDRESS),
        (bytes([4, ROBOT >> 8, ROBOT & 0xFF, 0, 1]), ILLEGAL_ADDRESS),  # there is no servo here
        (bytes([1, 0, 16, 0, 1]), ILLEGAL_ADDRESS),
        (bytes([3, 0, 0, 0, 126]), ILLEGAL_VALUE),
        (bytes([3, 0, 0]), ILLEGAL_VALUE),
        (bytes([16, 0, 24, 0, 2, 3, 0, 1, 0]), ILLEGAL_VALUE),
        (bytes([16, 0, MAILBOX, 0, 1, 2, 0, 1]), ILLEGAL_VALUE),
        (bytes([8, 0, 4, 0, 0]), ILLEGAL_FUNCTION),  # nobody forces this device to listen only
        (bytes([43, 14, 1, 0]), ILLEGAL_FUNCTION),
        (bytes([99]), ILLEGAL_FUNCTION),
    ],
)
def test_a_bad_request_gets_the_exception_code_for_it_and_moves_nothing(far: Far, request_: bytes, code: int) -> None:
    with far.socket() as sock:
        assert ask(sock, request_) == bytes([request_[0] | 0x80, code])
    assert not far.board.applied


def test_a_second_writer_and_a_board_that_is_away_have_codes_of_their_own(far: Far) -> None:
    write, read = bytes([6, 0, DAC // 2, 8, 0]), bytes([3, 0, 0, 0, 1])
    with far.socket() as first, far.socket() as second:
        assert ask(first, write) == write
        assert ask(second, write) == bytes([0x86, DEVICE_BUSY])
        assert ask(second, read)[0] == 3
        far.board.gone = True
        assert ask(first, write) == bytes([0x86, DEVICE_FAILURE])
        assert ask(second, read) == bytes([0x83, DEVICE_FAILURE])


def test_a_client_is_told_that_another_keeps_the_control_and_may_wait_for_it(far: Far) -> None:
    lines = [ModbusLine(*far.server.address, timeout_s=PATIENCE_S) for _ in range(2)]
    keeper, waiter = map(ModbusBus, lines)
    keeper.connect()
    keeper.exchange(safe_operations(0), make_image())
    lines[1].timeout_s = MOMENT_S  # with the control; the answers may take their time
    with pytest.raises(LinkBusy, match="another client"):
        waiter.connect()
    lines[1].timeout_s = PATIENCE_S
    keeper.close()
    assert waiter.connect().joints == 6
    waiter.close()


def test_the_watchdog_acts_between_requests() -> None:
    board, clock_ns = PaperBoard(), [0]
    with ModbusServer(ModbusDevice(board, watchdog_ms=20, now_ns=lambda: clock_ns[0])) as served:
        far = Far(served, board)
        line = far.line()
        line.ask(line.client.write_register, address=DAC // 2, value=0)
        clock_ns[0] = 21_000_000
        far.until("trips", 1)
        wait_until(lambda: (OP_WRITE, DAC, 0x800) in board.applied, "the board is made safe")
        line.ask(line.client.write_register, address=DAC // 2, value=1)
        assert board.applied[-1] == (OP_WRITE, DAC, 1)
        line.close()


def test_two_servers_cannot_have_one_address(far: Far) -> None:
    with (
        pytest.raises(LinkBusy, match="is the port taken"),
        ModbusServer(ModbusDevice(PaperBoard(), now_ns=VirtualClock()), *far.server.address),
    ):
        pass


# -------------------------------------------------------------------------------------------------------------- crowds


def test_a_crowd_that_asks_for_nothing_is_closed_before_a_client_that_does(far: Far) -> None:
    read = bytes([3, 0, 0, 0, 1])
    with ExitStack() as crowd, far.socket() as client:
        assert ask(client, read)[0] == 3
        for _ in range(100):
            crowd.enter_context(far.socket())
        assert ask(client, read)[0] == 3
        with far.socket() as another:
            assert ask(another, read)[0] == 3
        wait_until(lambda: len(far.server.callers) <= MAX_CALLERS, "the others are closed")


def test_a_client_that_does_not_read_holds_little_memory_and_the_others_are_served(far: Far) -> None:
    read = bytes([3, 0, 0, 0, 32])
    with far.socket() as deaf, far.socket() as client:
        deaf.setblocking(False)
        sent, full = 0, False
        while not full and sent < 20_000_000:
            try:
                sent += deaf.send(frame(read) * 5_000)
            except BlockingIOError:
                assert ask(client, read)[0] == 3  # the server has had its turn
                full = not _accepts(deaf, frame(read))
        assert full
        assert max(caller.waiting_bytes for caller in list(far.server.callers)) < 400_000
        assert ask(client, read)[0] == 3


def _accepts(sock: socket.socket, data: bytes) -> bool:
    try:
        return sock.send(data) > 0
    except BlockingIOError:
        return False


def test_a_client_that_is_silent_for_too_long_is_closed(far: Far, monkeypatch: pytest.MonkeyPatch) -> None:
    with far.socket() as silent:
        wait_until(lambda: len(far.server.callers) > 0, "it is connected")
        monkeypatch.setattr(server, "SILENCE_NS", -1)
        assert silent.recv(1) == b""


@needs_root
def test_another_account_of_this_machine_reaches_no_board(far: Far) -> None:
    write = bytes([6, 0, DAC // 2, 0, 9])

    def command() -> bytes:
        with far.socket() as sock:
            return ask(sock, write)

    said = as_other_account(command)
    assert said == "b''" or "Error" in said
    assert not far.board.applied


@pytest.mark.parametrize("host", ["0.0.0.0", "::", "192.0.2.7", "robot"])
def test_a_server_for_the_whole_network_is_refused_unless_clients_are_named(host: str) -> None:
    with pytest.raises(ConfigError, match="name those that may"):
        ModbusServer(ModbusDevice(PaperBoard(), now_ns=VirtualClock()), host, 0)
    with pytest.raises(ConfigError, match="client of a Modbus server"):
        ModbusServer(ModbusDevice(PaperBoard(), now_ns=VirtualClock()), host, 0, ["neighbour"])


def test_clients_from_elsewhere_are_those_that_were_named() -> None:
    assert split_address("0.0.0.0:1502@50+10.0.0.0/24,10.1.1.1") == (
        "0.0.0.0", 1502, 50.0, ("10.0.0.0/24", "10.1.1.1"),
    )  # fmt: skip
    with ModbusServer(ModbusDevice(PaperBoard(), now_ns=VirtualClock()), "0.0.0.0", 0, ["10.0.0.0/24"]) as open_server:
        far = Far(open_server, PaperBoard())
        with socket.create_connection(("127.0.0.1", far.server.address[1]), PATIENCE_S) as local:
            assert ask(local, bytes([3, 0, 0, 0, 1]))[0] == 3


# ------------------------------------------------------------------------------------------------------------ rubbish


def test_requests_sent_without_waiting_are_answered_one_after_the_other(far: Far) -> None:
    requests = [bytes([6, 0, DAC // 2, 0, value]) for value in range(20)]
    with far.socket() as sock:
        sock.sendall(b"".join(frame(request, n) for n, request in enumerate(requests)))
        answers = bytearray()
        while len(answers) < 12 * len(requests):
            answers += sock.recv(4096)
    assert list(frames(answers)) == [(n, 1, request) for n, request in enumerate(requests)]
    assert [value for _, _, value in far.board.applied] == list(range(20))


def test_a_request_that_comes_in_pieces_is_a_request(far: Far) -> None:
    with far.socket() as sock:
        for byte in frame(bytes([6, 0, DAC // 2, 0, 9])):
            sock.sendall(bytes([byte]))
        assert sock.recv(300)[7:] == bytes([6, 0, DAC // 2, 0, 9])


@pytest.mark.parametrize(
    "data", [b"GET / HTTP/1.1\r\n\r\n", struct.pack(">HHHB", 1, 0, 300, 1), struct.pack(">HHHB", 1, 0, 1, 1)]
)
def test_who_does_not_speak_modbus_is_cut_off_and_counted(far: Far, data: bytes) -> None:
    before = far.device.bad
    with far.socket() as sock:
        sock.sendall(data)
        assert sock.recv(10) == b""
    far.until("bad", before + 1)


@settings(max_examples=examples(40), deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.lists(st.binary(max_size=60), min_size=1, max_size=4))
def test_bytes_of_any_kind_neither_stop_the_server_nor_move_the_arm(far: Far, chunks: list[bytes]) -> None:
    with far.socket() as sock:
        for chunk in chunks:
            try:
                sock.sendall(chunk)
            except OSError:
                break
    assert _is_well(far)


@settings(max_examples=examples(60), deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.integers(0, 127), st.binary(max_size=252))
def test_a_request_of_any_content_is_answered_or_refused(far: Far, function: int, content: bytes) -> None:
    before = len(far.board.applied)
    with far.socket() as sock:
        answer = ask(sock, bytes([function, *content]))
    assert answer[0] in (function, function | 0x80)
    if answer[0] != function:
        assert 1 <= answer[1] <= DEVICE_BUSY
        assert len(far.board.applied) == before


def _is_well(far: Far) -> bool:
    bus = ModbusBus(ModbusLine(*far.server.address, timeout_s=PATIENCE_S))
    bus.connect()
    bus.close()
    return not far.board.applied


@settings(max_examples=examples(40), deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.binary(min_size=1, max_size=64), st.integers(0, 12))
def test_an_answer_of_any_content_is_an_error_of_ours_or_an_image(far: Far, wild: bytes, at: int) -> None:
    with Relay(far.server.address) as relay:
        bus = ModbusBus(ModbusLine("127.0.0.1", relay.port, timeout_s=MOMENT_S))
        image = make_image()
        relay.spoil = lambda data: data[:at] + wild + data[at + len(wild) :]
        try:
            bus.connect()
            bus.exchange(safe_operations(0), image)
        except (LinkError, ProtocolError):
            assert not image.any()
        relay.spoil = as_it_came
        bus.close()


# ------------------------------------------------------------------------------------------------------------- client


def test_a_device_that_is_no_board_of_ours_is_told_by_its_exception(far: Far) -> None:
    line = far.line()
    with pytest.raises(RemoteProtocolError, match="exception 2"):
        line.registers(line.client.read_input_registers, 1, address=IDENTITY + 20, count=1)
    line.close()
    with pytest.raises(LinkLost, match="not connected"):
        line.registers(line.client.read_input_registers, 1, address=IMAGE, count=1)


def test_nobody_at_the_address_is_told_with_what_to_look_at() -> None:
    with socket.socket() as deaf:  # has the port, so that nobody else listens there
        deaf.bind(("127.0.0.1", 0))
        with pytest.raises(LinkError, match="is the server running"):
            ModbusBus(ModbusLine(*deaf.getsockname(), timeout_s=PATIENCE_S)).connect()
