"""Summary of a gain study: every pair of gains over all arms, and the pair that serves the worst of them best."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from qrobot.arrays import Floats
from qrobot.errors import ConfigError
from qrobot.study.results import Results
from qrobot.study.study import ArmResult

QUIET: Final = 2.0  # times the least chatter of all pairs: a louder one heats motors and wears gears
MEASURES: Final = ("rms", "largest", "chatter")


@dataclass(frozen=True, eq=False)
class PairSummary:
    """A pair of gains over a arms; arms that the servo stopped have NaN.

    Attributes:
        bandwidth, damping: factors on the robot file's.
        rms, largest: errors of the worst joint, as shares of what the guard allows. Shapes (a,).
        chatter: of the worst joint, as a share of the torque limit. Shape (a,).
        faults: how many arms each fault stopped.
    """

    bandwidth: float
    damping: float
    rms: Floats
    largest: Floats
    chatter: Floats
    faults: dict[str, int]

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON: median and worst over the arms that were not stopped."""
        numbers = {}
        for name in MEASURES:
            values = getattr(self, name)
            ran = values[~np.isnan(values)]
            numbers[name] = {"median": float(np.median(ran)), "worst": float(ran.max())} if ran.size else None
        return {"bandwidth": self.bandwidth, "damping": self.damping, **numbers, "faults": self.faults}


@dataclass(frozen=True, eq=False)
class GainSummary:
    """All pairs, in the order in which they were tried, and the arms that could not try any."""

    arms: int
    failed: dict[int, str]
    pairs: tuple[PairSummary, ...]

    @property
    def best(self) -> PairSummary | None:
        """The pair whose worst arm errs least, of those that stop no arm and chatter at most `QUIET` times the
        least."""
        safe = [pair for pair in self.pairs if not pair.faults]
        if not safe:
            return None
        loudest = QUIET * min(float(np.median(pair.chatter)) for pair in safe)
        quiet = [pair for pair in safe if float(np.median(pair.chatter)) <= loudest]
        return min(quiet, key=lambda pair: float(pair.rms.max()))

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        best = self.best
        return {
            "arms": self.arms,
            "failed": {str(seed): reason for seed, reason in self.failed.items()},
            "pairs": [pair.to_dict() for pair in self.pairs],
            "best": None if best is None else {"bandwidth": best.bandwidth, "damping": best.damping},
        }


def summarise_gains(results: Results) -> GainSummary:
    """The summary of a results file. Raises ConfigError when no arm in it tried any gains."""
    good, failed = results.good, {outcome["seed"]: outcome["failed"] for outcome in results.failed}
    if not good:
        why = next(iter(failed.values()), "there is none yet")
        raise ConfigError(f"no arm of this study tried any gains: {why}")
    by_pair = zip(*(outcome["tried"] for outcome in good), strict=True)
    return GainSummary(len(good), failed, tuple(_pair(tries) for tries in by_pair))


def _pair(tries: Sequence[ArmResult]) -> PairSummary:
    rms, largest, chatter = (np.array([tried.get(name, np.nan) for tried in tries]) for name in MEASURES)
    faults = Counter(tried["fault"] for tried in tries if "fault" in tried)
    return PairSummary(tries[0]["bandwidth"], tries[0]["damping"], rms, largest, chatter, dict(faults))
