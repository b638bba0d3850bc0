"""Reports of a generator's process: the newest sample, what happened to motions since, answers, the end.

The program may be kept from reading, which must not stop the generator: what it has not read is kept as one report, of
which the newest state counts and all events.
"""

from __future__ import annotations

import threading
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import NamedTuple

from qrobot.arrays import Floats
from qrobot.motion import EventKind, Exerted
from qrobot.rci.client import Beside
from qrobot.wire import RobotState


@dataclass(frozen=True)
class Seen:
    """The task as it is at one instant; attributes mean what they mean in `TrajectoryTask`, and those of its generator.

    Attributes:
        kept: the reason in words, empty for none.
        refusals: as of the link, by kind.
        words: the first ones of its descriptor.
    """

    tick: int
    how: RobotState | None
    words: tuple[int, ...]
    follows_setpoints: bool
    left: bool
    eventful: bool
    completed: int
    kept: str
    off_path: bool
    exerted: Exerted | None
    refusals: dict[type[Beside], str]
    hand: int
    outputs: int
    waiting: int = 0
    serving: bool = False
    stopping: bool = False
    rate: float = 1.0


class Happened(NamedTuple):
    """An event of a motion: of the request of that number, 0 for none; the arm was measured at `q` (n,)."""

    kind: EventKind
    request: int
    code: int
    q: Floats
    tick: int
    why: str


class MotionProgress(NamedTuple):
    """Share of the request of that number that is done, 0 to 1."""

    request: int
    scal: float


class OrderAnswer(NamedTuple):
    """Outcome of the order of that number: its value, or what it raised."""

    order: int
    value: object = None
    error: BaseException | None = None


@dataclass
class GeneratorReport:
    """Everything that the program has not been told yet.

    Attributes:
        seen: the newest state.
        happened: events, in their order.
        progress: of the motions under way.
        answers: of orders.
        error: what has ended the task before its time.
    """

    seen: Seen | None = None
    happened: list[Happened] = field(default_factory=list)
    progress: tuple[MotionProgress, ...] = ()
    answers: list[OrderAnswer] = field(default_factory=list)
    error: BaseException | None = None


class Outbox:
    """Box in which threads leave what is to be told; none of them waits for the program."""

    def __init__(self) -> None:
        self._filled = threading.Condition()
        self._report: GeneratorReport | None = None
        self._over = False

    def sample(self, seen: Seen, happened: Iterable[Happened], progress: tuple[MotionProgress, ...]) -> None:
        """A sample has passed."""
        with self._filled:
            report = self._open()
            report.seen, report.progress = seen, progress
            report.happened.extend(happened)
            self._filled.notify()

    def answer(self, answer: OrderAnswer, seen: Seen | None) -> None:
        """An order was carried out; this is how things are now."""
        with self._filled:
            report = self._open()
            report.seen = seen or report.seen
            report.answers.append(answer)
            self._filled.notify()

    def fail(self, error: BaseException) -> None:
        """The task has ended before its time."""
        with self._filled:
            self._open().error = error
            self._filled.notify()

    def close(self) -> None:
        """End the stream of reports: `take` returns None once it is empty."""
        with self._filled:
            self._over = True
            self._filled.notify()

    def take(self) -> GeneratorReport | None:
        """Wait for something to tell; None when there will be nothing more."""
        with self._filled:
            self._filled.wait_for(lambda: self._report is not None or self._over)
            report, self._report = self._report, None
            return report

    def _open(self) -> GeneratorReport:
        if self._report is None:
            self._report = GeneratorReport()
        return self._report
