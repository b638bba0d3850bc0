"""A test that is not marked `realtime` cannot read a clock (tests/support/clocks.py): also not behind its own back."""

from __future__ import annotations

import queue
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import pytest

from qrobot.hwif.modbus.device import ModbusDevice
from qrobot.realtime.clock import monotonic_ns, sleep_until_ns
from qrobot.realtime.jit import kernel
from tests.support import clocks
from tests.support.clocks import CALENDARS, CALLERS, CLOCKS, TESTS, WATCH, ClockReadError, virtual_time_only
from tests.support.paper_board import PaperBoard

ROOT = Path(__file__).parents[3]

# They change a clock, tell of one, or reckon with times that they are told.
NO_CLOCKS = {
    "clock_getres", "clock_settime", "clock_settime_ns", "get_clock_info", "mktime", "pthread_getcpuclockid",
    "strptime", "struct_time", "tzset",
}  # fmt: skip


@kernel
def now_ns() -> int:
    """The compiled clock."""
    return monotonic_ns()


@kernel
def sleep() -> None:
    """As long as it takes to ask."""
    sleep_until_ns(0)


def test_every_function_of_pythons_time_is_refused_or_reads_no_clock() -> None:
    functions = {name for name, found in vars(time).items() if callable(found) and not name.startswith("_")}
    assert functions == {*CLOCKS, *CALENDARS, *NO_CLOCKS}


@pytest.mark.parametrize("name", CLOCKS)
def test_no_clock_of_python_can_be_read(name: str) -> None:
    arguments = {"sleep": (0.0,), "clock_gettime": (0,), "clock_gettime_ns": (0,)}.get(name, ())
    with pytest.raises(ClockReadError, match=f"time.{name} in a test on virtual time"), virtual_time_only():
        getattr(time, name)(*arguments)


@pytest.mark.parametrize("name", CALENDARS)
def test_a_calendar_is_a_clock_unless_it_is_told_the_time(name: str) -> None:
    arguments = ("%H",) if name == "strftime" else ()
    told = time.gmtime(0.0) if name in ("strftime", "asctime") else 0.0
    assert getattr(time, name)(*arguments, told)
    for nothing in ((), (None,)):
        with pytest.raises(ClockReadError), virtual_time_only():
            getattr(time, name)(*arguments, *nothing)


@pytest.mark.parametrize("call", [now_ns, sleep])
def test_a_kernel_that_reads_a_clock_is_told_of_when_the_test_is_over(call: Callable[[], object]) -> None:
    with pytest.raises(ClockReadError), virtual_time_only():
        call()


def test_a_clock_that_is_the_default_of_an_argument_is_refused_as_well() -> None:
    with pytest.raises(ClockReadError, match=r"qrobot/hwif/modbus/device\.py"), virtual_time_only():
        ModbusDevice(PaperBoard())


def read_and_swallow() -> None:
    with suppress(ClockReadError):
        time.time()


def read_in_a_thread() -> None:
    thread = threading.Thread(target=read_and_swallow)
    thread.start()
    thread.join()


@pytest.mark.parametrize("call", [read_and_swallow, read_in_a_thread])
def test_whoever_swallows_the_error_fails_all_the_same(call: Callable[[], None]) -> None:
    with pytest.raises(ClockReadError, match=r"time\.time"), virtual_time_only():
        call()


def test_libraries_keep_their_clocks() -> None:
    assert eval(compile("time.monotonic()", "numba/core/event.py", "eval")) > 0.0
    assert not threading.Event().wait(0.0)
    with pytest.raises(queue.Empty):
        queue.Queue[int]().get(timeout=0.001)
    subprocess.run([sys.executable, "-c", ""], check=True, timeout=60.0)


def test_this_test_is_watched() -> None:
    assert WATCH.forbidden


@pytest.mark.realtime
def test_a_test_on_the_wall_clock_is_not() -> None:
    assert not WATCH.forbidden
    assert now_ns() <= time.monotonic_ns()


def test_every_exception_is_still_one_and_says_why() -> None:
    for name, reason in CALLERS.items():
        assert any(clock in (ROOT / name).read_text() for clock in ("time.", "clock", "monotonic_ns")), name
        assert len(reason.split()) > 3
    for name in TESTS:
        assert (ROOT / name.partition("::")[0]).is_file(), name


def test_a_test_is_an_exception_by_the_beginning_of_its_name(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(TESTS, "tests/unit/test_x.py::test_one", "because")
    assert clocks.may_read_clocks("tests/unit/test_x.py::test_one[3]", realtime=False)
    assert not clocks.may_read_clocks("tests/unit/test_x.py::test_two", realtime=False)
    assert clocks.may_read_clocks("tests/unit/test_x.py::test_two", realtime=True)
