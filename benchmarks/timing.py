"""How contenders are timed: interleaved in one run, so that a disturbance of the machine meets all of them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from time import perf_counter

Work = Callable[[], object]


@dataclass(frozen=True)
class Effort:
    """How much is measured.

    Attributes:
        rounds: times each contender has its turn.
        wake_up_s: length of one turn of a wake-up loop.
        rates_hz: of the wake-up loops.
        work: iterations of a compiled contender in one turn, as a share of a full run's.
        cold: start with an empty cache as well, which compiles for a minute.
    """

    rounds: int
    wake_up_s: float
    rates_hz: tuple[int, ...]
    work: float
    cold: bool

    def times(self, full: int) -> int:
        """So many iterations where a full run makes `full`."""
        return max(1, round(full * self.work))


FULL = Effort(rounds=5, wake_up_s=2.0, rates_hz=(1000, 2000, 4000, 8000, 10000), work=1.0, cold=True)
QUICK = Effort(rounds=2, wake_up_s=0.1, rates_hz=(1000, 4000), work=0.02, cold=False)


def seconds(work: Work) -> float:
    """How long `work` takes."""
    began = perf_counter()
    work()
    return perf_counter() - began


def interleaved(contenders: Mapping[str, Work], rounds: int) -> dict[str, float]:
    """Shortest duration of each contender, s: the one with least disturbance by others. The order rotates."""
    best = dict.fromkeys(contenders, float("inf"))
    names = list(contenders)
    for turn in range(rounds):
        for k in range(len(names)):
            name = names[(turn + k) % len(names)]
            best[name] = min(best[name], seconds(contenders[name]))
    return best
