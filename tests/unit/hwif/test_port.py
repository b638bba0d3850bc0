"""The ISA port: which accesses go out, in which order, how wide (TRC004 vendor driver v4.3), and who may make them."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numba
import numpy as np
import pytest
from numba import types

from qrobot.cli.arms import card_of_arm, choose_arm
from qrobot.cli.checks import look_at_card
from qrobot.cli.console import run_app
from qrobot.cli.main import make_app
from qrobot.config import load_robot
from qrobot.errors import ConfigError, LinkBusy, LinkLost
from qrobot.hwif.board_memory import Lane, fetch_image, local_board_memory
from qrobot.hwif.bus import NO_OPERATIONS, safe_operations
from qrobot.hwif.image import make_image
from qrobot.hwif.isa import instructions
from qrobot.hwif.isa.card import (
    CARD_BASE,
    CARD_KIND,
    CARD_READ_ONLY,
    CARD_REVISION,
    CARD_WITHHELD,
    NO_CARD,
    REAL_CARD,
    make_card,
    pour_lane,
    serve_card,
    show_card,
)
from qrobot.hwif.isa.owner import own_board_memory
from qrobot.hwif.isa.permission import LAST_SINGLE_PORT, allow_ports, require_ports
from qrobot.hwif.lanes import pending_operations
from qrobot.hwif.operations import OP_READ, OP_WRITE
from qrobot.hwif.registers import (
    ADC_MUX,
    ADC_START,
    ADC_VALUE,
    DAC,
    DAC_ZERO,
    DISCRETE,
    DISCRETE_ADC,
    DISCRETE_CALIBRATED,
    DISCRETE_HAND_RELAXED,
    DISCRETE_POWER,
    ENC_COUNT,
    ENC_INDEX,
    INDEX_BIT_0,
    N_DACS,
    STATUS,
    STATUS_ADC_BUSY,
    STATUS_CALIBRATED,
    STATUS_POWER,
)
from qrobot.hwif.trace import read_trace
from qrobot.realtime.flat_record import record_of
from qrobot.rig.deployed import ArmProcesses
from qrobot.rig.processes import ProcessPlan
from qrobot.servo.kernels.converter import make_adc_state, start_sample
from qrobot.servo.laws.shipped import find_law
from qrobot.servo.memory.mailbox import ServoMailbox
from qrobot.servo.memory.servo_memory import local_servo_memory, servo_front
from qrobot.servo.memory.telemetry import SMALLEST_RING
from qrobot.servo.parameters import servo_parameters
from qrobot.servo.process.guardian import N_OWN, N_SAFE_OPS, look
from qrobot.servo.process.loop import ENDED, run
from qrobot.servo.settings import ServoSettings
from qrobot.servo.state import make_state
from tests.support.bench import Bench, post, read_word
from tests.support.bus import BenchEndpoint
from tests.support.fake_card import FakeCard, FakeCardBus, PortAccess

CHANNEL = 6
IMAGE_READS = [*range(ENC_INDEX, ENC_INDEX + 12, 2), STATUS, *range(ENC_COUNT, ENC_COUNT + 12, 2), ADC_VALUE]
WINDOW = "ports 0x300-0x33f"


class Slot:
    """A fake card, the bench behind it, and the servo's side of a board memory."""

    def __init__(self, revision_f: bool = True, read_only: bool = False) -> None:
        self.end = BenchEndpoint(Bench(revision_f=revision_f))
        self.card = FakeCard(self.end, read_only)
        self.memory = local_board_memory()
        self.now_ns = 0

    def cycle(self, *operations: tuple[int, int, int], lane: Lane = Lane.SERVO) -> list[PortAccess]:
        """As the servo's loop does: image in, operations posted, operations out. Returns the accesses that act."""
        self.now_ns += 1_000_000
        show_card(self.card.words, self.memory, self.now_ns)
        post(self.memory, *operations, lane=lane)
        serve_card(self.card.words, self.memory, self.now_ns)
        return [access for access in self.card.settle() if access[0] == OP_WRITE or access[1] == ADC_START]

    def write(self, *pairs: tuple[int, int]) -> list[PortAccess]:
        return self.cycle(*((OP_WRITE, offset, value) for offset, value in pairs))

    def read(self, offset: int) -> int:
        self.cycle()
        return read_word(self.memory, offset)


def sampling(revision: str) -> list[tuple[int, int, int]]:
    """What the servo posts to have a channel converted."""
    ops: Any = np.zeros((8, 3), np.int64)
    n = start_sample(record_of(make_adc_state()), ops, 0, DISCRETE_ADC, 1 << CHANNEL, 0, ord(revision))
    return [tuple(map(int, row)) for row in ops[:n]]  # type: ignore[misc]


# --- the vendor's sequences --------------------------------------------------------------------------------------


def test_an_image_is_fourteen_reads_and_never_starts_a_conversion() -> None:
    slot = Slot()
    show_card(slot.card.words, slot.memory, 1)
    assert [(kind, offset, bits) for kind, offset, bits, _ in slot.card.settle()] == [
        (OP_READ, offset, 16) for offset in IMAGE_READS
    ]


def test_an_index_flag_is_cleared_by_its_mask_bit_at_zero_and_then_at_one() -> None:
    slot, bit = Slot(), INDEX_BIT_0 << 2
    assert slot.write((DISCRETE, 0), (DISCRETE, bit)) == [(OP_WRITE, DISCRETE, 16, 0), (OP_WRITE, DISCRETE, 16, bit)]
    assert slot.read(STATUS) & bit


def test_a_conversion_of_revision_f_takes_mask_and_one_word_that_selects_and_starts() -> None:
    slot = Slot()
    slot.end.set_volts(CHANNEL, 5.0)
    assert slot.cycle(*sampling("F")) == [
        (OP_WRITE, DISCRETE, 16, 0),
        (OP_WRITE, DISCRETE, 16, DISCRETE_ADC),
        (OP_WRITE, ADC_MUX, 16, CHANNEL << 7 | 0x50),
    ]
    assert not slot.read(STATUS) & STATUS_ADC_BUSY
    assert slot.read(ADC_VALUE) * 20 / 65536 == pytest.approx(5.0, abs=0.005)


def test_a_conversion_of_revision_e_is_bytes_and_its_mask_comes_after_the_read_that_starts() -> None:
    slot = Slot(revision_f=False)
    slot.end.set_volts(CHANNEL, 2.0)
    accesses = slot.cycle(*sampling("E"))
    assert [(kind, offset, bits) for kind, offset, bits, _ in accesses] == [
        (OP_WRITE, DISCRETE, 16),
        (OP_WRITE, ADC_MUX, 8),
        (OP_READ, ADC_START, 8),
        (OP_WRITE, DISCRETE, 16),
    ]
    assert [accesses[1][3], accesses[3][3]] == [CHANNEL, DISCRETE_ADC]
    assert not slot.read(STATUS) & STATUS_ADC_BUSY
    assert slot.read(ADC_VALUE) * 5 / 255 == pytest.approx(2.0, abs=0.02)


def test_the_converter_of_revision_e_is_read_as_a_byte() -> None:
    slot = Slot(revision_f=False)
    show_card(slot.card.words, slot.memory, 1)
    assert [bits for _, offset, bits, _ in slot.card.settle() if offset == ADC_VALUE] == [8]


@pytest.mark.parametrize("scratch", [0, DISCRETE_CALIBRATED])
def test_a_host_that_starts_zeroes_all_torques_first_and_keeps_the_bits_that_survived_it(scratch: int) -> None:
    slot = Slot()
    slot.end.bench.write((DISCRETE, DISCRETE_POWER | scratch), (DAC, 0))
    bus, image = FakeCardBus(slot.card), make_image()
    slot.card.settle()
    bus.connect()
    slot.card.settle()
    bus.exchange(safe_operations(read_word(slot.end.bench.memory, STATUS)), image)
    writes = [row for row in slot.end.applied if row[0] == OP_WRITE]
    assert writes[:N_DACS] == [(OP_WRITE, DAC + 2 * channel, DAC_ZERO) for channel in range(N_DACS)]
    assert writes[N_DACS:] == [(OP_WRITE, DISCRETE, scratch | DISCRETE_HAND_RELAXED)]
    assert bool(slot.read(STATUS) & STATUS_CALIBRATED) == bool(scratch)
    assert not slot.read(STATUS) & STATUS_POWER


def test_power_is_a_bit_that_is_written_and_a_bit_that_is_polled() -> None:
    slot = Slot()
    assert slot.write((DISCRETE, DISCRETE_POWER)) == [(OP_WRITE, DISCRETE, 16, DISCRETE_POWER)]
    assert slot.read(STATUS) & STATUS_POWER


def test_a_torque_is_one_word_for_its_converter() -> None:
    slot = Slot()
    assert slot.write((DAC + 6, 0x7A5)) == [(OP_WRITE, DAC + 6, 16, 0x7A5)]
    assert slot.end.bench.board.dac[3] == 0x7A5


# --- order, direction, dry run -----------------------------------------------------------------------------------


def test_servo_and_tool_are_applied_in_that_order_and_traced_and_the_guardian_applies_its_own() -> None:
    slot = Slot()
    post(slot.memory, (OP_WRITE, DAC, 1), lane=Lane.GUARDIAN)
    post(slot.memory, (OP_WRITE, DAC, 2), lane=Lane.TOOL)
    assert [value for *_, value in slot.cycle((OP_WRITE, DAC, 3))] == [3, 2]
    assert read_trace(slot.memory)[:, 1:].tolist() == [[Lane.SERVO, DAC, 3], [Lane.TOOL, DAC, 2]]
    assert pending_operations(slot.memory, int(Lane.GUARDIAN)) == 1
    pour_lane(slot.card.words, slot.memory, int(Lane.GUARDIAN), slot.now_ns)
    slot.card.settle()
    assert slot.end.bench.board.dac[0] == 1


def test_an_operation_in_the_wrong_direction_never_reaches_the_bus() -> None:
    slot = Slot()
    assert slot.cycle((OP_WRITE, STATUS, 1), (OP_READ, DISCRETE, 0), (OP_WRITE, DAC + 1, 5), (OP_WRITE, 0x40, 5)) == []
    assert slot.memory.facts.illegal_ops == 4


def test_a_dry_run_reads_everything_and_counts_what_it_would_have_written() -> None:
    slot = Slot(revision_f=False, read_only=True)
    assert slot.cycle(*sampling("E"), (OP_WRITE, DAC, 0)) == []
    assert slot.card.words[CARD_WITHHELD] == 5
    assert len(read_trace(slot.memory)) == 0
    slot.end.turn(0, 50.0)
    slot.card.settle()
    assert slot.read(ENC_COUNT) == 50


@pytest.mark.parametrize("revision_f", [True, False])
@pytest.mark.parametrize("connected", [False, True])
def test_an_empty_slot_is_said_to_be_empty(revision_f: bool, connected: bool) -> None:
    slot = Slot(revision_f)
    bus, image = FakeCardBus(slot.card), make_image()
    if connected:
        bus.connect()
        bus.exchange(NO_OPERATIONS, image)
    slot.card.pulled = True
    slot.card.settle()
    with pytest.raises(
        LinkLost, match=r"no card answers at ISA port 0x300: every register reads 0xffff; base, cable\?$"
    ):
        bus.exchange(NO_OPERATIONS, image) if connected else bus.connect()


def test_without_a_card_there_is_nothing_to_exchange() -> None:
    assert make_card(NO_CARD)[CARD_KIND] == NO_CARD


# --- the servo's own board memory --------------------------------------------------------------------------------


def test_the_servo_owns_the_memory_of_its_card_and_shows_it_safe() -> None:
    slot, name = Slot(), f"port{os.getpid()}"
    with own_board_memory(name, slot.card.words, 6, 1_000_000) as segment:
        slot.card.settle()
        assert (segment.memory.facts.joints, chr(segment.memory.facts.revision)) == (6, "F")
        assert fetch_image(segment.memory, make_image())
        assert slot.end.applied[0] == (OP_WRITE, DAC, DAC_ZERO)
        with pytest.raises(LinkBusy):
            own_board_memory(name, slot.card.words, 6, 1_000_000)


def test_the_servos_loop_reads_the_card_before_a_cycle_and_writes_what_the_cycle_posted() -> None:
    slot, robot, settings = Slot(), load_robot("puma560"), ServoSettings(rate_hz=1000.0, pots=False)
    law = find_law(settings.law, robot)
    params = servo_parameters(robot, settings)
    box = ServoMailbox(local_servo_memory(robot.name, settings.law, robot.n, settings.period_ns, SMALLEST_RING))
    box.memory.command.shutdown = 1
    loop: Any = run
    memories = box.memory, box.ring, slot.memory
    assert loop(params, make_state(params, law), *memories, slot.card.words, 0, 1_000_000_000) == ENDED
    accesses = slot.card.settle()
    kinds = [kind for kind, *_ in accesses]
    cycle = [OP_READ] * len(IMAGE_READS) + [OP_WRITE] * (1 + N_DACS)
    assert kinds == cycle * 4  # posted; seen to be taken; shown by two images more
    assert {offset: value for kind, offset, _, value in accesses if kind == OP_WRITE} == {
        DISCRETE: DISCRETE_HAND_RELAXED, **{DAC + 2 * channel: DAC_ZERO for channel in range(N_DACS)}
    }  # fmt: skip


def test_a_guardian_writes_to_the_card_itself_when_the_servo_is_silent() -> None:
    slot = Slot()
    slot.write((DISCRETE, DISCRETE_POWER), (DAC, 0))
    mail = servo_front(local_servo_memory("puma560", "pd", 6, 1_000_000, SMALLEST_RING))
    beat = mail.heartbeat
    beat.armed, beat.t_ns, beat.discrete = 1, 1, DISCRETE_POWER | DISCRETE_CALIBRATED
    own, ops = np.zeros(N_OWN, np.int64), np.zeros((N_SAFE_OPS, 3), np.int64)
    look(own, mail, slot.memory, slot.card.words, ops, 50_000_000, 5_000_000)
    slot.card.settle()
    assert slot.end.bench.board.dac[0] == DAC_ZERO
    assert not slot.read(STATUS) & STATUS_POWER
    assert slot.read(STATUS) & STATUS_CALIBRATED


# --- permission and configuration --------------------------------------------------------------------------------


def test_permission_is_granted_or_refused_with_a_remedy() -> None:
    step = look_at_card(0x300)
    assert step.name == WINDOW
    assert step.ok or step.remedy


class Libc:
    """A C library whose kernel says no, and remembers what it was asked."""

    asked: tuple[int, ...] = ()

    def ioperm(self, *arguments: int) -> int:
        self.asked = arguments
        return -1

    iopl = ioperm


@pytest.mark.parametrize(("number", "says"), [(1, "CAP_SYS_RAWIO"), (38, "CONFIG_X86_IOPL_IOPERM"), (22, "ioperm")])
@pytest.mark.parametrize(("base", "asked"), [(0x300, (0x300, 64, 1)), (LAST_SINGLE_PORT - 1, (3,))])
def test_a_refusal_says_what_to_do(
    monkeypatch: pytest.MonkeyPatch, number: int, says: str, base: int, asked: tuple[int, ...]
) -> None:
    libc = Libc()
    monkeypatch.setattr("ctypes.CDLL", lambda *_, **__: libc)
    monkeypatch.setattr("ctypes.get_errno", lambda: number)
    monkeypatch.setattr("qrobot.hwif.isa.permission.HAS_PORTS", True)
    assert says in allow_ports(base).remedy
    assert libc.asked == asked
    with pytest.raises(ConfigError, match="refused"):
        require_ports(base)


def test_another_processor_has_no_ports(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("qrobot.hwif.isa.permission.HAS_PORTS", False)
    with pytest.raises(ConfigError, match="x86-64"):
        require_ports(0x300)


@pytest.mark.parametrize(
    ("name", "assembly"), [("in_byte", "inb"), ("in_word", "inw"), ("out_byte", "outb"), ("out_word", "outw")]
)
def test_compiled_code_makes_the_access_itself(name: str, assembly: str) -> None:
    instruction = getattr(instructions, name)
    arguments = (types.int64,) * (1 + name.startswith("out"))
    if not instructions.HAS_PORTS:
        assert instruction(*[0x80] * len(arguments)) in (None, 0xFF, 0xFFFF)
        return

    def read(port: int) -> Any:
        return instruction(port)

    def write(port: int, value: int) -> None:
        instruction(port, value)

    compiled = numba.njit(arguments)(read if len(arguments) == 1 else write)
    [text] = compiled.inspect_asm().values()
    assert f"\t{assembly}\t" in text


def test_a_deployment_names_the_card_and_its_revision(tmp_path: Path) -> None:
    path = tmp_path / "here.toml"
    path.write_text(
        '[[arm]]\nname = "left"\nrobot = "puma560"\nbridge = { port = 5600 }\n'
        'board = { kind = "port", revision = "E", port = { base = 0x340, read_only = true } }\n'
    )
    card = card_of_arm(choose_arm(str(path), None))
    assert [int(card[i]) for i in (CARD_KIND, CARD_BASE, CARD_REVISION, CARD_READ_ONLY)] == [
        REAL_CARD, 0x340, ord("E"), 1,
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("board", "says"),
    [
        ('{ kind = "port" }', r"needs a table \[arm.board.port\]"),
        ("{ port = {} }", "a table 'port' needs kind = 'port'"),
        ('{ kind = "port", port = { base = 0x301 } }', "multiple of 2"),
        ('{ kind = "port", port = { base = 16 } }', "greater than or equal to 256"),
    ],
)
def test_a_board_is_where_its_kind_says(tmp_path: Path, board: str, says: str) -> None:
    path = tmp_path / "here.toml"
    path.write_text(f'[[arm]]\nname = "left"\nrobot = "puma560"\nbridge = {{ port = 5600 }}\nboard = {board}\n')
    with pytest.raises(ConfigError, match=says):
        choose_arm(str(path), None)


@pytest.fixture
def port_arm(tmp_path: Path) -> str:
    """A deployment with a card."""
    path = tmp_path / "here.toml"
    path.write_text(
        f'[[arm]]\nname = "port{os.getpid()}"\nrobot = "puma560"\nbridge = {{ port = 5600 }}\n'
        'log = { directory = "" }\nboard = { kind = "port", port = {} }\n'
    )
    return str(path)


@pytest.mark.parametrize("command", [["servo", "--own-guardian"], ["board", "check", "--read-only"], ["board"]])
def test_where_there_are_no_ports_a_command_says_so_before_it_does_anything(
    port_arm: str, command: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("qrobot.hwif.isa.permission.HAS_PORTS", False)
    assert run_app(make_app(), [*command, port_arm]) == 1
    said = capsys.readouterr()
    assert "x86-64" in said.out + said.err or "no board process is needed" in said.err


def test_an_arm_with_a_card_starts_no_board_process(port_arm: str) -> None:
    started: list[str] = []

    class Rig:
        def start(self, *plans: ProcessPlan) -> None:
            started.extend(plan.arguments[0] for plan in plans)

    ArmProcesses(Rig(), port_arm, choose_arm(port_arm, None)).start_all()  # type: ignore[arg-type]
    assert started == ["servo", "guardian", "bridge"]


def test_a_card_is_read_only_when_the_caller_says_so(port_arm: str) -> None:
    arm = choose_arm(port_arm, None)
    assert [int(card_of_arm(arm, read_only)[CARD_READ_ONLY]) for read_only in (False, True)] == [0, 1]
