"""The TRC004's registers, row by row, and the access sequences of the vendor's driver (version 4.3)."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from qrobot.hwif.board_memory import LANE_CAPACITY, Lane, fetch_image
from qrobot.hwif.image import IMAGE_COUNT, IMAGE_T_NS, make_image
from qrobot.hwif.lanes import pending_operations
from qrobot.hwif.operations import OP_READ, OP_WRITE
from qrobot.hwif.registers import (
    ADC_F_VOLT_PER_COUNT,
    ADC_MUX,
    ADC_START,
    ADC_VALUE,
    DAC,
    DAC_ZERO,
    DISCRETE,
    DISCRETE_ADC,
    DISCRETE_CALIBRATED,
    DISCRETE_INDEX,
    DISCRETE_J6_OVERFLOW,
    DISCRETE_POWER,
    ENC_COUNT,
    ENC_INDEX,
    ENC_LOAD,
    INDEX_BIT_0,
    N_DACS,
    N_ENCODERS,
    STATUS_ADC_BUSY,
    STATUS_CALIBRATED,
    STATUS_ESTOP_OK,
    STATUS_INDEX,
    STATUS_INPUTS,
    STATUS_J6_OVERFLOW,
    STATUS_POWER,
)
from qrobot.hwif.trace import read_trace
from qrobot.sim_board.board import REG_BRAKED
from tests.support.bench import COUNTS_PER_REV, PERIOD_NS, PHASE, POT_SLOPE, POT_ZERO, Bench, post
from tests.support.thorough import examples

NS_PER_MS = 1_000_000
channels = st.integers(0, N_ENCODERS - 1)


def signed(word: int) -> int:
    """A 16-bit word as two's complement."""
    return (word ^ 0x8000) - 0x8000


# --- reset -------------------------------------------------------------------------------------------------------


def test_at_chassis_power_up_torque_is_zero_everything_is_off_and_nothing_is_calibrated() -> None:
    bench = Bench()
    assert bench.board.dac.tolist() == [DAC_ZERO] * N_DACS
    assert bench.status == STATUS_ESTOP_OK
    assert [bench.read(ENC_COUNT + 2 * i) for i in range(N_ENCODERS)] == [0] * N_ENCODERS
    assert [bench.read(ENC_INDEX + 2 * i) for i in range(N_ENCODERS)] == [0] * N_ENCODERS
    assert bench.read(ADC_VALUE) == 0
    assert bench.board.register[REG_BRAKED] == 1


def test_every_image_carries_its_time_and_number() -> None:
    bench, image = Bench(), make_image()
    fetch_image(bench.memory, image)
    count, t_ns = image[IMAGE_COUNT], image[IMAGE_T_NS]
    bench.tick(3)
    fetch_image(bench.memory, image)
    assert image[IMAGE_COUNT] == count + 3
    assert image[IMAGE_T_NS] == t_ns + 3 * PERIOD_NS == bench.t_ns


# --- encoders ----------------------------------------------------------------------------------------------------


@given(channels, st.lists(st.floats(-200_000, 200_000), min_size=1, max_size=8))
def test_a_counter_follows_its_shaft_modulo_65536(channel: int, path: list[float]) -> None:
    bench = Bench()
    bench.turn(channel, *path)
    assert bench.read(ENC_COUNT + 2 * channel) == int(np.floor(path[-1] + 0.5)) % 65536
    others = [bench.read(ENC_COUNT + 2 * i) for i in range(N_ENCODERS) if i != channel]
    assert others == [0] * (N_ENCODERS - 1)


@given(channels, st.integers(-100_000, 100_000), st.integers(-40_000, 40_000))
def test_a_counter_counts_from_what_was_loaded(channel: int, loaded: int, travel: int) -> None:
    bench = Bench()
    bench.turn(channel, 123.0)
    bench.write((ENC_LOAD + 2 * channel, loaded))
    assert bench.read(ENC_COUNT + 2 * channel) == loaded % 65536
    bench.turn(channel, 123.0 + travel)
    assert bench.read(ENC_COUNT + 2 * channel) == (loaded + travel) % 65536


def test_joint_4_with_its_offset_covers_its_range_as_a_signed_word() -> None:
    """23.2k to -35.9k counts fit 16 bits only after + 8000, which the host adds when it loads [V]."""
    bench = Bench()
    bench.write((ENC_LOAD + 6, 8000))
    for position in (23_200, -35_900):
        bench.turn(3, position)
        assert signed(bench.read(ENC_COUNT + 6)) - 8000 == position


# --- index latches -----------------------------------------------------------------------------------------------


def armed(channel: int, relatch: bool = True) -> Bench:
    """A bench whose shaft stands two counts before an index pulse, flag cleared the vendor's way."""
    bench = Bench(relatch=relatch)
    bench.turn(channel, PHASE[channel] - 2)
    bench.write((DISCRETE, 0), (DISCRETE, INDEX_BIT_0 << channel))
    return bench


@given(channels)
def test_an_armed_latch_takes_the_count_at_the_index_and_drops_its_status_bit(channel: int) -> None:
    bench, bit = armed(channel), INDEX_BIT_0 << channel
    assert bench.status & bit
    bench.turn(channel, PHASE[channel] + 3)
    assert not bench.status & bit
    bench.write((DISCRETE, DISCRETE_INDEX))
    assert bench.status & STATUS_INDEX == STATUS_INDEX & ~bit
    assert bench.read(ENC_INDEX + 2 * channel) == PHASE[channel]


@given(channels)
def test_the_latched_count_is_on_the_counters_scale_after_a_load(channel: int) -> None:
    bench = armed(channel)
    bench.write((ENC_LOAD + 2 * channel, 60_000))
    bench.turn(channel, PHASE[channel] + 3)
    assert bench.read(ENC_INDEX + 2 * channel) == 60_002
    bench.write((ENC_LOAD + 2 * channel, 5))
    assert bench.read(ENC_INDEX + 2 * channel) == 60_002


@given(channels)
def test_reading_status_and_index_changes_nothing(channel: int) -> None:
    bench = armed(channel)
    bench.turn(channel, PHASE[channel])
    before = bench.status, bench.read(ENC_INDEX + 2 * channel)
    for offset in range(0, ADC_START + 1, 2):
        bench.touch(offset)
    assert (bench.status, bench.read(ENC_INDEX + 2 * channel)) == before


@given(channels)
def test_a_flag_stays_down_until_its_mask_bit_goes_low_and_high_again(channel: int) -> None:
    bench, bit = armed(channel), INDEX_BIT_0 << channel
    bench.turn(channel, PHASE[channel] + 3)
    bench.write((DISCRETE, bit))
    assert not bench.status & bit
    bench.write((DISCRETE, 0))
    bench.write((DISCRETE, bit))
    assert bench.status & bit
    bench.turn(channel, PHASE[channel] - 3)
    assert not bench.status & bit


@pytest.mark.parametrize("index_idle", [False, True])
@pytest.mark.parametrize("adc_idle", [False, True])
def test_masked_flags_show_their_idle_levels_and_unmasked_ones_their_own(adc_idle: bool, index_idle: bool) -> None:
    bench = Bench(adc_idle=adc_idle, index_idle=index_idle)
    idle = (STATUS_ADC_BUSY if adc_idle else 0) | (STATUS_INDEX if index_idle else 0)
    assert bench.status == idle | STATUS_ESTOP_OK
    for mask in (INDEX_BIT_0, DISCRETE_INDEX, DISCRETE_ADC, DISCRETE_ADC | DISCRETE_INDEX):
        bench.write((DISCRETE, mask))
        assert bench.status == idle | mask | STATUS_ESTOP_OK
        bench.write((DISCRETE, 0))
        assert bench.status == idle | STATUS_ESTOP_OK


def test_a_cold_board_does_not_look_calibrated_to_a_driver_that_takes_its_scratch_bits_from_bits_15_and_14() -> None:
    """The vendor's driver writes `(STATUS & 0xC000) >> 8` to DISCRETE at its start."""
    bench = Bench()
    bench.write((DISCRETE, (bench.status & 0xC000) >> 8))
    assert not bench.status & STATUS_CALIBRATED


def test_clearing_and_arming_within_one_tick_is_enough() -> None:
    bench = armed(0)
    bench.turn(0, PHASE[0] + 3)
    bench.write((DISCRETE, 0), (DISCRETE, DISCRETE_INDEX))
    assert bench.status & STATUS_INDEX == STATUS_INDEX


@given(channels)
def test_an_index_passed_while_the_mask_is_low_is_not_latched(channel: int) -> None:
    bench = Bench()
    bench.turn(channel, PHASE[channel] - 2, PHASE[channel] + 2)
    assert bench.read(ENC_INDEX + 2 * channel) == 0
    bench.write((DISCRETE, DISCRETE_INDEX))
    assert bench.status & STATUS_INDEX == STATUS_INDEX


@given(channels, st.booleans())
def test_a_second_index_is_latched_or_not_by_the_switch(channel: int, relatch: bool) -> None:
    bench, period = armed(channel, relatch), int(COUNTS_PER_REV[channel])
    bench.turn(channel, PHASE[channel] + 3, PHASE[channel] + period + 3)
    assert bench.read(ENC_INDEX + 2 * channel) == PHASE[channel] + (period if relatch else 0)


@given(channels, st.booleans(), st.integers(-3000, 3000), st.integers(-5000, 5000))
def test_an_index_is_found_wherever_a_step_passes_it(channel: int, relatch: bool, start: int, travel: int) -> None:
    """Against the definition: walk the step count by count and note every index position met."""
    bench, period = Bench(relatch=relatch), int(COUNTS_PER_REV[channel])
    bench.turn(channel, start)
    bench.write((DISCRETE, DISCRETE_INDEX))
    bench.turn(channel, start + travel)
    direction = 1 if travel >= 0 else -1
    way = [start + direction * k for k in range(1, abs(travel) + 1)]
    met = [p for p in way if p % period == PHASE[channel]]
    assert bool(bench.status & INDEX_BIT_0 << channel) == (not met)
    if met:
        assert bench.read(ENC_INDEX + 2 * channel) == (met[-1] if relatch else met[0]) % 65536


# --- discrete word and status ------------------------------------------------------------------------------------


def test_calibrated_and_overflow_bits_read_back_at_their_own_places() -> None:
    """Bits 6 and 7, not where the vendor's `(status & 0xC000) >> 8` looks for them."""
    bench = Bench()
    bench.write((DISCRETE, DISCRETE_CALIBRATED))
    assert bench.status & (STATUS_CALIBRATED | STATUS_J6_OVERFLOW) == STATUS_CALIBRATED
    bench.write((DISCRETE, DISCRETE_J6_OVERFLOW))
    assert bench.status & (STATUS_CALIBRATED | STATUS_J6_OVERFLOW) == STATUS_J6_OVERFLOW


def test_counters_and_calibration_survive_a_host_that_starts_again() -> None:
    """The intended start: read STATUS, write back bits 7 and 6 alone, and adopt the counts if CALIB is set."""
    bench = Bench()
    bench.write((ENC_LOAD + 2, 1234), (DISCRETE, DISCRETE_CALIBRATED | DISCRETE_POWER))
    bench.turn(1, 100.0)
    bench.write((DISCRETE, bench.status & 0x00C0))
    assert bench.status & STATUS_CALIBRATED
    assert not bench.status & STATUS_POWER
    assert bench.read(ENC_COUNT + 2) == 1334


def test_the_vendors_start_up_line_loses_or_invents_the_calibration() -> None:
    """`discrete = (status & 0xC000) >> 8` moves ARM POWER to bit 7 and the converter's flag to bit 6."""
    bench = Bench(adc_idle=True)
    bench.write((DISCRETE, (bench.status & 0xC000) >> 8))
    assert bench.status & STATUS_CALIBRATED  # never calibrated, yet the idle converter's 1 claims it


@given(st.integers(0, 0xFFFF))
def test_discrete_inputs_show_the_panel_and_bit_0_is_the_emergency_stops(levels: int) -> None:
    bench = Bench()
    bench.memory.panel.inputs = levels
    bench.tick()
    assert bench.status & STATUS_INPUTS == (levels & STATUS_INPUTS) | STATUS_ESTOP_OK
    bench.memory.panel.estop = 1
    bench.tick()
    assert not bench.status & STATUS_ESTOP_OK


# --- power and brakes --------------------------------------------------------------------------------------------


def test_power_comes_on_when_enabled_and_the_button_is_pressed_after_it() -> None:
    bench = Bench(auto_panel=False)
    bench.memory.panel.presses += 1
    bench.tick()
    bench.write((DISCRETE, DISCRETE_POWER))
    assert not bench.status & STATUS_POWER
    bench.memory.panel.presses += 1
    bench.tick()
    assert bench.status & STATUS_POWER


def test_the_emulator_presses_the_button_by_itself_when_told_to() -> None:
    bench = Bench(auto_panel=True)
    bench.write((DISCRETE, DISCRETE_POWER))
    assert bench.status & STATUS_POWER


@pytest.mark.parametrize("auto_panel", [False, True])
def test_releasing_the_emergency_stop_does_not_bring_power_back(auto_panel: bool) -> None:
    bench = Bench(auto_panel=auto_panel)
    bench.write((DISCRETE, DISCRETE_POWER))
    bench.memory.panel.presses += 1
    bench.tick()
    bench.memory.panel.estop = 1
    bench.tick()
    assert not bench.status & STATUS_POWER
    bench.memory.panel.estop = 0
    bench.tick(10)
    assert not bench.status & STATUS_POWER
    bench.write((DISCRETE, 0))
    bench.write((DISCRETE, DISCRETE_POWER))
    bench.memory.panel.presses += 1
    bench.tick()
    assert bench.status & STATUS_POWER


def test_dropping_the_enable_bit_drops_the_latch_even_within_one_tick() -> None:
    bench = Bench(auto_panel=False)
    bench.write((DISCRETE, DISCRETE_POWER))
    bench.memory.panel.presses += 1
    bench.tick()
    bench.write((DISCRETE, 0), (DISCRETE, DISCRETE_POWER))
    assert not bench.status & STATUS_POWER


def test_power_does_not_come_on_while_the_emergency_stop_is_pressed() -> None:
    bench = Bench()
    bench.memory.panel.estop = 1
    bench.write((DISCRETE, DISCRETE_POWER))
    assert not bench.status & STATUS_POWER


def test_brakes_release_and_engage_after_their_delays() -> None:
    bench = Bench(brake_release_ns=3 * NS_PER_MS, brake_engage_ns=2 * NS_PER_MS)
    bench.write((DISCRETE, DISCRETE_POWER))
    on = bench.t_ns - PERIOD_NS
    while bench.board.register[REG_BRAKED]:
        bench.tick()
    assert bench.t_ns - PERIOD_NS - on == 3 * NS_PER_MS
    bench.write((DISCRETE, 0))
    off = bench.t_ns - PERIOD_NS
    while not bench.board.register[REG_BRAKED]:
        bench.tick()
    assert bench.t_ns - PERIOD_NS - off == 2 * NS_PER_MS


def test_a_brake_that_was_told_to_release_and_to_close_again_has_never_opened() -> None:
    bench = Bench(brake_release_ns=3 * NS_PER_MS)
    bench.write((DISCRETE, DISCRETE_POWER))
    bench.tick(8)
    bench.write((DISCRETE, 0))
    for _ in range(100):
        assert bench.board.register[REG_BRAKED]
        bench.tick()


# --- DACs --------------------------------------------------------------------------------------------------------


@settings(max_examples=examples(25))
@given(st.integers(0, N_DACS - 1), st.integers(0, 0xFFFF))
def test_a_dac_keeps_the_low_twelve_bits_for_ever(channel: int, word: int) -> None:
    bench = Bench()
    bench.write((DAC + 2 * channel, word))
    bench.tick(200)
    assert bench.board.dac[channel] == word & 0xFFF
    assert (np.delete(bench.board.dac, channel) == DAC_ZERO).all()


def test_the_optional_watchdog_zeroes_all_torques_when_writes_stop() -> None:
    bench = Bench(watchdog_ns=5 * NS_PER_MS)
    for _ in range(30):
        bench.write((DAC, 1), (DAC + 14, 2))
        assert bench.board.dac[[0, 7]].tolist() == [1, 2]
    bench.tick(20)
    assert bench.board.dac[[0, 7]].tolist() == [1, 2]
    bench.tick(2)
    assert bench.board.dac.tolist() == [DAC_ZERO] * N_DACS


# --- converter ---------------------------------------------------------------------------------------------------


def convert_f(bench: Bench, channel: int) -> int:
    """The vendor's revision F sequence: mask, start, poll, read, mask off."""
    bench.write((DISCRETE, DISCRETE_ADC), (ADC_MUX, channel << 7 | 0x50))
    for _ in range(4):
        if not bench.status & STATUS_ADC_BUSY:
            break
        bench.tick()
    assert not bench.status & STATUS_ADC_BUSY
    value = bench.read(ADC_VALUE)
    bench.write((DISCRETE, 0))
    return value


def convert_e(bench: Bench, channel: int) -> int:
    """The vendor's revision E sequence: channel, start by reading, mask after the start, poll, read, mask off."""
    post(bench.memory, (OP_WRITE, ADC_MUX, channel), (OP_READ, ADC_START, 0), (OP_WRITE, DISCRETE, DISCRETE_ADC))
    bench.tick()
    for _ in range(4):
        if not bench.status & STATUS_ADC_BUSY:
            break
        bench.tick()
    assert not bench.status & STATUS_ADC_BUSY
    value = bench.read(ADC_VALUE)
    bench.write((DISCRETE, 0))
    return value


@given(st.integers(6, 7), st.floats(-12.0, 12.0))
def test_revision_f_converts_plus_minus_ten_volts_to_twelve_left_justified_bits(channel: int, volts: float) -> None:
    bench = Bench()
    bench.memory.panel.analog[channel] = round(volts * 1e6)
    value = convert_f(bench, channel)
    assert value % 16 == 0
    assert 0 <= value <= 0xFFFF
    clipped = min(max(volts, -10.0), 10.0 - 16 * ADC_F_VOLT_PER_COUNT)
    assert abs(signed(value) * ADC_F_VOLT_PER_COUNT - clipped) <= 8.01 * ADC_F_VOLT_PER_COUNT


@given(st.integers(6, 7), st.floats(-1.0, 6.0))
def test_revision_e_converts_zero_to_five_volts_to_a_byte(channel: int, volts: float) -> None:
    bench = Bench(revision_f=False)
    bench.memory.panel.analog[channel] = round(volts * 1e6)
    value = convert_e(bench, channel)
    assert abs(value * 5.0 / 255.0 - min(max(volts, 0.0), 5.0)) <= 0.5 * 5.0 / 255.0 + 1e-6


@pytest.mark.parametrize("channel", range(N_ENCODERS))
def test_potentiometers_follow_the_vendors_line(channel: int) -> None:
    bench = Bench()
    bench.turn(channel, 10 * COUNTS_PER_REV[channel])
    assert abs(convert_f(bench, channel) - (POT_ZERO[channel] + 10 * POT_SLOPE)) <= 8


def test_waviness_and_noise_stay_within_what_the_vendors_table_shows() -> None:
    bench = Bench(noise=5.0, wave=20.0)
    residuals = []
    for turns in range(-30, 30):
        bench.turn(2, turns * COUNTS_PER_REV[2])
        residuals.append(convert_f(bench, 2) - (POT_ZERO[2] + turns * POT_SLOPE))
    assert 5.0 < np.std(residuals) < 22.0
    assert np.max(np.abs(residuals)) < 51


def test_noise_is_the_same_for_the_same_seed_and_differs_for_another() -> None:
    runs = []
    for seed in (1, 1, 2):
        bench = Bench(noise=40.0, seed=seed)
        runs.append([convert_f(bench, 0) for _ in range(8)])
    assert runs[0] == runs[1] != runs[2]
    assert len(set(runs[0])) > 1


def test_backlash_of_the_potentiometer_shows_at_a_reversal_only() -> None:
    bench, rev = Bench(backlash=0.4), COUNTS_PER_REV[0]
    bench.turn(0, 5 * rev)
    there = convert_f(bench, 0)
    bench.turn(0, 4.65 * rev)
    assert convert_f(bench, 0) == there
    bench.turn(0, 4.0 * rev)
    assert convert_f(bench, 0) - there == pytest.approx(-0.6 * POT_SLOPE, abs=16)


def test_channels_without_a_potentiometer_are_free_inputs() -> None:
    bench = Bench(n_pots=3)
    bench.memory.panel.analog[:] = 2_000_000
    assert signed(convert_f(bench, 3)) * ADC_F_VOLT_PER_COUNT == pytest.approx(2.0, abs=0.003)
    assert abs(convert_f(bench, 2) - POT_ZERO[2]) <= 8


def test_a_conversion_takes_its_time_and_shows_the_old_value_until_then() -> None:
    bench = Bench(conversion_ns=2 * PERIOD_NS + 1)
    bench.memory.panel.analog[6] = 5_000_000
    bench.write((DISCRETE, DISCRETE_ADC), (ADC_MUX, 6 << 7 | 0x50))
    bench.memory.panel.analog[6] = 0  # sampled at the start
    bench.tick()
    assert bench.status & STATUS_ADC_BUSY
    assert bench.read(ADC_VALUE) == 0
    bench.tick()
    assert not bench.status & STATUS_ADC_BUSY
    assert bench.read(ADC_VALUE) == 0x4000


def test_revision_f_does_not_start_without_the_convert_bit_nor_by_reading() -> None:
    bench = Bench()
    bench.write((DISCRETE, DISCRETE_ADC), (ADC_MUX, 2 << 7))
    bench.touch(ADC_START)
    bench.tick(10)
    assert bench.status & STATUS_ADC_BUSY


def test_revision_e_does_not_start_by_writing_the_channel() -> None:
    bench = Bench(revision_f=False)
    bench.write((DISCRETE, DISCRETE_ADC), (ADC_MUX, 0x50))
    bench.tick(10)
    assert bench.status & STATUS_ADC_BUSY


def test_a_conversion_that_ends_before_its_mask_is_set_is_never_seen() -> None:
    """Why revision E's mask has to follow the start in the same burst, and why a host's poll needs a time-out."""
    bench = Bench(revision_f=False)
    bench.memory.panel.analog[6] = 5_000_000
    bench.write((ADC_MUX, 6))
    bench.touch(ADC_START)
    bench.write((DISCRETE, DISCRETE_ADC))
    bench.tick(10)
    assert bench.status & STATUS_ADC_BUSY
    assert bench.read(ADC_VALUE) == 255


# --- the bus -----------------------------------------------------------------------------------------------------


def test_operations_on_the_wrong_direction_or_outside_the_window_are_ignored_and_counted() -> None:
    bench = Bench()
    wrong = [(OP_WRITE, offset, 7) for offset in range(0x00, 0x20, 2)]
    wrong += [(OP_READ, offset, 0) for offset in range(0x20, 0x40, 2)]
    wrong += [(OP_WRITE, 0x40, 7), (OP_WRITE, 0x31, 7), (OP_WRITE, -2, 7), (OP_READ, 0x01, 0), (9, DAC, 7)]
    before = bench.status, bench.board.dac.tolist(), bench.board.encoders.counter.tolist()
    post(bench.memory, *wrong)
    bench.tick()
    assert bench.memory.facts.illegal_ops == len(wrong)
    assert (bench.status, bench.board.dac.tolist(), bench.board.encoders.counter.tolist()) == before
    assert len(read_trace(bench.memory)) == 0


def test_operations_act_in_the_order_posted_and_lanes_in_the_order_of_their_rank() -> None:
    bench = Bench()
    post(bench.memory, (OP_WRITE, DAC, 3), lane=Lane.GUARDIAN)
    post(bench.memory, (OP_WRITE, DAC, 2), lane=Lane.TOOL)
    post(bench.memory, (OP_WRITE, DAC, 0), (OP_WRITE, DAC, 1), lane=Lane.SERVO)
    bench.tick()
    rows = read_trace(bench.memory)
    assert rows[:, 3].tolist() == [0, 1, 2, 3]
    assert rows[:, 1].tolist() == [Lane.SERVO, Lane.SERVO, Lane.TOOL, Lane.GUARDIAN]
    assert bench.board.dac[0] == 3


def test_every_dac_and_discrete_write_is_traced_with_the_boards_time() -> None:
    bench = Bench()
    t_ns = bench.t_ns
    bench.write((DAC + 4, 5), (ENC_LOAD, 9), (DISCRETE, 1))
    bench.write((DAC + 4, 6))
    assert read_trace(bench.memory).tolist() == [
        [t_ns, Lane.SERVO, DAC + 4, 5],
        [t_ns, Lane.SERVO, DISCRETE, 1],
        [t_ns + PERIOD_NS, Lane.SERVO, DAC + 4, 6],
    ]


def test_a_full_lane_is_drained_within_one_tick() -> None:
    bench = Bench()
    post(bench.memory, *[(OP_WRITE, DAC, i) for i in range(LANE_CAPACITY)])
    bench.tick()
    assert pending_operations(bench.memory, Lane.SERVO) == 0
    assert bench.board.dac[0] == LANE_CAPACITY - 1
