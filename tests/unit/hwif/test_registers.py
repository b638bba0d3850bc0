"""The register table agrees with itself and with its bit masks."""

from __future__ import annotations

from itertools import combinations

import pytest

from qrobot.hwif import registers as r
from qrobot.hwif.registers import REGISTERS, Access, Register, register_at

NAMED = {"ENC_INDEX", "STATUS", "ENC_COUNT", "ADC_VALUE", "ADC_START", "ENC_LOAD", "ADC_MUX", "DISCRETE", "DAC"}


def test_registers_are_even_words_inside_the_window_and_do_not_overlap() -> None:
    offsets = [offset for register in REGISTERS for offset in register.offsets]
    assert len(offsets) == len(set(offsets))
    assert all(offset % 2 == 0 and 0 <= offset < r.WINDOW_BYTES for offset in offsets)


@pytest.mark.parametrize("register", REGISTERS, ids=lambda register: register.name)
def test_reads_live_below_0x20_and_writes_above(register: Register) -> None:
    assert (register.access is Access.WRITE) == (register.offset >= 2 * r.N_INPUT_WORDS)


@pytest.mark.parametrize("register", REGISTERS, ids=lambda register: register.name)
def test_every_row_has_a_constant_of_its_name_and_a_source(register: Register) -> None:
    assert getattr(r, register.name) == register.offset
    assert register.source


def test_the_table_has_the_channels_of_the_board() -> None:
    counts = {register.name: register.count for register in REGISTERS}
    assert counts.keys() == NAMED
    assert counts["ENC_COUNT"] == counts["ENC_INDEX"] == counts["ENC_LOAD"] == r.N_ENCODERS
    assert counts["DAC"] == r.N_DACS


def test_an_offset_finds_its_row_and_an_unused_one_does_not() -> None:
    assert register_at(r.DAC + 14).name == "DAC"
    assert register_at(r.ENC_INDEX + 10).name == "ENC_INDEX"
    with pytest.raises(KeyError, match="0x0e"):
        register_at(0x0E)


def test_bits_of_status_and_of_discrete_do_not_overlap() -> None:
    fields = (
        r.STATUS_POWER,
        r.STATUS_ADC_BUSY,
        r.STATUS_INDEX,
        r.STATUS_J6_OVERFLOW,
        r.STATUS_CALIBRATED,
        r.STATUS_INPUTS,
    )
    outputs = (r.DISCRETE_POWER, r.DISCRETE_HAND_OPEN, r.DISCRETE_HAND_CLOSE, r.DISCRETE_CALIBRATED,
               r.DISCRETE_J6_OVERFLOW, r.DISCRETE_INDEX, r.DISCRETE_ADC)  # fmt: skip
    for masks in (fields, outputs):
        assert all(a & b == 0 for a, b in combinations(masks, 2))


def test_masks_of_the_flip_flops_and_the_scratch_bits_are_the_same_bits_in_status_and_discrete() -> None:
    assert (r.STATUS_INDEX, r.STATUS_ADC_BUSY) == (r.DISCRETE_INDEX, r.DISCRETE_ADC)
    assert (r.STATUS_CALIBRATED, r.STATUS_J6_OVERFLOW) == (r.DISCRETE_CALIBRATED, r.DISCRETE_J6_OVERFLOW)
    assert r.INDEX_BIT_0 << (r.N_ENCODERS - 1) == r.STATUS_INDEX + r.INDEX_BIT_0 >> 1


@pytest.mark.parametrize(("code", "volts"), [(0x000, 10.000), (0x800, 0.0), (0xFFF, -9.995)])
def test_dac_codes_are_the_published_voltages(code: int, volts: float) -> None:
    assert (r.DAC_ZERO - code) / r.DAC_COUNTS_PER_VOLT == pytest.approx(volts, abs=5e-4)


def test_converter_scales_are_the_published_ones() -> None:
    assert pytest.approx(0.0003052, abs=1e-7) == r.ADC_F_VOLT_PER_COUNT
    assert pytest.approx(0.0196, abs=1e-4) == r.ADC_E_VOLT_PER_COUNT
    assert 7 << r.ADC_F_CHANNEL_SHIFT | r.ADC_F_COMMAND == 0x3D0
