"""Execution traces: what became of each request of a program, and the setpoints that went out.

`use(factory, traces)` fills a list with one trace for each time the program takes control of an arm. A trace keeps the
newest of them, so that a program may run for weeks.
"""

from __future__ import annotations

import json
from collections import deque
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from typing import Any, Final

import numpy as np

from qrobot.arrays import Floats
from qrobot.config import Robot
from qrobot.motion import EventKind, MotionEvent, MoveRequest, Termination
from qrobot.rccl.setpoints import Setpoints

KEPT_SAMPLES: Final = 250_000  # [A] two hours at 28 ms, and 90 MB
KEPT_REQUESTS: Final = 10_000  # [A]
_STILL_TOLD: Final = 8  # [A] ended requests of which more may be told: that the arm has lost its goal
_HEADING: Final = f"{'':>4}  {'position':<16} {'mode':<10} {'asked':>9} {'begun':>9} {'ended':>9}  how it ended"


@dataclass
class TracedRequest:
    """The course of one request; times in seconds since the setpoints began, None for what has not happened.

    Attributes:
        number: from 1, in the order in which the program asked.
        name: of its position.
        mode: "joint" or "cartesian".
        pace: how long it was to take, as it was asked for.
        code: a `Termination`, or the program's own number; 0 as long as it is under way.
        lost: time at which the arm, having arrived, could not follow its goal any further, and why.
    """

    number: int
    name: str
    mode: str
    pace: str
    asked_s: float
    begun_s: float | None = None
    ended_s: float | None = None
    code: int = 0
    lost_s: float | None = None
    lost_code: int = 0

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        return {**asdict(self), "reason": reason_of(self.code)}

    def line(self) -> str:
        """One line for people."""
        times = " ".join("        -" if t is None else f"{t:9.3f}" for t in (self.asked_s, self.begun_s, self.ended_s))
        lost = "" if self.lost_s is None else f", lost its goal at {self.lost_s:.3f} s: {reason_of(self.lost_code)}"
        return f"{self.number:4d}  {self.name:<16} {self.mode:<10} {times}  {reason_of(self.code)}{lost}"


def reason_of(code: int) -> str:
    """A termination code in words."""
    if code > 0:
        return f"the program's code {code}"
    return "under way" if code == Termination.NONE else Termination(code).name.lower().replace("_", " ")


class Trace:
    """One hold of one arm, the newest KEPT_SAMPLES and KEPT_REQUESTS of it.

    Args:
        robot: the arm.
        period_s: sample period.
    """

    def __init__(self, robot: Robot, period_s: float) -> None:
        self.robot = robot
        self._requests: deque[TracedRequest] = deque(maxlen=KEPT_REQUESTS)
        self._period_s = period_s
        self._asked = self._samples = 0
        self._open: dict[MoveRequest, TracedRequest] = {}
        self._ended: deque[MoveRequest] = deque()
        self._q: deque[Floats] = deque(maxlen=KEPT_SAMPLES)
        self._measured: deque[Floats] = deque(maxlen=KEPT_SAMPLES)

    def asked(self, request: MoveRequest) -> None:
        """The program queued a motion."""
        mode = "joint" if isinstance(request.target, np.ndarray) else request.mode.value
        self._asked += 1
        traced = TracedRequest(self._asked, request.name, mode, str(request.speed), self._now_s)
        self._requests.append(traced)
        self._open[request] = traced

    def told(self, event: MotionEvent) -> None:
        """The generator told something."""
        traced = None if event.request is None else self._open.get(event.request)
        if event.request is None or traced is None:
            return
        if event.kind is EventKind.BEGUN:
            traced.begun_s = self._now_s
        elif event.kind is EventKind.ENDED:
            traced.ended_s, traced.code = self._now_s, event.code
            self._close(event.request)
        elif event.kind is EventKind.LOST:
            traced.lost_s, traced.lost_code = self._now_s, event.code

    def sampled(self, q: Floats, measured: Floats, events: Iterable[MotionEvent] = ()) -> None:
        """Setpoints `q` went out while the joints were at `measured`, rad or m, with `events`. Shapes (n,)."""
        for event in events:
            self.told(event)
        self._q.append(q.copy())
        self._measured.append(measured.copy())
        self._samples += 1

    @property
    def requests(self) -> list[TracedRequest]:
        """The newest requests, in the order in which the program asked."""
        return list(self._requests)

    @property
    def setpoints(self) -> Setpoints:
        """All that went out from `begin_s` on."""
        rows = np.array(self._q).reshape(-1, self.robot.n)
        return Setpoints(self.robot.name, round(self._period_s * 1e6), rows)

    @property
    def measured(self) -> Floats:
        """Positions of the joints at each of these samples, rad or m. Shape (samples, n)."""
        return np.array(self._measured).reshape(-1, self.robot.n)

    @property
    def begin_s(self) -> float:
        """Time of the first setpoint that is kept; seconds since they began."""
        return (self._samples - len(self._q)) * self._period_s

    @property
    def forgotten(self) -> int:
        """Number of requests, the first ones, that are not kept."""
        return self._asked - len(self._requests)

    def text(self) -> str:
        """The requests as a table; seconds."""
        left_out = [f"({self.forgotten} requests before these are not kept)"] if self.forgotten else []
        return "\n".join([_HEADING, *left_out, *(request.line() for request in self.requests)]) + "\n"

    def json_lines(self) -> str:
        """The requests, one JSON object in a line."""
        return "".join(json.dumps(request.to_dict()) + "\n" for request in self.requests)

    def _close(self, request: MoveRequest) -> None:
        """Note that a request has ended: once some others have too, nothing is told of it any more."""
        self._ended.append(request)
        if len(self._ended) > _STILL_TOLD:
            self._open.pop(self._ended.popleft(), None)

    @property
    def _now_s(self) -> float:
        """Time of the setpoint that goes out next."""
        return self._samples * self._period_s


def add_trace(traces: list[Trace] | None, robot: Robot, period_us: int) -> Trace | None:
    """Another trace among `traces`; none where no traces are wanted."""
    if traces is None:
        return None
    traces.append(Trace(robot, period_us * 1e-6))
    return traces[-1]
