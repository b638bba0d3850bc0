"""The samples of one robot on virtual time, which pass while the program waits."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from qrobot.errors import LinkLost, MotionError
from qrobot.rci.program_time import NO_WAIT, Rank, Turn, program_time
from qrobot.units import NS_PER_S

RELEASED: Final = "the arm was released: nothing can happen any more"


class RobotSamples:
    """Takes samples, one in each period from `begin` to `end` or to the first that fails.

    Args:
        sample: takes one.
        failed: told the error of one that failed, once.
        rank: their place in the order of an instant; by default behind all that is there.

    Attributes:
        error: what ended them before their time, None as long as all is well.
        count: of samples so far.
        next_ns: time of the next one, None before `begin` and after the end.
        rank: as given.
    """

    def __init__(
        self,
        sample: Callable[[], object],
        failed: Callable[[BaseException], object] = lambda _error: None,
        rank: Rank | None = None,
    ) -> None:
        self.error: BaseException | None = None
        self.count = 0
        self.next_ns: int | None = None
        self._sample, self._failed = sample, failed
        self._period_ns = 0
        self._due = False
        self._time = program_time()
        self.rank = rank or self._time.rank()
        self._turns = (Turn(self.rank, self),)

    def begin(self, period_s: float) -> None:
        """Let samples pass from now on, beside all else that the program does; the first is a period away."""
        self._period_ns = round(period_s * NS_PER_S)
        self.next_ns = self._time.now_ns + self._period_ns
        self._time.join(self)

    def end(self) -> None:
        """Let no more of them pass."""
        self.next_ns, self._due = None, False
        self._time.leave(self)

    def wait(self, predicate: Callable[[], object]) -> None:
        """Let time pass until `predicate`, which is called behind each sample, is true.

        Raises:
            BaseException: what ended the samples, or what `predicate` raises.
            MotionError: called by a function that is itself called as time passes.
            LinkLost: there are none any more.
        """
        if self._time.passing:
            raise MotionError(NO_WAIT)
        with self._time.waiting():
            while not predicate():
                self._await_sample()

    def _await_sample(self) -> None:
        if self.error is not None:
            raise self.error
        if self.next_ns is None:
            raise LinkLost(RELEASED)
        before = self.count
        while self.count == before and self.next_ns is not None:
            self._time.advance()

    # --------------------------------------------------------------------------------------------- as time passes

    def come_to(self, now_ns: int) -> None:
        """See `TimeMember.come_to`."""
        self._due = self._due or (self.next_ns is not None and self.next_ns <= now_ns)

    @property
    def turns(self) -> tuple[Turn, ...]:
        """See `TimeMember.turns`."""
        return self._turns

    @property
    def runnable(self) -> bool:
        """See `Runnable.runnable`."""
        return self._due

    def run(self) -> None:
        """Take a sample. What ends it is told where the program waits; what ends a program is raised at once."""
        self._due = False
        self.next_ns = None if self.next_ns is None else self.next_ns + self._period_ns
        self.count += 1
        try:
            self._sample()
        except BaseException as error:
            self.error = told_later(error)
            self.end()
            self._failed(self.error)
            if not isinstance(error, Exception):
                raise


def told_later(error: BaseException) -> BaseException:
    """Error of whoever asks again for what `error`, which was raised at once, has ended. An interrupt was heard then;
    nobody has hit it again, and a program that answers it by a stop would answer for ever."""
    if not isinstance(error, KeyboardInterrupt):
        return error
    lost = LinkLost("an interrupt in the midst of a sample has let go of the arm: nothing can happen any more")
    lost.__cause__ = error
    return lost
