"""The planning program's side of a processor in a process of its own: start it, give it orders, notice its death."""

from __future__ import annotations

import multiprocessing
import pickle
from collections.abc import Callable
from functools import partial
from multiprocessing.connection import Connection
from typing import Any, Final

from qrobot.errors import ConfigError, LinkLost, RogueTask
from qrobot.rci.descriptor import TaskDescriptor, TaskState, TaskWord
from qrobot.rci.forked_child import keep_from_children
from qrobot.rci.host_thread import PATIENCE_S, lateness, nothing_left, refuse_start
from qrobot.rci.process_main import run_processor
from qrobot.rci.processor_image import ProcessorImage
from qrobot.rci.processor_names import claim_processor, cpu_of
from qrobot.units import NS_PER_S

END_S: Final = 10.0  # [A] with robots that come to rest
_LOOK_S: Final = 0.1


class ProcessProcessor:
    """One processor of a program.

    It is started with the first task that is, when all tasks and memory are known; orders before that wait.

    Args:
        name: "cpu0", "aux1" and so on.
        happened: called when one of its tasks, or itself, has ended.

    Raises:
        ConfigError: there is no such processor. LinkBusy: another program has it.
    """

    def __init__(self, name: str, happened: Callable[[], object]) -> None:
        self.name, self.cpu = name, cpu_of(name)
        self._claim = None if self.cpu is None else claim_processor(name)
        self._happened = happened
        self._tds: dict[int, TaskDescriptor] = {}
        self._waiting: list[tuple[str, tuple[Any, ...]]] = []
        self._process: Any = None
        self._asked = 0  # orders that were sent
        self._dead = ""  # why it can do nothing any more
        keep_from_children(self)

    def forget_in_child(self) -> None:
        """See `Owned`: the process is the parent's, and `multiprocessing` would end it with this one."""
        if self._process is not None:
            vars(multiprocessing.process)["_children"].discard(self._process)
            self._process = None
            self._orders.close()
            self._events.close()

    # --------------------------------------------------------------------------------------------------------- orders

    def order(self, order: str, *arguments: Any) -> None:
        """Let its monitor do something, and wait until it has; before it runs, when it does. Raises what it raises."""
        self.begin(order, *arguments)()

    def begin(self, order: str, *arguments: Any) -> Callable[[], object]:
        """See `Processors.begin`."""
        if order == "add":
            self._tds[arguments[0].bit] = arguments[0]  # its process makes a task of the image by itself
            return nothing_left
        check_portable(order, arguments)
        if order == "attach":
            for bit, td in self._tds.items():
                if bit & arguments[0]:
                    td.begin()
        if self._process is None:
            self._waiting.append((order, arguments))
        elif self._dead:
            refuse_start(order, self._dead)
        else:
            self._send_waiting()
            return self._ask(order, arguments)
        return nothing_left

    def boot(self, image: ProcessorImage) -> None:
        """Start its process, once. Raises ConfigError when what it needs cannot be handed over."""
        if self._process is None:
            self._start(image)
            self._send_waiting()

    def _start(self, image: ProcessorImage) -> None:
        check_portable("robots", (image.environment,))
        context = multiprocessing.get_context("spawn")  # a fork would share locks, threads and sockets
        self._orders, theirs = context.Pipe()
        self._events, told = context.Pipe(duplex=False)
        process = context.Process(
            target=run_processor, args=(image, theirs, told), name=f"rci-{self.name}", daemon=True
        )
        process.start()
        self._process = process  # from now on it is looked after
        theirs.close()
        told.close()

    def _send_waiting(self) -> None:
        """Give the orders that have waited for the process: after Ctrl-C at its start, those that are left."""
        while self._waiting and not self._dead:
            self._ask(*self._waiting.pop(0))()

    def _ask(self, order: str, arguments: tuple[Any, ...]) -> Callable[[], object]:
        """Send an order; gives what waits for its answer, and raises that."""
        self._asked += 1
        try:
            self._orders.send((self._asked, order, arguments))
        except OSError:
            self._find_dead()
            return nothing_left
        return partial(self._take_answer, self._asked)

    def _take_answer(self, number: int) -> None:
        try:
            error = self._answer(number)
        except (EOFError, OSError):
            self._find_dead()
            return
        if error is not None:
            raise error

    def _find_dead(self) -> None:
        if not self._dead:
            self._bury(f"processor {self.name} has died: {self._end_of_process()}")

    def _answer(self, number: int) -> BaseException | None:
        """Answer to the order of that number; one that nobody waits for any more, after Ctrl-C, is left out.

        Raises EOFError, OSError: the process has died.
        """
        while True:
            while not self._orders.poll(_LOOK_S):
                if self._dead or not self._process.is_alive():
                    raise EOFError
            answered, error = self._orders.recv()
            if answered == number:
                return error  # type: ignore[no-any-return]

    # ---------------------------------------------------------------------------------------------------- looking after

    def end_rogues(self, now_ns: int) -> None:
        """Hear which tasks have ended; kill the process when a function neither ends nor lets itself be ended."""
        if self._process is None or self._dead:
            return
        self._hear()
        for td in list(self._tds.values()):
            if lateness(td, now_ns) > 2 * PATIENCE_S * NS_PER_S:
                self._process.kill()
                self._bury(f"task {td.name} does not return, and its processor with it", RogueTask)
                return
        if not self._process.is_alive():
            self._hear()
            self._bury(f"processor {self.name} has died: {self._end_of_process()}")

    def _hear(self) -> None:
        try:
            while self._events.poll():
                bit, starts, error = self._events.recv()
                if self._tds[bit].starts == starts:  # otherwise it was started again since
                    self._tds[bit].error = error
                self._happened()
        except (EOFError, OSError):
            return  # its end is noticed by itself

    def _end_of_process(self) -> str:
        self._process.join(END_S)
        return f"exit status {self._process.exitcode}; the bridges of its robots have stopped them"

    def _bury(self, why: str, kind: type[Exception] = LinkLost) -> None:
        """Tell of every task that ran there."""
        self._dead = why
        for td in self._tds.values():
            if td.state is not TaskState.RELEASED and td.error is None:
                td.error = kind(why)
                td.words[TaskWord.BEGAN_NS] = 0
                td.words[TaskWord.STATE] = TaskState.ENDED
        self._happened()

    def close(self) -> None:
        """End the process; kill it when it does not end."""
        if self._process is not None:
            if not self._dead:
                _tell_end(self._orders)
            self._process.join(END_S)
            if self._process.is_alive():
                self._process.kill()
                self._process.join()
            self._process.close()
            self._orders.close()
            self._events.close()
        if self._claim is not None:
            self._claim.close(unlink=True)


def _tell_end(orders: Connection) -> None:
    try:
        orders.send((0, "end", ()))
    except OSError:
        return  # it has ended


def check_portable(what: str, arguments: tuple[Any, ...]) -> None:
    """Raise ConfigError for functions that another process cannot find by their name."""
    try:
        pickle.dumps(arguments)
    except (pickle.PicklingError, AttributeError, TypeError) as error:
        raise ConfigError(
            f"{what}: a processor of its own finds functions by name: define them in a module, not in another "
            f"function, and reach robots by their bridges ({error})"
        ) from None
