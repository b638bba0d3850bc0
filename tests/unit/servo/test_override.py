"""Speed override and pause: from the operator into the state that everybody reads, and into the log."""

from __future__ import annotations

import math

import pytest

from qrobot.rccl_bridge.mailbox_port import MailboxPort
from tests.support.servo_bench import ServoBench


def test_a_servo_starts_with_the_programmed_speed_and_tells_what_the_operator_wants() -> None:
    bench = ServoBench().hold()
    port = MailboxPort(bench.mailbox.words)
    assert (port.read_state().override, port.read_state().paused) == (1.0, False)
    bench.mailbox.request_override(0.3)
    bench.mailbox.request_pause(True)
    bench.run(0.01)
    assert (port.read_state().override, port.read_state().paused) == (0.3, True)
    assert bench.rows()["override"][-1] == 0.3
    bench.mailbox.request_stop()
    bench.mailbox.request_pause(False)
    bench.run(0.05)
    assert (port.read_state().override, port.read_state().paused) == (0.3, False)


@pytest.mark.parametrize("spoilt", [-0.1, 1.001, math.nan, math.inf])
def test_an_override_that_cannot_be_leaves_the_one_before_in_force(spoilt: float) -> None:
    bench = ServoBench().hold()
    bench.mailbox.request_override(0.5)
    bench.run(0.01)
    bench.mailbox.request_override(spoilt)
    bench.run(0.01)
    assert bench.mailbox.snapshot().override == 0.5


def test_numbers_of_a_program_are_in_every_row_and_no_numbers_are_nan() -> None:
    bench = ServoBench().hold()
    assert all(math.isnan(number) for number in bench.rows()["program_signals"][-1])
    bench.mailbox.tell_signals((1.0, 2.5, *(math.nan,) * 6))
    bench.run(0.01)
    assert bench.rows()["program_signals"][-1, :2].tolist() == [1.0, 2.5]
