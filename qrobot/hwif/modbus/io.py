"""Modbus modules beside a board: inputs in its STATUS word, channels of its converter, outputs, a gripper for a hand.

`IoBus` stands before the bus to the board, so servo and programs see inputs, outputs and a hand as ever. Each module is
asked by a thread of its own at its own pace. Neither an exchange with the board waits for one, nor a board that was
lost and is to be made safe. Beside an emulated board the panel takes the place of the bus (panel.py).
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import zip_longest
from typing import Final

from qrobot.arrays import Words
from qrobot.config.modbus_io import ModbusIo
from qrobot.config.outputs import ALL_OUTPUTS
from qrobot.errors import LinkError, ProtocolError
from qrobot.hwif.bus import BoardFacts, Bus, Operations, for_the_transport
from qrobot.hwif.converter import RemoteChannels, adc_word, require_signed_converter
from qrobot.hwif.image import IMAGE_STATUS
from qrobot.hwif.modbus.client import ModbusLine
from qrobot.hwif.operations import ALL_ANALOG, OP_ANALOG, OP_OUTPUTS, OP_WRITE, signed_microvolts
from qrobot.hwif.registers import DISCRETE, DISCRETE_HAND_CLOSE, DISCRETE_HAND_OPEN
from qrobot.report import Report
from qrobot.units import MS_PER_S, NS_PER_MS, NS_PER_S

SIGN: Final = 0x8000  # of a register
REGISTER: Final = 0xFFFF
MICRO: Final = 1e-6


@dataclass(frozen=True)
class ModuleState:
    """Newest state of a module: bits in their places of STATUS, voltage by converter channel, and when it was asked."""

    bits: int
    volts: Mapping[int, float]
    t_ns: int


class RemoteModule:
    """One module.

    Args:
        choice: where it is and what it has.
        report: takes a line when it is found or lost, is not there at first, or is too slow for `timeout_ms`.
        now_ns: the clock of what was seen.
        begin: called first in the thread that polls. It is to have the priority of the one that exchanges, which waits
            for it at the interpreter's lock.

    Attributes:
        name: for messages. mask: bits of STATUS that are its own. channels: of the converter, likewise.
        losses: times it has been lost.
    """

    def __init__(
        self,
        choice: ModbusIo,
        report: Report = lambda _line: None,
        now_ns: Callable[[], int] = time.monotonic_ns,
        begin: Callable[[], object] = lambda: None,
    ) -> None:
        self._choice, self._report, self._now_ns, self._begin = choice, report, now_ns, begin
        self._line = ModbusLine(choice.host, choice.port, choice.device_id, choice.timeout_ms / MS_PER_S)
        self.name = f"module at {self._line.name}"
        self.mask = sum(1 << each.input for each in choice.inputs)
        self.channels = frozenset(each.channel for each in choice.analog)
        self.losses = 0
        self._held = sum(1 << (each.output - 1) for each in choice.outputs if each.on_stop == "hold")
        self._safe = sum(1 << each.input for each in choice.inputs if each.safe)
        self._seen = ModuleState(self._safe, {}, 0)  # replaced whole, so that readers never mix two of them
        self._wanted: Sequence[int] | None = None
        self._written: Sequence[int] | None = None
        self._outputs: int | None = None  # None until somebody has said anything
        self._shown: dict[int, bool] = {}  # what each output was last told, by its line
        self._volts: dict[int, float] = {}  # of analogue outputs, by their numbers; of those left out their off values
        self._driven: dict[int, int] = {}  # what the registers of analogue outputs were last told, by their numbers
        self._here = self._told = self._slow = False

    def command(self, discrete: int) -> None:
        """The hand is as this DISCRETE word says; both solenoids at once, as after reset, say nothing."""
        gripper = self._choice.gripper
        if gripper is None:
            return
        opens, closes = not discrete & DISCRETE_HAND_OPEN, not discrete & DISCRETE_HAND_CLOSE  # active low
        if opens != closes:
            self._wanted = gripper.open if opens else gripper.close
        elif not opens and gripper.relax is not None:
            self._wanted = gripper.relax

    def switch(self, outputs: int) -> None:
        """The outputs of the arm are as these bits say, output 1 in bit 0."""
        self._outputs = outputs

    def drive(self, output: int, volts: float | None) -> None:
        """Analogue output `output` of the arm, from 1, is to show `volts`; None, or too many, for its off value."""
        if volts is None:
            self._volts.pop(output, None)
        else:
            self._volts[output] = volts

    def let_go(self) -> None:
        """Let all analogue outputs show their off values."""
        self._volts.clear()

    def forget(self) -> None:
        """Leave on what holds and let go of the rest, which comes on again only when somebody says so anew."""
        self.let_go()
        if self._outputs is not None:
            self._outputs &= self._held

    def bits(self, now_ns: int) -> int:
        """Its inputs in their places of STATUS; the safe ones when what was seen is too old."""
        seen = self._seen
        return seen.bits if self._may_be_believed(seen, now_ns) else self._safe

    def maybe_volt(self, channel: int, now_ns: int) -> float | None:
        """Voltage at a converter channel of its own; None when what was seen is too old, or nothing was."""
        seen = self._seen
        return seen.volts.get(channel) if self._may_be_believed(seen, now_ns) else None

    def _may_be_believed(self, seen: ModuleState, now_ns: int) -> bool:
        return now_ns - seen.t_ns <= self._choice.timeout_ms * NS_PER_MS

    def poll(self, leaving: bool = False) -> None:
        """Ask it once, and pass on what the hand does; a module that is away is told once and tried again.

        `leaving`, nobody is left to say what outputs are to be: only those that hold stay on.
        """
        try:
            if not self._here:
                self._line.connect()
                self._written = None
                self._shown.clear()
                self._driven.clear()
                self._slow = False
            self._look()
            self._switch(self._held if leaving else ALL_OUTPUTS)
            self._drive({} if leaving else self._volts)
            self._write()
        except (LinkError, ProtocolError) as error:
            self._lose(error)
            return
        if not self._here:
            self._here, self._told = True, False
            self._report(f"{self.name} found")

    def run(self, stop: threading.Event) -> None:
        """Poll until `stop` is set, then leave on what holds, analogue outputs off, and let go of it."""
        self._begin()
        period_s = self._choice.period_ms / MS_PER_S
        while not stop.is_set():
            asked_ns = self._now_ns()
            self.poll()
            stop.wait(max(0.0, period_s - (self._now_ns() - asked_ns) / NS_PER_S))
        if self._here:
            self.poll(leaving=True)
        self.close()

    def close(self) -> None:
        """Let go of it."""
        self._line.close()
        self._here = False

    def _look(self) -> None:
        """Ask for inputs and channels; once a connection, tell when they are too old before there are newer ones."""
        asked_ns = self._now_ns()  # no answer is older
        seen = ModuleState(self._read(), self._measure(), asked_ns)
        asks = self.mask or self.channels
        if asks and self._here and not self._slow and not self._may_be_believed(self._seen, self._now_ns()):
            self._slow = True
            self._report(
                f"{self.name} is slow: what it says is older than timeout_ms "
                f"({self._choice.timeout_ms:g} ms) before there is anything newer; its inputs read as safe meanwhile"
            )
        self._seen = seen

    def _read(self) -> int:
        bits = 0
        for each in self._choice.inputs:
            [bit] = self._line.bits(self._line.client.read_discrete_inputs, 1, address=each.address, count=1)
            bits |= bit << each.input
        return bits

    def _measure(self) -> dict[int, float]:
        volts = {}
        for each in self._choice.analog:
            [word] = self._line.registers(self._line.client.read_input_registers, 1, address=each.address, count=1)
            number = (word ^ SIGN) - SIGN
            volts[each.channel] = number * each.volt_per_count - each.zero_v
        return volts

    def _switch(self, allowed: int) -> None:
        """Tell the outputs what is new to them; those beside `allowed` are off."""
        if self._outputs is None:
            return
        for each in self._choice.outputs:
            on = bool((self._outputs & allowed) >> (each.output - 1) & 1)
            if self._shown.get(each.output) == on:
                continue
            value, client = each.on if on else each.off, self._line.client
            if each.kind == "coil":
                self._line.ask(client.write_coil, address=each.address, value=bool(value))
            else:
                self._line.ask(client.write_register, address=each.address, value=value)
            self._shown[each.output] = on

    def _drive(self, volts: Mapping[int, float]) -> None:
        """Tell the analogue outputs what is new to them; those without `volts` show their off values."""
        for each in self._choice.analog_outputs:
            number = each.number(volts.get(each.output, each.off_v))
            if self._driven.get(each.output) != number:
                self._line.ask(self._line.client.write_register, address=each.address, value=number & REGISTER)
                self._driven[each.output] = number

    def _write(self) -> None:
        gripper, wanted = self._choice.gripper, self._wanted
        if gripper is None or wanted is None or wanted == self._written:
            return
        self._line.ask(self._line.client.write_registers, address=gripper.address, values=list(wanted))
        self._written = wanted

    def _lose(self, error: Exception) -> None:
        if self._here:
            self.losses += 1
            self._report(f"{self.name} lost, its inputs read as safe: {error}")
        elif not self._told:
            self._report(f"no {self.name}: {error}")
        self._told = True
        self.close()


class IoBus:
    """A `Bus` to a board with modules beside it.

    Args:
        bus: to the board.
        modules: each with inputs of its own.
        now_ns: their clock.
    """

    def __init__(
        self, bus: Bus, modules: Sequence[RemoteModule], now_ns: Callable[[], int] = time.monotonic_ns
    ) -> None:
        self.name = bus.name
        self._bus, self._modules, self._now_ns = bus, modules, now_ns
        self._channels = RemoteChannels(set().union(*(each.channels for each in modules)), self._maybe_word)
        self._stop = threading.Event()
        self._threads: list[threading.Thread] = []

    def connect(self) -> BoardFacts:
        """Connect the board's bus; the modules come when they come.

        Raises LinkError also for a board of revision E with analogue inputs beside it.
        """
        self._end_threads()
        facts = self._bus.connect()
        if any(each.channels for each in self._modules):
            require_signed_converter(facts)
        self._channels.forget()
        self._stop = threading.Event()
        self._threads = [self._thread(*pair) for pair in zip_longest(self._modules, self._threads)]
        return replace(facts, outputs=True)

    def _thread(self, module: RemoteModule, before: threading.Thread | None) -> threading.Thread:
        """A thread that polls a module once the one `before` has let go of it."""
        stop = self._stop

        def run() -> None:
            if before is not None:
                before.join()
            module.run(stop)

        thread = threading.Thread(target=run, name=module.name, daemon=True)
        thread.start()
        return thread

    def exchange(self, operations: Operations, image: Words) -> None:
        """See `Bus`."""
        self._tell(operations)
        self._bus.exchange(self._channels.for_board(for_the_transport(operations)), image)
        status, now_ns = IMAGE_STATUS, self._now_ns()
        for module in self._modules:
            image[status] = int(image[status]) & ~module.mask | module.bits(now_ns)
        self._channels.answer(image, now_ns)

    def _tell(self, operations: Operations) -> None:
        """Tell the modules what concerns them; they hear it also while the board is being lost."""
        for kind, offset, value in operations.tolist():
            for module in self._modules:
                if kind == OP_OUTPUTS:
                    module.switch(value)
                elif kind == OP_ANALOG and offset == ALL_ANALOG:
                    module.let_go()
                elif kind == OP_ANALOG:
                    module.drive(offset + 1, MICRO * signed_microvolts(value))
                elif (kind, offset) == (OP_WRITE, DISCRETE):
                    module.command(value)

    def _maybe_word(self, channel: int, now_ns: int) -> int | None:
        """ADC_VALUE word of a channel of the one module that has it."""
        volts = (each.maybe_volt(channel, now_ns) for each in self._modules if channel in each.channels)
        volt = next(volts, None)
        return None if volt is None else adc_word(volt)

    def close(self) -> None:
        """Let go of all; modules that are slow to answer are let go of meanwhile, and before they are found again."""
        self._end_threads()
        self._bus.close()

    def settle(self) -> None:
        """Wait, once closed, until all modules have been let go of; each takes as long as its answers."""
        for thread in self._threads:
            thread.join()

    def _end_threads(self) -> None:
        for module in self._modules:
            module.forget()
        self._stop.set()
