"""Into another segment from any instant of a motion (A-34, `nextmove`).

The corner is where the arm would be, at its present speed, once the transition is half over: B = q + v Ta. So the
transition begins with the velocity the arm has, and its present acceleration fades out during it (blend.absorb). That
corner is no place anybody asked for: the way is looked at beforehand, and taken only if it keeps the limits.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from qrobot.motion.leg import leg_from
from qrobot.motion.limits import Floats
from qrobot.motion.path import Segment
from qrobot.motion.request import MoveRequest
from qrobot.motion.schedule import Scheduler

_LOOKS: Final = 32
_TRIES: Final = 16
_LONGER: Final = 1.4


def divert(request: MoveRequest, state: Floats, clock: float, scheduler: Scheduler, following: int) -> Segment | None:
    """The segment that takes the arm from `state` (3, n: q, v, a) at path time `clock` into `request`.

    Longer and longer transitions are tried; None when none of them keeps the limits.
    """
    q, v, _ = state
    transition = 1
    for _ in range(_TRIES):
        distance = request.target - (q + v * (transition * scheduler.period_s))
        schedule = scheduler.plan(request, distance, v, least=transition, following=following)
        if schedule.transition == transition:  # else the corner lies elsewhere
            velocity = distance / (schedule.length * scheduler.period_s)
            if _safe(state, velocity, transition, scheduler):
                return Segment(request, clock + transition, schedule, velocity)
            transition = int(_LONGER * transition) + 1
        else:
            transition = schedule.transition
    return None


def _safe(state: Floats, velocity: Floats, transition: int, scheduler: Scheduler) -> bool:
    """True when the transition keeps the limits wherever it is looked at."""
    leg = leg_from(state, velocity, 0.0, 2.0 * transition)
    out = np.empty_like(state)
    for look in np.linspace(0.0, leg.length, _LOOKS + 1)[1:]:
        leg.state(look, scheduler.period_s, scheduler.blend, 1.0, 0.0, out)
        if not scheduler.limits.allow(out):
            return False
    return True
