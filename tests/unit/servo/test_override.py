"""Speed override and pause: from the operator into the state that everybody reads, and into the log."""

from __future__ import annotations

import math

import pytest

from qrobot.modecodes import Mode
from qrobot.rccl_bridge.mailbox_port import MailboxPort
from tests.support.servo_bench import ServoBench, moving


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


def test_a_resume_is_told_as_the_end_of_a_short_pause_unless_setpoints_are_followed() -> None:
    """A program that waits to be led back to its path hears no command, but sees a pause end."""
    bench = ServoBench().hold()
    paused = lambda: bench.mailbox.snapshot().paused  # noqa: E731
    bench.mailbox.request_resume()
    bench.run(0.2)
    assert paused()  # at least two samples of the longest period begin within
    bench.run(0.1)
    assert not paused()
    bench.mailbox.request_pause(True)
    bench.run(0.5)
    bench.mailbox.request_resume()
    bench.run(0.01)
    assert not paused()
    moving(bench)
    bench.mailbox.request_resume()
    bench.run(0.01)
    assert not paused()
    bench.mailbox.request_stop()
    bench.run(0.2)
    assert bench.mode is not Mode.TRACKING
    assert not paused()  # what was said while the arm moved is no word about where it was stopped


def test_a_resume_does_not_undo_a_pause_that_somebody_asks_for_after_it() -> None:
    bench = ServoBench().hold()
    seen = []
    bench.mailbox.request_resume()
    bench.run(0.1)
    bench.mailbox.request_pause(True)
    for _ in range(50):
        seen.append(bench.mailbox.snapshot().paused)
        bench.run(0.01)
    assert all(seen)  # nobody hears a pause that ends
    bench.mailbox.request_resume()
    bench.run(0.01)
    assert not bench.mailbox.snapshot().paused


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
