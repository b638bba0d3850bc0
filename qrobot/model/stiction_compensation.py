"""Friction of a motor that stands and is pushed: what is added to the push so that little of it is lost.

Coulomb friction of a moving motor follows from its velocity (`model.dynamics.friction_torque`). One that stands shows
no direction; where a torque, not a position, says what it is to do, that torque gives one. So the friction model is
asked at a speed that leads the motor's own:

    v' = v + REST_SHARE w s max(0, 1 - |v| / w)        s = clip(push / (PUSH_SHARE coulomb), -1, 1)

with w the speed within which Coulomb friction grows (`FrictionParams.velocity`). Without a push nothing is added, and
at rest never more than REST_SHARE of Coulomb friction: a motor that nobody pushes stays where it is, and one that is
pushed a little does too, even if its friction is somewhat less than the model's. Once it moves, its velocity alone
decides, so nothing is made up for twice.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from qrobot.arrays import Floats
from qrobot.model.dynamics import FrictionParams
from qrobot.realtime.jit import lean_kernel

REST_SHARE: Final = 0.8  # of Coulomb friction that is added at rest, at most [A]
PUSH_SHARE: Final = 0.1  # of Coulomb friction: a push from which all of that is added [A]
_TINY: Final = 1e-9  # N m: of a motor without friction nothing is added


@lean_kernel
def lead(v: Any, push: Any, p: FrictionParams) -> None:
    """Turn motor velocities into those the friction model is asked at, where `push` moves the motors. Shapes (n,)."""
    for i in range(v.size):
        coulomb = p.coulomb_pos[i] if push[i] > 0.0 else p.coulomb_neg[i]
        way = min(max(push[i] / max(PUSH_SHARE * coulomb, _TINY), -1.0), 1.0)
        v[i] += REST_SHARE * way * max(0.0, p.velocity[i] - abs(v[i]))


def added_at_rest(push: Floats, p: FrictionParams) -> Floats:
    """Torque that `lead` makes the friction model add to a push on motors at rest, viscous friction left out. Shapes
    (n,)."""
    coulomb = np.where(push > 0.0, p.coulomb_pos, p.coulomb_neg)
    way = np.clip(push / np.maximum(PUSH_SHARE * coulomb, _TINY), -1.0, 1.0)
    return np.array(REST_SHARE * way * coulomb, dtype=np.float64)


def push_for(total: Floats, p: FrictionParams) -> Floats:
    """The push p on motors at rest with p + `added_at_rest(p)` = `total`. Shapes (n,)."""
    coulomb = np.where(total > 0.0, p.coulomb_pos, p.coulomb_neg)
    small = total * (PUSH_SHARE / (PUSH_SHARE + REST_SHARE))
    large = total - np.sign(total) * REST_SHARE * coulomb
    return np.where(np.abs(total) < (PUSH_SHARE + REST_SHARE) * coulomb, small, large)
