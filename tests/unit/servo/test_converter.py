"""Sampling the board's converter from the servo's cycle, on the emulated board's registers."""

from __future__ import annotations

import numpy as np
import pytest

from qrobot.errors import ConfigError
from qrobot.hwif.board_memory import Lane, fetch_image, newest_count
from qrobot.hwif.image import IMAGE_COUNT, IMAGE_T_NS, make_image
from qrobot.hwif.lanes import post_operations
from qrobot.hwif.operations import OP_FIELDS
from qrobot.hwif.registers import (
    DISCRETE_ADC,
    N_ADCS,
    STATUS_ADC_BUSY,
    STATUS_CALIBRATED,
    STATUS_ESTOP_OK,
    STATUS_POWER,
)
from qrobot.realtime.flat_record import record_of
from qrobot.servo.kernels.awaited import Awaited
from qrobot.servo.kernels.converter import (
    await_answer,
    code_volts,
    collect_sample,
    is_answered,
    make_adc_state,
    next_channel,
    note_post,
    start_sample,
)
from qrobot.servo.settings import ServoSettings
from qrobot.sim_board.board import REG_ADC_DONE_NS, REG_FLAGS, accept_operations, publish_sample
from tests.support.bench import PERIOD_NS, Bench
from tests.support.servo_bench import ServoBench

PATIENCE = 10
REVISIONS = [ord("F"), ord("E")]


class Sampler:
    """The servo's part of the conversation, and a board with known volts at its free channels."""

    def __init__(self, wanted: int, revision: int = ord("F"), **options: object) -> None:
        self.bench = Bench(n_pots=0, revision_f=revision == ord("F"), **options)  # type: ignore[arg-type]
        for channel in range(N_ADCS):
            self.bench.memory.panel.analog[channel] = 500_000 * channel + 100_000
        self.wanted, self.revision = wanted, revision
        self.adc, self.volts = record_of(make_adc_state()), np.zeros(N_ADCS)
        self.image, self.ops = make_image(), np.zeros((8, OP_FIELDS), np.int64)
        self.sampled: list[int] = []

    def look(self) -> None:
        """The first half of a cycle: the newest image."""
        assert fetch_image(self.bench.memory, self.image)
        channel = collect_sample(self.adc, self.volts, self.image, self.image[IMAGE_T_NS], self.revision, PATIENCE)
        if channel >= 0:
            self.sampled.append(channel)

    def post(self, late_ns: int = 0) -> None:
        """The second half: what is to be done, `late_ns` after the board's newest sample."""
        count = self.image[IMAGE_COUNT]
        n = start_sample(self.adc, self.ops, 0, DISCRETE_ADC, self.wanted, count, self.revision)
        now_ns = self.bench.t_ns + late_ns
        assert post_operations(self.bench.memory, Lane.SERVO, self.ops, n, now_ns)
        note_post(self.adc, newest_count(self.bench.memory), now_ns)

    def cycles(self, n: int, ticks: int) -> Sampler:
        """Cycles with so many board ticks after each."""
        for _ in range(n):
            self.look()
            self.post()
            self.bench.tick(ticks)
        return self

    def expected(self, channel: int) -> float:
        return 0.5 * channel + 0.1


@pytest.mark.parametrize("ticks", [1, 2, 4])
@pytest.mark.parametrize("revision", REVISIONS)
def test_each_channel_wanted_shows_its_own_voltage_in_turn(revision: int, ticks: int) -> None:
    sampler = Sampler(0b10101010, revision).cycles(20, ticks)
    assert sampler.sampled[:5] == [1, 3, 5, 7, 1]
    for channel in (1, 3, 5, 7):
        assert sampler.volts[channel] == pytest.approx(sampler.expected(channel), abs=0.01)
    assert sampler.volts[[0, 2, 4, 6]].tolist() == [0.0] * 4
    assert sampler.adc.timeouts == 0


def test_a_conversion_takes_one_cycle_of_a_slow_servo_and_two_of_one_as_fast_as_the_board() -> None:
    assert len(Sampler(1).cycles(21, 4).sampled) == 20
    assert len(Sampler(1).cycles(21, 1).sampled) == 10


def test_a_sensor_of_the_plant_adds_its_volts_at_a_free_channel() -> None:
    sampler = Sampler(1 << 6)
    sampler.bench.board.analog.external[6] = -4.5
    assert sampler.cycles(5, 1).volts[6] == pytest.approx(sampler.expected(6) - 4.5, abs=0.01)


@pytest.mark.parametrize("revision", REVISIONS)
def test_operations_that_arrive_while_the_board_is_sampling_are_never_answered_by_the_conversion_before(
    revision: int,
) -> None:
    sampler = Sampler(0b11000000, revision)
    bench = sampler.bench
    for _ in range(40):
        sampler.look()
        accept_operations(bench.board, bench.memory, bench.t_ns)
        sampler.post()  # too late for this tick
        bench.t_ns += PERIOD_NS
        publish_sample(bench.board, bench.memory, bench.shaft, bench.t_ns)
        for channel in set(sampler.sampled):
            assert sampler.volts[channel] == pytest.approx(sampler.expected(channel), abs=0.01)
    assert set(sampler.sampled) == {6, 7}


@pytest.mark.parametrize("revision", REVISIONS)
def test_a_servo_that_stalls_before_it_posts_takes_no_conversion_for_another(revision: int) -> None:
    """The board has shown images meanwhile that know nothing of what is posted then."""
    sampler = Sampler(0b11000000, revision)
    bench = sampler.bench
    for number in range(60):
        sampler.look()
        bench.tick(number % 7)
        accept_operations(bench.board, bench.memory, bench.t_ns)
        sampler.post()  # too late for this tick
        bench.t_ns += PERIOD_NS
        publish_sample(bench.board, bench.memory, bench.shaft, bench.t_ns)
        for channel in set(sampler.sampled):
            assert sampler.volts[channel] == pytest.approx(sampler.expected(channel), abs=0.01)
    assert set(sampler.sampled) == {6, 7}


@pytest.mark.parametrize("revision", REVISIONS)
def test_images_that_a_late_board_makes_up_for_answer_nothing_that_was_posted_after_them(revision: int) -> None:
    """Operations count from when they were posted: a board that lives its past first shows images without them."""
    sampler = Sampler(0b11000000, revision)
    for number in range(60):
        sampler.look()
        sampler.post(late_ns=number % 7 * PERIOD_NS)
        sampler.bench.tick(4)
        for channel in set(sampler.sampled):
            assert sampler.volts[channel] == pytest.approx(sampler.expected(channel), abs=0.01)
    assert set(sampler.sampled) == {6, 7}


def test_what_else_is_posted_is_answered_by_the_second_image_after_the_one_that_was_newest_then() -> None:
    """Whichever the cycle had seen: the servo may have stalled before it posted."""
    adc, awaited, image = record_of(make_adc_state()), record_of(Awaited()), make_image()
    await_answer(awaited)
    note_post(adc, 7, 1000)
    for count, taken_ns, answers in ((5, 900, False), (8, 1001, False), (9, 1000, False), (9, 1001, True)):
        image[IMAGE_COUNT] = count
        assert is_answered(awaited, adc, image, taken_ns) == answers
        note_post(adc, 20 + count, 2000)  # of later cycles, which have posted something else


def test_a_slow_converter_is_waited_for() -> None:
    sampler = Sampler(1 << 6, conversion_ns=6 * PERIOD_NS).cycles(30, 1)
    assert len(sampler.sampled) >= 3
    assert sampler.volts[6] == pytest.approx(sampler.expected(6), abs=0.01)


def test_a_channel_whose_conversion_never_ends_is_nan_until_one_succeeds_and_the_others_go_on() -> None:
    sampler = Sampler(0b11000000).cycles(9, 1)
    assert sampler.volts[6] == pytest.approx(sampler.expected(6), abs=0.01)

    def cycles(n: int, stuck: int) -> None:
        for _ in range(n):
            sampler.look()
            sampler.post()
            sampler.bench.tick()
            if sampler.adc.channel == stuck:  # its end never comes
                sampler.bench.board.register[REG_FLAGS] |= STATUS_ADC_BUSY
                sampler.bench.board.register[REG_ADC_DONE_NS] = 1 << 62

    cycles(60, stuck=6)
    assert np.isnan(sampler.volts[6])
    assert sampler.volts[7] == pytest.approx(sampler.expected(7), abs=0.01)
    assert sampler.adc.timeouts > 0
    cycles(60, stuck=-1)
    assert sampler.volts[6] == pytest.approx(sampler.expected(6), abs=0.01)


def test_codes_of_both_revisions_are_volts() -> None:
    assert code_volts(0x7FF0, ord("F")) == pytest.approx(10.0, abs=0.005)
    assert code_volts(0x8000, ord("F")) == -10.0
    assert code_volts(0x400F, ord("F")) == 5.0  # the low four bits mean nothing
    assert code_volts(0xAAFF, ord("E")) == 5.0  # nor does the high byte


def test_the_next_channel_is_the_next_one_wanted_round_the_end() -> None:
    assert next_channel(7, 0b1) == 0
    assert next_channel(0, 0b1) == 0
    assert next_channel(1, 0b10000011) == 7


def test_a_board_without_a_converter_makes_the_configured_channels_nan_and_does_nothing_else() -> None:
    bench = ServoBench(sensor_channels=(2, 6)).hold()
    bench.status = STATUS_POWER | STATUS_ESTOP_OK | STATUS_CALIBRATED | STATUS_ADC_BUSY
    bench.run(0.1)
    assert np.isnan(bench.state.sensors[[2, 6]]).all()
    assert np.isfinite(bench.state.sensors[[0, 1, 3, 4, 5, 7]]).all()
    assert bench.mode.name == "HOLDING"


@pytest.mark.parametrize("exchange_ms", [2, 30, 100])
def test_a_converter_is_waited_for_however_rarely_its_board_is_asked(exchange_ms: int) -> None:
    bench = ServoBench(sensor_channels=(2,), exchange_ms=exchange_ms, board_timeout_ms=2.0 * exchange_ms)
    bench.state.sensors[2] = np.nan
    for _ in range(4):
        bench.frozen = False
        bench.tick()
        bench.frozen = True
        bench.tick(exchange_ms - 1)
    assert bench.state.adc.done[2] > 0
    assert bench.state.adc.timeouts == 0
    assert np.isfinite(bench.state.sensors[2])


def test_without_sensors_the_servo_leaves_the_converter_alone() -> None:
    bench = ServoBench().hold()
    assert not any(write.value & DISCRETE_ADC for write in bench.writes if write.offset == 0x2E)
    assert all(write.offset != 0x2C for write in bench.writes)


def test_a_channel_the_board_does_not_have_is_refused() -> None:
    with pytest.raises(ConfigError, match="0 to 7"):
        ServoSettings(sensor_channels=(8,))
