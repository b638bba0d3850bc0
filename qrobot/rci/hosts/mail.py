"""Messages between tasks of two hosts: taken out of the lanes of one end, put into those of the other."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping

from qrobot.errors import RemoteProtocolError
from qrobot.rci.descriptor import TaskDescriptor
from qrobot.rci.hosts.packets import MOST_MAIL, Mail
from qrobot.rci.mail_lane import put_message, words_of
from qrobot.rci.task_table import ALL, TaskTable


def collected(table: TaskTable, receivers: Iterable[TaskDescriptor]) -> list[Mail]:
    """Take messages for tasks of the other end out of their lanes, as many as one packet takes."""
    found: list[Mail] = []
    for td in receivers:
        while len(found) < MOST_MAIL:
            data, sender = table.receive(td, ALL)
            if sender is None:
                break
            found.append(Mail(to=td.bit, sender=sender.bit, data=data))
    return found


class Letterbox:
    """Puts messages from the other end into the lanes of tasks here; what finds no room waits, in its order.

    Args:
        receivers: tasks of this end, by their bits.
        senders: bits of those of the other end, whose lanes nobody here writes.
        stamp: numbers that never fall, as those of the table here.
    """

    def __init__(self, receivers: Mapping[int, TaskDescriptor], senders: set[int], stamp: Callable[[], int]) -> None:
        self._receivers, self._senders, self._stamp = receivers, senders, stamp
        self._waiting: list[Mail] = []

    @property
    def room(self) -> bool:
        """True when no message waits."""
        return not self._waiting

    def take(self, mail: list[Mail]) -> None:
        """Deliver what fits. Raises RemoteProtocolError for a message between tasks that are not there."""
        for each in mail:
            if each.to not in self._receivers or each.sender not in self._senders:
                raise RemoteProtocolError(f"a message from {each.sender:#x} to {each.to:#x}, which are no such tasks")
        full: set[tuple[int, int]] = set()
        left: list[Mail] = []
        for each in (*self._waiting, *mail):
            lane = (each.to, each.sender)
            if lane in full or not self._put(each):
                full.add(lane)
                left.append(each)
        self._waiting = left

    def _put(self, mail: Mail) -> bool:
        lane = self._receivers[mail.to].lane_from(mail.sender)
        return put_message(lane, self._stamp(), len(mail.data), words_of(mail.data)) > 0
