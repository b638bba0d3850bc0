"""Reads logs for pages, in a process of low priority: what is heavy must not keep the pendant from a stop.

Between requests it reads on in the logs that are open. A file that is cut off while it is mapped kills a process
(SIGBUS): this one, and the pendant begins another.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import numpy as np
from mcap.exceptions import McapError
from mcap.reader import make_reader

from qrobot.errors import LogError, QRobotError
from qrobot.log.animation import robot_of_log
from qrobot.log.fences_of_log import fences_of_log
from qrobot.log.flight import incidents_of
from qrobot.log.windows import QUANTITIES, LogWindows
from qrobot.model.arm_shape import NO_TOOL
from qrobot.pendant.answering import ProcessAnswer, serve_answers
from qrobot.pendant.curve_bytes import CSV_NAMES, curve_bytes, cycles_csv
from qrobot.pendant.fence_facts import fence_facts
from qrobot.pendant.frames import arm_facts
from qrobot.units import NS_PER_S

MOST_OPEN: Final = 4
MOST_EVENTS: Final = 1000  # that a page lists


class OpenLogs:
    """Logs that are open, by their path."""

    def __init__(self) -> None:
        self._open: dict[Path, LogWindows] = {}
        self._broken: dict[Path, str] = {}  # why one is not read on

    def answer(self, request: dict[str, Any]) -> ProcessAnswer:
        """Answer to a request, or why there is none."""
        asks: dict[str, Callable[..., ProcessAnswer]] = {
            "glance": self._glance, "open": self._begin, "facts": self._facts, "curves": self._curves, "csv": self._csv
        }  # fmt: skip
        try:
            return asks[request.pop("do")](**request)
        except QRobotError as error:
            return {"error": str(error)}, b""

    def read_on(self) -> bool:
        """Read a piece of a log that is not read to its end; False when there is none."""
        for path, log in list(self._open.items()):
            try:
                if log.read_on():
                    return True
            except QRobotError as error:
                self._broken[path] = str(error)
                del self._open[path]
        return False

    def _glance(self, paths: list[str]) -> ProcessAnswer:
        return {"seconds": [_seconds_of(Path(path)) for path in paths]}, b""

    def _begin(self, path: str) -> ProcessAnswer:
        """Open it anew: it may have grown."""
        for known in (self._open, self._broken):
            known.pop(Path(path), None)
        while len(self._open) >= MOST_OPEN:
            self._open.pop(next(iter(self._open)))
        log = self._open[Path(path)] = LogWindows(Path(path))
        header = log.header
        told = ("robot", "joint_names", "rate_hz", "law", "clock", "plant")
        facts: dict[str, Any] = {name: getattr(header, name) for name in told}
        facts |= {"prismatic": header.prismatic or (False,) * header.n, "quantities": QUANTITIES}
        facts |= {"arm": None, "why": "", "incidents": []}
        try:
            robot = robot_of_log(log.log)
            facts["arm"] = arm_facts(header.robot, robot, NO_TOOL) | fence_facts(fences_of_log(log.log), robot)
            facts["incidents"] = [incident.line(header.prismatic) for incident in incidents_of(log.log)]
        except QRobotError as error:
            facts["why"] = str(error)
        return facts, b""

    def _facts(self, path: str) -> ProcessAnswer:
        log = self._of(path)
        events = log.events
        told = [{"t": e.t_s, "kind": e.kind, "short": e.short, "text": e.text} for e in events[:MOST_EVENTS]]
        return {"share": log.share, "end": log.end_s, "damaged": log.damaged, "whole": log.whole,
                "events": told, "more": len(events) - len(told)}, b""  # fmt: skip

    def _curves(self, path: str, begin: float, end: float, points: int) -> ProcessAnswer:
        curves = self._of(path).curves(begin, end, points)
        return {"instants": curves.t_s.size}, curve_bytes(curves)

    def _csv(self, path: str, begin: float, end: float) -> ProcessAnswer:
        log = self._of(path)
        rows, joints = log.rows(begin, end), log.header.joint_names
        first_ns = int(log.log.rows["t_ns"][0]) if rows.size else 0
        values = np.concatenate([rows[name] for name in CSV_NAMES], axis=1)
        t_s = (rows["t_ns"] - first_ns) / NS_PER_S
        return {}, cycles_csv(joints, t_s, values, rows["mode"], rows["fault"])

    def _of(self, path: str) -> LogWindows:
        log = self._open.get(Path(path))
        if log is None:
            raise LogError(self._broken.get(Path(path), f"{path} is not open any more: open it again"))
        if not Path(path).exists():
            raise LogError(f"{path} has vanished: it was moved or removed")
        return log


def _seconds_of(path: Path) -> float | None:
    """Length of one file, by its summary; None when it has none, or cannot be read."""
    try:
        with path.open("rb") as file:
            summary = make_reader(file).get_summary()
    except (OSError, McapError, ValueError, struct.error, EOFError):
        return None
    if summary is None or summary.statistics is None:
        return None
    begin_ns, end_ns = int(summary.statistics.message_start_time), int(summary.statistics.message_end_time)
    return (end_ns - begin_ns) / NS_PER_S


if __name__ == "__main__":
    serve_answers(OpenLogs())
