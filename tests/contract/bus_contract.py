"""What every transport to a board keeps, whatever it is made of: run by a class of each transport's own tests.

    class TestMyTransport(BusContract):
        @contextmanager
        def open_transport(self, end: BenchEndpoint) -> Iterator[Transport]:
            ...build near and far end around `end`, not connected yet; tear them down behind the yield...

The far end may live in a thread or in lock-step; nothing here depends on how often it exchanges by itself.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import AbstractContextManager
from itertools import pairwise
from typing import Protocol

import pytest

from qrobot.arrays import Words
from qrobot.errors import LinkError, ProtocolError, RemoteProtocolError
from qrobot.hwif.bus import Bus
from qrobot.hwif.image import IMAGE_COUNT, IMAGE_ENC_COUNT, IMAGE_STATUS, IMAGE_T_NS, input_at, make_image
from qrobot.hwif.operations import OP_READ, OP_WRITE
from qrobot.hwif.registers import (
    ADC_E_VOLT_PER_COUNT,
    ADC_F_CHANNEL_SHIFT,
    ADC_F_COMMAND,
    ADC_F_VOLT_PER_COUNT,
    ADC_MUX,
    ADC_START,
    ADC_VALUE,
    DAC,
    DISCRETE,
    DISCRETE_ADC,
    DISCRETE_CALIBRATED,
    DISCRETE_LINES,
    DISCRETE_POWER,
    ENC_COUNT,
    ENC_INDEX,
    ENC_LOAD,
    INDEX_BIT_0,
    N_DACS,
    N_ENCODERS,
    STATUS,
    STATUS_ADC_BUSY,
    STATUS_CALIBRATED,
    STATUS_ESTOP_OK,
    STATUS_J6_OVERFLOW,
    STATUS_POWER,
)
from tests.support.bench import PHASE, Bench
from tests.support.bus import BenchEndpoint, Row, rows_of
from tests.support.patience import wait_until

POLLS = 40
FREE_CHANNEL = 6  # of the converter: the bench's potentiometers take the first six


class Transport(Protocol):
    """A transport under test."""

    bus: Bus

    def hurry(self) -> None:
        """Let the near end wait a moment only, for what will not come, until the transport is mended."""

    def cut(self) -> None:
        """Break it, at once and silently if it can be; may be called by the far end, in the middle of an exchange."""

    def restore(self) -> None:
        """Mend it; the near end is patient again and connects by itself."""

    def garbage(self) -> None:
        """Let the far end answer the next exchange with something that means nothing, unless it is mended before."""


class Traveller:
    """Somebody at the near end."""

    def __init__(self, transport: Transport, end: BenchEndpoint) -> None:
        self.transport, self.bus, self.end = transport, transport.bus, end
        self.image = make_image()

    def exchange(self, *operations: Row) -> Words:
        self.bus.exchange(rows_of(operations), self.image)
        return self.image.copy()

    def write(self, *pairs: tuple[int, int]) -> Words:
        return self.exchange(*((OP_WRITE, offset, value) for offset, value in pairs))

    def read(self, offset: int) -> int:
        return int(self.exchange()[input_at(offset)])

    def status_without(self, bit: int) -> int:
        """Poll STATUS until `bit` has fallen."""
        for _ in range(POLLS):
            if not (status := self.read(STATUS)) & bit:
                return status
        raise AssertionError(f"bit {bit:#06x} of STATUS did not fall")

    def come_back(self) -> None:
        self.bus.close()
        self.transport.restore()
        self.bus.connect()


class BusContract:
    """The contract.

    Attributes:
        board_counts: the board numbers its images; without, the transport does, and nothing it reads can be old.
    """

    board_counts = True

    def illegal(self, there: Traveller) -> int:
        """Operations in the wrong direction that were ignored and counted: by the board, unless the transport does
        it."""
        return there.end.illegal

    def open_transport(self, end: BenchEndpoint) -> AbstractContextManager[Transport]:
        """The transport to `end`."""
        raise NotImplementedError

    @pytest.fixture
    def there(self, request: pytest.FixtureRequest) -> Iterator[Traveller]:
        """A connected transport to a board at rest; `@pytest.mark.parametrize("there", [...], indirect=True)` with
        options
        of the board."""
        end = BenchEndpoint(Bench(**getattr(request, "param", {})))
        with self.open_transport(end) as transport:
            transport.bus.connect()
            there = Traveller(transport, end)
            there.exchange()
            end.lists.clear()
            yield there
            end.before = end.after = lambda: None
            transport.bus.close()

    # --- what it is ----------------------------------------------------------------------------------------------

    @pytest.mark.parametrize("there", [{"revision_f": True}, {"revision_f": False}], indirect=True)
    def test_a_board_says_what_it_is(self, there: Traveller) -> None:
        facts = there.bus.connect()
        assert (facts.revision, facts.joints) == (there.end.facts().revision, N_ENCODERS)
        assert facts.period_ns >= 0

    def test_a_transport_has_a_name_that_people_recognise(self, there: Traveller) -> None:
        assert there.bus.name.strip()
        assert "\n" not in there.bus.name

    # --- registers -----------------------------------------------------------------------------------------------

    def test_every_converter_takes_its_word(self, there: Traveller) -> None:
        there.write(*((DAC + 2 * channel, 0x123 + channel) for channel in range(N_DACS)))
        assert there.end.bench.board.dac.tolist() == [0x123 + channel for channel in range(N_DACS)]

    def test_every_counter_takes_a_load_and_counts_on_from_it_beyond_sixteen_bits(self, there: Traveller) -> None:
        image = there.write(*((ENC_LOAD + 2 * joint, 0xFFF0 + joint) for joint in range(N_ENCODERS)))
        assert [int(image[IMAGE_ENC_COUNT + j]) for j in range(N_ENCODERS)] == list(range(0xFFF0, 0xFFF6))
        there.end.turn(2, 40.0)
        assert there.read(ENC_COUNT + 4) == (0xFFF2 + 40) % 0x10000
        there.end.turn(2, -40.0)
        assert there.read(ENC_COUNT + 4) == 0xFFF2 - 40

    def test_power_comes_and_goes_with_its_bit_and_the_scratch_bits_can_be_read_back(self, there: Traveller) -> None:
        there.write((DISCRETE, DISCRETE_POWER | DISCRETE_CALIBRATED))
        status = there.read(STATUS)
        assert status & STATUS_POWER
        assert status & STATUS_CALIBRATED
        assert status & STATUS_ESTOP_OK
        there.write((DISCRETE, DISCRETE_CALIBRATED))
        assert not there.read(STATUS) & STATUS_POWER

    def test_the_boards_own_output_lines_are_those_of_its_last_word(self, there: Traveller) -> None:
        for lines in (DISCRETE_LINES, 0x10, 0):
            there.write((DISCRETE, DISCRETE_POWER | lines))
            assert there.end.bench.memory.panel.discrete == DISCRETE_POWER | lines

    @pytest.mark.parametrize("scratch", [STATUS_CALIBRATED, STATUS_J6_OVERFLOW, 0])
    def test_a_host_that_starts_adopts_a_calibrated_arm_and_zeroes_the_counters_of_another(
        self, there: Traveller, scratch: int
    ) -> None:
        """STATUS read, its two scratch bits written back, STATUS read again (TRC004 vendor driver v4.3, as meant)."""
        loads = [(ENC_LOAD + 2 * joint, 500 + joint) for joint in range(N_ENCODERS)]
        there.write(*loads, (DISCRETE, scratch | DISCRETE_POWER))  # what a host leaves behind that died
        kept = there.read(STATUS) & (STATUS_CALIBRATED | STATUS_J6_OVERFLOW)
        status = int(there.write((DISCRETE, kept))[IMAGE_STATUS])
        assert (kept, status & (STATUS_POWER | STATUS_CALIBRATED | STATUS_J6_OVERFLOW)) == (scratch, scratch)
        if not status & STATUS_CALIBRATED:
            there.write(*((offset, 0) for offset, _ in loads), (DISCRETE, 0))
        expected = [value if scratch & STATUS_CALIBRATED else 0 for _, value in loads]
        assert [there.read(ENC_COUNT + 2 * joint) for joint in range(N_ENCODERS)] == expected

    def test_an_index_is_latched_once_armed_and_again_when_armed_again(self, there: Traveller) -> None:
        """Mask bit 0, then 1, in one exchange (TRC004 vendor driver v4.3)."""
        bit, phase = INDEX_BIT_0 << 1, int(PHASE[1])
        there.end.turn(1, phase - 5.0)
        for target in (phase + 5.0, phase - 5.0):
            there.write((DISCRETE, 0), (DISCRETE, bit))
            assert there.read(STATUS) & bit
            there.end.turn(1, target)
            there.status_without(bit)
        assert abs(there.read(ENC_INDEX + 2) - phase) <= 1

    def test_loading_a_counter_leaves_the_latch_alone(self, there: Traveller) -> None:
        there.end.turn(1, PHASE[1] - 5.0)
        there.write((DISCRETE, 0), (DISCRETE, INDEX_BIT_0 << 1))
        there.end.turn(1, PHASE[1] + 5.0)
        there.write((ENC_LOAD + 2, 7))
        assert there.read(ENC_INDEX + 2) == PHASE[1]
        assert there.read(ENC_COUNT + 2) == 7

    def test_a_conversion_of_revision_f_is_started_by_its_channel(self, there: Traveller) -> None:
        there.end.set_volts(FREE_CHANNEL, -2.5)
        word = FREE_CHANNEL << ADC_F_CHANNEL_SHIFT | ADC_F_COMMAND
        there.write((DISCRETE, 0), (DISCRETE, DISCRETE_ADC), (ADC_MUX, word))
        there.status_without(STATUS_ADC_BUSY)
        code = there.read(ADC_VALUE)
        assert code & 0xF == 0
        assert (code - 0x10000) * ADC_F_VOLT_PER_COUNT == pytest.approx(-2.5, abs=16 * ADC_F_VOLT_PER_COUNT)

    @pytest.mark.parametrize("there", [{"revision_f": False}], indirect=True)
    def test_a_conversion_of_revision_e_is_started_by_a_read(self, there: Traveller) -> None:
        there.end.set_volts(FREE_CHANNEL, 2.5)
        sequence: tuple[Row, ...] = (
            (OP_WRITE, DISCRETE, 0),
            (OP_WRITE, ADC_MUX, FREE_CHANNEL),
            (OP_READ, ADC_START, 0),
            (OP_WRITE, DISCRETE, DISCRETE_ADC),
        )
        there.exchange(*sequence)
        assert tuple(there.end.applied) == sequence
        there.status_without(STATUS_ADC_BUSY)
        assert there.read(ADC_VALUE) * ADC_E_VOLT_PER_COUNT == pytest.approx(2.5, abs=ADC_E_VOLT_PER_COUNT)

    @pytest.mark.parametrize("there", [{"revision_f": False}], indirect=True)
    def test_reading_the_image_starts_no_conversion(self, there: Traveller) -> None:
        there.write((DISCRETE, 0), (DISCRETE, DISCRETE_ADC))
        for _ in range(3):
            assert there.read(STATUS) & STATUS_ADC_BUSY
        assert (OP_READ, ADC_START, 0) not in there.end.applied

    # --- order ---------------------------------------------------------------------------------------------------

    def test_operations_are_applied_in_order_also_when_they_are_many(self, there: Traveller) -> None:
        wanted = [(OP_WRITE, DAC + 2 * (i % N_DACS), i % 0x1000) for i in range(150)]
        there.exchange(*wanted)
        assert there.end.applied == wanted

    def test_the_last_of_several_writes_to_a_register_stands(self, there: Traveller) -> None:
        there.write((DAC, 1), (DAC, 2), (DAC, 3))
        there.write((DAC, 4), (DAC, 3))
        assert there.end.bench.board.dac[0] == 3
        assert [value for _, _, value in there.end.applied] == [1, 2, 3, 4, 3]

    def test_what_is_written_before_and_after_a_read_that_acts_stays_there(self, there: Traveller) -> None:
        rows: list[Row] = [(OP_WRITE, DISCRETE, 1), (OP_READ, ADC_START, 0), (OP_WRITE, DISCRETE, 0)]
        there.exchange(*rows, *rows)
        assert there.end.applied == rows * 2

    def test_an_image_shows_what_its_own_operations_did(self, there: Traveller) -> None:
        for value in (5, 6, 7):
            image = there.write((ENC_LOAD, value))
            assert image[IMAGE_ENC_COUNT] == value

    def test_operations_in_the_wrong_direction_do_nothing_and_are_counted(self, there: Traveller) -> None:
        before = there.end.bench.board.dac.tolist()
        there.exchange((OP_WRITE, STATUS, 0xFFFF), (OP_READ, DAC, 0), (OP_WRITE, ADC_START, 1))
        assert self.illegal(there) == 3
        assert there.end.bench.board.dac.tolist() == before

    # --- age -----------------------------------------------------------------------------------------------------

    def test_images_have_rising_numbers_and_times(self, there: Traveller) -> None:
        images = [there.exchange() for _ in range(4)]
        for earlier, later in pairwise(images):
            assert later[IMAGE_COUNT] > earlier[IMAGE_COUNT]
            assert later[IMAGE_T_NS] > earlier[IMAGE_T_NS]

    def test_a_board_that_stands_still_never_looks_alive(self, there: Traveller) -> None:
        """Either the count shows it, or there is no answer."""
        there.end.standing = True
        there.transport.hurry()
        count = None
        for _ in range(3):
            try:
                newest = int(there.exchange()[IMAGE_COUNT])
            except LinkError:
                continue
            assert count is None or newest == count or not self.board_counts
            count = newest

    # --- away ----------------------------------------------------------------------------------------------------

    def test_a_transport_that_is_cut_says_so_and_shows_no_image(self, there: Traveller) -> None:
        image = there.exchange()
        there.transport.hurry()
        there.transport.cut()
        for _ in range(2):
            with pytest.raises(LinkError):
                there.write((DAC, 1))
        assert list(there.image) == list(image)

    def test_a_transport_that_is_mended_goes_on_and_brings_nothing_from_before(self, there: Traveller) -> None:
        there.transport.hurry()
        there.transport.cut()
        with pytest.raises(LinkError):
            there.write((DAC, 0x111))
        there.come_back()
        there.write((DAC + 2, 0x222))
        assert there.end.bench.board.dac[1] == 0x222
        assert [row for row in there.end.applied if row[2] == 0x222] == [(OP_WRITE, DAC + 2, 0x222)]
        assert len([row for row in there.end.applied if row[2] == 0x111]) <= 1

    def test_a_transport_cut_before_the_operations_are_applied_gives_no_image(self, there: Traveller) -> None:
        cuts: list[bool] = []
        there.end.before = lambda: cuts.append(there.transport.cut() is None)
        self._fail_and_come_back(there, cuts)

    def test_a_transport_cut_before_the_answer_applies_at_most_once(self, there: Traveller) -> None:
        cuts: list[bool] = []
        there.end.after = lambda: cuts.append(there.transport.cut() is None)
        self._fail_and_come_back(there, cuts)

    def _fail_and_come_back(self, there: Traveller, cuts: list[bool]) -> None:
        image, written = there.image.copy(), list[int]()
        there.transport.hurry()

        def write() -> None:
            if written:
                there.bus.connect()
            written.append(0x333 + len(written))
            there.write((DAC, written[-1]))

        def fail() -> bool:
            """The near end, which is in a hurry, may give up before the far end has had its turn."""
            with pytest.raises((LinkError, ProtocolError)):
                write()
            return bool(cuts)

        wait_until(fail, "the far end cuts the transport")
        there.end.before = there.end.after = lambda: None
        assert list(there.image) == list(image)
        there.come_back()
        there.exchange()
        assert all(there.end.applied.count((OP_WRITE, DAC, value)) <= 1 for value in written)

    def test_a_far_end_without_a_board_says_so(self, there: Traveller) -> None:
        there.end.gone = True
        there.transport.hurry()
        with pytest.raises((LinkError, RemoteProtocolError)):
            there.write((DAC, 1))
        there.end.gone = False
        there.come_back()
        assert there.write((DAC, 2))[IMAGE_COUNT] > 0

    def test_closing_twice_does_no_harm_and_a_closed_transport_is_no_transport(self, there: Traveller) -> None:
        there.bus.close()
        there.bus.close()
        there.bus.connect()
        assert there.exchange()[IMAGE_COUNT] > 0

    # --- garbage -------------------------------------------------------------------------------------------------

    def test_garbage_is_an_error_and_never_an_image(self, there: Traveller) -> None:
        image = there.exchange()
        there.transport.hurry()
        there.transport.garbage()
        with pytest.raises((LinkError, ProtocolError)):
            there.exchange()
        assert list(there.image) == list(image)
        there.come_back()
        assert there.exchange()[IMAGE_COUNT] > 0
