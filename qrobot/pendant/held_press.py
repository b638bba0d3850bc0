"""A button of a page as a dead man's switch: numbered presses, heard of again and again while they last.

    free --press k--> held --beat k within PATIENCE_S--> held --release k, silence or another press--> dead

A press that fell silent is dead for good: a page that had stalled, slept or lost its network, and comes back with the
button still down, moves nothing until it is let go and pressed anew under a higher number.
"""

from __future__ import annotations

import threading
from dataclasses import dataclass
from typing import Final, Literal

BEAT_S: Final = 0.05  # the page says so often that a button is held
PATIENCE_S: Final = 0.25  # 0.15 s stopped for nothing on a loaded machine, measured; a page's worst gap was 0.245 s

PressTarget = Literal["joint", "axis", "place", "guide"]


@dataclass(frozen=True)
class Press:
    """One press.

    Attributes:
        number: higher than that of any press before.
        target: a joint turns, the tool goes along or about an axis, the arm goes to a place, or is led by hand.
        name: the joint's number from 1; the axis (dx dy dz rx ry rz); the name of a place; of no meaning for a hand.
        way: 1.0 or -1.0.
        in_base: the axis is one of the base, else of the last link.
        frame: name of a taught place whose axes are meant, "" for none.
        share: of the speeds at which jogging begins.
        step: rad or m for a joint; mm or degrees along or about an axis; 0 moves for as long as it is held.
    """

    number: int
    target: PressTarget
    name: str
    way: float = 1.0
    in_base: bool = True
    share: float = 1.0
    step: float = 0.0
    frame: str = ""


class HeldPress:
    """Press that is held now. Instants are seconds of one clock; may be used by several threads."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._press: Press | None = None
        self._heard_s = 0.0
        self._highest = 0
        self._silence_s = 0.0

    def begin(self, press: Press, now_s: float) -> bool:
        """A button was pressed; False for a number that is not new. Any other press ends."""
        with self._lock:
            self._press = None
            if press.number <= self._highest:
                return False
            self._highest, self._press, self._heard_s = press.number, press, now_s
            return True

    def beat(self, number: int, now_s: float) -> None:
        """The press of this number lasts. One that is dead stays so."""
        with self._lock:
            if self._living(now_s) is not None and self._press is not None and self._press.number == number:
                self._heard_s = now_s

    def end(self) -> None:
        """Let go of whatever is held."""
        with self._lock:
            self._press = None

    def end_of(self, press: Press) -> None:
        """End `press`, which is done or cannot be: it moves nothing any more, also while its button is down."""
        with self._lock:
            if self._press is press:
                self._press = None

    def held(self, now_s: float) -> Press | None:
        """The press that lasts, None for none."""
        with self._lock:
            return self._living(now_s)

    def take_silence(self) -> float:
        """Time from the last word of a press to when it was found dead of silence, s; told once, 0 for none."""
        with self._lock:
            silence_s, self._silence_s = self._silence_s, 0.0
            return silence_s

    def _living(self, now_s: float) -> Press | None:
        if self._press is not None and not 0.0 <= now_s - self._heard_s <= PATIENCE_S:
            self._press, self._silence_s = None, now_s - self._heard_s
        return self._press
