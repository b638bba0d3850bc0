"""The time slot of a sample: what of a program takes longer (Hayward & Paul 1986, section 3.1)."""

from __future__ import annotations

from weakref import WeakKeyDictionary

from qrobot.motion import Equation
from qrobot.rccl.transforms import Transform
from qrobot.realtime.interpreter import InterpreterShare


class CallbackTiming:
    """Knows the functional transforms of the motions that were asked for.

    Args:
        period_ms: sample period.

    Attributes:
        share: of the interpreter with the thread that answers samples, None where they need no thread.
    """

    def __init__(self, period_ms: float) -> None:
        self.share: InterpreterShare | None = None
        self._period_ms = period_ms
        self._watched: WeakKeyDictionary[Transform, None] = WeakKeyDictionary()  # in the order of the motions

    def watch(self, equation: Equation | None) -> None:
        """Its transforms count from now on."""
        if equation is not None:
            self._watched.update({term: None for term in equation.terms if isinstance(term, Transform)})

    @property
    def overruns(self) -> dict[str, float]:
        """The longest time of each function that took longer than a sample, ms, by the name of its transform."""
        return {trsf.name: trsf.longest_ms for trsf in list(self._watched) if trsf.longest_ms > self._period_ms}

    def complaint(self) -> str:
        """Remark for a stop that the program itself may have caused; empty when nothing of it took too long."""
        garbage = "" if self.share is None else self.share.complaint(self._period_ms)
        slow = ", ".join(f"{name} took {ms:.0f} ms" for name, ms in self.overruns.items())
        return (f"; the sample period is {self._period_ms:g} ms, and the function of {slow}" if slow else "") + garbage
