"""Binary outputs of an arm: who switches them, where they go, and what a stop makes of them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from qrobot.cli.servo_settings import servo_settings
from qrobot.config import load_deployment
from qrobot.config.outputs import N_OUTPUTS
from qrobot.errors import ConfigError, MotionError
from qrobot.faultcodes import FaultCode
from qrobot.hwif.gateway import Gateway
from qrobot.hwif.isa.card import NO_CARD, make_card
from qrobot.hwif.operations import OP_FIELDS
from qrobot.hwif.registers import (
    DISCRETE,
    DISCRETE_HAND_OPEN,
    DISCRETE_HAND_RELAXED,
    DISCRETE_LINES,
    STATUS_CALIBRATED,
    STATUS_POWER,
)
from qrobot.modecodes import Mode
from qrobot.rci import Chg
from qrobot.servo.memory.servo_memory import servo_front
from qrobot.servo.output_lines import OutputWire
from qrobot.servo.process.guardian import N_OWN, N_SAFE_OPS, look
from qrobot.servo.stages.binary_outputs import asked_outputs, settle_outputs, stop_stands
from tests.support.bus import BenchEndpoint, DirectBus
from tests.support.deployment import LEFT
from tests.support.servo_bench import ServoBench, moving

GLUE, CLAMP, LAMP, VACUUM = 0b0001, 0b0010, 0b0100, 0b1000
WIRES = (
    OutputWire(1, "glue", holds=False, bit=3),
    OutputWire(2, "clamp", holds=True, bit=5),
    OutputWire(3, "lamp", holds=False),
    OutputWire(4, "vacuum", holds=True),
)
ALL, HELD = GLUE | CLAMP | LAMP | VACUUM, CLAMP | VACUUM
GLUE_BIT, CLAMP_BIT = 0x08, 0x20
MODULE = (
    '[[arm.board.io]]\nhost = "127.0.0.1"\noutputs = [{ address = 7, output = 2, on_stop = "hold", name = "clamp" }]\n'
)


class Cell:
    """An arm with four outputs, whose program says in every cycle what they are to be."""

    def __init__(self, wires: tuple[OutputWire, ...] = WIRES) -> None:
        self.bench = ServoBench(outputs=wires)
        self.asked = 0
        self.talks = True
        self.bench.before.append(self._say)
        self.bench.tick(3)

    def _say(self, now_ns: int) -> None:
        if self.talks:
            self.bench.mailbox.request_outputs(self.asked, now_ns)

    def ask(self, outputs: int) -> Cell:
        self.asked = outputs
        self.bench.tick()
        return self

    @property
    def on(self) -> int:
        """What is on, as the servo tells it, the board's register shows it and the modules were told."""
        told = self.bench.snapshot.outputs
        lines = GLUE * bool(self.bench.discrete & GLUE_BIT) | CLAMP * bool(self.bench.discrete & CLAMP_BIT)
        assert told & (GLUE | CLAMP) == lines
        assert self.bench.outputs[-1] == told
        return told


def test_outputs_follow_the_program_with_and_without_arm_power() -> None:
    cell = Cell()
    assert cell.on == 0
    assert cell.ask(GLUE | VACUUM).on == GLUE | VACUUM
    cell.bench.hold()
    assert cell.ask(CLAMP).on == CLAMP
    assert cell.bench.powered


def test_a_power_off_ends_what_a_stop_ends_also_without_power() -> None:
    cell = Cell()
    assert cell.ask(ALL).on == ALL
    assert cell.bench.mode is Mode.OFF
    cell.bench.mailbox.request_power_off()
    cell.bench.tick()
    assert cell.on == HELD
    cell.bench.tick(5)
    assert cell.on == HELD  # although its program goes on asking
    cell.ask(HELD)
    assert cell.ask(ALL).on == ALL


def test_modules_are_told_what_is_new_and_everything_to_a_board_that_is_new() -> None:
    cell = Cell()
    for asked in (LAMP, LAMP, LAMP | CLAMP):
        cell.ask(asked)
    assert cell.bench.outputs == [0, LAMP, LAMP | CLAMP]
    cell.bench.frozen = True
    cell.bench.tick(8)
    assert cell.on == CLAMP  # the way to the board is lost: what does not hold goes off
    told = len(cell.bench.outputs)
    cell.bench.frozen = False
    cell.bench.tick()
    assert cell.bench.outputs[told:] == [CLAMP]
    assert cell.bench.writes[-1].t_ns == cell.bench.now_ns - cell.bench.settings.period_ns
    assert cell.bench.discrete & DISCRETE_LINES == CLAMP_BIT


def test_lines_that_nobody_has_wired_stay_off_and_without_wires_nothing_is_posted() -> None:
    cell = Cell(WIRES[:2])
    assert cell.ask(0xFFFF).on == GLUE | CLAMP
    bare = Cell(())
    bare.ask(0xFFFF)
    assert bare.bench.snapshot.outputs == 0
    assert not bare.bench.outputs
    assert bare.bench.discrete & DISCRETE_LINES == 0


def press_estop(bench: ServoBench) -> None:
    bench.estop_ok = False


def ask_for_a_stop(bench: ServoBench) -> None:
    bench.mailbox.request_stop()


def take_power_away(bench: ServoBench) -> None:
    bench.mailbox.request_power_off()


def drop_the_request(bench: ServoBench) -> None:
    bench.mailbox.request_power(False)


def slip_an_encoder(bench: ServoBench) -> None:
    bench.slip[0] = 5000


def drop_power(bench: ServoBench) -> None:
    bench.status = STATUS_CALIBRATED | 1 & ~STATUS_POWER


@pytest.mark.parametrize(
    "stop", [press_estop, ask_for_a_stop, take_power_away, drop_the_request, slip_an_encoder, drop_power]
)
def test_a_stop_switches_off_what_does_not_hold_until_its_program_has_let_go(
    stop: Callable[[ServoBench], None],
) -> None:
    cell = Cell()
    cell.bench.hold()
    assert cell.ask(ALL).on == ALL
    stop(cell.bench)
    cell.bench.until(lambda: cell.bench.snapshot.outputs == HELD, 0.01)
    assert cell.on == HELD
    cell.bench.estop_ok, cell.bench.status = True, None
    cell.bench.slip.clear()
    cell.bench.mailbox.request_power(False)
    cell.bench.mailbox.request_clear()
    cell.bench.until(lambda: cell.bench.mode in (Mode.OFF, Mode.HOLDING))
    cell.bench.tick(5)
    assert cell.on == HELD  # nothing comes on because a fault was cleared
    assert cell.ask(HELD).on == HELD
    assert cell.ask(ALL).on == ALL


@pytest.mark.parametrize("stopped_anew", [False, True])
def test_a_program_that_let_go_for_less_than_a_cycle_has_let_go(stopped_anew: bool) -> None:
    """Two COMMANDs that arrive together: the cycle sees what the second one asks for alone."""
    cell = Cell()
    cell.bench.hold()
    assert cell.ask(ALL).on == ALL
    cell.bench.mailbox.request_stop()
    cell.bench.tick()
    assert cell.on == HELD
    cell.bench.mailbox.request_outputs(HELD, cell.bench.now_ns)
    if stopped_anew:
        cell.bench.mailbox.request_stop()
    cell.bench.tick()  # in which it asks for all of them again
    assert cell.on == (HELD if stopped_anew else ALL)


def test_what_a_program_says_after_a_silence_while_a_cycle_reads_it_is_taken_in_the_next_one() -> None:
    cell = Cell()
    cell.talks = False
    cell.bench.skip(500)
    params, state, mail, now_ns = cell.bench.params, cell.bench.state, cell.bench.mail, cell.bench.now_ns
    asked = asked_outputs(params, state, mail)
    cell.bench.mailbox.request_outputs(ALL, now_ns)
    settle_outputs(params, state, mail, asked, stop_stands(params, state, mail, now_ns))
    assert (state.outputs, state.outputs_locked) == (0, 0)
    cell.bench.tick()
    assert cell.on == ALL


def test_a_stop_on_the_path_counts_from_its_first_cycle() -> None:
    cell = Cell()
    moving(cell.bench)
    assert cell.ask(ALL).on == ALL
    cell.bench.mailbox.request_stop()
    cell.bench.tick()
    assert cell.bench.mode is Mode.STOPPING
    assert cell.on == HELD


def test_the_emergency_stop_counts_without_arm_power_too() -> None:
    cell = Cell().ask(ALL)
    cell.bench.estop_ok = False
    cell.bench.tick()
    assert cell.bench.mode is Mode.OFF
    assert cell.on == HELD


def test_a_board_lost_for_less_than_its_timeout_switches_off_as_one_lost_for_longer() -> None:
    bench, end = ServoBench(outputs=WIRES, board_timeout_ms=20.0), BenchEndpoint()
    bench.frozen = bench.deaf = True  # another one is its board
    bus, asked = DirectBus(end), [ALL]
    gateway = Gateway(bus, bench.board, bench.settings.period_ns, held_lines=CLAMP_BIT)
    bench.before += [gateway.step, lambda now_ns: bench.mailbox.request_outputs(asked[0], now_ns)]
    bench.mailbox.request_hand(2)

    def seen(ticks: int) -> tuple[int, int]:
        bench.tick(ticks)
        word = [value for _, offset, value in end.applied if offset == DISCRETE][-1]
        return bench.snapshot.outputs, word & (DISCRETE_LINES | DISCRETE_HAND_RELAXED)

    closed, relaxed = DISCRETE_HAND_OPEN, DISCRETE_HAND_RELAXED  # active low
    assert seen(5) == (ALL, GLUE_BIT | CLAMP_BIT | closed)
    bus.cut = True
    bench.mailbox.request_power(True)
    bench.tick()
    assert (bench.mode, bench.event) == (Mode.OFF, FaultCode.BOARD_GONE)
    bus.cut = False
    assert seen(1) == (HELD, CLAMP_BIT | relaxed)  # made safe when it was found
    assert seen(2) == (HELD, CLAMP_BIT | closed)  # the hand as its program has it
    bench.mailbox.request_hand(0)
    assert seen(2) == (HELD, CLAMP_BIT | relaxed)
    for asked[0], lines in ((HELD, CLAMP_BIT), (ALL, GLUE_BIT | CLAMP_BIT)):
        assert seen(2) == (asked[0], lines | relaxed)


def test_power_that_was_asked_for_is_not_waited_for_when_its_board_has_been_lost_meanwhile() -> None:
    bench = ServoBench(board_timeout_ms=20.0).wait_for_power()
    assert bench.mode is Mode.POWERING
    bench.board.facts.losses += 1
    bench.tick()
    assert (bench.mode, bench.fault, bench.powered) == (Mode.FAULT, FaultCode.BOARD_GONE, False)


@pytest.mark.parametrize("timeout", [False, True])
def test_a_board_lost_after_its_counters_have_jumped_does_not_come_back_calibrated(timeout: bool) -> None:
    bench = ServoBench(board_timeout_ms=20.0).tick(3)
    slip_an_encoder(bench)
    bench.until(lambda: bench.fault is FaultCode.ENC_JUMP)
    assert bench.discrete & STATUS_CALIBRATED
    bench.board.facts.losses += 1
    bench.frozen = timeout
    bench.tick(30)
    bench.frozen = False
    bench.mailbox.request_clear()
    bench.until(lambda: bench.mode is Mode.OFF)
    assert not bench.discrete & STATUS_CALIBRATED


def test_when_nobody_commands_what_holds_stays_and_the_rest_goes_off() -> None:
    cell = Cell().ask(ALL)
    cell.talks = False
    patience = round(0.3 * cell.bench.settings.rate_hz)  # cycles: as the pages on safety and on the wire say
    cell.bench.tick(patience)
    assert cell.on == ALL
    cell.bench.tick()
    assert cell.on == HELD
    cell.bench.tick(2 * patience)
    cell.talks = True
    assert cell.ask(HELD).on == HELD  # the next program begins with what it finds


def test_a_silent_servo_leaves_the_guardian_what_holds() -> None:
    cell = Cell().ask(ALL)
    bench = cell.bench
    own, ops = np.zeros(N_OWN, np.int64), np.zeros((N_SAFE_OPS, OP_FIELDS), np.int64)
    timeout_ns = 5_000_000
    look(own, servo_front(bench.mailbox.words), bench.board, make_card(NO_CARD), ops, bench.now_ns, timeout_ns)
    look(
        own,
        servo_front(bench.mailbox.words),
        bench.board,
        make_card(NO_CARD),
        ops,
        bench.now_ns + 2 * timeout_ns,
        timeout_ns,
    )
    bench.collect()
    assert bench.discrete & DISCRETE_LINES == CLAMP_BIT
    assert bench.outputs[-1] == HELD
    assert bench.writes[-1].offset != DISCRETE  # torque is written after it, as ever


def test_a_program_signals_lines_by_their_numbers() -> None:
    chg = Chg(6)
    chg.signal(1, 3)
    chg.signal(-1, 16)
    assert chg.outputs == 0x8004
    for wrong in (0, N_OUTPUTS + 1, -N_OUTPUTS - 1):
        with pytest.raises(MotionError, match="outputs are 1 to 16"):
            chg.signal(2, wrong)
    assert chg.outputs == 0x8004


@pytest.mark.parametrize("bit", [-1, 0, 1, 2, 6, 7])
def test_a_line_is_no_bit_of_arm_power_hand_or_host(bit: int) -> None:
    with pytest.raises(ConfigError, match=f"bit {bit} of DISCRETE is no line's, take 3, 4 or 5"):
        OutputWire(1, "glue", bit=bit)


def arm_of(tmp_path: Path, board: str):  # type: ignore[no-untyped-def]
    path = tmp_path / "here.toml"
    path.write_text(LEFT + board)
    [arm] = load_deployment(path).arm
    return arm


def test_lines_of_a_deployment_file_reach_the_servo_by_their_names(tmp_path: Path) -> None:
    arm = arm_of(tmp_path, "outputs = [{ output = 3, bit = 4 }]\n" + MODULE)
    assert servo_settings(arm).outputs == (OutputWire(2, "clamp", holds=True), OutputWire(3, "output_3", bit=4))


@pytest.mark.parametrize(
    ("board", "says"),
    [
        ("outputs = [{ output = 17, bit = 3 }]", "less than or equal to 16"),
        ("outputs = [{ output = 1, bit = 6 }]", "less than or equal to 5"),
        ("outputs = [{ output = 1, bit = 3, on_stop = 'keep' }]", "'off' or 'hold'"),
        ("outputs = [{ output = 1, bit = 3 }, { output = 2, bit = 3 }]", "two outputs have the same bit 3"),
        ("outputs = [{ output = 2, bit = 3 }]\n" + MODULE, "two outputs have the same output 2"),
        ("outputs = [{ output = 1, bit = 3, name = 'clamp' }]\n" + MODULE, "two outputs have the same name clamp"),
        ("kind = 'drives'\noutputs = [{ output = 1, bit = 3 }]\n[arm.board.drives]\nnodes = [1]\nabsolute = true\n"
         "torque_permille = [1]\nincrements_per_count = [1]\ncounts_at_zero = [0]", "separate drives have no output"),
        (MODULE.replace("[{", "[{ address = 7, output = 1 }, {"), "output 2: coil 7 has another use already"),
        (MODULE.replace("address = 7", "address = 9, kind = 'register'") + "gripper = { address = 8, open = [1, 2], "
         "close = [3, 4] }\n", "output 2: register 9 has another use already"),
        (MODULE.replace("address = 7", "address = 7, on = 9"), 'a coil is 0 or 1; kind = "register"'),
        (MODULE.replace("address = 7", "address = 7, off = 1"), "1 both on and off does nothing"),
        ("kind = 'port'\nport = {}\n" + MODULE, "modules need an emulated board or one behind a gateway"),
    ],
)  # fmt: skip
def test_outputs_that_make_no_sense_are_refused(tmp_path: Path, board: str, says: str) -> None:
    with pytest.raises(ConfigError, match=says):
        arm_of(tmp_path, board)
