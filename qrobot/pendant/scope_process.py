"""Every cycle of the servos for the scope of pages, in a process of low priority; see `answering`.

It reads telemetry rings, and only when it is asked: between questions, and while no page looks, it does nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Final

import numpy as np

from qrobot.errors import LogError, QRobotError
from qrobot.log.events import row_events
from qrobot.log.ring_history import Cycles, CycleTrigger, RingHistory, curves_of
from qrobot.log.servo_ring import ServoRing
from qrobot.log.windows import QUANTITIES
from qrobot.pendant.answering import ProcessAnswer, serve_answers
from qrobot.pendant.curve_bytes import curve_bytes, cycles_csv
from qrobot.units import NS_PER_S

LONGEST_S: Final = 60.0
MOST_KEPT: Final = 4  # pictures that pages have frozen, 34 MB each at most
MOST_EVENTS: Final = 50  # of a picture
_CSV_ORDER: Final = tuple(QUANTITIES.index(name) for name in ("setpoint", "position", "velocity", "torque"))


class ScopeRings:
    """Rings that are read, and pictures that are kept."""

    def __init__(self) -> None:
        self._rings: dict[str, ServoRing] = {}
        self._kept: dict[int, Cycles] = {}
        self._last = 0

    def answer(self, request: dict[str, Any]) -> ProcessAnswer:
        """Answer to a request, or why there is none."""
        asks: dict[str, Callable[..., ProcessAnswer]] = {
            "look": self._look, "keep": self._keep, "kept": self._show, "csv": self._csv
        }  # fmt: skip
        try:
            return asks[request.pop("do")](**request)
        except QRobotError as error:
            return {"error": str(error)}, b""

    def read_on(self) -> bool:
        """See `Answerer`."""
        return False

    def _look(
        self, arm: str, seconds: float, points: int, trigger: dict[str, Any] | None, after: int, before: float
    ) -> ProcessAnswer:
        """The newest cycles; with a trigger those around the first one from number `after` on that meets it.

        `before`: share of the picture that comes before that one.
        """
        ring = self._rings.setdefault(arm, ServoRing(arm))
        history = ring.history()
        seconds, end_s = min(max(seconds, 0.0), LONGEST_S), history.newest_s
        told: dict[str, Any] = {"newest": history.newest_tick, "triggered": None, "whole": True}
        told["rate_hz"] = ring.info.rate_hz if ring.info else 0.0
        if trigger is not None and (at_s := _found(history, CycleTrigger(**trigger), after)) is not None:
            end_s = at_s + (1.0 - before) * seconds
            told |= {"triggered": at_s, "whole": end_s <= history.newest_s}
        return _picture(history.cycles(end_s - seconds, end_s), points, told)

    def _keep(self, arm: str, begin: float, end: float) -> ProcessAnswer:
        """Keep the cycles of a picture; the oldest of `MOST_KEPT` is forgotten."""
        ring = self._rings.setdefault(arm, ServoRing(arm))
        self._last += 1
        self._kept[self._last] = ring.history().cycles(begin, end)
        for number in sorted(self._kept)[:-MOST_KEPT]:
            del self._kept[number]
        return {"number": self._last}, b""

    def _show(self, number: int, begin: float, end: float, points: int) -> ProcessAnswer:
        return _picture(_part(self._of(number), begin, end), points, {})

    def _csv(self, number: int, begin: float, end: float, joints: Sequence[str]) -> ProcessAnswer:
        cycles = _part(self._of(number), begin, end)
        n = len(joints)
        values = np.concatenate([cycles["values"][:, k * n : (k + 1) * n] for k in _CSV_ORDER], axis=1)
        return {}, cycles_csv(joints, cycles["t_ns"] / NS_PER_S, values, cycles["mode"], cycles["fault"])

    def _of(self, number: int) -> Cycles:
        if number not in self._kept:
            raise LogError(f"this picture is kept no longer, only the newest {MOST_KEPT} are: go on, and freeze again")
        return self._kept[number]


def _found(history: RingHistory, trigger: CycleTrigger, after: int) -> float | None:
    """Time of the first cycle that meets a trigger, s on the servo's clock."""
    cycles = history.since(after)
    place = trigger.first_in(cycles)
    return None if place is None else int(cycles["t_ns"][place]) / NS_PER_S


def _part(cycles: Cycles, begin_s: float, end_s: float) -> Cycles:
    t_s = cycles["t_ns"] / NS_PER_S
    return np.asarray(cycles[(t_s >= begin_s) & (t_s <= end_s)])


def _picture(cycles: Cycles, points: int, told: dict[str, Any]) -> ProcessAnswer:
    if not cycles.size:
        raise LogError("there is no cycle of the servo in this picture")
    t_s = cycles["t_ns"] / NS_PER_S
    events = [event for event in row_events(cycles, t_s) if event.tick > int(cycles["tick"][0])][-MOST_EVENTS:]
    told |= {"begin": t_s[0], "end": t_s[-1], "cycles": int(cycles.size), "last": int(cycles["tick"][-1])}
    told["events"] = [{"t": e.t_s, "kind": e.kind, "short": e.short, "text": e.text} for e in events]
    return told, curve_bytes(curves_of(cycles, points))


if __name__ == "__main__":
    serve_answers(ScopeRings())
