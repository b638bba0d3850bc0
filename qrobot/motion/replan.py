"""Into another segment from any instant of a motion (A-34, `nextmove`).

The corner is where the arm would be, at its present speed, once the transition is half over: B = q + v Ta. So the
transition begins with the velocity the arm has, and its present acceleration fades out during it (blend.absorb). That
corner is no place anybody asked for: the way is looked at beforehand, and taken only if it keeps the limits.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np

from qrobot.arrays import Floats
from qrobot.motion.geometric_path import GeometricPath
from qrobot.motion.path import Segment, segment_of
from qrobot.motion.path_piece import BlendSettings, piece_from_state
from qrobot.motion.queued_motion import Following
from qrobot.motion.request import MoveRequest
from qrobot.motion.timing import Scheduler

_LOOKS: Final = 32
_TRIES: Final = 16
_LONGER: Final = 1.4


def divert(
    request: MoveRequest,
    lay: Callable[[Floats], GeometricPath],
    state: Floats,
    clock: float,
    scheduler: Scheduler,
    shape: BlendSettings,
    following: Following,
) -> Segment | None:
    """The segment that takes the arm from `state` (3, n: q, v, a) at path time `clock` into `request`.

    `lay` gives the joint course that begins at a corner (n,). Longer and longer transitions are tried; None when
    none of them keeps the limits.
    """
    q, v, _ = state
    transition = 1
    for _ in range(_TRIES):
        course = lay(q + v * (transition * scheduler.period_s))
        schedule = scheduler.plan(request, course, v, least=transition, following=following)
        if schedule.transition == transition:  # else the corner lies elsewhere
            segment = segment_of(request, course, schedule, clock + transition, scheduler.period_s)
            if _safe(state, segment.velocity, transition, scheduler, shape):
                return segment
            transition = int(_LONGER * transition) + 1
        else:
            transition = schedule.transition
    return None


def _safe(state: Floats, velocity: Floats, transition: int, scheduler: Scheduler, shape: BlendSettings) -> bool:
    """True when the transition keeps the limits wherever it is looked at."""
    leg = piece_from_state(state, velocity, 0.0, 2.0 * transition)
    return all(scheduler.limits.allow(leg.state(look, shape)) for look in np.linspace(0.0, leg.length, _LOOKS + 1)[1:])
