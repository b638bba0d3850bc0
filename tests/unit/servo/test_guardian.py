"""The guardian's look at the servo, on virtual time: when it takes the board, what it writes, when it gives it back."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import pytest

from qrobot.faultcodes import FaultCode
from qrobot.hwif.board_memory import LANE_CAPACITY, BoardMemory, Lane, create_board_memory, local_board_memory
from qrobot.hwif.isa.card import NO_CARD, make_card
from qrobot.hwif.lanes import pending_operations, post_operations, take_all_operations, take_operation
from qrobot.hwif.operations import OP_FIELDS, OP_WRITE
from qrobot.hwif.registers import (
    DAC,
    DAC_ZERO,
    DISCRETE,
    DISCRETE_CALIBRATED,
    DISCRETE_HAND_OPEN,
    DISCRETE_HAND_RELAXED,
    DISCRETE_POWER,
    N_DACS,
    STATUS_CALIBRATED,
    STATUS_ESTOP_OK,
    STATUS_POWER,
)
from qrobot.modecodes import Mode
from qrobot.realtime.structure import view_words
from qrobot.servo.memory.servo_memory import arm_is_driven, create_servo_memory, servo_front
from qrobot.servo.process import guardian as guardian_module
from qrobot.servo.process.guardian import (
    HELD_LOOK_NS,
    LOOKS_PER_TIMEOUT,
    N_OWN,
    N_SAFE_OPS,
    TRIPPED,
    TRIPS,
    Guardian,
    await_look,
    look,
    monotonic_now,
    watch,
)
from tests.support.patience import wait_until
from tests.support.servo_bench import ServoBench, moving, writes_at

TIMEOUT_NS = 5_000_000
FAR_NS = 3600_000_000_000
BEATS = 50
SILENT_MS, PATIENT_MS = 1000.0, 2000.0  # bound of a guardian that is to trip, and of one that is not to
OPERATIONS = np.zeros((LANE_CAPACITY, OP_FIELDS), dtype=np.int64)
LANES = np.zeros(len(OPERATIONS), np.int64)
NO_CARD_WORDS = make_card(NO_CARD)
TORQUE = np.array([[OP_WRITE, DAC, 0x7A5]])


class Watchman:
    """A guardian of a bench, looking five times per bound."""

    def __init__(self, bench: ServoBench) -> None:
        self.bench = bench
        self.own = np.zeros(N_OWN, dtype=np.int64)
        self.ops = np.zeros((N_SAFE_OPS, OP_FIELDS), dtype=np.int64)
        bench.beating = False
        bench.before.append(self.step)
        self.step(bench.now_ns)

    def step(self, now_ns: int) -> None:
        """One look, if it is time."""
        if now_ns % (TIMEOUT_NS // LOOKS_PER_TIMEOUT) == 0:
            look(
                self.own,
                servo_front(self.bench.mailbox.words),
                self.bench.board,
                NO_CARD_WORDS,
                self.ops,
                now_ns,
                TIMEOUT_NS,
            )

    @property
    def trips(self) -> int:
        return int(self.own[TRIPS])

    @property
    def tripped(self) -> bool:
        return bool(self.own[TRIPPED])


def watched() -> tuple[ServoBench, Watchman]:
    bench = ServoBench(guarded=True)
    return bench, Watchman(bench)


@contextmanager
def beside(act: Callable[[], object]) -> Iterator[None]:
    """Inside, a thread does it again and again."""
    done = threading.Event()

    def again() -> None:
        while not done.wait(0.001):
            act()

    thread = threading.Thread(target=again)
    thread.start()
    try:
        yield
    finally:
        done.set()
        thread.join()


def sleep(bench: ServoBench, seconds: float) -> None:
    """The servo does not run; the guardian and the board do."""
    for _ in range(round(seconds * 1000)):
        bench.before[0](bench.now_ns)
        bench.collect()
        bench.now_ns += bench.settings.period_ns


def test_a_living_servo_is_left_alone_and_sees_its_guardian() -> None:
    bench, guardian = watched()
    moving(bench)
    assert guardian.trips == 0
    assert all(write.lane is Lane.SERVO for write in bench.writes)
    assert bench.mail.guardian.t_ns > bench.now_ns - 2_000_000


def test_a_silent_servo_that_drives_nothing_is_left_alone() -> None:
    bench, guardian = watched()
    bench.tick(5)
    sleep(bench, 1.0)
    assert guardian.trips == 0


def test_a_servo_that_never_ran_is_left_alone() -> None:
    bench, guardian = watched()
    sleep(bench, 0.1)
    assert guardian.trips == 0
    assert bench.writes == []


def test_an_armed_servo_that_falls_silent_loses_the_board_within_the_bound_and_one_look() -> None:
    bench, guardian = watched()
    moving(bench)
    last_beat_ns = int(bench.mail.heartbeat.t_ns)
    sleep(bench, 0.02)
    assert guardian.tripped
    first = next(write for write in bench.writes if write.lane is Lane.GUARDIAN)
    assert TIMEOUT_NS < first.t_ns - last_beat_ns <= TIMEOUT_NS * (1 + 1 / LOOKS_PER_TIMEOUT) + 1_000_000
    assert bench.safe


def test_the_guardian_takes_power_first_then_writes_zero_torque_and_keeps_the_other_bits() -> None:
    bench, _ = watched()
    bench.mailbox.request_hand(1)
    moving(bench)
    sleep(bench, 0.02)
    first_ns = next(write.t_ns for write in bench.writes if write.lane is Lane.GUARDIAN)
    expected = [(DISCRETE, DISCRETE_CALIBRATED | DISCRETE_HAND_RELAXED & ~DISCRETE_HAND_OPEN)]
    expected += [(DAC + 2 * channel, DAC_ZERO) for channel in range(N_DACS)]
    assert writes_at(bench, first_ns) == expected
    assert DAC_ZERO == 0x800


def test_it_says_so_again_and_again() -> None:
    bench, _ = watched()
    moving(bench)
    sleep(bench, 0.1)
    times = {write.t_ns for write in bench.writes if write.lane is Lane.GUARDIAN}
    assert len(times) > 80


def test_a_servo_that_wakes_up_finds_the_board_taken_and_gets_it_back_by_a_clear() -> None:
    bench, guardian = watched()
    moving(bench)
    sleep(bench, 0.05)
    written = sum(write.lane is Lane.SERVO for write in bench.writes)
    bench.run(0.1)
    assert (bench.mode, bench.fault) == (Mode.FAULT, FaultCode.GUARD_TRIP)
    assert sum(write.lane is Lane.SERVO for write in bench.writes) == written
    assert guardian.tripped
    bench.mailbox.request_power(False)
    bench.mailbox.request_clear()
    bench.run(0.05)
    assert bench.mode is Mode.OFF
    assert not guardian.tripped
    assert guardian.trips == 1
    assert bench.hold().mode is Mode.HOLDING


def test_a_clear_of_an_earlier_trip_does_not_answer_for_a_later_one() -> None:
    bench, guardian = watched()
    moving(bench)
    sleep(bench, 0.05)
    bench.tick()
    bench.mailbox.request_power(False)
    bench.mailbox.request_clear()
    bench.run(0.05)
    bench.hold()
    sleep(bench, 0.05)
    bench.run(0.3)
    assert guardian.trips == 2
    assert guardian.tripped
    assert bench.mode is Mode.FAULT


def test_a_servo_restarted_after_a_trip_finds_the_calibration_kept_and_the_board_taken() -> None:
    bench, guardian = watched()
    moving(bench)
    sleep(bench, 0.05)
    reborn = ServoBench(guarded=True)  # the memory of a new servo: no heartbeat, no shadow of DISCRETE
    guardian.bench = reborn
    reborn.board, reborn.beating, reborn.q = bench.board, False, bench.q
    reborn.before.append(guardian.step)
    reborn.now_ns = bench.now_ns
    sleep(reborn, 0.05)
    assert reborn.mail.guardian.takeover == 1
    discretes = [write.value for write in reborn.writes if write.offset == DISCRETE]
    assert discretes
    assert all(value & DISCRETE_CALIBRATED and not value & DISCRETE_POWER for value in discretes)
    reborn.run(0.05)
    assert (reborn.mode, reborn.fault) == (Mode.FAULT, FaultCode.GUARD_TRIP)
    reborn.mailbox.request_clear()
    reborn.run(0.05)
    assert reborn.mode is Mode.OFF
    assert reborn.discrete & DISCRETE_CALIBRATED


def test_a_servo_that_was_armed_is_not_forgotten_when_a_new_one_has_made_its_memory_anew() -> None:
    bench, guardian = watched()
    moving(bench)
    view_words(bench.mail.heartbeat)[:-2] = 0  # all but the slipped time
    sleep(bench, 0.005)
    assert guardian.tripped
    assert bench.safe


def test_a_servo_that_has_disarmed_may_end_and_make_room_for_another() -> None:
    bench, guardian = watched()
    bench.hold()
    bench.mailbox.request_power(False)
    bench.tick(10)
    assert bench.mail.heartbeat.armed == 0
    sleep(bench, 0.05)
    view_words(bench.mail.heartbeat)[:-2] = 0  # all but the slipped time
    sleep(bench, 0.05)
    assert guardian.trips == 0


def test_a_servo_that_arms_after_a_silence_has_beaten_before() -> None:
    """Nothing was driven while it was silent, so nothing is to be held against it."""
    bench, guardian = watched()
    bench.tick(10)
    sleep(bench, 0.5)
    bench.mailbox.request_power(True)
    bench.run(0.1)
    assert (bench.mode, guardian.trips) == (Mode.HOLDING, 0)


def test_it_stays_armed_until_the_board_has_shown_that_power_is_off() -> None:
    bench, _ = watched()
    bench.hold()
    bench.mailbox.request_power(False)
    bench.status = STATUS_POWER | STATUS_ESTOP_OK | STATUS_CALIBRATED  # a contactor that sticks
    bench.tick(50)
    assert (bench.mode, bench.mail.heartbeat.armed) == (Mode.OFF, 1)
    assert {write.value & DISCRETE_POWER for write in bench.writes[-100:] if write.offset == DISCRETE} == {0}
    bench.status = None
    bench.tick(4)
    assert bench.mail.heartbeat.armed == 0


@pytest.mark.realtime
@pytest.mark.parametrize(("beats", "trips"), [(True, 0), (False, 1)])
def test_asked_to_end_beside_a_silent_servo_it_makes_the_board_safe_first(beats: bool, trips: int) -> None:
    name, taken = f"leaving{os.getpid()}", [0]
    with create_board_memory(name) as board, create_servo_memory(name, "puma560", "pd", 6, 1_000_000, 16) as servo:

        def board_and_servo() -> None:
            taken[0] += take_all_operations(board.memory, OPERATIONS, LANES)
            if beats:
                servo.front.heartbeat.t_ns = monotonic_now()

        servo.front.heartbeat.armed, servo.front.heartbeat.t_ns = 1, monotonic_now()
        guardian = Guardian(name, SILENT_MS if trips else PATIENT_MS)
        guardian.stop[0] = 1
        with beside(board_and_servo):
            guardian.run(5.0)
        guardian.close()
    assert guardian.trips == trips
    assert (taken[0] >= 1 + N_DACS) == bool(trips)


@pytest.mark.realtime
@pytest.mark.parametrize(("stops_the_arm", "trips"), [(True, 0), (False, 1)])
def test_when_its_terminal_is_closed_it_stays_until_the_servo_has_stopped_the_arm(
    stops_the_arm: bool, trips: int
) -> None:
    name, taken, beats = f"hung{os.getpid()}", [0], [0]
    with create_board_memory(name) as board, create_servo_memory(name, "puma560", "pd", 6, 1_000_000, 16) as servo:

        def board_and_servo() -> None:
            taken[0] += take_all_operations(board.memory, OPERATIONS, LANES)
            beats[0] += 1
            if beats[0] <= BEATS:
                servo.front.heartbeat.t_ns = monotonic_now()
                assert arm_is_driven(name)
            elif stops_the_arm:
                servo.front.heartbeat.armed = 0
                assert not arm_is_driven(name)

        servo.front.heartbeat.armed, servo.front.heartbeat.t_ns = 1, monotonic_now()
        guardian = Guardian(name, SILENT_MS if trips else PATIENT_MS)
        guardian.hang_up()
        with beside(board_and_servo):
            guardian.run(5.0)
        guardian.close()
    assert beats[0] > BEATS
    assert guardian.trips == trips
    assert (taken[0] >= 1 + N_DACS) == bool(trips)


def test_a_servo_whose_guardian_is_slow_but_alive_goes_on() -> None:
    bench, guardian = watched()
    moving(bench)
    bench.before.remove(guardian.step)
    bench.run(0.008)
    bench.before.append(guardian.step)
    bench.run(0.2)
    assert bench.mode is Mode.TRACKING


@pytest.mark.parametrize(
    ("age_ns", "trips"), [(TIMEOUT_NS, 0), (TIMEOUT_NS + 1, 1), (-TIMEOUT_NS, 0), (-TIMEOUT_NS - 1, 1)]
)
def test_the_bound_is_the_bound(age_ns: int, trips: int) -> None:
    bench = ServoBench()
    mail, board = servo_front(bench.mailbox.words), local_board_memory()
    own, ops = np.zeros(N_OWN, dtype=np.int64), np.zeros((N_SAFE_OPS, OP_FIELDS), dtype=np.int64)
    mail.heartbeat.armed, mail.heartbeat.t_ns, mail.heartbeat.discrete = 1, 1_000_000_000, DISCRETE_POWER
    look(own, mail, board, NO_CARD_WORDS, ops, 1_000_000_000 + age_ns, TIMEOUT_NS)
    assert (own[TRIPS], mail.guardian.trips, mail.guardian.takeover) == (trips, trips, trips)
    assert pending_operations(board, int(Lane.GUARDIAN)) == trips * (1 + N_DACS)


def on_a_clock(
    monkeypatch: pytest.MonkeyPatch,
    now_ns: list[int],
    sleep_until_ns: Callable[[int], None],
    look_at: Callable[..., object],
) -> None:
    """Let the guardian's loop, in plain Python, take its time from `now_ns`."""
    for name, fake in {
        "monotonic_ns": lambda: now_ns[0],
        "arm_time_ns": lambda *_: now_ns[0],
        "may_slip_ns": lambda *_: 0,
        "sleep_until_ns": sleep_until_ns,
        "load_acquire": lambda words, k: words[k],
        "look": look_at,
        "await_look": getattr(await_look, "py_func", await_look),
    }.items():
        monkeypatch.setattr(guardian_module, name, fake)


@pytest.mark.parametrize("slept_ns", [0, 2_000_000, 4_000_000, 40_000_000])
def test_on_a_real_board_it_looks_five_times_per_bound_and_allows_the_bound_however_long_it_overslept(
    monkeypatch: pytest.MonkeyPatch, slept_ns: int
) -> None:
    now_ns, looks = [0], list[tuple[int, int]]()

    def sleep_until_ns(deadline_ns: int) -> None:
        now_ns[0] = max(now_ns[0], deadline_ns) + slept_ns * (len(looks) == 7)

    on_a_clock(monkeypatch, now_ns, sleep_until_ns, lambda *asked: looks.append(asked[-2:]))
    run, stop = getattr(watch, "py_func", watch), np.zeros(1, np.int64)
    run(np.zeros(N_OWN, np.int64), None, None, None, None, stop, TIMEOUT_NS, 20 * TIMEOUT_NS, 0)
    times_ns, allowed_ns = np.array(looks).T
    gaps_ns = np.sort(np.diff(times_ns))
    assert set(allowed_ns) == {TIMEOUT_NS}
    assert gaps_ns[-2] <= TIMEOUT_NS / 5
    assert gaps_ns[-1] <= TIMEOUT_NS / 5 + slept_ns


@pytest.mark.parametrize("between_slices", [False, True])
def test_beside_an_emulated_board_one_that_overslept_lets_others_wake_up_beyond_the_end_of_its_slice(
    monkeypatch: pytest.MonkeyPatch, between_slices: bool
) -> None:
    """It comes back to Python five times a second, and may sleep through the end of a slice, or between two of them."""
    slice_ns, slept_ns = 4 * TIMEOUT_NS, 50 * TIMEOUT_NS
    now_ns, looks = [1_000_000], list[tuple[int, int]]()

    def sleep_until_ns(deadline_ns: int) -> None:
        now_ns[0] = max(now_ns[0], deadline_ns) + slept_ns * (len(looks) == 7 and not between_slices)

    on_a_clock(monkeypatch, now_ns, sleep_until_ns, lambda *asked: looks.append(asked[-2:]))
    run, stop, own = getattr(watch, "py_func", watch), np.zeros(1, np.int64), np.zeros(N_OWN, np.int64)
    for k in range(4):
        run(own, None, None, None, None, stop, TIMEOUT_NS, now_ns[0] + slice_ns, 1)
        now_ns[0] += slept_ns * (k == 0 and between_slices)
    times_ns, allowed_ns = np.array(looks).T
    woke = int(np.diff(times_ns).argmax()) + 1
    patient = (times_ns >= times_ns[woke]) & (times_ns < times_ns[woke] + TIMEOUT_NS)
    assert patient.sum() >= LOOKS_PER_TIMEOUT
    assert (allowed_ns[patient] > slept_ns).all()
    assert set(allowed_ns[~patient]) == {TIMEOUT_NS}


def one_more(board: BoardMemory) -> None:
    """The servo posts a torque."""
    assert post_operations(board, int(Lane.SERVO), TORQUE, 1)


def one_less(board: BoardMemory) -> None:
    """The servo writes to its card what it has posted."""
    assert take_operation(board, int(Lane.SERVO), np.zeros(OP_FIELDS, np.int64))


@pytest.mark.parametrize("writes", [one_more, one_less], ids=["posts", "writes to its card"])
def test_a_servo_that_wakes_up_in_the_middle_of_its_writing_is_overruled_within_a_millisecond(
    monkeypatch: pytest.MonkeyPatch, writes: Callable[[BoardMemory], None]
) -> None:
    """However patient the guardian is: a fifth of its bound is 20 ms here."""
    began_ns, patient_ns = 1_000_000_000, 100_000_000
    now_ns, looks = [began_ns], list[int]()
    mail, board = servo_front(ServoBench().mailbox.words), local_board_memory()
    mail.heartbeat.armed, mail.heartbeat.t_ns, mail.heartbeat.discrete = 1, began_ns, DISCRETE_POWER
    for _ in range(3):
        one_more(board)
    due_ns = [began_ns + us * 1000 for us in (150_300, 152_100, 177_700)]
    written = list(due_ns)

    def sleep_until_ns(deadline_ns: int) -> None:
        now_ns[0] = max(now_ns[0], deadline_ns)
        while due_ns and due_ns[0] <= now_ns[0]:
            del due_ns[0]
            writes(board)

    def look_and_note(*asked: Any) -> None:
        looks.append(asked[-2])
        look(*asked)

    on_a_clock(monkeypatch, now_ns, sleep_until_ns, look_and_note)
    run, stop, own = getattr(watch, "py_func", watch), np.zeros(1, np.int64), np.zeros(N_OWN, np.int64)
    ops = np.zeros((N_SAFE_OPS, OP_FIELDS), dtype=np.int64)
    run(own, mail, board, NO_CARD_WORDS, ops, stop, patient_ns, began_ns + 3 * patient_ns, 0)
    assert own[TRIPPED] == 1
    for t_ns in written:
        assert any(t_ns <= look_ns <= t_ns + HELD_LOOK_NS for look_ns in looks)
    assert len(looks) <= 3 * LOOKS_PER_TIMEOUT + len(written) + 1


def test_a_board_that_takes_nothing_does_not_make_the_guardian_forget() -> None:
    bench, guardian = watched()
    moving(bench)
    bench.deaf = True
    sleep(bench, 0.2)
    assert pending_operations(bench.board, int(Lane.GUARDIAN)) > LANE_CAPACITY - N_SAFE_OPS
    assert guardian.tripped
    bench.deaf = False
    sleep(bench, 0.02)
    assert bench.safe


def test_what_takes_long_is_done_before_other_servos_are_kept_from_running(monkeypatch) -> None:
    order: list[str] = []
    for step in ("freeze_garbage", "lock_memory", "tighten_timers", "set_fifo"):
        monkeypatch.setattr(guardian_module, step, lambda *_, name=step: order.append(name))
    guardian_module.prepare()
    assert order[-1] == "set_fifo"
    assert {"freeze_garbage", "lock_memory"} <= set(order)


@pytest.mark.realtime
@pytest.mark.parametrize(("board_runs", "slips", "trips"), [(False, 1, 0), (True, 1, 1), (False, 0, 1)])
def test_a_servo_is_not_silent_while_its_emulated_board_sleeps_too(board_runs: bool, slips: int, trips: int) -> None:
    """The guardian alone gets the processor: it looks on time, and knows of no stall by its own clock."""
    guardian_module.warm_up()
    mail, board = servo_front(ServoBench().mailbox.words), local_board_memory()
    own, ops = np.zeros(N_OWN, dtype=np.int64), np.zeros((N_SAFE_OPS, OP_FIELDS), dtype=np.int64)
    stop = np.zeros(1, dtype=np.int64)
    began_ns = monotonic_now()
    board.facts.now_ns = began_ns + (FAR_NS if board_runs else 0)
    mail.heartbeat.armed, mail.heartbeat.t_ns, mail.heartbeat.discrete = 1, began_ns, DISCRETE_POWER

    def watch_on() -> bool:
        watch(own, mail, board, NO_CARD_WORDS, ops, stop, TIMEOUT_NS, monotonic_now() + 4 * TIMEOUT_NS, slips)
        return own[TRIPS] == trips

    watch_on()
    wait_until(watch_on, f"{trips} trips")
