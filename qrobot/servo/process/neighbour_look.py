"""The thread of a servo process that looks at other arms, through their servos' memories."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Final

from qrobot.arrays import Floats
from qrobot.errors import LinkError
from qrobot.servo.memory.mailbox import ServoMailbox
from qrobot.servo.memory.published_state import ServoSnapshot
from qrobot.servo.memory.servo_memory import ServoSegment, attach_servo_memory
from qrobot.servo.neighbour import LOOK_S, NOT_HEARD_OF, Neighbour, NeighbourLook

RETRY_S: Final = 0.2  # [A] between two attempts to find a servo that is not there


class OtherServo:
    """Newest state of the servo of another arm on this machine, whenever it comes and goes.

    A servo of another robot than the deployment file says is none: its places would be taken for those of that body.

    Args:
        arm: its name. robot, n: what it has to drive, and how many joints that has.
        clock: seconds.
    """

    def __init__(self, arm: str, robot: str, n: int, clock: Callable[[], float]) -> None:
        self._arm, self._drives, self._clock = arm, (robot, n), clock
        self._generation = 0
        self._segment: ServoSegment | None = None
        self._mailbox: ServoMailbox | None = None
        self._again_s = clock()

    def snapshot(self) -> ServoSnapshot | None:
        """The newest state, None while there is none."""
        try:
            self._find()
            return None if self._mailbox is None else self._mailbox.snapshot()
        except LinkError:
            self.close()
            return None

    def close(self) -> None:
        """Let the memory go."""
        if self._segment is not None:
            self._segment.close()
        self._segment = self._mailbox = None

    def _find(self) -> None:
        """Attach the memory where there is another one, or none yet."""
        if (now_s := self._clock()) < self._again_s:
            return
        self._again_s = now_s + RETRY_S
        if self._segment is None or not self._segment.is_current:
            self.close()
            self._segment = attach_servo_memory(self._arm)
        generation = int(self._segment.front.header.generation)
        if self._mailbox is None or generation != self._generation:
            self._mailbox, self._generation = ServoMailbox(self._segment.words), generation
            info = self._mailbox.info
            if (info.robot_name, info.n) != self._drives:
                self._mailbox = None


@contextmanager
def looking(
    neighbours: Sequence[Neighbour], mailbox: ServoMailbox, told: Floats, say: Callable[[str], None]
) -> Iterator[None]:
    """Look at other arms in a thread during this block. `told`: a row for each, shape (k, N_NEIGHBOUR)."""
    if not neighbours:
        yield
        return
    done = threading.Event()
    others = [OtherServo(each.name, each.robot, each.other_a_stop.size, time.monotonic) for each in neighbours]
    looks = [
        NeighbourLook(each, mailbox.snapshot, other.snapshot, words, time.monotonic)
        for each, other, words in zip(neighbours, others, told, strict=False)  # there may be more rows
    ]
    thread = threading.Thread(target=_look_on, args=(looks, done, say), name="servo-neighbours", daemon=True)
    thread.start()
    try:
        yield
    finally:
        done.set()
        thread.join()
        for other in others:
            other.close()


def _look_on(looks: Sequence[NeighbourLook], done: threading.Event, say: Callable[[str], None]) -> None:
    """Look until the end; whoever is lost or found again is told."""
    heard = [True for _ in looks]
    while not done.wait(LOOK_S):
        for k, each in enumerate(looks):
            now = each.look() != NOT_HEARD_OF
            if now != heard[k]:
                heard[k] = now
                say(f"{each.neighbour.name} is {'heard of again' if now else 'not heard of: this arm does not move'}")
