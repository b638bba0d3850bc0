"""Control functions that are compiled, and the loop that runs them without the interpreter.

A compiled control function takes the tick at which it is due and an array of numbers, the region of shared memory that
has the name of its task. It is a `@lean_kernel`, or any function that Numba has compiled, and returns nothing.
"""

from __future__ import annotations

from typing import Any, Final

from numba import types

from qrobot.arrays import Floats, Words
from qrobot.errors import ConfigError
from qrobot.rci.common_clock import newest_tick, start_of_tick
from qrobot.rci.descriptor import TaskDescriptor, TaskWord
from qrobot.realtime.atomics import load_acquire, store_release
from qrobot.realtime.clock import monotonic_ns, sleep_until_ns
from qrobot.realtime.jit import jit_disabled, lean_kernel
from qrobot.realtime.pointer import COMPILE_ERRORS, KernelPointer, raising_function_at

SIGNATURE: Final = types.void(types.int64, types.float64[::1])
LOOK_NS: Final = 20_000_000  # [A] a loop that sleeps looks up so often, to see that it is to end

tick_at_time = lean_kernel(newest_tick)
time_of_tick = lean_kernel(start_of_tick)
_call_at = raising_function_at(SIGNATURE)
_WOKEN: Final = int(TaskWord.WOKEN)
_SERVED: Final = int(TaskWord.SERVED)
_RUNS: Final = int(TaskWord.RUNS)
_MISSED: Final = int(TaskWord.MISSED)
_BEGAN_NS: Final = int(TaskWord.BEGAN_NS)
_LONGEST_NS: Final = int(TaskWord.LONGEST_NS)


@lean_kernel
def no_function(tick: int, memory: Floats) -> None:
    """A second control function that has nothing to do."""


@lean_kernel
def run_control(
    words: Words, over: Words, memory: Floats, control1: int, control2: int, rate_hz: int, epoch_ns: int,
    interval: int, tick: int,
) -> None:  # fmt: skip
    """Run two functions by the common clock, at `tick` first, until `over[0]` is set.

    Every wake-up until then is answered, late ones one after the other, each with its own tick. Raises what the
    functions raise.
    """
    first, second = _call_at(control1), _call_at(control2)
    while load_acquire(over, 0) == 0:
        due_ns = epoch_ns + time_of_tick(tick, rate_hz)
        now_ns = monotonic_ns()
        if now_ns < due_ns:
            sleep_until_ns(min(due_ns, now_ns + LOOK_NS))
            continue
        times = (tick_at_time(now_ns - epoch_ns, rate_hz) - tick) // interval + 1
        words[_MISSED] += times - 1
        store_release(words, _WOKEN, words[_WOKEN] + times)
        for _ in range(times):
            if load_acquire(over, 0) != 0:
                return
            began_ns = monotonic_ns()
            store_release(words, _BEGAN_NS, began_ns)
            first(tick, memory)
            second(tick, memory)
            store_release(words, _BEGAN_NS, 0)
            words[_LONGEST_NS] = max(words[_LONGEST_NS], monotonic_ns() - began_ns)
            store_release(words, _SERVED, words[_SERVED] + 1)
            store_release(words, _RUNS, words[_RUNS] + 1)
            tick += interval


def refuse_order(processor: str, order: str) -> None:
    """Raise ConfigError for an order that only an interpreter can carry out."""
    if order in ("set_wakeup", "set_device", "set_trigger"):
        raise ConfigError(f"processor {processor}: a compiled task is woken by the clock alone, see rci_onclock")


def refuse_task(processor: str, td: TaskDescriptor, alone: bool) -> None:
    """Raise ConfigError for a second task of a processor, and for one with a robot."""
    if not alone or td.robot is not None:
        raise ConfigError(
            f"task {td.name}: {processor} runs one task, and none with a robot; take another compiled processor, "
            "and share memory with the task of the robot"
        )


def pointer_to(function: Any, task: str) -> KernelPointer:
    """The machine code of a compiled control function. Raises ConfigError when it is none."""
    if not jit_disabled() and not hasattr(function, "get_compile_result"):
        raise ConfigError(f"{task}: a compiled processor runs functions that Numba has compiled, not {function!r}")
    pointer = KernelPointer(function, SIGNATURE)
    try:
        assert pointer.raising_address
    except COMPILE_ERRORS as error:
        wanted = "a compiled control function takes a tick and an array of numbers and returns nothing"
        raise ConfigError(f"{task}: {wanted}: {error}") from error
    return pointer
