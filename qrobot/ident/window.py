"""Means over a window that obey the equations of motion exactly, without differentiating measured positions.

An equation is multiplied by a smooth window and integrated; integration by parts moves the derivatives from the
positions to the window (modulating functions, Shinbrot 1954). So torque, velocity and acceleration are means of the
same kind over the same time: what the window takes away from one it takes away from all, and what still decays from a
motion before takes nothing from any.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from qrobot.arrays import Floats, Ints


class Weights(NamedTuple):
    """Weights of the samples of a window, for means of value, slope and curvature. Each of shape (samples,)."""

    value: Floats
    slope: Floats
    curvature: Floats


class Subsample(NamedTuple):
    """Some samples of a window, and the share in which each counts in a mean. Both of shape (count,)."""

    at: Ints
    share: Floats


def window_weights(samples: int, period_s: float) -> Weights:
    """Weights of a window (1 - x^2)^2 and its derivatives; exact for parabolas."""
    t = period_s * (np.arange(samples) - 0.5 * (samples - 1))
    x = 2.0 * t / (period_s * samples)
    value, slope, curvature = (1.0 - x**2) ** 2, x * (1.0 - x**2), 3.0 * x**2 - 1.0
    curvature -= curvature.mean()
    return Weights(value / value.sum(), slope / (slope @ t), 2.0 * curvature / (curvature @ t**2))


def subsample(weights: Weights, count: int) -> Subsample:
    """Subsample a window at the middles of equal parts, for terms too expensive to evaluate at every sample.

    Half a cycle off would show as viscous friction.
    """
    samples = len(weights.value)
    at = ((np.arange(count) + 0.5) * samples / count - 0.5).round().astype(np.int64)
    share = weights.value[at]
    return Subsample(at, share / share.sum())
