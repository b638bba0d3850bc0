"""The motions a program has asked for and that have not ended, and what their positions tell of them.

    code   0 from `move` on, why it ended from then on
    scal   0 from `move` on, grows to 1 during the motion, and stays where it was at its end
    end    signalled at its end

A motion ends where its via point is passed, in the middle of the transition, or where the arm comes to rest. Of several
motions to one position the oldest that has not ended counts.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Final, Protocol

from qrobot.arrays import Floats
from qrobot.motion import Equation, EventKind, MotionEvent, MoveRequest, Output, Termination, TransformKind, Trsf
from qrobot.rccl.parameters import MoveOrder
from qrobot.rccl.position import Position
from qrobot.rccl.trace import reason_of

_FAILURES: Final = {
    Termination.JOINT_LIMIT,
    Termination.UNREACHABLE,
    Termination.SINGULAR,
    Termination.TOO_FAST,
    Termination.FENCE,
}


class Placed(Protocol):
    """Kinematics from coordinates to a pose."""

    def forward(self, q: Floats) -> Floats:
        """The pose at `q` (n,). Shape (4, 4)."""


class OpenMotions:
    """The motions of one arm that have not ended.

    Args:
        arm: whose measured T6 `update` takes.

    Attributes:
        arm: as given.
        failures: motions that turned out to be impossible, in words.
    """

    def __init__(self, arm: Placed) -> None:
        self.failures: list[str] = []
        self.arm = arm
        self._open: dict[MoveRequest, MoveOrder] = {}
        self._begun: set[MoveRequest] = set()
        self._arrived: Position | None = None

    def add(self, order: MoveOrder) -> None:
        """A motion was asked for."""
        if self._oldest(order.position) is None and not self._looked_at(order.position):
            order.position.code, order.position.scal, order.position.why = Termination.NONE, 0.0, ""
        self._open[order.request] = order

    def notify(self, events: Iterable[MotionEvent], q: Floats, tick: int) -> None:
        """Pass events of one sample on to the positions they concern; the arm was measured at `q` (n,)."""
        for event in events:
            if event.kind is EventKind.LOST and self._arrived is not None:
                self._arrived.code, self._arrived.why = event.code, event.why
            elif event.request is None:
                continue
            elif event.kind is EventKind.BEGUN:
                self._begin(event.request)
            elif event.kind is EventKind.INTERRUPTED:
                self._measure(event.request, q, tick)
            elif event.kind is EventKind.ENDED:
                self._measure(event.request, q, tick)
                self._end(event.request, event.code, event.why)

    def update_progress(self, output: Output) -> None:
        """Tell positions how much of their motions is done: two of them in the first half of a transition."""
        if output.request is not None:
            self.show_progress(output.request, output.scal)
        if output.passing is not None:  # the older one; it counts when both go to one position
            self.show_progress(output.passing, output.passing_scal)

    def show_progress(self, request: MoveRequest, scal: float) -> None:
        """Tell the position of a motion that `scal` of it is done, 0 to 1."""
        self._open[request].position.scal = scal

    def _begin(self, request: MoveRequest) -> None:
        self._begun.add(request)
        position = self._open[request].position
        if self._oldest(position) is request:
            position.code, position.scal, position.why = Termination.NONE, 0.0, ""

    def _measure(self, request: MoveRequest, q: Floats, tick: int) -> None:
        """Do what `update` has asked for, once; a motion that never began has been nowhere."""
        order = self._open[request]
        if order.updates and request in self._begun:
            t6 = self.arm.forward(q)
            for update in order.updates:
                update.trsf.set(update.equation.solve(update.trsf, t6, tick))
        self._open[request] = replace(order, updates=())

    def _end(self, request: MoveRequest, code: int, why: str) -> None:
        position = self._open.pop(request).position
        if request in self._begun:  # else it has led the arm nowhere
            self._arrived = position
        self._begun.discard(request)
        if code in _FAILURES:
            self.failures.append(f"{position.name}: {reason_of(code)}{f' ({why})' if why else ''}")
        if (following := self._oldest(position)) is None or following not in self._begun:
            position.code, position.why = code, why
            position.scal = 1.0 if code == Termination.COMPLETED else position.scal
        if following is not None and not self._looked_at(position):
            position.scal = 0.0
        position.end.signal()

    def _oldest(self, position: Position) -> MoveRequest | None:
        """The oldest open motion to `position`."""
        return next((request for request, order in self._open.items() if order.position is position), None)

    def _looked_at(self, position: Position) -> bool:
        """The `scal` of `position` may turn a frame that the arm goes by before it: then it must not jump now.

        As far as can be known: a motion before it, or the position that the arm is leaving, has a function in its
        equation which that of `position` has too.
        """
        functions = _functions(position)
        others = [order.position for order in self._open.values() if order.position is not position]
        if self._open and self._arrived is not None:
            others.append(self._arrived)
        return any(functions & _functions(other) for other in others)


def _functions(position: Position) -> set[Trsf]:
    """The functional transforms in its equation."""
    if not isinstance(position.target, Equation):
        return set()
    return {term for term in position.target.terms if term.kind is TransformKind.FUNCTION}
