"""Calls of a program about what its arm does beside its motions: hand, outputs, numbers for the log, payload."""

from __future__ import annotations

from collections.abc import Sequence
from math import isnan

from qrobot.errors import MotionError
from qrobot.rccl.arguments import numbers
from qrobot.rccl.arm_session import ArmSession
from qrobot.rccl.task import TrajectoryTask
from qrobot.units import M_PER_MM
from qrobot.wire import Payload
from qrobot.wire.vocabulary import Hand


class HandAndOutputs:
    """The calls about hand, outputs, log and payload; `Channel` inherits them."""

    _task: TrajectoryTask
    _session: ArmSession

    def OPEN(self) -> None:  # noqa: N802 (RCCL's name)
        """Open the hand, now."""
        self._set_hand(Hand.OPEN)

    def CLOSE(self) -> None:  # noqa: N802 (RCCL's name)
        """Close the hand, now."""
        self._set_hand(Hand.CLOSED)

    def signal(self, *lines: int) -> None:
        """Switch binary outputs, now: `signal(3, -4)` switches output 3 on and output 4 off. Named after VAL's.

        Raises:
            MotionError: there is no such output; none is switched.
        """
        with self._session.task():
            self._task.chg.signal(*lines)

    def log_signal(self, name: str, value: float) -> None:
        """Tell a number of this program's own, which goes into the arm's log in each cycle from the next sample on.

        Up to eight names, of letters, digits and underscores. NaN stands for none.

        Raises:
            MotionError: no such name can be, or it would be the ninth; or the value is no number.
        """
        (number,) = (value,) if isinstance(value, float) and isnan(value) else numbers("log_signal", value)
        self._session.log_signal(name, number)

    def setload(
        self, kg: float, centre: Sequence[float] = (0.0, 0.0, 0.0), inertia: Sequence[float] = (0.0,) * 6
    ) -> None:
        """Tell the servo what the hand holds: mass, and centre of mass in the frame of the flange, mm.

        Waits half a second, until the servo reckons with it; the arm may be moving meanwhile. A load stays when the
        program ends: `setload(0)` takes it away.

        Args:
            kg: mass. centre: mm. Shape (3,).
            inertia: about the centre along the axes of the flange, kg m^2: xx yy zz xy xz yz. Shape (6,).

        Raises:
            MotionError: the arm cannot carry it, or that is no load; nothing has changed then.
        """
        mass, *at = numbers("setload", kg, *centre)
        moments = numbers("setload", *inertia)
        if len(at) != 3 or len(moments) != 6:
            raise MotionError("setload: a centre has 3 numbers, mm, and an inertia 6, kg m^2: xx yy zz xy xz yz")
        self._session.set_payload(Payload(mass, tuple(M_PER_MM * x for x in at), tuple(moments)))

    def _set_hand(self, hand: Hand) -> None:
        with self._session.task():
            self._task.chg.hand = hand
