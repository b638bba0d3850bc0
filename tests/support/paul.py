"""Paul's path through via points, written down from the papers and from nothing of the engine.

Segment i goes from corner B[i-1] to B[i] in T[i] samples. Round each corner lasts a quartic, from Ta before to Ta after
the instant at which the corner would have been reached; Ta is that of the segment behind it, and of the last segment
where the arm comes to rest (Paul 1981; Hayward & Paul 1986, section 2.3).
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np


def samples_of(seconds: float, period_s: float) -> int:
    """The nearest whole number of samples, at least one."""
    return max(1, int(np.floor(seconds / period_s + 0.5)))


def stretched(lengths: Sequence[int], transitions: Sequence[int]) -> list[int]:
    """T >= 2 Ta, and T >= Ta + the next Ta."""
    behind = [*transitions[1:], 0]
    return [max(t, ta + max(ta, next_ta)) for t, ta, next_ta in zip(lengths, transitions, behind, strict=True)]


def paul_quartic(h: float, before: np.ndarray, behind: np.ndarray, share: float) -> np.ndarray:
    """Position relative to the corner: dB = A - B, dC = C - B, and Ta / T of the segment behind."""
    k = behind * share + before
    return (k * (2.0 - h) * h * h - 2.0 * before) * h + before


def paul_path(
    corners: Sequence[np.ndarray], lengths: Sequence[int], transitions: Sequence[int], samples: int
) -> np.ndarray:
    """Positions at samples 0, 1, ...; the first transition begins at sample 0. Shape (samples, m)."""
    ways = [(c - b) / t for (b, c), t in zip(pairwise(corners), lengths, strict=True)]
    still = np.zeros_like(corners[0])
    speeds = [still, *ways, still]
    halves = [*transitions, transitions[-1]]
    instants = transitions[0] + np.concatenate(([0], np.cumsum(lengths)))
    path = np.empty((samples, corners[0].size))
    for sample in range(samples):
        near = [i for i, (at, ta) in enumerate(zip(instants, halves, strict=True)) if abs(sample - at) <= ta]
        i = near[0] if near else int(np.searchsorted(instants, sample)) - 1
        t, ta = sample - instants[i], halves[i]
        if near:
            path[sample] = corners[i] + paul_quartic((t + ta) / (2 * ta), -speeds[i] * ta, speeds[i + 1], ta)
        else:
            path[sample] = corners[i] + speeds[i + 1] * t
    return path
