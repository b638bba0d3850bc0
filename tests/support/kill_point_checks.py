"""A servo that dies, or stalls, at any instruction: the guardian leaves the arm without torque and power in time.

Run by `tests/system/test_servo_without_jit.py`, in plain Python, each cause over one way to the board or two; by
`python -m tests.campaigns deaths` over all of them.
"""

from __future__ import annotations

import os
from collections.abc import Callable

import pytest

from qrobot.faultcodes import FaultCode
from qrobot.hwif.board_memory import Lane
from qrobot.hwif.lanes import discard_operations
from qrobot.modecodes import Mode
from qrobot.realtime.jit import jit_disabled
from qrobot.servo.checks.guardian_arming import stands_down
from qrobot.servo.laws.law_swap import SWAPPED, ask_for_law, maybe_swap_result
from qrobot.servo.laws.shipped import find_law
from qrobot.servo.output_lines import OutputWire
from qrobot.servo.process.guardian import TRIPPED
from qrobot.servo.settings import Overrun
from tests.support.kill_points import WAYS, DyingBench
from tests.support.servo_bench import moving


def power_off(bench: DyingBench) -> None:
    bench.mailbox.request_power(False)


def power_off_by_another(bench: DyingBench) -> None:
    bench.mailbox.request_power_off()


def emergency_stop(bench: DyingBench) -> None:
    bench.estop_ok = False


def shutdown(bench: DyingBench) -> None:
    bench.mail.command.shutdown = 1


def garbage(bench: DyingBench) -> None:
    bench.status = 0xFFFF


def board_silent(bench: DyingBench) -> None:
    bench.frozen = True


def stop(bench: DyingBench) -> None:
    bench.mailbox.request_stop()


def power_lost(bench: DyingBench) -> None:
    bench.panel = False


ALL_WAYS = bool(os.environ.get("QROBOT_ALL_WAYS"))


def ways(*chosen: str, of: tuple[str, ...] = tuple(WAYS)) -> list[str]:
    """The ways to the board that a cause is tried over: those chosen for the suite, or all there are."""
    return [way for way in of if ALL_WAYS or way in chosen]


FROM_HOLDING = [power_off, emergency_stop, shutdown, power_lost]
if ALL_WAYS:
    FROM_HOLDING += [power_off_by_another, board_silent, garbage]
CASES = [(happens, "memory") for happens in FROM_HOLDING]
CASES += [(power_off, "port"), (shutdown, "gateway")]
if ALL_WAYS:
    several = [(happens, way) for happens in (power_off, shutdown, board_silent) for way in ("port", "gateway")]
    CASES += [case for case in several if case not in CASES]
FROM_TRACKING = [emergency_stop, power_lost, board_silent, stop]


def holding(way: str) -> DyingBench:
    bench = DyingBench(way)
    bench.hold()
    bench.tick(3)
    return bench


def tracking(way: str) -> DyingBench:
    bench = DyingBench(way)
    moving(bench, seconds=0.1)
    return bench


def dies_everywhere(bench: DyingBench, ticks: int) -> None:
    with bench.dying():
        bench.tick(ticks)
    assert bench.points > 50 * ticks  # a vector is one store here
    assert bench.worlds > 3 * ticks


def test_this_is_plain_python() -> None:
    assert jit_disabled()


@pytest.mark.parametrize(("happens", "way"), CASES, ids=lambda value: getattr(value, "__name__", value))
def test_a_servo_that_dies_while_it_leaves_holding(happens: Callable[[DyingBench], None], way: str) -> None:
    bench = holding(way)
    assert not bench.way.registers.safe
    happens(bench)
    dies_everywhere(bench, 8)
    assert bench.mode in (Mode.OFF, Mode.FAULT)
    assert bench.way.registers.safe
    assert bench.mail.guardian.takeover == 0


@pytest.mark.parametrize("way", ways("memory", of=("memory", "port")))
@pytest.mark.parametrize("happens", FROM_TRACKING, ids=lambda happens: happens.__name__)
def test_a_servo_that_dies_while_it_leaves_tracking(happens: Callable[[DyingBench], None], way: str) -> None:
    bench = tracking(way)
    happens(bench)
    dies_everywhere(bench, 7)
    assert bench.mode in (Mode.STOPPING, Mode.FAULT)


@pytest.mark.parametrize("way", ways("gateway"))
@pytest.mark.parametrize("end", [power_off, shutdown], ids=lambda end: end.__name__)
def test_a_servo_that_dies_where_a_controlled_stop_ends_in_power_off(
    end: Callable[[DyingBench], None], way: str
) -> None:
    trial, bench = tracking("memory"), tracking(way)
    end(trial)
    ticks = trial.until(lambda: trial.mode is Mode.OFF)
    end(bench)
    bench.tick(ticks - 2)
    assert bench.mode is Mode.STOPPING
    dies_everywhere(bench, 10)
    assert bench.mode is Mode.OFF


@pytest.mark.parametrize("way", ways("port"))
def test_a_servo_that_dies_where_a_category_1_stop_ends_in_fault(way: str) -> None:
    def late(bench: DyingBench) -> None:
        for _ in range(3):
            bench.skip(1)
            bench.tick()

    strict = Overrun(misses_in_a_row=3, late_share=1.0, window_s=1.0)
    trial, bench = DyingBench(overrun=strict), DyingBench(way, overrun=strict)
    for each in (trial, bench):
        moving(each, seconds=0.1)
        late(each)
        assert each.mode is Mode.STOPPING
    ticks = trial.until(lambda: trial.mode is Mode.FAULT)
    bench.tick(ticks - 2)
    dies_everywhere(bench, 10)
    assert (bench.mode, bench.fault) == (Mode.FAULT, FaultCode.OVERRUN)


@pytest.mark.parametrize("way", ways("memory"))
def test_a_servo_that_dies_while_it_powers_up(way: str) -> None:
    bench = DyingBench(way)
    bench.tick(8)
    assert bench.mail.heartbeat.armed == 0
    bench.mailbox.request_power(True)
    dies_everywhere(bench, 8)
    assert bench.mode is Mode.HOLDING


@pytest.mark.parametrize("way", ways("gateway"))
def test_a_servo_that_dies_while_a_request_for_power_is_withdrawn(way: str) -> None:
    bench = DyingBench(way)
    bench.tick(5)
    bench.wait_for_power()
    assert bench.mode is Mode.POWERING
    bench.mailbox.request_power(False)
    dies_everywhere(bench, 8)
    assert bench.mode is Mode.OFF


@pytest.mark.parametrize("way", ways("port"))
def test_a_servo_that_dies_while_a_fault_is_cleared(way: str) -> None:
    bench = holding(way)
    bench.estop_ok = False
    bench.tick(8)
    bench.estop_ok = True
    bench.mailbox.request_power(False)
    bench.mailbox.request_clear()
    with bench.dying():
        bench.tick(8)
    assert bench.mode is Mode.OFF


def test_a_servo_that_dies_while_its_law_is_swapped() -> None:
    bench = holding("memory")
    ask_for_law(bench.state.swap, find_law("pd", bench.robot), bench.state.swap.gains)
    dies_everywhere(bench, 3)
    assert maybe_swap_result(bench.state.swap) == SWAPPED
    assert bench.mode is Mode.HOLDING


def test_a_servo_that_dies_while_the_guardian_hands_the_board_back() -> None:
    bench = holding("memory")
    bench.sleep(8)
    bench.tick(2)
    assert bench.own[TRIPPED] == 1
    bench.mailbox.request_power(False)
    bench.mailbox.request_clear()
    with bench.dying():
        bench.tick(8)
    assert (bench.mode, bench.own[TRIPPED], bench.mail.heartbeat.armed) == (Mode.OFF, 0, 0)


@pytest.mark.parametrize(
    "way", ways("gateway", of=("memory", "gateway"))
)  # with a card the board's memory is the servo's own
def test_a_servo_that_starts_beside_what_a_dead_one_has_left_and_dies_in_turn(way: str) -> None:
    dead, bench = holding(way), DyingBench(way)
    bench.board, bench.way, bench.own, bench.now_ns, bench.q = dead.board, dead.way, dead.own, dead.now_ns, dead.q
    bench._image[:] = dead._image
    discard_operations(bench.board, int(Lane.SERVO))
    assert not bench.way.registers.safe
    dies_everywhere(bench, 8)
    assert bench.mode is Mode.OFF
    assert bench.way.registers.safe


def test_a_servo_that_starts_after_the_bound_finds_the_board_taken() -> None:
    dead, bench = holding("memory"), DyingBench()
    bench.board, bench.way, bench.own, bench.now_ns, bench.q = dead.board, dead.way, dead.own, dead.now_ns, dead.q
    bench._image[:] = dead._image
    bench.sleep(8)
    assert bench.own[TRIPPED] == 1
    bench.tick(3)
    assert (bench.mode, bench.fault) == (Mode.FAULT, FaultCode.GUARD_TRIP)
    assert bench.way.registers.safe


def test_what_waits_for_the_card_when_the_guardian_takes_the_board_is_not_written() -> None:
    bench = holding("port")
    write_card = bench.way.after_cycle

    def stalled(_bench: DyingBench) -> None:
        bench.sleep(8)
        assert bench.own[TRIPPED]
        bench.way.registers.driven = False
        write_card(bench)

    bench.way.after_cycle = stalled  # type: ignore[method-assign]
    bench.tick()
    bench.way.after_cycle = write_card  # type: ignore[method-assign]
    bench.tick(4)
    assert not bench.way.registers.driven
    assert (bench.mode, bench.fault) == (Mode.FAULT, FaultCode.GUARD_TRIP)


@pytest.mark.parametrize("way", ways("memory", "port"))
def test_a_guardian_that_dies_while_it_takes_the_board_leaves_a_servo_that_makes_it_safe_before_it_ends(
    way: str,
) -> None:
    for at in (*range(1, 9), *range(9, 100, 13)):
        bench = holding(way)
        assert bench.sleep_beside_a_dying_guardian(8, at)
        bench.mail.command.shutdown = 1
        bench.tick()
        bench.until(lambda bench=bench: stands_down(bench.state, bench.mail), seconds=0.05)
        assert bench.way.registers.safe, at


GLUE = (OutputWire(1, "glue", bit=3),)


def test_a_servo_that_dies_while_an_output_goes_off_without_power() -> None:
    bench = DyingBench(outputs=GLUE)
    bench.before.append(lambda now_ns: bench.mailbox.request_outputs(glued, now_ns))
    glued = 1
    bench.tick(8)
    assert bench.way.registers.discrete & 1 << 3
    assert bench.mail.heartbeat.armed == 1
    glued = 0
    with bench.dying():
        bench.tick(8)
    assert not bench.way.registers.discrete & 1 << 3
    assert bench.mail.heartbeat.armed == 0


# -------------------------------------------------------------------------------------------------------- what is lost


def test_a_power_off_that_the_board_loses_is_said_again_and_the_guardian_stays() -> None:
    bench = holding("gateway")
    bench.mailbox.request_power(False)
    way, step = bench.way, bench.way.registers.apply
    way.registers.apply = lambda _offset, _value: None  # type: ignore[method-assign]
    bench.tick(20)
    assert (bench.mode, bench.mail.heartbeat.armed) == (Mode.OFF, 1)
    assert not way.registers.safe
    way.registers.apply = step  # type: ignore[method-assign]
    bench.tick(2)
    assert way.registers.safe
    bench.tick(6)
    assert bench.mail.heartbeat.armed == 0


def test_a_board_that_is_deaf_when_the_servo_dies_gets_power_off_as_soon_as_it_hears() -> None:
    bench = holding("memory")
    bench.mailbox.request_power(False)
    apply = bench.way.registers.apply
    bench.way.registers.apply = lambda _offset, _value: None  # type: ignore[method-assign]
    bench.tick(20)
    bench.sleep(20)
    bench.way.registers.apply = apply  # type: ignore[method-assign]
    bench.sleep(2)
    assert bench.way.registers.safe


# --------------------------------------------------------------------------------------------------------- stalled


@pytest.mark.parametrize(("way", "step"), [("memory", 23), ("port", 97), ("gateway", 97)])
@pytest.mark.parametrize("asks", [True, False], ids=["power on", "power off"])
def test_a_servo_that_stalls_anywhere_and_goes_on_does_not_undo_what_the_guardian_did(
    asks: bool, way: str, step: int
) -> None:
    """A list that it was just posting when the guardian took the board may act, until the guardian's next look."""
    whole = asking(way, asks)
    with whole.dying():
        whole.tick(4)
    taken = silenced = 0
    for at in range(1, whole.points, step):
        bench = asking(way, asks)
        with bench.stalling(at, 30):
            bench.tick(4)
        bench.tick(4)
        if bench.own[TRIPPED]:
            taken += 1
            silenced += bench.silenced
            assert bench.way.registers.safe
            assert not (bench.silenced and bench.way.registers.driven)
            assert (bench.mode, bench.fault) == (Mode.FAULT, FaultCode.GUARD_TRIP)
        else:  # it stalled before it was armed, or was not any more
            assert bench.mode in (Mode.POWERING, Mode.HOLDING, Mode.OFF)
    assert taken > 2
    assert silenced > 0


def asking(way: str, power: bool) -> DyingBench:
    """A servo that has just been asked for power, or to give it up."""
    bench = DyingBench(way)
    bench.tick(8)
    if not power:
        bench.hold()
    bench.mailbox.request_power(power)
    return bench
