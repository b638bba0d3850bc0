"""A gamepad or a SpaceMouse that moves an arm: a button as dead man's switch, sticks for where to and how fast.

    idle --the button, all sticks at rest--> ready --a stick--> moving --it goes back--> ready
    ready, moving --the button is let go of, nothing is heard for a while, the device is lost--> idle

The stick that is drawn most moves the arm along, or about, its axis; the others count once it is at rest again. It
knows no device: events are those of Linux input, a kind, a code and a value.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Final, NamedTuple

from qrobot.errors import LinkError, QRobotError, ServoFault
from qrobot.rccl.channel import Channel
from qrobot.rccl.held_motion import HeldMotion
from qrobot.rccl.jog import measure, place

SYN, KEY, REL = 0, 1, 2  # kinds of an event: of the stream itself, a button, a relative axis. Others are sticks
DROPPED: Final = 3  # code of SYN: events were lost
BEGINS: Final = 0.25  # [A] of the full stroke: less is rest
ENDS: Final = 0.15  # [A] below which a stick that moves the arm has gone back
REST_MS: Final = 100.0  # [A] of a relative axis, until it is at rest: Linux passes no 0 of it on
SILENCE_MS: Final = 2000.0  # [A] of a device that is held, until it counts as lost: a hand is never quite still
STEP: Final = 0.05  # of the speed: changes below are none

StickCode = tuple[int, int]  # kind and code of an event


class StickEvent(NamedTuple):
    """One event of a device."""

    kind: int
    code: int
    value: int


class StickAxis(NamedTuple):
    """One direction of a stick.

    Attributes:
        name: dx dy dz rx ry rz.
        low, high: its values at both ends.
        sign: 1 or -1, of the arm's motion for values that grow.
        value: before the first event; None at rest.
    """

    name: str
    low: int
    high: int
    sign: float
    value: int | None = None


@dataclass(frozen=True)
class StickLayout:
    """Purposes of the parts of a device.

    Attributes:
        name: of the device, for people.
        axes: by their events.
        button: code of the dead man's switch.
        turn: code of the button that changes between the axes of the base and of the last link; None for none.
    """

    name: str
    axes: Mapping[StickCode, StickAxis]
    button: int
    turn: int | None = None


class HeldStick:
    """Follows what is done to a device.

    Args:
        layout: of the device.

    Attributes:
        turned: how often the button that changes axes was pressed.
        speed: share of the greatest speed that is asked for, 0 to 1.
    """

    def __init__(self, layout: StickLayout) -> None:
        self.turned, self.speed = 0, 0.0
        self._layout = layout
        self._drawn = dict.fromkeys(layout.axes, 0.0)  # -1 to 1, with the sign of the arm's motion
        self._told_ms = dict.fromkeys((code for code in layout.axes if code[0] == REL), 0.0)
        self._pressed = self._ready = False
        self._moving: StickCode | None = None
        self._heard_ms = 0.0
        for (kind, code), axis in layout.axes.items():
            if axis.value is not None:
                self._take(StickEvent(kind, code, axis.value), 0.0)

    def hear(self, events: Iterable[StickEvent], now_ms: float) -> tuple[str, float] | None:
        """Take what has happened since the last call: the axis and the way, 1 or -1, that is held; None for none."""
        for event in events:
            self._heard_ms = now_ms
            self._take(event, now_ms)
        for code, told_ms in self._told_ms.items():
            if not now_ms - told_ms <= REST_MS:
                self._drawn[code] = 0.0
        if not now_ms - self._heard_ms <= SILENCE_MS:
            self._ready = self._ready and self._moving is None  # a button alone may be held in silence
        return self._held()

    def lose(self) -> None:
        """The device is gone, or events of it are: nothing is held any more."""
        self._pressed = self._ready = False

    def _take(self, event: StickEvent, now_ms: float) -> None:
        if (event.kind, event.code) == (SYN, DROPPED):
            self.lose()  # the button may have been let go of
        elif event.kind == KEY and event.code == self._layout.button:
            self._pressed = event.value != 0
            self._ready = self._pressed and max(map(abs, self._drawn.values())) < BEGINS
        elif event.kind == KEY and event.code == self._layout.turn:
            self.turned += event.value == 1
        elif (axis := self._layout.axes.get((event.kind, event.code))) is not None:
            stroke = 2.0 * (event.value - axis.low) / (axis.high - axis.low) - 1.0
            self._drawn[event.kind, event.code] = axis.sign * min(max(stroke, -1.0), 1.0)
            if event.kind == REL:
                self._told_ms[event.kind, event.code] = now_ms

    def _held(self) -> tuple[str, float] | None:
        if not self._ready:
            self._moving = None
            return None
        if self._moving is None or abs(self._drawn[self._moving]) < ENDS:
            most = max(self._drawn, key=lambda code: abs(self._drawn[code]))
            self._moving = most if abs(self._drawn[most]) >= BEGINS else None
        if self._moving is None:
            return None
        drawn = self._drawn[self._moving]
        self.speed = max(STEP, round((abs(drawn) - ENDS) / (1.0 - ENDS) / STEP) * STEP)
        return self._layout.axes[self._moving].name, 1.0 if drawn > 0.0 else -1.0


class StickJog:
    """Moves an arm by a device, until it is lost or `over` is true.

    Args:
        arm: under control, at rest, with a sample period of 60 ms at most. Its stream moves by a key from now on.
        layout: of the device.
        read: events since it was called last; called at each sample, it must not wait. Raises LinkError: it is gone.
        tell: takes a line for people.
        share: of the jog speeds at a full stroke.
        over: asked at each sample.
    """

    def __init__(
        self,
        arm: Channel,
        layout: StickLayout,
        read: Callable[[], Iterable[StickEvent]],
        tell: Callable[[str], None],
        share: float = 1.0,
        over: Callable[[], bool] = lambda: False,
    ) -> None:
        self._arm, self._layout, self._read, self._tell, self._share, self._over = arm, layout, read, tell, share, over
        self._stick, self._lost, self._turned = HeldStick(layout), "", 0
        self._motion = HeldMotion(arm, self._held)

    def run(self) -> None:
        """Obey. Raises LinkError: the arm or the device is lost; ServoFault: the arm."""
        self._tell(f"{self._layout.name}: hold the button, then draw a stick; {self._axes()}")
        with self._motion.watched():
            while not self._ended():
                self._arm.waitas(lambda: self._ended() or self._motion.held or self._turned != self._stick.turned)
                if self._turned != self._stick.turned:
                    self._turned = self._stick.turned
                    self._tell(self._axes())
                elif (held := self._motion.held) is not None and not self._ended():
                    self._move(*held)
        if self._lost:
            raise LinkError(self._lost)

    def _ended(self) -> bool:
        return bool(self._lost) or self._over()

    @property
    def _in_base(self) -> bool:
        return self._stick.turned % 2 == 0

    def _axes(self) -> str:
        return f"axes of the {'base' if self._in_base else 'last link'}"

    def _held(self) -> tuple[str, float] | None:
        """Look at the device; how far a stick is drawn is the override of the motion."""
        try:
            held = self._stick.hear(self._read(), self._arm.time)
        except LinkError as gone:
            self._lost = str(gone)
            self._stick.lose()
            return None
        if held is not None:
            self._arm.override(100.0 * self._stick.speed)
        return held

    def _move(self, axis: str, way: float) -> None:
        try:
            self._motion.go_along(axis, way, self._share, self._in_base)
        except (LinkError, ServoFault):
            raise
        except QRobotError as error:
            self._tell(f"error: {error}")
        self._tell(place(measure(self._arm, "HERE").value))
