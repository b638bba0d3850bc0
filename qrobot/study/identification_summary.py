"""Summary of an identification study over all its arms."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from qrobot.arrays import Floats
from qrobot.errors import ConfigError
from qrobot.ident.fit import NORMAL_95
from qrobot.ident.friction import FRICTION_NAMES
from qrobot.study.results import Results

QUANTILES: Final = {"median": 0.5, "p95": 0.95, "worst": 1.0}
FRICTION_GOAL: Final = 0.1  # share of the truth


@dataclass(frozen=True, eq=False)
class IdentificationSummary:
    """Numbers of a arms with n joints, whose models have p values.

    Attributes:
        joints: names.
        values: names of what was identified.
        failed: seeds and reasons of arms that were not.
        seeds, payload_kg: of the arms. Shapes (a,).
        gravity_before, gravity: rms errors of the robot file's and the model's, N m (N). Shapes (a, n).
        friction_error: as a share of the truth. Shape (a, n, 3).
        deviations: errors in the fit's own standard deviations, NaN for values that an arm's model has not: the terms
            of friction that arms need differ. Shape (a, p).
        inertia: errors of the torque predicted for fast runs before and after, N m (N), shapes (a, n), and `deviations`
            (a, q) of inertial parameters; empty when not tried.
        tracking: rms errors before, after and with the exact model, rad (m), shapes (a, n); empty when not tried.
    """

    joints: tuple[str, ...]
    values: tuple[str, ...]
    failed: dict[int, str]
    seeds: NDArray[np.int64]
    payload_kg: Floats
    gravity_before: Floats
    gravity: Floats
    friction_error: Floats
    deviations: Floats
    inertia: dict[str, Floats]
    tracking: dict[str, Floats]

    @property
    def inside(self) -> NDArray[np.bool_]:
        """Whether the 95 % interval of each value holds the truth; False of one that is not known. Shape (a, p)."""
        return np.abs(self.deviations) <= NORMAL_95

    @property
    def known(self) -> NDArray[np.bool_]:
        """Whether the model of an arm has a value at all. Shape (a, p)."""
        return ~np.isnan(self.deviations)

    @property
    def gain(self) -> Floats:
        """Tracking error without the model divided by that with it, of each arm that tried both. Shape (a,)."""
        return self._ratio("before", "after")

    @property
    def over_exact(self) -> Floats:
        """Tracking error with its model over that with the exact one, when that was tried. Shape (a,)."""
        return self._ratio("after", "exact")

    def _ratio(self, above: str, below: str) -> Floats:
        first, second = (np.linalg.norm(self.tracking[name], axis=1) for name in (above, below))
        return np.asarray(first / second)

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        friction = np.abs(self.friction_error).reshape(-1, len(FRICTION_NAMES))
        return {
            "arms": len(self.seeds),
            "failed": {str(seed): reason for seed, reason in self.failed.items()},
            "gravity_before": quantiles(self.gravity_before),
            "gravity_rms": quantiles(self.gravity),
            "friction_error": dict(zip(FRICTION_NAMES, map(quantiles, friction.T), strict=True)),
            "friction_within_a_tenth": float((friction <= FRICTION_GOAL).mean()),
            "inside_95": float(self.inside.sum() / self.known.sum()),
            "inside_95_by_value": dict(
                zip(self.values, (self.inside.sum(axis=0) / self.known.sum(axis=0)).tolist(), strict=True)
            ),
            "inertia": self._inertia_quantiles() if self.inertia else None,
            "tracking": self._tracking_quantiles() if self.tracking else None,
        }

    def _inertia_quantiles(self) -> dict[str, Any]:
        """Quantiles of inertia; where torque was not known there are no deviations."""
        off = np.abs(self.inertia["deviations"])
        errors = {name: quantiles(self.inertia[name]) for name in ("before", "after")}
        return errors | {"inside_95": float((off <= NORMAL_95).mean()) if off.size else None}

    def _tracking_quantiles(self) -> dict[str, Any]:
        """Quantiles of the tracking gain, whose worst is the least."""
        lost = quantiles(-self.gain)
        return {"gain": {name: -value for name, value in lost.items()}, "over_exact": quantiles(self.over_exact)}


def summarise_identification(results: Results) -> IdentificationSummary:
    """The summary of a results file. Raises ConfigError when no arm in it was identified."""
    good, failed = results.good, {outcome["seed"]: outcome["failed"] for outcome in results.failed}
    if not good:
        why = next(iter(failed.values()), "there is none yet")
        raise ConfigError(f"no arm of this study was identified: {why}")

    def column(name: str) -> NDArray[Any]:
        return np.array([outcome[name] for outcome in good])

    values = tuple(dict.fromkeys(name for outcome in good for name in outcome["deviations"]))
    moved = [
        arm | {"deviations": list(arm["deviations"].values())}
        for arm in (outcome["inertia"] for outcome in good if "inertia" in outcome)
    ]
    tracked = [outcome["tracking"] for outcome in good if "tracking" in outcome]
    return IdentificationSummary(
        tuple(results.terms["joints"]),
        values,
        failed,
        column("seed"),
        column("payload_kg"),
        column("gravity_before"),
        column("gravity_rms"),
        column("friction_error"),
        np.array([[outcome["deviations"].get(name, np.nan) for name in values] for outcome in good]),
        {name: np.array([arm[name] for arm in moved]) for name in moved[0]} if moved else {},
        {name: np.array([arm[name] for arm in tracked]) for name in tracked[0]} if tracked else {},
    )


def quantiles(values: Floats) -> dict[str, Any]:
    """Median, 95 % quantile and largest over the first axis."""
    return {name: np.quantile(values, share, axis=0).tolist() for name, share in QUANTILES.items()}
