"""Analogue outputs of an arm: who sets them, where they go, and what becomes of them at a stop."""

from __future__ import annotations

from collections.abc import Callable
from math import inf, nan
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from qrobot.cli.servo_settings import servo_settings
from qrobot.config import load_deployment
from qrobot.config.modbus_io import RemoteAnalogOutput
from qrobot.errors import ConfigError
from qrobot.hwif.isa.card import NO_CARD, make_card
from qrobot.hwif.operations import ALL_ANALOG, OP_FIELDS, put_analog, signed_microvolts
from qrobot.hwif.registers import DAC_COUNTS_PER_VOLT, DAC_ZERO
from qrobot.modecodes import Mode
from qrobot.servo.analog_lines import AnalogWire, analog_params
from qrobot.servo.memory.servo_memory import NOT_TAKEN, TAKEN, describe_analog_outputs, servo_front
from qrobot.servo.process.guardian import N_OWN, N_SAFE_OPS, look
from tests.support.deployment import LEFT
from tests.support.servo_bench import ServoBench, moving

# number: 1 on a converter and 2 on a module go off at a stop, 3 on a converter and 4 on a module hold
WIRES = (
    AnalogWire(1, "laser", 0.0, 5.0, dac=6),
    AnalogWire(2, "pump", -5.0, 5.0, off_v=-1.0),
    AnalogWire(3, "fan", dac=7, holds=True),
    AnalogWire(4, "heater", 0.0, 10.0, off_v=0.5, holds=True),
)
OFF = (0.0, -1.0, 0.0, 0.5)
ASKED = (4.0, 2.5, -3.0, 7.25)
HELD = (0.0, -1.0, -3.0, 7.25)


class Cell:
    """An arm with four analogue outputs, whose program talks in every cycle."""

    def __init__(self, wires: tuple[AnalogWire, ...] = WIRES) -> None:
        self.bench = ServoBench(analog_outputs=wires)
        self.talks = True
        self.bench.before.append(self._say)
        self.bench.tick(3)

    def _say(self, now_ns: int) -> None:
        if self.talks:
            self.bench.mailbox.request_outputs(0, now_ns)

    def ask(self, *volts: float) -> Cell:
        self.bench.mailbox.request_analog((*volts, *(nan,) * (8 - len(volts))))
        self.bench.tick()
        return self

    @property
    def shown(self) -> tuple[float, ...]:
        """What they show, as the servo tells it, the converters have it and the modules were told."""
        told = tuple(self.bench.snapshot.analog_outputs.tolist())
        converters = (DAC_ZERO - self.bench.dac[6:]) / DAC_COUNTS_PER_VOLT
        assert converters == pytest.approx((told[0], told[2]), abs=0.5 / DAC_COUNTS_PER_VOLT)
        modules = [1e-6 * self.bench.analog[k] for k in (1, 3)]
        assert modules == pytest.approx((told[1], told[3]), abs=1e-6)
        return told[:4]


def test_outputs_are_off_at_first_and_follow_the_program_with_and_without_arm_power() -> None:
    cell = Cell()
    assert cell.shown == OFF
    assert cell.ask(*ASKED).shown == ASKED
    cell.bench.hold()
    assert cell.ask(nan, 1.0, nan, nan).shown == (4.0, 1.0, -3.0, 7.25)  # NaN leaves the others as they are


def press_estop(bench: ServoBench) -> None:
    bench.estop_ok = False


def ask_for_a_stop(bench: ServoBench) -> None:
    bench.mailbox.request_stop()


def slip_an_encoder(bench: ServoBench) -> None:
    bench.slip[0] = 5000


def take_power_away(bench: ServoBench) -> None:
    bench.mailbox.request_power_off()


def lose_the_board(bench: ServoBench) -> None:
    bench.frozen = True


def test_a_stop_on_the_path_ends_what_does_not_hold_from_its_first_cycle() -> None:
    cell = Cell()
    moving(cell.bench)
    assert cell.ask(*ASKED).shown == ASKED
    cell.bench.mailbox.request_stop()
    cell.bench.tick()
    assert cell.bench.mode is Mode.STOPPING
    assert cell.shown == HELD
    assert cell.ask(*ASKED).shown == HELD  # not while the stop stands
    cell.bench.until(lambda: cell.bench.mode is Mode.HOLDING)
    cell.bench.tick(3)
    assert cell.shown == HELD  # nothing comes back by itself
    assert cell.ask(*ASKED).shown == ASKED


@pytest.mark.parametrize("stop", [press_estop, slip_an_encoder, take_power_away, lose_the_board])
def test_all_go_off_when_arm_power_goes_or_the_board_is_lost(stop: Callable[[ServoBench], None]) -> None:
    cell = Cell()
    cell.bench.hold()
    assert cell.ask(*ASKED).shown == ASKED
    stop(cell.bench)
    cell.bench.until(lambda: tuple(cell.bench.snapshot.analog_outputs[:4]) == OFF, 2.0)
    cell.bench.tick(5)
    assert cell.shown == OFF
    cell.bench.estop_ok, cell.bench.frozen = True, False
    cell.bench.slip.clear()
    cell.bench.mailbox.request_power(False)
    cell.bench.mailbox.request_clear()
    cell.bench.until(lambda: cell.bench.mode is Mode.OFF)
    cell.bench.tick(5)
    assert cell.shown == OFF
    assert cell.ask(*ASKED).shown == ASKED


def test_when_nobody_commands_what_holds_stays_and_the_rest_goes_off() -> None:
    cell = Cell().ask(*ASKED)
    cell.talks = False
    patience = round(0.3 * cell.bench.settings.rate_hz)  # cycles: as the pages on safety and on the wire say
    cell.bench.tick(patience)
    assert cell.shown == ASKED
    cell.bench.tick()
    assert cell.shown == HELD


@pytest.mark.parametrize("wrong", [5.001, -0.001, 1e300, inf, -inf])
def test_a_servo_takes_no_volts_beyond_the_range(wrong: float) -> None:
    cell = Cell().ask(*ASKED)
    assert cell.ask(wrong, nan, nan, nan).shown == ASKED
    cell.bench.mailbox.request_analog((nan,) * 4 + (1.0,) * 4)  # there are no such outputs
    cell.bench.tick()
    assert tuple(cell.bench.snapshot.analog_outputs) == (*ASKED, 0.0, 0.0, 0.0, 0.0)


def test_the_range_that_the_servo_tells_is_what_requests_are_judged_by() -> None:
    mailbox = Cell().bench.mailbox
    describe_analog_outputs(mailbox.words, {2: (-5.0, 5.0)})
    assert mailbox.analog_objection((nan, 5.0, *(nan,) * 6)) == ""
    assert mailbox.analog_objection((nan, 5.1, *(nan,) * 6)) == "analogue output 2: 5.1 V is not within -5 to 5 V"
    assert "inf V is not within" in mailbox.analog_objection((nan, inf, *(nan,) * 6))
    assert "there is no analogue output 1" in mailbox.analog_objection((0.0, *(nan,) * 7))


@pytest.mark.parametrize("asked", [ASKED, (nan, nan, nan, 7.25), (nan, nan, -3.0, nan)])
def test_a_silent_servo_leaves_the_guardian_none_that_is_on(asked: tuple[float, ...]) -> None:
    """Those that hold in a stop are among them, and alone keep the guardian at its post."""
    cell = Cell().ask(*asked)
    bench = cell.bench
    own, ops = np.zeros(N_OWN, np.int64), np.zeros((N_SAFE_OPS, OP_FIELDS), np.int64)
    front, timeout_ns = servo_front(bench.mailbox.words), 5_000_000
    for late_ns in (0, 2 * timeout_ns):
        look(own, front, bench.board, make_card(NO_CARD), ops, bench.now_ns + late_ns, timeout_ns)
    bench.collect()
    assert bench.dac[6:].tolist() == [DAC_ZERO, DAC_ZERO]
    assert ALL_ANALOG in bench.analog


def test_what_the_guardian_has_switched_off_stays_off_when_the_servo_goes_on() -> None:
    cell = Cell().ask(*ASKED)
    bench = cell.bench
    bench.mailbox.memory.guardian.takeover = TAKEN
    bench.tick(5)
    assert tuple(bench.snapshot.analog_outputs[:4]) == OFF
    bench.mailbox.memory.guardian.takeover = NOT_TAKEN
    bench.mailbox.request_clear()
    bench.tick(5)
    assert cell.shown == OFF
    assert cell.ask(*ASKED).shown == ASKED


def test_a_power_off_ends_what_a_stop_ends_also_without_power() -> None:
    cell = Cell().ask(*ASKED)
    assert cell.bench.mode is Mode.OFF
    take_power_away(cell.bench)
    cell.bench.tick()
    assert cell.shown == HELD
    assert cell.ask(*ASKED).shown == ASKED


def test_an_arm_without_analogue_outputs_writes_what_it_always_wrote() -> None:
    bare = Cell(())
    bare.ask(1.0, 2.0)
    assert bare.bench.dac[6:].tolist() == [DAC_ZERO, DAC_ZERO]
    assert not bare.bench.analog


@given(st.integers(-(1 << 31), (1 << 31) - 1))
def test_microvolts_survive_being_cut_to_32_bits(microvolts: int) -> None:
    operations = np.zeros((1, OP_FIELDS), np.int64)
    put_analog(operations, 0, 3, microvolts)
    assert signed_microvolts(int(operations[0, 2]) & 0xFFFFFFFF) == microvolts


@given(st.floats(-10.0, 10.0), st.floats(1e-3, 1.0), st.floats(-2.0, 2.0))
def test_a_register_shows_the_volts_to_half_a_step(volts: float, step: float, zero: float) -> None:
    output = RemoteAnalogOutput(output=1, address=0, volt_per_count=step, zero_v=zero)
    assert abs(output.number(volts) * step - zero - volts) <= 0.5 * step + 1e-9
    assert output.number(10.5) == output.number(nan) == output.number(0.0)  # what cannot be is off


@pytest.mark.parametrize("dac", range(6))
def test_a_converter_that_drives_a_motor_is_no_output(dac: int) -> None:
    with pytest.raises(ConfigError, match=f"analogue output 1: DAC {dac} drives a motor of the arm; free are 6 to 7"):
        analog_params((AnalogWire(1, "laser", dac=dac),), 6)


def arm_of(tmp_path: Path, board: str):  # type: ignore[no-untyped-def]
    path = tmp_path / "here.toml"
    path.write_text(LEFT + board)
    [arm] = load_deployment(path).arm
    return arm


BOARD = '[[arm.board.analog_outputs]]\noutput = 1\ndac = 6\nname = "laser"\nmin_v = 0.0\nmax_v = 5.0\n'
MODULE = (
    '[[arm.board.io]]\nhost = "127.0.0.1"\n'
    "analog_outputs = [{ output = 2, address = 3, volt_per_count = 0.001, off_v = -1.0, min_v = -5.0, max_v = 5.0 }]\n"
)


def test_the_deployment_tells_the_outputs_of_board_and_modules(tmp_path: Path) -> None:
    arm = arm_of(tmp_path, BOARD + MODULE)
    laser, pump = servo_settings(arm).analog_outputs
    assert laser == AnalogWire(1, "laser", 0.0, 5.0, dac=6)
    assert pump == AnalogWire(2, "analog_output_2", -5.0, 5.0, off_v=-1.0)
    assert [(each.name, each.analog_output) for each in arm.named_signals] == [("laser", 1)]


@pytest.mark.parametrize(
    ("board", "complaint"),
    [
        (BOARD.replace("dac = 6", "dac = 5"), "DAC 5 drives a motor"),
        (BOARD.replace("dac = 6", "dac = 8"), "board.analog_outputs.0.dac"),
        (BOARD + BOARD.replace("output = 1", "output = 2").replace("laser", "fan"), "same dac 6"),
        (BOARD + BOARD.replace("dac = 6", "dac = 7").replace("laser", "fan"), "same output 1"),
        (BOARD + MODULE.replace("output = 2", 'output = 2, name = "laser"'), "same name laser"),
        (BOARD.replace("min_v = 0.0", "min_v = 1.0"), "0 V, which it shows while it is off, is not within 1 to 5 V"),
        (BOARD.replace("max_v = 5.0", "max_v = -1.0"), "min_v 0 is not below max_v -1"),
        (MODULE.replace("off_v = -1.0", "off_v = 6.0"), "6 V, which it shows while it is off"),
        (MODULE.replace("0.001", "0.0"), "analog_outputs.0.volt_per_count: 0 is no scale"),
        (MODULE.replace("0.001", "0.0001"), "-5 V would be -50000 in its register"),
        (MODULE.replace("2, address", "9, address"), "board.io.0.analog_outputs.0.output"),
        (MODULE + "outputs = [{ output = 1, address = 3, kind = 'register' }]\n", "register 3 has another use"),
        (MODULE + "[[arm.signals]]\nname = 'x'\nanalog_output = 1\n", "has no analogue output 1"),
        (MODULE + "[[arm.signals]]\nname = 'x'\nanalog_output = 2\nanalog = 6\n", "is needed, not 2"),
    ],
)
def test_what_cannot_be_is_refused_in_the_deployment_file(tmp_path: Path, board: str, complaint: str) -> None:
    with pytest.raises(ConfigError, match=complaint):
        servo_settings(arm_of(tmp_path, board))
