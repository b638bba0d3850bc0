"""The transport to a board behind Modbus TCP: one request with writes and reads (function 23) for an exchange."""

from __future__ import annotations

import socket
from collections.abc import Callable, Sequence
from typing import Any, Final

from pymodbus.client import ModbusTcpClient
from pymodbus.constants import ExcCodes
from pymodbus.exceptions import ConnectionException, ModbusException
from pymodbus.pdu import ModbusPDU

from qrobot.arrays import Words
from qrobot.config.modbus import ModbusTransport
from qrobot.errors import LinkBusy, LinkError, LinkLost, LinkTimeout, RemoteProtocolError
from qrobot.hwif.bus import BoardFacts, Operations
from qrobot.hwif.modbus.map import (
    ANOTHER,
    APPLIED,
    CONTROL,
    IDENTITY,
    IDENTITY_REGISTERS,
    IMAGE,
    IMAGE_REGISTERS,
    MAILBOX,
    MAX_OPERATIONS,
    WORD_MASK,
    decode_identity,
    decode_image,
    encode_operations,
)
from qrobot.realtime.deadline import Deadline, sleep_between_looks
from qrobot.units import MS_PER_S

DEFAULT_PORT: Final = 502
TIMEOUT_S: Final = 0.1
POLL_S: Final = 0.01
RequestPdu = Callable[..., ModbusPDU]


class ModbusLine:
    """A connection to any Modbus TCP device, with errors of ours.

    Args:
        host: name or address.
        port: of the server.
        device_id: unit identifier; matters behind a gateway to a serial line.
        timeout_s: patience with an answer.
    """

    def __init__(self, host: str, port: int = DEFAULT_PORT, device_id: int = 1, timeout_s: float = TIMEOUT_S) -> None:
        self.name = f"Modbus {host}:{port}, unit {device_id}"
        self._device_id = device_id
        self.timeout_s = timeout_s
        self.client = ModbusTcpClient(host, port=port, timeout=timeout_s, retries=0)

    def connect(self) -> None:
        """Open it, anew if it was open. Raises LinkError."""
        self.close()
        if not self.client.connect():
            raise LinkError(f"{self.name} cannot be reached: is the server running, the address right, the cable in?")
        open_socket: Any = self.client.socket
        open_socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def ask(self, request: RequestPdu, **arguments: Any) -> ModbusPDU:
        """Make a request, one of the methods of `client`, and wait for its answer.

        Raises:
            LinkTimeout: no answer came in time, or none that could be read.
            LinkLost: not connected, or not any more.
            LinkBusy, LinkError, RemoteProtocolError: the device refused, by the exception code of its answer.
        """
        if not self.client.connected:
            raise LinkLost(f"{self.name} is not connected")
        try:
            answer = request(device_id=self._device_id, **arguments)
        except (ConnectionException, OSError) as error:
            self.close()
            raise LinkLost(f"{self.name} has closed the connection") from error
        except ModbusException as error:
            self.close()  # what comes late must not be taken for the answer to something else
            raise LinkTimeout(f"{self.name} gave no answer within {self.timeout_s * 1e3:g} ms") from error
        if answer.isError():
            raise self._refusal(answer.exception_code)
        return answer

    def registers(self, request: RequestPdu, expected: int, **arguments: Any) -> list[int]:
        """`ask` for `expected` registers. Raises RemoteProtocolError when another number comes as well."""
        registers = list(self.ask(request, **arguments).registers)
        if len(registers) != expected:
            raise RemoteProtocolError(f"{self.name} answered with {len(registers)} registers instead of {expected}")
        return registers

    def bits(self, request: RequestPdu, expected: int, **arguments: Any) -> list[bool]:
        """`ask` for `expected` bits, which come in whole bytes. Raises RemoteProtocolError when fewer come as well."""
        bits = list(self.ask(request, **arguments).bits)
        if len(bits) < expected:
            raise RemoteProtocolError(f"{self.name} answered with {len(bits)} bits instead of {expected}")
        return bits[:expected]

    def close(self) -> None:
        """Let go of it."""
        self.client.close()

    def _refusal(self, code: int) -> Exception:
        if code == ExcCodes.DEVICE_BUSY:
            return LinkBusy(f"{self.name} is busy: somebody else has the control")
        if code in (ExcCodes.DEVICE_FAILURE, ExcCodes.GATEWAY_PATH_UNAVIABLE, ExcCodes.GATEWAY_NO_RESPONSE):
            return LinkError(f"{self.name} answers, but what is behind it does not (exception {code})")
        return RemoteProtocolError(
            f"{self.name} refused the request with exception {code}: is its map the one expected?"
        )


class ModbusBus:
    """Near end of the transport over Modbus.

    Args:
        line: to the server.
    """

    def __init__(self, line: ModbusLine) -> None:
        self._line = line
        self._sequence = 0

    @property
    def name(self) -> str:
        """Kind and address."""
        return self._line.name

    def connect(self) -> BoardFacts:
        """Find the board. Raises LinkError, LinkBusy when another client keeps the control, RemoteProtocolError."""
        self._line.connect()
        read = self._line.client.read_input_registers
        words = self._line.registers(read, IDENTITY_REGISTERS, address=IDENTITY, count=IDENTITY_REGISTERS)
        facts = decode_identity(words)
        deadline = Deadline(self._line.timeout_s)
        while True:  # the server may still be busy with the end of our last connection
            self._sequence, control = self._line.registers(read, 2, address=APPLIED, count=CONTROL - APPLIED + 1)
            if control != ANOTHER:
                return facts
            if deadline.passed:
                raise LinkBusy(f"{self.name}: another client has the control")
            sleep_between_looks(POLL_S)

    def exchange(self, operations: Operations, image: Words) -> None:
        """Exchange as `Bus.exchange` does; more than MAX_OPERATIONS operations need several requests."""
        for first in range(0, max(len(operations), 1), MAX_OPERATIONS):
            registers = self._exchange(operations[first : first + MAX_OPERATIONS])
        decode_image(registers, image)

    def close(self) -> None:
        """Let go of it."""
        self._line.close()

    def _exchange(self, operations: Operations) -> Sequence[int]:
        self._sequence = (self._sequence + 1) & WORD_MASK
        *registers, applied = self._line.registers(
            self._line.client.readwrite_registers,
            IMAGE_REGISTERS + 1,
            read_address=IMAGE,
            read_count=IMAGE_REGISTERS + 1,
            write_address=MAILBOX,
            values=encode_operations(self._sequence, operations),
        )
        if applied != self._sequence:
            raise RemoteProtocolError(f"{self.name} applied mailbox {applied} instead of {self._sequence}")
        return registers


def modbus_bus(transport: ModbusTransport) -> ModbusBus:
    """The bus that a deployment file describes."""
    return ModbusBus(ModbusLine(transport.host, transport.port, transport.device_id, transport.timeout_ms / MS_PER_S))
