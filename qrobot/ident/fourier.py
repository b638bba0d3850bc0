"""Motion for inertia: every joint swings by a few harmonics of one period, from rest to rest.

q(t) = centre + sum over k of sine_k sin(k w t) + cosine_k cos(k w t), w = 2 pi / period: limited in band, so that its
derivatives are known exactly and filters take little away (Swevers et al. 1997). For rest at both ends velocity and
acceleration are to be 0 at t = 0: sum k sine_k = 0 and sum k^2 cosine_k = 0.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from qrobot.arrays import Floats


class States(NamedTuple):
    """Positions, velocities and accelerations, each of shape (m, n): rad (m), per second, per second squared."""

    q: Floats
    v: Floats
    a: Floats


@dataclass(frozen=True, eq=False)
class Fourier:
    """A periodic motion that is made once.

    Attributes:
        centre: rad (m). Shape (n,).
        sine, cosine: amplitudes of the harmonics, rad (m). Shape (n, harmonics).
        seconds: its period.
    """

    centre: Floats
    sine: Floats
    cosine: Floats
    seconds: float

    @classmethod
    def from_rest(cls, centre: Floats, sine: Floats, cosine: Floats, seconds: float) -> Fourier:
        """The nearest such motion that begins and ends at rest."""
        order = np.arange(1.0, sine.shape[1] + 1.0)
        return cls(centre, _across(sine, order), _across(cosine, order**2), seconds)

    def at(self, t: Floats) -> States:
        """Position, velocity and acceleration at times of shape (m,), in seconds from its start."""
        rate = 2.0 * np.pi / self.seconds * np.arange(1.0, self.sine.shape[1] + 1.0)
        sin, cos = np.sin(np.outer(t, rate)), np.cos(np.outer(t, rate))
        return States(
            self.centre + sin @ self.sine.T + cos @ self.cosine.T,
            (cos * rate) @ self.sine.T - (sin * rate) @ self.cosine.T,
            -(sin * rate**2) @ self.sine.T - (cos * rate**2) @ self.cosine.T,
        )

    def scaled(self, factor: Floats | float) -> Fourier:
        """The same with other amplitudes, joint by joint (n,) or all alike."""
        column = np.broadcast_to(factor, self.centre.shape)[:, None]
        return replace(self, sine=self.sine * column, cosine=self.cosine * column)

    @property
    def start(self) -> Floats:
        """Position at its begin and its end. Shape (n,)."""
        return np.asarray(self.centre + self.cosine.sum(axis=1))


def _across(amplitudes: Floats, order: Floats) -> Floats:
    """Part of the amplitudes (n, harmonics) that is orthogonal to `order`."""
    return np.asarray(amplitudes - np.outer(amplitudes @ order, order) / (order @ order))
