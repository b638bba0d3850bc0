"""The thread of a servo process that looks at other arms, through their servos' memories."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Final

from qrobot.arrays import Floats
from qrobot.errors import LinkError
from qrobot.servo.memory.followed_servo import FollowedServo
from qrobot.servo.memory.mailbox import ServoMailbox
from qrobot.servo.memory.published_state import ServoSnapshot
from qrobot.servo.neighbour import LOOK_S, NOT_HEARD_OF, Neighbour, NeighbourLook
from qrobot.units import NS_PER_S

RETRY_S: Final = 0.2  # [A] between two attempts to find a servo that is not there


class OtherServo:
    """Newest state of the servo of another arm on this machine, whenever it comes and goes.

    A servo of another robot than the deployment file says is none: its places would be taken for those of that body.

    Args:
        arm: its name. robot, n: what it has to drive, and how many joints that has.
        clock: seconds.
    """

    def __init__(self, arm: str, robot: str, n: int, clock: Callable[[], float]) -> None:
        self._servo, self._clock = FollowedServo(arm, robot, n), clock
        self._mailbox: ServoMailbox | None = None
        self._again_s = clock()

    @property
    def mismatch(self) -> str:
        """Reason for which a servo that runs is not believed, "" for none."""
        return self._servo.mismatch

    def snapshot(self) -> ServoSnapshot | None:
        """The newest state, None while there is none."""
        try:
            self._look_again()
            return None if self._mailbox is None else self._mailbox.snapshot()
        except LinkError:
            self.close()
            return None

    def close(self) -> None:
        """Let the memory go."""
        self._servo.close()
        self._mailbox = None

    def _look_again(self) -> None:
        """Look which servo runs, now and then."""
        if (now_s := self._clock()) < self._again_s:
            return
        self._again_s = now_s + RETRY_S
        self._mailbox = self._servo.mailbox()


@contextmanager
def looking(
    neighbours: Sequence[Neighbour], mailbox: ServoMailbox, told: Floats, say: Callable[[str], None]
) -> Iterator[None]:
    """Look at other arms in a thread during this block. `told`: a row for each, shape (k, N_NEIGHBOUR)."""
    if not neighbours:
        yield
        return
    done = threading.Event()
    period_s = int(mailbox.info.period_ns) / NS_PER_S
    others = [OtherServo(each.name, each.robot, each.other_a_stop.size, time.monotonic) for each in neighbours]
    looks = [
        NeighbourLook(each, mailbox.snapshot, other.snapshot, words, time.monotonic, period_s)
        for each, other, words in zip(neighbours, others, told, strict=False)  # there may be more rows
    ]
    thread = threading.Thread(target=_look_on, args=(looks, others, done, say), name="servo-neighbours", daemon=True)
    thread.start()
    try:
        yield
    finally:
        done.set()
        thread.join()
        for other in others:
            other.close()


def _look_on(
    looks: Sequence[NeighbourLook], others: Sequence[OtherServo], done: threading.Event, say: Callable[[str], None]
) -> None:
    """Look until the end; whoever is lost or found again is told."""
    heard = [True for _ in looks]
    while not done.wait(LOOK_S):
        for k, each in enumerate(looks):
            try:
                now = each.look() != NOT_HEARD_OF
            except LinkError:  # our own loop was interrupted while it wrote: the next look will do
                continue
            if now != heard[k]:
                heard[k] = now
                why = f" ({others[k].mismatch})" if others[k].mismatch else ""
                told = "heard of again" if now else f"not heard of{why}: this arm does not move"
                say(f"{each.neighbour.name} is {told}")
