"""When a bridge takes the servo of its arm for one that runs."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from dataclasses import replace

import pytest

from qrobot.rccl_bridge.servo_interface import SetpointFrame
from qrobot.rccl_bridge.servo_port import STALE_NS, STALLED_NS, ServoPort
from qrobot.servo.memory.servo_memory import ServoFront, create_servo_memory
from qrobot.servo.rates import LOWEST_RATE_HZ
from qrobot.units import NS_PER_S


@pytest.fixture
def port() -> ServoPort:
    return ServoPort(f"port{os.getpid()}", "puma560", 6)


@pytest.fixture
def front(port: ServoPort, monkeypatch: pytest.MonkeyPatch) -> Iterator[ServoFront]:
    """Memory of a servo whose last cycle is of the instant at which time stands still."""
    now_ns = NS_PER_S
    monkeypatch.setattr(time, "monotonic_ns", lambda: now_ns)
    with create_servo_memory(port.arm, port.robot_name, "pd", port.n, 1_000_000, 16) as servo:
        servo.front.info.ready, servo.front.heartbeat.t_ns = 1, now_ns
        yield servo.front


def test_without_memory_there_is_no_servo(port: ServoPort) -> None:
    assert not port.alive()


@pytest.mark.parametrize(
    ("age_ns", "takeover", "alive"),
    [
        (STALE_NS - 1, 0, True),
        (STALE_NS, 0, False),
        (-STALE_NS, 0, False),  # no cycle comes from the future
        (STALLED_NS - 1, 1, True),  # it runs again, and has a fault to tell
        (STALLED_NS, 1, False),
    ],
)
def test_a_silent_servo_is_gone_sooner_when_its_guardian_has_taken_the_board(
    port: ServoPort, front: ServoFront, age_ns: int, takeover: int, alive: bool
) -> None:
    front.guardian.takeover, front.heartbeat.t_ns = takeover, NS_PER_S - age_ns
    assert port.alive() is alive


@pytest.mark.parametrize(
    ("age_ns", "slips", "asleep"),
    [
        (STALLED_NS, 1, False),
        (STALLED_NS + 1, 1, True),
        (STALLED_NS + 1, 0, False),
    ],  # no real board's time slips
)
def test_an_emulated_arm_is_asleep_once_its_servo_has_been_silent_for_a_while(
    port: ServoPort, front: ServoFront, age_ns: int, slips: int, asleep: bool
) -> None:
    front.heartbeat.slips, front.heartbeat.t_ns = slips, NS_PER_S - age_ns
    assert port.stalled() is asleep


def test_a_silence_in_which_the_bridge_was_stopped_as_well_is_none(
    port: ServoPort, front: ServoFront, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its arm tells of the stall between the bridge's two readings, and goes on."""
    stall_ns, slipped_ns = NS_PER_S // 2, port.slipped_ns

    def stopped() -> int:
        """The slip as it was before the stall; time goes on, and all the rest is told, before it is used."""
        monkeypatch.setattr(port, "slipped_ns", slipped_ns)
        before = slipped_ns()
        monkeypatch.setattr(time, "monotonic_ns", lambda: NS_PER_S + stall_ns)
        front.heartbeat.slipped_ns = stall_ns
        return before

    monkeypatch.setattr(port, "slipped_ns", stopped)
    assert port.alive()


def test_time_does_not_leap_ahead_while_a_servo_that_was_started_again_has_run_no_cycle(
    port: ServoPort, front: ServoFront
) -> None:
    assert port.slipped_ns() == 0
    front.heartbeat.slipped_ns = NS_PER_S // 2
    assert port.slipped_ns() == NS_PER_S // 2
    front.heartbeat.t_ns = front.heartbeat.slipped_ns = 0
    front.header.generation += 1
    assert port.slipped_ns() == NS_PER_S // 2
    front.heartbeat.t_ns, front.heartbeat.slipped_ns = NS_PER_S, NS_PER_S // 4
    assert port.slipped_ns() == NS_PER_S // 4


def test_a_servo_that_was_started_again_counts_as_away_for_the_longest_period_even_if_nobody_saw_it_gone(
    port: ServoPort, front: ServoFront, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert port.alive()
    front.header.generation += 1
    for passed_ns, alive in ((0, False), (99_999_999, False), (100_000_000, True), (200_000_000, True)):
        monkeypatch.setattr(time, "monotonic_ns", lambda passed_ns=passed_ns: NS_PER_S + passed_ns)
        front.heartbeat.t_ns = NS_PER_S + passed_ns
        assert port.alive() is alive


def test_each_servo_has_another_number_also_one_whose_file_is_new(
    port: ServoPort, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(time, "monotonic_ns", lambda: NS_PER_S)
    numbers = []
    for _ in range(3):  # the owner of each takes its file away, as a servo does that ends in order
        with create_servo_memory(port.arm, port.robot_name, "pd", port.n, 1_000_000, 16) as servo:
            port.alive()
            numbers += [port.servo]
            port.alive()
            numbers += [port.servo]
            servo.front.header.generation += 1  # one that was killed, and started again
            port.alive()
            numbers += [port.servo]
        assert not port.alive()
        assert port.servo == numbers[-1]
    assert numbers == [1, 1, 2, 3, 3, 4, 5, 5, 6]


ASKING = SetpointFrame(1, 1, NS_PER_S, 28_000_000, (0,) * 6, (0.0,) * 6, True, False, False, 0, 0)


def test_a_request_for_power_made_to_the_servo_before_neither_powers_nor_takes_the_power_that_somebody_else_gave(
    port: ServoPort, front: ServoFront
) -> None:
    port.write_setpoint(ASKING)
    assert front.command.power == 1
    front.command.power, front.header.generation = 0, front.header.generation + 1  # a new servo
    port.write_setpoint(ASKING)
    assert front.command.power == 0
    front.command.power = 1  # the operator
    port.write_setpoint(ASKING)
    assert front.command.power == 1
    port.write_setpoint(replace(ASKING, power=False))
    assert front.command.power == 0
    port.write_setpoint(ASKING)
    assert front.command.power == 1  # it has been asked for anew


@pytest.mark.parametrize(("age_periods", "alive"), [(1.5, True), (2.0, False)])
def test_nor_is_a_slow_one_gone_between_two_of_its_cycles(
    port: ServoPort, front: ServoFront, age_periods: float, alive: bool
) -> None:
    period_ns = round(NS_PER_S / LOWEST_RATE_HZ)
    front.info.period_ns, front.guardian.takeover = period_ns, 1
    front.heartbeat.t_ns = NS_PER_S - int(age_periods * period_ns)
    assert port.alive() is alive


def test_a_servo_of_another_robot_or_of_other_code_counts_as_away_and_is_named(port: ServoPort) -> None:
    with create_servo_memory(port.arm, "stanford", "pd", port.n, 1_000_000, 16) as servo:
        assert not port.alive()
        assert port.mismatch == f"the servo of {port.arm} drives 'stanford', not 'puma560'"
        servo.header.digest += 1
        again = ServoPort(port.arm, "puma560", port.n)
        assert not again.alive()
        assert again.mismatch.endswith(
            "with other fields than this version expects: its owner runs other code; restart both"
        )
    for each in (port, again):  # its owner is gone
        assert not each.alive()
        assert each.mismatch == ""
