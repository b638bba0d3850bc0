"""A board memory that somebody damages: nobody crashes, nobody moves, and counters tell."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from qrobot.config import load_robot
from qrobot.faultcodes import explain
from qrobot.hwif.board_memory import LANE_CAPACITY, Lane, local_board_memory
from qrobot.hwif.bus import sane_operations
from qrobot.hwif.gateway import Gateway
from qrobot.hwif.image import IMAGE_INPUTS, IMAGE_WORDS
from qrobot.hwif.lanes import pending_operations, post_operations
from qrobot.hwif.operations import OP_OUTPUTS, OP_READ, OP_WRITE
from qrobot.hwif.registers import DAC, DAC_ZERO, ENC_COUNT, STATUS_POWER, WINDOW_BYTES
from qrobot.modecodes import Mode
from qrobot.realtime.structure import view_words
from qrobot.rig.lockstep import LockstepRig
from qrobot.servo.settings import ServoSettings
from qrobot.sim_board.emulator import Emulator
from tests.support.bench import PERIOD_NS, Bench
from tests.support.bus import BenchEndpoint, DirectBus, rows_of
from tests.support.thorough import examples

WILD = st.integers(-(2**63), 2**63 - 1)
SEEDS = st.integers(0, 2**32 - 1)


@given(SEEDS)
@settings(max_examples=examples(40))
def test_a_board_whose_lanes_are_noise_applies_nothing_and_goes_on_showing_images(seed: int) -> None:
    bench = Bench()
    random = np.random.default_rng(seed)
    for lane in bench.memory.lanes:
        words = view_words(lane)
        words[:] = random.integers(-(2**62), 2**62, words.size)
    bench.shaft[2] = 77.0
    bench.tick(3)
    assert bench.board.dac.tolist() == [DAC_ZERO] * len(bench.board.dac)
    assert bench.read(ENC_COUNT + 4) == 77
    assert not bench.status & STATUS_POWER


@given(st.sampled_from(Lane), st.integers(-(2**62), -1) | st.integers(LANE_CAPACITY + 2, 2**62))
@settings(max_examples=examples(30))
def test_a_lane_whose_head_is_damaged_is_told_and_works_again_from_the_next_tick_on(lane: Lane, head: int) -> None:
    bench, write = Bench(), rows_of([(OP_WRITE, DAC, 0x123)])
    assert post_operations(bench.memory, int(lane), rows_of([(OP_WRITE, DAC, DAC_ZERO)]), 1)
    bench.tick()
    bench.memory.lanes[int(lane)].head = head
    bench.tick(2)
    assert bench.board.dac[0] == DAC_ZERO
    assert post_operations(bench.memory, int(lane), write, 1)
    assert pending_operations(bench.memory, int(lane)) == 1
    bench.tick()
    assert bench.board.dac[0] == 0x123
    assert pending_operations(bench.memory, int(lane)) == 0
    assert bench.memory.facts.dropped == 1


@given(st.lists(st.tuples(WILD, WILD, WILD), max_size=20))
def test_operations_out_of_a_damaged_lane_are_counted_and_never_reach_the_bus(rows: list[tuple[int, int, int]]) -> None:
    memory, end = local_board_memory(), BenchEndpoint(Bench())
    gateway = Gateway(DirectBus(end), memory, PERIOD_NS)
    assert gateway.step(1)
    end.lists.clear()
    assert post_operations(memory, int(Lane.SERVO), rows_of(rows), len(rows))
    assert gateway.step(2)
    for_modules = sum((kind, offset) == (OP_OUTPUTS, 0) for kind, offset, _ in rows)
    assert memory.facts.illegal_ops == len(rows) - len(end.applied) - for_modules
    for kind, offset, value in end.applied:
        assert kind in (OP_READ, OP_WRITE)
        assert offset in range(0, WINDOW_BYTES, 2)
        assert value in range(0x10000)


def test_what_makes_sense_is_kept_in_order_and_its_values_are_cut_to_sixteen_bits() -> None:
    rows = [(OP_WRITE, DAC, 0x12345), (OP_READ, 0x1E, 0), (OP_WRITE, 0x20, -1), (2, DAC, 0), (OP_WRITE, 0x40, 0)]
    rows += [(OP_OUTPUTS, 2, 1), (OP_OUTPUTS, 0, 0x10005)]
    assert sane_operations(rows_of(rows)).tolist() == [
        [OP_WRITE, DAC, 0x2345],
        [OP_READ, 0x1E, 0],
        [OP_WRITE, 0x20, 0xFFFF],
        [OP_OUTPUTS, 0, 5],
    ]


def test_a_servo_whose_image_is_noise_faults_and_the_arm_stays_where_it_is() -> None:
    robot = load_robot("puma560")
    rig = LockstepRig(robot, ServoSettings(rate_hz=1000.0), Emulator(robot, physics="rigid"))
    rig.ticks(3)
    rig.mailbox.request_power(True)
    rig.run_for(0.3)
    assert rig.mailbox.snapshot().mode == Mode.HOLDING
    before, random = rig.emulator.q, np.random.default_rng(7)
    for _ in range(30):
        rig.board.shown.image[IMAGE_INPUTS:] = random.integers(-(2**62), 2**62, IMAGE_WORDS - IMAGE_INPUTS)
        rig.ticks(1)
    rig.run_for(0.1)
    seen = rig.mailbox.snapshot()
    assert seen.mode == Mode.FAULT
    assert explain(seen.event)
    assert not rig.emulator.powered
    assert np.degrees(np.abs(rig.emulator.q - before)).max() < 3.0


def test_a_full_lane_of_noise_is_taken_within_one_tick() -> None:
    bench = Bench()
    rows = rows_of((9, 9, 9) for _ in range(LANE_CAPACITY))
    assert post_operations(bench.memory, int(Lane.TOOL), rows, len(rows))
    bench.tick()
    assert bench.memory.facts.illegal_ops == LANE_CAPACITY
