"""The scheduler: at which ticks of the common clock which task is woken (Lloyd et al. 1987, section 5.3.2).

A task with an interval and an offset is woken at every tick for which

    (ticks - offset) % interval == 0

The scheduler keeps a private list of the next tick of each active task and reads no clock: whoever owns one says how
far it has come. When it comes late, every tick that has passed counts, so that a task's run count tells what it missed.
"""

from __future__ import annotations

from dataclasses import dataclass

from qrobot.errors import ConfigError


def check_interval(what: str, interval: int, offset: int) -> None:
    """Raise ConfigError unless these are a number of ticks from 1 on and any number of ticks."""
    for name, value, least in (("interval", interval, 1), ("offset", offset, None)):
        if not isinstance(value, int) or isinstance(value, bool) or (least is not None and value < least):
            allowed = "a whole number of clock ticks" + (f", {least} or more" if least is not None else "")
            raise ConfigError(f"{what}: {name} {value!r}; {allowed} is needed")


@dataclass
class ClockEntry:
    """Entry that is due every `interval` ticks; `next_tick` is None while it is not active."""

    interval: int
    offset: int
    next_tick: int | None = None

    def first_after(self, tick: int) -> int:
        """The first tick behind `tick` at which it is due."""
        return tick + 1 + (self.offset - tick - 1) % self.interval

    def take(self, tick: int) -> int:
        """Number of times it was due since it was looked at last, `tick` included."""
        if self.next_tick is None or self.next_tick > tick:
            return 0
        times = (tick - self.next_tick) // self.interval + 1
        self.next_tick += times * self.interval
        return times


class TaskScheduler:
    """Clock entries by key, which the caller chooses; keys are told in the order in which they were set.

    Attributes:
        served: the newest tick that was served, -1 before the first.
    """

    def __init__(self) -> None:
        self.served = -1
        self._entries: dict[int, ClockEntry] = {}

    def set(self, key: int, interval: int, offset: int) -> None:
        """Give `key` an interval and an offset in ticks; an active one goes on with them from the next tick on."""
        before = self._entries.get(key)
        entry = self._entries[key] = ClockEntry(interval, offset)
        if before is not None and before.next_tick is not None:
            entry.next_tick = entry.first_after(self.served)

    def remove(self, key: int) -> None:
        """Wake `key` no more."""
        self._entries.pop(key, None)

    def activate(self, key: int, after: int | None = None) -> None:
        """Wake `key` at its ticks behind `after`, by default behind the newest one served; without entry, never."""
        if (entry := self._entries.get(key)) is not None:
            entry.next_tick = entry.first_after(self.served if after is None else max(after, self.served))

    def deactivate(self, key: int) -> None:
        """Wake `key` no more until it is activated again."""
        if (entry := self._entries.get(key)) is not None:
            entry.next_tick = None

    @property
    def next_tick(self) -> int | None:
        """The next tick at which anything is due, None when nothing is."""
        return min((e.next_tick for e in self._entries.values() if e.next_tick is not None), default=None)

    def due(self, tick: int) -> list[tuple[int, int]]:
        """Serve all ticks up to `tick`: the keys that are due and how often each was, in the order they were set."""
        self.served = max(self.served, tick)
        return [(key, times) for key, entry in self._entries.items() if (times := entry.take(tick))]
