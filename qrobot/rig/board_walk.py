"""One walk over a bus: registers and time as its steps need them.

Time is the board's own, as its images tell it: a walk runs as well on virtual time. Nothing rests on that alone: no
wait is much longer by our clock, and a board is refused whose clock goes faster or slower than ours.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Final

import numpy as np

from qrobot.config import Robot
from qrobot.config.drives import DriveMode
from qrobot.errors import LinkTimeout, QRobotError
from qrobot.hwif.bus import NO_OPERATIONS, BoardFacts, Bus, Operations, safe_operations
from qrobot.hwif.image import IMAGE_COUNT, IMAGE_T_NS, input_at, make_image
from qrobot.hwif.operations import OP_FIELDS, OP_READ, OP_WRITE
from qrobot.hwif.registers import (
    ADC_F_CHANNEL_SHIFT,
    ADC_F_COMMAND,
    ADC_MUX,
    ADC_START,
    DISCRETE,
    DISCRETE_ADC,
    DISCRETE_CALIBRATED,
    DISCRETE_HAND_RELAXED,
    ENC_COUNT,
    SCRATCH_BITS,
    STATUS,
)
from qrobot.model.transmission import signed_word
from qrobot.report import Report

PATIENCE: Final = 5.0  # [A] times what a wait should take, and a little: an emulated arm's time stands still at times
PATIENCE_S: Final = 0.25
PACES: Final = 0.7, 1.4  # [A] of a board's clock beside ours: an image is a few hundredths of the time looked on
PACE_S: Final = 0.2
PACE_LOOKS: Final = 5  # one of which is right also where the machine, or an emulated board, stands still at times

Confirm = Callable[[str], bool]
RegisterAccess = tuple[int, int, int]


class StepError(QRobotError):
    """A step found something wrong.

    Attributes:
        remedy: what to do about it.
    """

    def __init__(self, detail: str, remedy: str) -> None:
        super().__init__(detail)
        self.remedy = remedy


class LeftOutError(QRobotError):
    """A step has nothing to look at; the text says why."""


class Walk:
    """A connection to a board, its newest image, and an operator.

    Args:
        bus: to the board; nobody else may drive it meanwhile.
        robot: what is expected behind it.
        ask: puts a question to the operator; False leaves something out.
        drives: mode of the separate drives that stand in for the board, if they do.
        tell: takes a line for the operator, who is to do something at once.
        now_ns: our clock.

    Attributes:
        ways_seen: joints that somebody has seen to count the way they go.
    """

    def __init__(
        self,
        bus: Bus,
        robot: Robot,
        ask: Confirm,
        drives: DriveMode | None = None,
        tell: Report = lambda _line: None,
        now_ns: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self.bus, self.robot, self.ask, self.drives, self.tell = bus, robot, ask, drives, tell
        self._now_ns = now_ns
        self.facts = BoardFacts("F", robot.n)
        self.ways_seen: set[int] = set()
        self._image = make_image()
        self._found: int | None = None

    def begin(self) -> None:
        """Find the board. Raises LinkError."""
        self.ways_seen.clear()
        self.facts = self.bus.connect()

    def look(self) -> None:
        """The newest image."""
        self._exchange(NO_OPERATIONS)

    def write(self, *pairs: tuple[int, int]) -> None:
        """Write (offset, value) pairs in order; the image shows what they did."""
        self.do(*((OP_WRITE, offset, value) for offset, value in pairs))

    def do(self, *accesses: RegisterAccess) -> None:
        """Apply operations (kind, offset, value) as `write` does, with reads for their side effect among them."""
        self._exchange(np.array(accesses, np.int64).reshape(-1, OP_FIELDS))

    def make_safe(self) -> None:
        """Torque and power off, also where images have stopped coming; the scratch bits become those of the first one.

        A board that the newest image shows uncalibrated stays so.
        """
        found = self.status if self._found is None else self._found
        self._exchange(safe_operations(found & (self.status | ~DISCRETE_CALIBRATED)))

    def _exchange(self, operations: Operations) -> None:
        self.bus.exchange(operations, self._image)
        if self._found is None:
            self._found = self.status

    def word(self, offset: int) -> int:
        """An input word of the newest image."""
        return int(self._image[input_at(offset)])

    @property
    def seen(self) -> bool:
        """Whether there has been an image."""
        return bool(self._image.any())

    @property
    def status(self) -> int:
        """STATUS of the newest image."""
        return self.word(STATUS)

    @property
    def kept(self) -> int:
        """DISCRETE word that leaves the scratch bits as they are, with the hand relaxed."""
        return self.status & SCRATCH_BITS | DISCRETE_HAND_RELAXED

    @property
    def count(self) -> int:
        """Number of the newest image."""
        return int(self._image[IMAGE_COUNT])

    @property
    def t_s(self) -> float:
        """Time of the newest image."""
        return int(self._image[IMAGE_T_NS]) * 1e-9

    def counts(self) -> list[int]:
        """Encoder words of the robot's joints."""
        return [self.word(ENC_COUNT + 2 * joint) for joint in range(self.robot.n)]

    def moved(self, before: list[int]) -> list[int]:
        """Counts since, as the words wrap."""
        return [signed_word(now - was & 0xFFFF) for was, now in zip(before, self.counts(), strict=True)]

    def wait(self, seconds: float, until: Callable[[], bool] = lambda: False) -> bool:
        """Look on for so long; True as soon as `until` holds. Raises LinkTimeout when the board's clock hardly goes."""
        begin_s, ours = self.t_s, self._stopwatch()
        while True:
            self.look()
            if until():
                return True
            if (went := self.t_s - begin_s) >= seconds:
                return False
            if ours() > PATIENCE * seconds + PATIENCE_S:
                raise LinkTimeout(f"the board's clock has gone {went:.3g} s in {ours():.3g} s; its stamps are to be ns")

    def keeps_time(self) -> bool:
        """Whether the board's clock goes as fast as ours, by the best of some looks. Raises LinkTimeout as `wait`."""
        for _ in range(PACE_LOOKS):
            self.look()
            begin_s, ours = self.t_s, self._stopwatch()
            self.wait(PACE_S)
            if PACES[0] * ours() <= self.t_s - begin_s <= PACES[1] * ours():
                return True
        return False

    def _stopwatch(self) -> Callable[[], float]:
        """Seconds of our clock since now."""
        begin_ns = self._now_ns()
        return lambda: 1e-9 * (self._now_ns() - begin_ns)

    def start_conversion(self, channel: int, discrete: int) -> None:
        """The vendor's sequence for the revision (TRC004 vendor driver v4.3); `discrete` without the ADC bit."""
        armed = (OP_WRITE, DISCRETE, discrete | DISCRETE_ADC)
        if self.facts.revision == "F":
            self.do(armed, (OP_WRITE, ADC_MUX, channel << ADC_F_CHANNEL_SHIFT | ADC_F_COMMAND))
        else:
            self.do((OP_WRITE, ADC_MUX, channel), (OP_READ, ADC_START, 0), armed)


def joints_named(numbers: list[int]) -> str:
    """`joint 2` or `joints 2, 3`."""
    return ("joint " if len(numbers) == 1 else "joints ") + ", ".join(map(str, numbers))


def reversed_counts(walk: Walk) -> str:
    """Remedy for an encoder that counts against its joint."""
    if walk.drives is not None:
        torque = " and torque_permille" if walk.drives == "torque" else ""
        return f"change the sign of its increments_per_count{torque}"
    key = "vendor_rad_per_count" if walk.robot.transmission.scales == "vendor" else "count_sign"
    return f"swap A and B of its encoder, or change its sign in {key} of the robot file"
