"""The walk through a new board: what is in order is said to be, what is not is found, and nothing is left on."""

from __future__ import annotations

import contextlib
import re
import signal
from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from qrobot.arrays import Words
from qrobot.config import load_robot
from qrobot.config.values import frozen
from qrobot.errors import LinkLost
from qrobot.hwif.bus import Operations
from qrobot.hwif.image import IMAGE_ENC_COUNT, IMAGE_INPUTS, IMAGE_STATUS, IMAGE_T_NS, make_image
from qrobot.hwif.operations import OP_WRITE
from qrobot.hwif.registers import (
    DAC,
    DAC_ZERO,
    DISCRETE,
    DISCRETE_CALIBRATED,
    DISCRETE_HAND_RELAXED,
    DISCRETE_J6_OVERFLOW,
    DISCRETE_POWER,
    ENC_LOAD,
    SCRATCH_BITS,
    STATUS_ADC_BUSY,
    STATUS_INDEX,
)
from qrobot.rig.board_check import STEPS, Permissions, check_board, turn_by_hand
from qrobot.rig.board_power import see_ways
from qrobot.rig.board_walk import LeftOutError, StepError, Walk
from qrobot.rig.interrupts import interrupted_by_signals
from qrobot.sim_board.board import BoardOptions
from qrobot.sim_board.faults import FaultPlan
from tests.support.fake_card import FakeCard, FakeCardBus
from tests.support.signals import default_signals
from tests.support.walk_desk import EVERYTHING, ROBOT, UNATTENDED, Desk, reversed_in, verdicts


@pytest.mark.parametrize(("revision_f", "idle"), [(True, False), (False, False), (True, True), (False, True)])
def test_an_emulated_board_passes_every_step_at_whatever_levels_its_flags_idle(revision_f: bool, idle: bool) -> None:
    desk = Desk(options=BoardOptions(revision_f=revision_f, adc_idle=idle, index_idle=idle))
    desk.answer = desk.by_hand(+1)
    findings = desk.check(EVERYTHING)
    assert verdicts(findings) == {step.name: True for step in STEPS}, findings
    assert findings[0].detail.startswith(f"revision {'F' if revision_f else 'E'}, 6 joints")


def test_the_board_is_left_as_it_was_without_torque_and_power() -> None:
    desk = Desk(start="ready")
    counters, calibrated = desk.emulator.counters, desk.emulator.calibrated
    assert all(finding.ok for finding in desk.check(Permissions(hands=False)) if finding.ok is not None)
    assert (desk.emulator.counters == counters).all()
    assert desk.emulator.calibrated == calibrated
    assert not desk.emulator.powered
    assert (desk.emulator.bundle.board.dac == DAC_ZERO).all()
    assert not any(value & DISCRETE_POWER for offset, value in desk.written if offset == DISCRETE)


def test_a_board_that_is_not_calibrated_is_not_left_calibrated() -> None:
    desk = Desk(calibrated=False)
    desk.check()
    assert not desk.emulator.calibrated


@pytest.mark.parametrize("found", [0, DISCRETE_J6_OVERFLOW, SCRATCH_BITS])
@pytest.mark.parametrize("error", [KeyboardInterrupt, LinkLost])
def test_scratch_bits_that_were_tried_are_not_left_on_a_board_also_when_that_is_broken_off_twice(
    found: int, error: type[BaseException]
) -> None:
    desk = Desk(calibrated=False)
    desk.end.apply(np.array([(OP_WRITE, DISCRETE, found)], np.int64))
    exchange, left = desk.bus.exchange, [2]

    def interrupt(operations: Operations, image: Words) -> None:
        if left[0] and desk.written[-1:] == [(DISCRETE, DISCRETE_CALIBRATED | DISCRETE_HAND_RELAXED)]:
            left[0] -= 1
            raise error
        exchange(operations, image)

    desk.bus.exchange = interrupt  # type: ignore[method-assign]
    with contextlib.suppress(KeyboardInterrupt):
        assert not all(finding.ok for finding in desk.check())
    assert left == [0]
    image = make_image()
    desk.end.read_image(image)
    assert image[IMAGE_STATUS] & SCRATCH_BITS == found


def test_a_dry_run_writes_nothing() -> None:
    desk = Desk()
    findings = desk.check(Permissions(read_only=True, power=True, hands=False))
    assert not desk.written
    assert [finding.ok for finding in findings[:2]] == [True, True]
    assert all(finding.ok is None for finding in findings[2:])


def test_power_is_asked_for_before_it_comes_and_a_no_leaves_it_off() -> None:
    desk = Desk()
    desk.answer = lambda _question: False
    findings = verdicts(desk.check(EVERYTHING))
    assert findings["power for an instant"] is findings["a push on each joint"] is None
    assert not any(value & DISCRETE_POWER for offset, value in desk.written if offset == DISCRETE)
    assert all("emergency stop" in question for question in desk.asked[-2:])


def test_an_emergency_stop_that_is_pressed_ends_the_walk_before_anything_is_written() -> None:
    desk = Desk()
    desk.end.memory.panel.estop = 1
    desk.end.apply(np.zeros((0, 3), np.int64))
    *_, last = desk.check()
    assert (last.step, last.ok) == ("status", False)
    assert "emergency stop" in last.detail
    assert not any(offset == DAC and value != DAC_ZERO for offset, value in desk.written)


def empty_slot(image: Words) -> None:
    image[IMAGE_INPUTS:] = 0xFFFF


def no_index(image: Words) -> None:
    image[IMAGE_STATUS] &= ~STATUS_INDEX


def busy(image: Words) -> None:
    image[IMAGE_STATUS] |= STATUS_ADC_BUSY


def frozen_counter(image: Words) -> None:
    image[IMAGE_ENC_COUNT + 2] = 5


@pytest.mark.parametrize(
    ("spoil", "step", "words"),
    [
        (empty_slot, "the board answers", "base address"),
        (no_index, "index flags", "joints 1, 2, 3, 4, 5, 6"),
        (busy, "converter", "is it revision E?"),
        (frozen_counter, "counters take a load", "joint 3 did not take a load"),
    ],
)
def test_what_is_wrong_is_found_by_its_step_with_something_to_do(
    spoil: Callable[[Words], None], step: str, words: str
) -> None:
    desk = Desk()
    desk.spoil = spoil
    *_, last = desk.check()
    assert (last.step, last.ok) == (step, False)
    assert words in f"{last.detail} {last.remedy}"
    assert last.remedy
    assert not desk.emulator.powered


@pytest.mark.parametrize(
    ("fault", "step", "words"),
    [
        ("board deaf", "scratch bits", "do writes reach the board?"),
        ("dac:4 dead", "a push on each joint", "joint 4 does not answer to torque"),
        ("dac:5 gain -1", "a push on each joint", "joint 5 runs against its torque"),
    ],
)
def test_a_fault_injected_is_found_by_its_step(fault: str, step: str, words: str) -> None:
    desk = Desk(faults=FaultPlan.parse([fault]))
    *_, last = desk.check()
    assert (last.step, last.ok) == (step, False), last
    assert words in f"{last.detail} {last.remedy}"
    assert not desk.emulator.powered


def test_an_encoder_that_counts_backwards_is_found_by_hand() -> None:
    desk = Desk()
    desk.answer = desk.by_hand(-1)
    *_, last = desk.check(EVERYTHING)
    assert (last.step, last.ok) == ("encoders by hand", False)
    assert "swap A and B" in last.remedy


def test_of_a_joint_that_slides_nobody_is_asked_for_angles() -> None:
    stanford = load_robot("stanford")
    free = {"brake": frozen(~stanford.prismatic)}
    desk = Desk(stanford.model_copy(update={"transmission": stanford.transmission.model_copy(update=free)}))
    desk.answer = lambda _question: False
    with pytest.raises(StepError, match="joint 3 was not moved"):
        turn_by_hand(desk.walk)
    assert desk.asked == ["Slide joint 3 by hand towards positive positions, by some centimetres. Done?"]


@pytest.mark.parametrize("start", ["park", "ready", "end"])
@pytest.mark.parametrize(
    ("keys", "step", "words"),
    [
        (("count_sign", "dac_per_Nm"), "which way the joints go", "swap A and B of its encoder"),
        (("count_sign",), "which way the joints go", "swap A and B of its encoder"),
        (("dac_per_Nm",), "a push on each joint", "swap its motor leads"),
    ],
)
def test_a_joint_with_a_brake_that_is_reversed_or_mirrored_is_found_by_who_looks_at_it(
    keys: tuple[str, ...], step: str, words: str, start: str
) -> None:
    desk = Desk(reversed_in(2, *keys), start=start)
    desk.answer = desk.by_hand(+1)
    *_, last = desk.check(EVERYTHING)
    assert (last.step, last.ok) == (step, False), last
    assert "joint 2" in last.detail
    assert last.remedy.startswith(words)


def test_a_joint_that_only_its_brake_has_shifted_is_not_asked_about() -> None:
    desk = Desk(faults=FaultPlan.parse(["dac:1 dead"]))
    desk.answer = desk.by_hand(+1)
    closed = []

    def shift(image: Words) -> None:
        closed.append(desk.emulator.powered)
        image[IMAGE_ENC_COUNT] += 5 * (sum(was and not now for was, now in pairwise(closed)) % 2)

    desk.spoil = shift
    *_, last = desk.check(EVERYTHING)
    assert (last.step, last.ok) == ("which way the joints go", False), last
    assert last.detail == "joint 1 was not moved by a push to either side"
    assert not any(question.startswith("Joint 1") for question in desk.asked)


def pushes(desk: Desk) -> set[int]:
    """How hard joint 1 was pushed, steps of its converter."""
    return {abs(value - DAC_ZERO) for offset, value in desk.written if offset == DAC} - {0}


def test_a_joint_that_a_push_moves_too_little_to_be_seen_is_pushed_once_more_twice_as_hard() -> None:
    preset = ROBOT.control.friction_preset
    shares = np.where(np.arange(ROBOT.n) == 0, 0.5, 1.0)
    expected = ROBOT.friction[preset]
    halved = {key: frozen(getattr(expected, key) * shares) for key in ("coulomb_pos", "coulomb_neg")}
    desk = Desk(ROBOT.model_copy(update={"friction": {**ROBOT.friction, preset: expected.model_copy(update=halved)}}))
    desk.answer = desk.by_hand(+1)
    desk.walk.begin()
    desk.walk.ways_seen |= set(range(1, ROBOT.n))
    assert see_ways(desk.walk).startswith("counts go the way the joints go, joint 1: ")
    usual, harder = sorted(pushes(desk))
    assert harder == pytest.approx(2 * usual, abs=1)
    [far] = [re.findall(r"pushed by ([0-9.]+) degrees", each) for each in desk.asked if each.startswith("Joint 1")]
    assert float(far[0]) > 0.1


def test_who_stands_at_the_button_for_arm_power_is_told_each_time_what_comes_then() -> None:
    desk, told = Desk(options=BoardOptions(auto_panel=False)), list[str]()

    def press(line: str) -> None:
        told.append(line)
        desk.end.memory.panel.presses += 1

    desk.walk.tell = press
    assert all(finding.ok is not False for finding in desk.check())
    pushes = [f"press ARM POWER now: at once the brakes open, and joint {k // 2 + 1} is pushed" for k in range(12)]
    assert told == ["press ARM POWER now: at once the brakes open for an instant", *pushes]


def test_nobody_is_told_to_press_where_arm_power_comes_by_itself_and_its_want_is_told() -> None:
    desk, told = Desk(), list[str]()
    desk.walk.tell = told.append
    assert all(finding.ok is not False for finding in desk.check())
    assert told == []
    desk = Desk(options=BoardOptions(auto_panel=False))
    assert desk.check()[-1].detail == "no arm power within 10 s"


def test_a_joint_whose_encoder_may_be_dead_is_not_pushed_harder() -> None:
    desk = Desk()
    desk.spoil = lambda image: image.__setitem__(IMAGE_ENC_COUNT, 5)
    desk.walk.begin()
    desk.walk.look()
    with pytest.raises(StepError, match="joint 1 was not moved"):
        see_ways(desk.walk)
    assert len(pushes(desk)) == 1
    assert not desk.asked


def test_where_nobody_looks_no_advice_makes_a_mirrored_joint_of_a_reversed_one_and_it_is_told() -> None:
    *_, last = Desk(reversed_in(2, "count_sign")).check()
    assert (last.step, last.ok) == ("a push on each joint", False)
    assert "look which way the joint goes" in last.remedy
    *_, ways, last = Desk(reversed_in(2, "count_sign", "dac_per_Nm")).check()
    assert (ways.step, ways.ok) == ("which way the joints go", None)
    assert "nobody saw which way joints 1, 2, 3, 4, 5, 6 went" in last.detail


def test_who_did_not_see_which_way_a_joint_went_is_no_witness() -> None:
    desk = Desk()
    turns = desk.by_hand(+1)
    desk.answer = lambda question: " further towards " not in question and turns(question)
    *_, last = desk.check(EVERYTHING)
    assert (last.step, last.ok) == ("which way the joints go", False)
    assert last.detail == "nobody saw which way joint 1 went"


def test_an_arm_with_brakes_on_every_joint_has_none_to_turn_by_hand_and_all_are_looked_at() -> None:
    changed = {"brake": frozen(np.full(ROBOT.n, True))}
    desk = Desk(ROBOT.model_copy(update={"transmission": ROBOT.transmission.model_copy(update=changed)}))
    desk.answer = desk.by_hand(+1)
    findings = desk.check(EVERYTHING)
    assert [(finding.step, finding.detail) for finding in findings if finding.ok is not True] == [
        ("encoders by hand", "left out: every joint has a brake")
    ]
    assert [question.split(" was pushed")[0] for question in desk.asked if " was pushed" in question] == [
        f"Joint {number} ({name})" for number, name in enumerate(ROBOT.joint_names, 1)
    ]
    assert "nobody saw" not in findings[-1].detail
    with pytest.raises(LeftOutError, match="all were turned by hand"):
        see_ways(desk.walk)


def lose_images(desk: Desk, when: Callable[[], bool], times: int = 1_000_000) -> None:
    """No image comes back any more from the exchange on at which `when` holds, `times` in a row."""
    lost = 0

    def spoil(_image: Words) -> None:
        nonlocal lost
        lost += lost > 0 or when()
        if 0 < lost <= times:
            raise LinkLost("the cable is out")

    desk.spoil = spoil


def test_a_board_that_goes_away_is_a_finding_at_any_step_and_who_may_still_have_power_says_so() -> None:
    for exchanges in (0, 1, 2, 30, 40, 60, 500):
        desk = Desk()
        left = iter(range(exchanges, -1, -1))
        lose_images(desk, lambda left=left: next(left) == 0)  # type: ignore[misc]
        first, *others = [finding for finding in desk.check() if finding.ok is False]
        assert first.detail == "the cable is out"
        assert [finding.remedy for finding in others] == ["press the emergency stop"] * bool(exchanges)


def pushing(desk: Desk) -> bool:
    """A joint is being pushed."""
    return bool((desk.emulator.bundle.board.dac != DAC_ZERO).any())


def test_images_that_stop_coming_in_the_middle_of_a_push_leave_neither_torque_nor_power() -> None:
    desk = Desk()
    lose_images(desk, lambda: pushing(desk))
    *_, push, last = desk.check()
    assert (push.step, push.ok) == ("a push on each joint", False)
    assert (last.step, last.ok) == ("torque and power off", False)
    assert "EMERGENCY STOP" in last.detail
    assert not pushing(desk)
    desk.end.apply(np.zeros((0, 3), np.int64))
    assert not desk.emulator.powered


@pytest.mark.parametrize("first", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_second_interrupt_does_not_tear_what_switches_torque_and_power_off(first: signal.Signals) -> None:
    desk = Desk()
    left: list[bool] = []

    def interrupt(_image: Words) -> None:
        if pushing(desk) or left:
            left.append(pushing(desk))
            signal.raise_signal(first if len(left) == 1 else signal.SIGINT)

    desk.spoil = interrupt
    with default_signals(signal.SIGHUP), interrupted_by_signals(), pytest.raises(KeyboardInterrupt):
        desk.check()
    assert left == [True, False]
    assert desk.bus.closed == 1


def test_a_walk_that_nobody_follows_any_more_ends_safe_or_raises() -> None:
    for lost in (False, True):
        desk = Desk()
        findings = check_board(desk.walk, UNATTENDED)
        next(findings)
        desk.bus.cut = lost
        with pytest.raises(StepError, match="EMERGENCY STOP") if lost else contextlib.nullcontext():
            findings.close()
        assert desk.bus.closed == 1


@pytest.mark.parametrize("taken", [True, False])
def test_a_load_of_the_counters_that_gets_no_answer_leaves_their_counts_or_no_calibration(taken: bool) -> None:
    for times in (1, 2, 1_000_000):
        desk = Desk(start="ready")
        counters = desk.emulator.counters.copy()
        exchange, left = desk.bus.exchange, [times]

        def lose(operations: Operations, image: Words, exchange: Any = exchange, left: list[int] = left) -> None:
            if left[0] and (left[0] < times or (operations[:, 1] == ENC_LOAD).any()):  # noqa: B023
                left[0] -= 1
                if taken:
                    exchange(operations, make_image())
                raise LinkLost("no answer")
            exchange(operations, image)

        desk.bus.exchange = lose  # type: ignore[method-assign]
        failed = next(finding for finding in desk.check() if finding.ok is False)
        assert (failed.step, failed.detail) == ("counters take a load", "no answer")
        back = bool((desk.emulator.counters == counters).all())
        assert back or not desk.emulator.calibrated
        assert back or times > 1


@pytest.mark.parametrize("channels", [5, 6])
def test_a_robot_with_more_joints_than_the_board_is_found_before_anything_is_written(channels: int) -> None:
    names, kinds = ROBOT.joints.names, ROBOT.joints.kinds
    joints = ROBOT.joints.model_copy(update={"names": (*names, "seventh"), "kinds": (*kinds, "revolute")})
    desk = Desk(ROBOT if channels < ROBOT.n else ROBOT.model_copy(update={"joints": joints}))
    desk.channels = channels
    *_, last = desk.check()
    assert (last.step, last.ok) == ("the board answers", False)
    assert f"{max(channels + 1, 6)} joints, the board {channels} encoder channels" in last.detail


def test_no_board_is_a_finding() -> None:
    desk = Desk()
    desk.bus.cut = True
    (only,) = desk.check()
    assert (only.ok, bool(only.remedy)) == (False, True)


@pytest.mark.parametrize(
    ("pace", "says"),
    [(0.01, "has gone 0.0"), (0.5, "faster or slower"), (3.0, "faster or slower"), (1000.0, "faster or slower")],
)
def test_a_board_whose_clock_is_not_ours_gets_no_power(pace: float, says: str) -> None:
    """Its stamps may be of another unit: a push of some hundredths of a second would last for minutes."""
    desk = Desk(start="ready")
    desk.spoil = lambda image: image.__setitem__(IMAGE_T_NS, int(image[IMAGE_T_NS] * pace))
    *_, last = desk.check()
    assert (last.step, last.ok) == ("the board answers", False)
    assert says in last.detail
    assert not [word for offset, word in desk.written if offset == DISCRETE and word & DISCRETE_POWER]


def test_a_clock_that_stops_ends_a_push_at_once() -> None:
    desk = Desk(start="ready")
    stopped_ns = list[int]()

    def stop(image: Words) -> None:
        pushes = any(DAC <= offset < DAC + 12 and word != DAC_ZERO for offset, word in desk.written)
        if pushes:
            stopped_ns[:] = stopped_ns or [int(image[IMAGE_T_NS])]
            image[IMAGE_T_NS] = stopped_ns[0]

    desk.spoil = stop
    *_, last = desk.check()
    assert last.ok is False
    assert "the board's clock has gone" in last.detail
    assert desk.emulator.bundle.board.dac.tolist() == [DAC_ZERO] * 8
    assert not desk.emulator.powered
    assert desk.end.now_ns - stopped_ns[0] < 0.6e9


def test_a_card_in_this_machine_is_walked_through_as_well() -> None:
    desk = Desk()
    card = FakeCard(desk.end)
    findings = list(check_board(Walk(FakeCardBus(card), ROBOT, desk.answer, now_ns=desk.now_ns), UNATTENDED))
    assert [finding for finding in findings if finding.ok is False] == []
    assert not desk.emulator.powered
    assert desk.emulator.bundle.board.dac.tolist() == [DAC_ZERO] * 8


def test_no_step_that_writes_is_right_on_a_card_that_is_only_read_and_a_dry_run_writes_nothing() -> None:
    desk = Desk()
    walk = Walk(FakeCardBus(FakeCard(desk, read_only=True)), ROBOT, desk.answer, now_ns=desk.now_ns)
    findings = list(check_board(walk, Permissions(power=True, hands=False)))
    assert [(finding.step, finding.ok) for finding in findings[2:]] == [("scratch bits", False)]
    findings = list(check_board(walk, Permissions(read_only=True, hands=False)))
    assert {finding.ok for finding in findings} == {True, None}
    assert not desk.written
