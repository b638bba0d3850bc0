"""Criteria of the experiment in lock-step, run by run and between runs.

The numbers are ours, from simulation of the paper's test with these gains (wn = 30 rad/s on joints 1-3, 50 on the
wrist); the paper's own figure is an image without numbers.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from qrobot.rig.experiment import Result

ARM_JOINTS: Final = 3
LARGEST_ERROR_RAD: Final = {"nominal": (0.005, 0.002), "mismatched": (0.010, 0.004)}  # joints 1-3, joints 4-6
PD_FACTOR: Final = 2.0
RATE_SPREAD: Final = 0.10


@dataclass(frozen=True)
class Verdict:
    """One bound and whether it held."""

    what: str
    holds: bool

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        return {"what": self.what, "holds": self.holds}


def judge(results: Sequence[Result]) -> list[Verdict]:
    """All bounds that these results can be held to."""
    return [*_faults(results), *_errors(results), *_pd_is_worse(results), *_rates_agree(results), *_repeats(results)]


def _lockstep(results: Sequence[Result], law: str, plant: str | None = None) -> list[Result]:
    return [r for r in results if r.run.clock == "lockstep" and r.run.law == law and plant in (None, r.run.plant)]


def _largest(result: Result) -> np.ndarray[Any, np.dtype[np.float64]]:
    return np.asarray(result.summary.max_abs_error)


def _faults(results: Sequence[Result]) -> list[Verdict]:
    faulted = [Verdict(f"{r.run.name}: no fault, but {r.fault}", False) for r in results if r.fault]
    if faulted or not results:
        return faulted
    return [Verdict(f"no fault in {len(results)} {'run' if len(results) == 1 else 'runs'}", True)]


def _errors(results: Sequence[Result]) -> list[Verdict]:
    verdicts = []
    for plant, bounds in LARGEST_ERROR_RAD.items():
        errors = [_largest(r) for r in _lockstep(results, "qrobot", plant)]
        if errors:
            worst = np.max(errors, axis=0)
            found = worst[:ARM_JOINTS].max(), worst[ARM_JOINTS:].max()
            parts = [
                f"{joints} within {bound * 1e3:g} mrad ({most * 1e3:.2f})"
                for joints, bound, most in zip(("joints 1-3", "the others"), bounds, found, strict=True)
            ]
            holds = all(most <= bound for bound, most in zip(bounds, found, strict=True))
            verdicts.append(Verdict(f"{plant} plant in lock-step: {', '.join(parts)}", holds))
    return verdicts


def _pd_is_worse(results: Sequence[Result]) -> list[Verdict]:
    verdicts = []
    for pd in _lockstep(results, "pd", "nominal"):
        for full in _lockstep(results, "qrobot", "nominal"):
            if full.run.rate_hz == pd.run.rate_hz:
                times = float(np.min(_largest(pd)[:ARM_JOINTS] / _largest(full)[:ARM_JOINTS]))
                what = (
                    f"law pd in lock-step: joints 1-3 at least {PD_FACTOR:g} times as bad as law qrobot ({times:.1f})"
                )
                verdicts.append(Verdict(what, times >= PD_FACTOR))
    return verdicts


def _rates_agree(results: Sequence[Result]) -> list[Verdict]:
    verdicts = []
    for plant in LARGEST_ERROR_RAD:
        errors = np.array([_largest(r) for r in _lockstep(results, "qrobot", plant)])
        if len(errors) > 1:
            spread = float(np.max(errors.max(axis=0) / errors.min(axis=0) - 1.0))
            what = f"{plant} plant in lock-step: all rates within {RATE_SPREAD:.0%} of each other ({spread:.1%})"
            verdicts.append(Verdict(what, spread <= RATE_SPREAD))
    return verdicts


def _repeats(results: Sequence[Result]) -> list[Verdict]:
    digests: dict[str, set[str]] = {}
    runs = [r for r in results if r.digest]
    for result in runs:
        digests.setdefault(result.run.name, set()).add(result.digest)
    repeated = {r.run.name for r in runs if sum(s.run == r.run for s in runs) > 1}
    return [Verdict(f"{name}: bit-identical when repeated", len(digests[name]) == 1) for name in sorted(repeated)]
