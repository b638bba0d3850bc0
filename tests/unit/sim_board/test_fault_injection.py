"""What each fault does to the emulated board, at registers and arm, and that it says whether it acted."""

from __future__ import annotations

import numpy as np
import pytest

from qrobot.config import load_robot
from qrobot.errors import ConfigError
from qrobot.hwif.board_memory import FAULT_SLOTS, fetch_image, local_board_memory
from qrobot.hwif.image import IMAGE_COUNT, IMAGE_T_NS, make_image
from qrobot.hwif.registers import (
    ADC_F_CHANNEL_SHIFT,
    ADC_MUX,
    ADC_VALUE,
    DAC,
    DAC_ZERO,
    DISCRETE,
    DISCRETE_INDEX,
    DISCRETE_POWER,
    ENC_COUNT,
    INDEX_BIT_0,
    STATUS,
    STATUS_ESTOP_OK,
    STATUS_POWER,
)
from qrobot.model.transmission import signed_word
from qrobot.sim_board.emulator import Emulator, emulator_run
from qrobot.sim_board.faults import FaultPlan
from qrobot.sim_board.injection import FaultPanel, Injected
from tests.support.bench import OP_WRITE, post, read_word

PUMA = load_robot("puma560")
STEPS_PER_S = 4000
STEP_NS = 250_000


class Rig:
    """An emulator in lock-step whose joint 1 turns when it is asked to."""

    def __init__(self, *faults: str, seed: int = 0) -> None:
        self.emulator = Emulator(PUMA, physics="rigid", start="ready", faults=FaultPlan.parse(faults, seed))
        self.memory = local_board_memory()
        self.t_ns = 0
        self.emulator.connect(self.memory)

    def step(self, steps: int = 1) -> None:
        self.t_ns = emulator_run(self.emulator.bundle, self.memory, self.t_ns, steps)

    def write(self, *pairs: tuple[int, int]) -> None:
        post(self.memory, *((OP_WRITE, offset, value) for offset, value in pairs))

    def power(self) -> None:
        """Power on, brakes released; the arm begins to sag."""
        self.write((DISCRETE, DISCRETE_POWER))
        self.step(130)
        assert self.emulator.powered

    def spin(self, speed: float = 2.0, joint: int = 0) -> None:
        """The joint has a speed, rad/s, as if it had been pushed."""
        self.emulator.bundle.plant.v[joint] = speed

    def count(self, joint: int = 0) -> int:
        return signed_word(read_word(self.memory, ENC_COUNT + 2 * joint))

    def moved(self, joint: int = 0) -> float:
        """Counts by which the shaft really moved since the last call."""
        shaft = float(self.emulator.bundle.shaft[joint])
        before, self._before = getattr(self, "_before", 0.0), shaft
        return shaft - before

    def image(self) -> np.ndarray:
        image = make_image()
        assert fetch_image(self.memory, image)
        return image

    def counted(self, steps: int = 40) -> tuple[int, float]:
        """Counts shown and counts turned while joint 1 spins for some steps."""
        self.spin()
        before = self.count()
        self.moved()
        self.step(steps)
        return signed_word((self.count() - before) & 0xFFFF), self.moved()

    def report(self, place: int = 0) -> Injected:
        return self.emulator.faults.report(place)


# ---------------------------------------------------------------------------------------------------------- encoders


def test_a_healthy_encoder_counts_what_its_shaft_turns() -> None:
    rig = Rig()
    rig.power()
    shown, turned = rig.counted()
    assert abs(turned) > 100
    assert abs(shown - turned) <= 1


@pytest.mark.parametrize(
    ("line", "share"),
    [("encoder:1 stuck", 0.0), ("encoder:1 reversed", -1.0), ("encoder:1 scale 1.5", 1.5), ("encoder:1 scale", 1.01)],
)
def test_a_faulty_encoder_counts_a_share_of_each_step(line: str, share: float) -> None:
    rig = Rig(line)
    rig.power()
    shown, turned = rig.counted()
    assert shown == pytest.approx(share * turned, abs=1.01)
    assert rig.report().acted >= 39  # seen one step later
    assert rig.report().acted < rig.report().steps  # it stood still before


def test_counts_missed_stay_lost_when_the_encoder_is_well_again() -> None:
    rig = Rig()
    rig.power()
    rig.emulator.faults.add("encoder:1 stuck +10ms")
    shown, _ = rig.counted(40)
    assert shown == 0
    shown, turned = rig.counted(40)
    assert abs(shown - turned) <= 1
    assert rig.report().over
    assert rig.report().steps == 40


def test_one_of_so_many_rising_counts_is_lost_and_no_falling_one() -> None:
    rig = Rig("encoder:1 lost 2")
    rig.power()
    forth, turned = rig.counted()
    rig.spin(-2.0)
    rising = turned > 0
    before = rig.count()
    rig.step(40)
    back = rig.count() - before
    ratios = (forth / turned, back / rig.moved())
    assert ratios == pytest.approx((0.5, 1.0) if rising else (1.0, 0.5), abs=0.02)


def test_a_jump_happens_once_and_stays() -> None:
    rig = Rig()
    before = rig.count()
    rig.emulator.faults.add("encoder:1 jump -3000 @1ms")
    rig.step(4)
    assert rig.count() == before
    rig.step()
    assert rig.count() == before - 3000
    rig.step(20)
    assert rig.count() == before - 3000
    assert rig.report().acted == 1


def test_a_wrong_count_is_right_again_afterwards() -> None:
    rig = Rig("encoder:1 wrong 700 +2ms")
    before = rig.count()
    rig.step(8)
    assert rig.count() == before + 700
    rig.step()
    assert rig.count() == before
    assert rig.report().acted == rig.report().steps == 8


def test_garbage_is_random_and_the_same_for_the_same_seed() -> None:
    def words(seed: int) -> list[int]:
        rig, seen = Rig("encoder:1 garbage +5ms", seed=seed), []
        for _ in range(20):
            rig.step()
            seen.append(rig.count())
        rig.step()
        seen.append(rig.count())
        return seen

    first = words(1)
    assert len(set(first)) > 15
    assert first == words(1)
    assert first[:-1] != words(2)[:-1]
    assert first[-1] == words(2)[-1]  # the counter itself was never wrong


def test_other_channels_count_on() -> None:
    rig = Rig("encoder:2 stuck")
    rig.power()
    shown, turned = rig.counted()
    assert abs(shown - turned) <= 1


# ------------------------------------------------------------------------------------------------- index and converter


def pulses_in(rig: Rig, revolutions: int) -> int:
    """Index pulses latched while joint 1's shaft is turned by hand."""
    bundle, pulses = rig.emulator.bundle, 0
    per_rev = int(bundle.board.encoders.counts_per_rev[0])
    for _ in range(revolutions * 10):
        bundle.plant.q[0] += per_rev / 10 / bundle.counts_per_unit[0]
        rig.write((DISCRETE, 0), (DISCRETE, DISCRETE_INDEX))
        rig.step()
        pulses += not read_word(rig.memory, STATUS) & INDEX_BIT_0
    return pulses


@pytest.mark.parametrize(("faults", "per_turn"), [((), 1), (("index:1 missing",), 0), (("index:1 double",), 2)])
def test_index_pulses_per_revolution(faults: tuple[str, ...], per_turn: int) -> None:
    rig = Rig(*faults)
    encoders = rig.emulator.bundle.board.encoders
    odd = int(encoders.odd[0])
    assert pulses_in(rig, 4) == 4 * per_turn
    assert (encoders.odd[0] > odd) == bool(faults)
    for place in range(len(faults)):
        assert rig.report(place).acted > 0


def convert(rig: Rig, channel: int) -> int:
    rig.write((ADC_MUX, channel << ADC_F_CHANNEL_SHIFT | 0x40))
    rig.step(2)
    return read_word(rig.memory, ADC_VALUE)


def test_a_dead_pot_reads_zero_a_wrong_one_is_off_and_a_noisy_one_scatters() -> None:
    rig = Rig()
    well = [convert(rig, 0) for _ in range(40)]
    rig.emulator.faults.add("pot:1 dead")
    assert convert(rig, 0) == 0
    rig.emulator.faults.clear()
    rig.emulator.faults.add("pot:1 wrong 0.5")
    assert convert(rig, 0) - np.mean(well) == pytest.approx(0.5 / (20 / 65536), abs=40)
    rig.emulator.faults.clear()
    rig.emulator.faults.add("pot:1 noise 50")
    assert np.std([convert(rig, 0) for _ in range(40)]) > 10 * max(4.0, np.std(well))
    assert rig.report().acted > 0


@pytest.mark.parametrize(("fault", "indexed"), [("encoder:1 off", False), ("encoder:1 stuck", True)])
def test_a_cable_that_is_out_gives_no_index_pulse_either(fault: str, indexed: bool) -> None:
    rig = Rig(fault)
    rig.write((DISCRETE, DISCRETE_POWER), (DISCRETE, DISCRETE_POWER | DISCRETE_INDEX))
    rig.step()
    rig.spin(joint=0)
    before = read_word(rig.memory, ENC_COUNT)
    rig.step(STEPS_PER_S // 4)  # more than a motor turn
    assert read_word(rig.memory, ENC_COUNT) == before
    assert (read_word(rig.memory, STATUS) & INDEX_BIT_0 == 0) == indexed
    assert rig.emulator.faults.report(0).acted > 0


def test_a_stuck_converter_shows_its_last_code_for_every_channel() -> None:
    rig = Rig()
    first, second = convert(rig, 0), convert(rig, 5)
    assert first != second
    rig.emulator.faults.add("adc stuck")
    assert convert(rig, 0) == second
    assert rig.report().acted > 0


# ------------------------------------------------------------------------------------------------ amplifiers and power


def test_a_stuck_amplifier_holds_its_word_whatever_is_written() -> None:
    rig = Rig()
    rig.power()
    rig.write((DAC, DAC_ZERO + 300))
    rig.step()
    rig.emulator.faults.add("dac:1 stuck")
    rig.step(3)
    assert rig.report().acted == 0  # it does as it is told, by chance
    rig.write((DAC, DAC_ZERO))
    rig.step(3)
    assert rig.emulator.bundle.board.amplified[0] == DAC_ZERO + 300
    assert rig.report().acted == 2


@pytest.mark.parametrize(
    ("line", "word"),
    [
        ("dac:1 full", 0xFFF),
        ("dac:1 full -1", 0),
        ("dac:1 gain", DAC_ZERO + 80),
        ("dac:1 gain -1", DAC_ZERO - 100),
        ("dac:1 dead", DAC_ZERO),
    ],
)
def test_an_amplifier_makes_another_word_of_the_one_written(line: str, word: int) -> None:
    rig = Rig(line)
    rig.power()
    rig.write((DAC, DAC_ZERO + 100))
    rig.step(5)
    assert rig.emulator.bundle.board.amplified[0] == word
    assert rig.emulator.bundle.board.amplified[1] == DAC_ZERO
    assert rig.report().acted > 0
    rig.emulator.faults.clear()
    rig.step()
    assert rig.emulator.bundle.board.amplified[0] == DAC_ZERO + 100


def test_an_amplifier_without_power_does_no_harm_and_says_so() -> None:
    rig = Rig("dac:1 full")
    rig.step(20)
    assert rig.report().steps == 20
    assert rig.report().acted == 0


def test_power_that_dropped_comes_back_when_it_is_asked_for_again() -> None:
    rig = Rig()
    rig.power()
    rig.emulator.faults.add("power drop")
    rig.step(2)
    assert not rig.emulator.powered
    assert not read_word(rig.memory, STATUS) & STATUS_POWER
    rig.write((DISCRETE, 0), (DISCRETE, DISCRETE_POWER))
    rig.step()
    assert rig.emulator.powered
    assert rig.report().acted == 1


def test_power_that_failed_does_not_come_on() -> None:
    rig = Rig("power off +100ms")
    rig.write((DISCRETE, DISCRETE_POWER))
    rig.step(400)
    assert not rig.emulator.powered
    assert rig.report().acted > 0
    rig.write((DISCRETE, 0), (DISCRETE, DISCRETE_POWER))
    rig.step(1)
    assert rig.emulator.powered


def test_the_emergency_stop_is_pressed_and_released() -> None:
    rig = Rig()
    rig.power()
    rig.emulator.faults.add("estop pressed +2ms")
    rig.step(8)
    assert not read_word(rig.memory, STATUS) & (STATUS_ESTOP_OK | STATUS_POWER)
    rig.step()
    assert read_word(rig.memory, STATUS) & STATUS_ESTOP_OK
    assert not rig.emulator.powered


# --------------------------------------------------------------------------------------------------- brakes and the arm


def sag(rig: Rig, joint: int, steps: int = 400) -> float:
    before = rig.emulator.q[joint]
    rig.step(steps)
    return float(abs(rig.emulator.q[joint] - before))


def test_a_stuck_brake_holds_its_joint_under_power_and_others_go() -> None:
    rig = Rig("brake:2 stuck")
    rig.power()
    rig.emulator.bundle.plant.v[:] = 0.0
    rig.emulator.faults.add("arm:2 pushed 60")
    rig.emulator.faults.add("arm:1 pushed 60")
    assert sag(rig, 1) < 1e-3
    assert rig.emulator.q[0] > 0.01
    assert rig.report().acted > 0


def test_a_slipping_brake_lets_a_push_through_that_a_good_one_holds() -> None:
    def pushed(*faults: str) -> float:
        rig = Rig(*faults, "arm:2 pushed 100")
        return sag(rig, 1)

    assert pushed() < 1e-3
    assert pushed("brake:2 slips 0.05") > 0.01


def test_slow_brakes_close_later() -> None:
    rig = Rig()
    rig.power()
    rig.emulator.faults.add("brake slow 100")
    rig.write((DISCRETE, 0))
    rig.step(470)
    assert not rig.emulator.braked
    rig.step(20)
    assert rig.emulator.braked
    assert rig.report().acted > 400


# ----------------------------------------------------------------------------------------------------- the whole board


@pytest.mark.parametrize(("line", "word"), [("board off", 0xFFFF), ("board off 0", 0)])
def test_a_board_that_is_off_reads_the_same_everywhere(line: str, word: int) -> None:
    rig = Rig(line)
    rig.step()
    image = rig.image()
    assert set(image[2:].tolist()) == {word}
    assert image[IMAGE_COUNT] == 2


def test_a_frozen_board_publishes_nothing_and_goes_on_later() -> None:
    rig = Rig()
    rig.step()
    count = rig.image()[IMAGE_COUNT]
    rig.emulator.faults.add("board frozen +5ms")
    rig.step(20)
    assert rig.image()[IMAGE_COUNT] == count
    rig.step()
    assert rig.image()[IMAGE_COUNT] == count + 21


def test_a_slow_board_shows_what_was_then() -> None:
    rig = Rig("board slow 5")
    rig.step(100)
    assert rig.image()[IMAGE_T_NS] == rig.t_ns - 20 * STEP_NS
    rig.emulator.faults.clear()
    rig.step()
    assert rig.image()[IMAGE_T_NS] == rig.t_ns


def test_an_intermittent_board_is_gone_in_its_share_of_images() -> None:
    rig = Rig("board intermittent 0.25", seed=3)
    gone = 0
    for _ in range(400):
        rig.step()
        gone += read_word(rig.memory, STATUS) == 0xFFFF
    assert 70 <= gone <= 130
    assert rig.report().acted == gone


def test_a_deaf_board_keeps_its_outputs() -> None:
    rig = Rig()
    rig.power()
    rig.write((DAC, DAC_ZERO + 200))
    rig.step()
    rig.emulator.faults.add("board deaf +1ms")
    rig.write((DAC, DAC_ZERO), (DISCRETE, 0))
    rig.step(4)
    assert rig.emulator.bundle.board.dac[0] == DAC_ZERO + 200
    assert rig.emulator.powered
    rig.write((DISCRETE, 0))
    rig.step()
    assert not rig.emulator.powered


# ------------------------------------------------------------------------------------------------------------ injecting


def test_a_board_without_faults_is_the_board_it_was_after_they_are_cleared() -> None:
    rig = Rig("dac:1 full", "board off", "index:1 missing", "pot:2 dead", "brake:1 stuck")
    rig.step(3)
    rig.emulator.faults.clear()
    rig.step()
    board, fresh = rig.emulator.bundle.board, Rig().emulator.bundle.board
    np.testing.assert_array_equal(board.upset.switch, fresh.upset.switch)
    np.testing.assert_array_equal(board.upset.knob[:12], fresh.upset.knob[:12])
    np.testing.assert_array_equal(board.encoders.pulses, 1)
    assert rig.emulator.faults.reports() == []


def test_a_robot_has_only_so_many_joints_and_a_board_only_so_many_places() -> None:
    rig = Rig()
    with pytest.raises(ConfigError, match="which joint"):
        rig.emulator.faults.add("encoder:7 stuck")
    for _ in range(FAULT_SLOTS):
        rig.emulator.faults.add("estop pressed")
    with pytest.raises(ConfigError, match="16 faults are in the board already: clear them first"):
        rig.emulator.faults.add("estop pressed")
    with pytest.raises(KeyError):
        rig.report(FAULT_SLOTS)


def test_a_report_names_the_fault() -> None:
    rig = Rig("arm:3 pushed 12.5 @1s +20ms", "estop pressed")
    first, second = rig.emulator.faults.reports()
    assert str(first.fault) == "arm:3 pushed 12.5 +0.02s"
    assert str(second.fault) == "estop pressed"
    assert (first.steps, first.acted, first.over) == (0, 0, False)


def test_an_emulator_nobody_met_has_nowhere_to_put_faults() -> None:
    with pytest.raises(ConfigError, match="connect the emulator first"):
        _ = Emulator(PUMA, physics="rigid").faults


def test_a_spoilt_panel_is_told_and_read_no_further_than_it_reaches() -> None:
    memory = local_board_memory()
    memory.faults.used, memory.faults.slots[0].kind = 1, 12345
    with pytest.raises(ConfigError, match="restart the board"):
        FaultPanel(memory).reports()
    for count in (-1, -(2**63)):
        memory.faults.used = count
        assert FaultPanel(memory).reports() == []
