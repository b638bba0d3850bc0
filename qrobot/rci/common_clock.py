"""The common clock of a program's tasks: ticks counted from one instant, from which every processor works out its own.

The papers' fallback is a clock of 100 Hz (section 5.3.3); a program may choose a faster one, whose ticks are counted
the same way.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from qrobot.errors import ConfigError
from qrobot.units import NS_PER_S

FALLBACK_HZ: Final = 100
FASTEST_HZ: Final = 1000


def checked_rate(rate_hz: int) -> int:
    """The rate of a clock. Raises ConfigError unless it is a whole number of ticks a second, 1 to 1000."""
    if not isinstance(rate_hz, int) or isinstance(rate_hz, bool) or not 1 <= rate_hz <= FASTEST_HZ:
        raise ConfigError(f"clock of {rate_hz!r} Hz: whole numbers from 1 to {FASTEST_HZ} are allowed")
    return rate_hz


def newest_tick(since_ns: int, rate_hz: int) -> int:
    """The newest tick of a clock that began `since_ns` ago; seconds by themselves, or 64 bits end after 106 days."""
    return since_ns // NS_PER_S * rate_hz + since_ns % NS_PER_S * rate_hz // NS_PER_S


def start_of_tick(tick: int, rate_hz: int) -> int:
    """First nanosecond of a tick, since the clock began."""
    return tick // rate_hz * NS_PER_S - (-(tick % rate_hz * NS_PER_S) // rate_hz)


@dataclass
class CommonClock:
    """Ticks since `epoch_ns` of a clock that `now_ns` reads, real or virtual."""

    now_ns: Callable[[], int]
    rate_hz: int = FALLBACK_HZ
    epoch_ns: int = 0

    @property
    def ticks(self) -> int:
        """Ticks so far; the first one is tick 0."""
        return self.tick_at(self.now_ns())

    def tick_at(self, now_ns: int) -> int:
        """The newest tick at an instant."""
        return newest_tick(now_ns - self.epoch_ns, self.rate_hz)

    def time_of(self, tick: int) -> int:
        """The instant of a tick, to the next whole nanosecond."""
        return self.epoch_ns + start_of_tick(tick, self.rate_hz)

    def whole_us(self, ticks: int) -> int:
        """The length of so many ticks, us. Raises ConfigError when it is no whole number of them."""
        us, rest = divmod(ticks * 1_000_000, self.rate_hz)
        if rest:
            raise ConfigError(f"{ticks} ticks of {self.rate_hz} Hz are no whole number of microseconds")
        return us
