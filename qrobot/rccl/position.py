"""The position descriptor of RCCL, for positions given by their joints."""

from __future__ import annotations

import numpy as np

from qrobot.motion import Termination
from qrobot.motion.limits import Floats
from qrobot.rccl.event import Event


class Position:
    """Somewhere to move to, and how the latest motion to it goes.

    Attributes:
        name: for traces and messages.
        q: joint positions, rad or m. Shape (n,), read-only.
        code: why the latest motion to it ended: a `Termination`, or the program's own number (`nextmove`); 0 before.
        scal: how much of the motion is done, 0 to 1.
    """

    def __init__(self, name: str, q: Floats) -> None:
        self.name = name
        self.q = np.array(q, dtype=np.float64)
        self.q.flags.writeable = False
        self.code: int = Termination.NONE
        self.scal = 0.0
        self._end = Event(f"{name}.end")

    @property
    def end(self) -> Event:
        """Signalled at the end of every motion to this position. Assigning a number sets its count."""
        return self._end

    @end.setter
    def end(self, count: int) -> None:
        self._end.count = count

    def __repr__(self) -> str:
        return f"Position({self.name!r}, q={np.round(self.q, 4).tolist()})"
