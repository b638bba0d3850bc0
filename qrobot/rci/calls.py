"""The calls of RCI, in snake case (Lloyd, Parker and McClain 1987, section 4).

The planning program creates tasks and memory, says what wakes each task, starts and releases them, and waits. The
functions of tasks use memory, messages and signals. One set of tasks lives from the first call to `rci_close`.
"""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Callable
from types import ModuleType
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from qrobot.errors import ConfigError
from qrobot.rci import arm_tasks
from qrobot.rci.descriptor import TaskDescriptor
from qrobot.rci.environment import environment
from qrobot.rci.mail_lane import clear_word, set_word
from qrobot.rci.processor_names import ProcessorInfo, processors
from qrobot.rci.program import HasFileno, RciProgram
from qrobot.rci.robot_data import KnownRobot
from qrobot.rci.task_runner import ControlFunction, ControlFunctions, current_task, nothing
from qrobot.rci.task_table import ALL, Bytes, SharedProgram, TaskTable, signal_parent

_WORD: Final = 8  # bytes
_program: RciProgram | None = None  # in the process of the planning program
_shared: SharedProgram | None = None  # wherever tasks run


def be_processor(shared: SharedProgram) -> None:
    """This process runs tasks of a program, whose calls reach it by `shared`."""
    global _shared  # noqa: PLW0603 (the papers' calls name no program)
    _shared = shared


def _forget_in_child() -> None:
    """A child that the program forks has no tasks; see `qrobot.rci.forked_child`."""
    global _program, _shared  # noqa: PLW0603 (as above)
    _program = _shared = None


os.register_at_fork(after_in_child=_forget_in_child)


def _begun() -> RciProgram:
    """The program, begun with the first call."""
    global _program, _shared  # noqa: PLW0603 (as above)
    if _program is None and _shared is not None:
        raise ConfigError("a task on a processor of its own uses what there is; the program creates and starts")
    if _program is None:
        _program = RciProgram(environment())
        _shared = _program.shared
    return _program


def _running() -> RciProgram:
    _seen()
    return _begun()


def _seen() -> SharedProgram:
    if _shared is None:
        raise ConfigError("there are no tasks: call rci_create() first")
    return _shared


def _table() -> TaskTable:
    return _seen().table


def _self() -> TaskDescriptor:
    """The caller: a task, or the planning program."""
    return current_task() or _seen().parent


# ----------------------------------------------------------------------------------------------- creation and deletion


def rci_robot(name: str, file: str, bridge: str = "") -> None:
    """Add a robot to the data base: tasks of that name are connected to it.

    Args:
        name: of tasks that want it; packaged robots are known by their own names already.
        file: robot file, or name of a packaged robot.
        bridge: "host:port" of its bridge; by default the one that QROBOT_BRIDGE names.

    Raises:
        ConfigError: no such robot file.
    """
    _begun().robots.add(KnownRobot(name, file, bridge))


def rci_clock(rate_hz: int) -> None:
    """Choose the rate of the common clock, 1 to 1000 ticks a second; 100 without this call.

    Raises:
        ConfigError: no such rate, or tasks have been active.
    """
    _begun().set_clock_rate(rate_hz)


def rci_create(name: str, proc: str | None = None, priority: int = 0) -> TaskDescriptor:
    """Create a control task, which is not active yet.

    Args:
        name: of the task. That of a robot connects it: its `td.how` and `td.chg` are that robot's. Any other name
            makes a task without one, a misspelt one too: `td.robot` is None, and `td.chg` raises LinkError.
        proc: processor it runs on, "host" by default: the program's own; "cpu1" for a process kept on that processor,
            "aux", "aux1" and so on for one that the system places; "compiled", "compiled1" and so on for a thread that
            runs one task of compiled functions.
        priority: of tasks of one processor that are due together the highest goes first, equals in turn.

    Raises:
        ConfigError: a name that is taken, too many tasks, a mistake in the robot's file, no such processor or priority,
            or tasks have been active.
    """
    return _begun().create(name, proc, priority)


def rci_processors() -> list[ProcessorInfo]:
    """The processors that tasks can run on, and whether a program can have them now; other hosts are asked."""
    from qrobot.rci.hosts.remote_processor import host_processors

    return [*processors(), *host_processors()]


def rci_close() -> None:
    """Release all tasks, stop their robots, and forget tasks and memory.

    Raises what ended a task and was not told; ConfigError, and nothing happens, in a control function.
    """
    global _program, _shared  # noqa: PLW0603 (as above)
    if current_task() is not None:
        raise ConfigError("rci_close: a control function must not wait for its own end: let it signal the program")
    program = _program
    if program is not None:
        _program = None
        try:
            program.close()  # until then a function under way finds memory and tasks
        finally:
            _shared = None


def rci_control(
    td: TaskDescriptor,
    control1: ControlFunction,
    control2: ControlFunction | None = None,
    startup: ControlFunction | None = None,
) -> None:
    """Give a task its functions, which get its descriptor.

    Args:
        td: the task; it may be active.
        control1: called at each wake-up; with a robot between its read and its send. On a compiled processor a function
            that Numba has compiled, of the tick and of the numbers in the shared memory of the task's name.
        control2: called behind the send, to prepare the next cycle; without a robot right behind `control1`.
        startup: called once, when the task is started for the first time.

    Raises:
        ConfigError: one of them is no function.
    """
    _running().control(td, ControlFunctions(control1, control2 or nothing, startup or nothing))


# --------------------------------------------------------------------------------------------------------- scheduling


def rci_onclock(td: TaskDescriptor, interval: int, offset: int = 0) -> None:
    """Wake a task at every tick of the common clock for which (ticks - offset) % interval == 0.

    For a task with a robot the interval is the robot's sample period, 1 to 100 ms.

    Raises:
        ConfigError: no numbers of ticks, or the task holds its robot.
    """
    _running().on_clock(td, interval, offset)


def rci_onfunction(td: TaskDescriptor, wakeup: Callable[[], object]) -> None:
    """Wake a task when `wakeup`, called at every tick while the task is active, returns true.

    Raises:
        ConfigError: it is no function, or the task has a robot, which wakes it.
    """
    _running().on_function(td, wakeup)


def rci_device_interrupt(td: TaskDescriptor, device: int | HasFileno) -> None:
    """Wake a task when a device is readable: a file, socket, pipe or descriptor, which its functions have to read.

    With `rci_onfunction` too, that function is asked then, and at no other time.

    Raises:
        ConfigError: it is nothing that can be waited for, or the task has a robot, which wakes it.
    """
    _running().on_device(td, device)


def rci_timeout(td: TaskDescriptor, seconds: float) -> None:
    """Choose how long each function of a task may take, 0.5 s without this call; one that takes longer is ended.

    In real time only: on virtual time nothing waits for a task that takes its time.

    Raises:
        ConfigError: less than a millisecond, or more than an hour.
    """
    _running().allow(td, seconds)


def rci_trigger(td: TaskDescriptor, interval: int, offset: int, trigger: ControlFunction) -> None:
    """Call a function by the clock while a task is active, to start a device that will wake the task.

    Raises:
        ConfigError: no numbers of ticks, or no function.
    """
    _running().trigger(td, interval, offset, trigger)


def rci_start(mask: int) -> None:
    """Activate tasks together: from one tick on, when all their robots have power and follow.

    Args:
        mask: bits of the tasks, `td1.bit | td2.bit`.

    Raises:
        ConfigError: no such tasks, no functions, or active already.
        LinkError, ServoFault, MotionError: a robot cannot be had. The tasks are released again.
        Exception: what a start-up function raised.
    """
    _running().start(mask)


def rci_release(mask: int, power_off: bool = False) -> None:
    """Let tasks rest until they are started again; their robots come to a controlled stop and are let go.

    Robots hold their position then, or lose power and close their brakes when `power_off`: the arm of a task that has
    ended is connected to once more for that. Raises ConfigError, and LinkLost where that connection fails, once all
    other arms have been let go of.
    """
    _running().release(mask, power_off)


def rci_ticks() -> int:
    """The newest tick of the common clock, -1 before the first."""
    return _seen().clock_ticks()


def rci_wait(predicate: Callable[[], object]) -> None:
    """Wait until a predicate is true; on virtual time this is what lets time pass.

    Raises:
        Exception: what ended a task before its time, once.
        ConfigError: called by a control function.
    """
    _running().wait(predicate)


# ------------------------------------------------------------------------------------- shared memory, data and messages


def rci_shared_memory(label: str, size: int, host_td: TaskDescriptor | None = None, access_mask: int = ALL) -> Bytes:
    """Make a region of shared memory, zeros; tasks get it by `rci_get_memory`.

    Args:
        label: its name.
        size: in bytes.
        host_td: the task whose processor holds it, which may always reach it.
        access_mask: tasks that may reach it besides; all by default.

    Raises:
        ConfigError: a label that is taken, no such size or tasks, or tasks have been active.
    """
    return _begun().share_memory(label, size, host_td, access_mask)


def rci_get_memory(label: str) -> Bytes:
    """The region of a label, bytes; `.view(np.float64)` makes numbers of them.

    Raises:
        ConfigError: there is none, or the task that calls may not reach it.
    """
    return _table().memory(label, _self())


def rci_shared_data(access_mask: int, module: ModuleType | str, name: str) -> NDArray[Any]:
    """Share a global array of a module among tasks: the variable becomes an array in shared memory, with its values.

    Args:
        access_mask: tasks that may reach it.
        module: where it is defined, "__main__" for the program itself.
        name: of the variable.

    Raises:
        ConfigError: it is no array of plain numbers, or tasks have been active.
    """
    place = sys.modules.get(module) if isinstance(module, str) else module
    array = getattr(place, name, None)
    if not isinstance(array, np.ndarray) or array.dtype.hasobject or not array.size:
        raise ConfigError(
            f"shared data {name!r}: a global NumPy array of numbers is needed, not {type(array).__name__}"
        )
    where = place.__name__  # type: ignore[union-attr]
    variable = (where, name, array.dtype.str, array.shape)
    memory = _begun().share_memory(f"{where}.{name}", array.nbytes, None, access_mask, variable)
    shared = memory.view(array.dtype).reshape(array.shape)
    shared[...] = array
    setattr(place, name, shared)
    return shared


def rci_send(sendcode: int, data: bytes) -> int:
    """Queue a message for each task of a mask; 1 is the planning program's bit. Never waits.

    Returns:
        The bytes queued; 0, and nobody gets it, when one of the tasks has no room.

    Raises:
        ConfigError: no such tasks, or a message longer than a queue.
    """
    if not isinstance(data, bytes | bytearray | memoryview | np.ndarray):
        raise ConfigError(f"send: a message is bytes, not {data!r}")
    return _table().send(_self(), sendcode, bytes(data))


def rci_receive(getcode: int = ALL) -> tuple[bytes, TaskDescriptor | None]:
    """The oldest message from any task of a mask, with its sender; without one no bytes and None. Never waits."""
    return _table().receive(_self(), getcode)


def rci_signal(number: int = signal.SIGUSR1) -> None:
    """Interrupt the planning program by a signal. Raises ConfigError when it has no handler for it."""
    signal_parent(_seen().parent_pid, number)


# ---------------------------------------------------------------------------------------------------------- support


def rci_descriptor(name: str) -> TaskDescriptor:
    """The descriptor of a task, or of an arm that a library moves in this process, by the name of its robot.

    An arm's is there from `control()` of RCCL, or `arcl_open`, to its release: its `how` and `chg`, `active`, `runs`
    and `missed` are as those of any task; no mask names it, and `chg` belongs to the library.

    Raises:
        ConfigError: there is none of that name.
    """
    arm = arm_tasks.held(name)
    if arm is not None and (_shared is None or not _shared.table.knows(name)):
        return arm
    return _table().find(name)


def rci_print(*values: object) -> None:
    """Print a line to the console, with the task's name in front."""
    print(f"[{_self().name}]", *values, file=sys.stderr)


def rci_malloc(size: int) -> memoryview:
    """Memory of this task alone, zeros; see `rci_free`. Raises ConfigError: no such size."""
    if not isinstance(size, int) or isinstance(size, bool) or size < 1:
        raise ConfigError(f"rci_malloc: a number of bytes is needed, not {size!r}")
    return memoryview(bytearray(size))


def rci_free(memory: memoryview) -> None:
    """Give memory of `rci_malloc` back; whoever uses it any further gets a ValueError."""
    memory.release()


def rci_test_and_set(memory: Bytes, word: int = 0) -> bool:
    """Set a word of shared memory in one step; True when it was set before, and so is somebody else's.

    Raises:
        ConfigError: there is no such word of 8 bytes.
    """
    return bool(set_word(_words_of(memory, word), word))


def rci_clear(memory: Bytes, word: int = 0) -> None:
    """Clear a word that `rci_test_and_set` has set. Raises ConfigError: there is none."""
    clear_word(_words_of(memory, word), word)


def _words_of(memory: Bytes, word: int) -> NDArray[np.int64]:
    n_words = memory.nbytes // _WORD
    if not isinstance(word, int) or not 0 <= word < n_words:
        raise ConfigError(f"test and set: this memory has the words 0 to {n_words - 1} of 8 bytes, not {word!r}")
    return memory.view(np.uint8)[: n_words * _WORD].view(np.int64)
