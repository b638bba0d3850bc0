"""Virtual time of a program: one for all that runs in its thread, whoever it is that the program waits for.

Arms of RCCL, machines of ARCL and tasks of RCI are members. Time stands still until the program waits. It then goes
from one event to the next: a sample of a robot, or a tick of the common clock of RCI. At one instant the members are
first told that it has come; what is due then runs in the order of processors, of which "host" is the first, priorities
and creation, each once a round until nothing is left. So a program of any mixture is the same in every run.
"""

from __future__ import annotations

import threading
from collections.abc import Iterable, Sequence
from contextlib import AbstractContextManager
from itertools import count, groupby
from typing import Final, NamedTuple, Protocol

from qrobot.errors import MotionError
from qrobot.rci.interruption import WholeSamples

NO_WAIT: Final = (
    "a function that is called at each sample must not wait: let it signal an event, or give a semaphore, "
    "for which the program waits"
)


class Rank(NamedTuple):
    """Place of something in the order of one instant; what is smaller runs first."""

    processor: int
    unimportance: int
    number: int


class Runnable(Protocol):
    """Something that runs at instants: a task of RCI, or the samples of a robot."""

    @property
    def runnable(self) -> bool:
        """True when it is due."""

    def run(self) -> None:
        """Run once."""


class Turn(NamedTuple):
    """Something that runs, and when at an instant."""

    rank: Rank
    runner: Runnable


class TimeMember(Protocol):
    """A part of the program for which time passes."""

    @property
    def next_ns(self) -> int | None:
        """Time of its next event, None when it has none to come."""

    def come_to(self, now_ns: int) -> None:
        """Time has come to `now_ns`: note what is due."""

    @property
    def turns(self) -> Iterable[Turn]:
        """Turns that may come at an instant."""


class ProgramTime:
    """The virtual time of one thread's program.

    Attributes:
        now_ns: how far it has come.
        passing: it passes now; whoever is called then must not wait.
    """

    def __init__(self) -> None:
        self.now_ns = 0
        self.passing = False
        self._whole_samples = WholeSamples()
        self._members: tuple[TimeMember, ...] = ()
        self._rounds: list[list[Runnable]] | None = None  # of each processor, in their order
        self._numbers = count()

    def rank(self, processor: int = 0, priority: int = 0) -> Rank:
        """The place of something new: behind all that was there before with that priority on that processor."""
        return Rank(processor, -priority, next(self._numbers))

    def join(self, member: TimeMember) -> None:
        """Let time pass for a member from now on; does nothing a second time."""
        if member not in self._members:
            self._members = (*self._members, member)
            self.reorder()

    def leave(self, member: TimeMember) -> None:
        """Let no more time pass for a member."""
        self._members = tuple(other for other in self._members if other is not member)
        self.reorder()

    def reorder(self) -> None:
        """Turns of a member have changed: work out the order anew."""
        self._rounds = None

    def waiting(self) -> AbstractContextManager[None]:
        """Block in which a program waits: Ctrl-C leaves whole what passes in it."""
        return self._whole_samples.waiting()

    def advance(self) -> None:
        """Go to the next event, and run what is due then; does nothing when there is none.

        Raises:
            MotionError: called while time passes already.
            KeyboardInterrupt: Ctrl-C was hit meanwhile; what was due has run, unless it was hit twice.
        """
        if self.passing:
            raise MotionError(NO_WAIT)
        members = self._members
        coming = [at for member in members if (at := member.next_ns) is not None]
        if not coming:
            return
        with self._whole_samples.one():
            self._pass_to(min(coming), members)

    def _pass_to(self, event_ns: int, members: Iterable[TimeMember]) -> None:
        self.passing = True
        try:
            self.now_ns = max(self.now_ns, event_ns)
            for member in members:
                member.come_to(self.now_ns)
            for runners in self._in_order():
                run_rounds(runners)
        finally:
            self.passing = False

    def _in_order(self) -> list[list[Runnable]]:
        """Everything that may run, of one processor after the other."""
        if self._rounds is None:
            turns = sorted(turn for member in self._members for turn in member.turns)
            groups = groupby(turns, key=lambda turn: turn.rank.processor)
            self._rounds = [[turn.runner for turn in group] for _, group in groups]
        return self._rounds


def run_rounds(runners: Sequence[Runnable]) -> None:
    """Give each its runs, one a round, until none is runnable."""
    ready = True
    while ready:
        ready = False
        for runner in runners:
            if runner.runnable:
                runner.run()
                ready = True


_times = threading.local()


def program_time() -> ProgramTime:
    """The virtual time of the thread that calls."""
    if not hasattr(_times, "own"):
        _times.own = ProgramTime()
    own: ProgramTime = _times.own
    return own
