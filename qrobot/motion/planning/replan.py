"""Replanning into another segment from any instant of a motion (A-34, `nextmove`).

The via point is where the arm would be, at its present speed, once the transition is half over: B = q + v Ta. So the
transition begins with the velocity the arm has, and its present acceleration fades out during it (`blend.absorb`).
Nobody asked for that via point: the way is checked beforehand, and taken only if it keeps the limits.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np

from qrobot.arrays import Floats
from qrobot.motion.path.path_piece import BlendSettings, piece_from_state
from qrobot.motion.path.segment import Segment
from qrobot.motion.planning.geometric_path import GeometricPath, segment_of
from qrobot.motion.planning.queued_motion import Following
from qrobot.motion.planning.timing import Scheduler
from qrobot.motion.request import MoveRequest

_PROBES: Final = 32
_TRIES: Final = 16
_LONGER: Final = 1.4


def replan(
    request: MoveRequest,
    plan_geometry: Callable[[Floats], GeometricPath],
    state: Floats,
    clock: float,
    scheduler: Scheduler,
    settings: BlendSettings,
    following: Following,
) -> Segment | None:
    """The segment that takes the arm from `state` (3, n: q, v, a) at path time `clock` into `request`.

    `plan_geometry` gives the joint path that begins at a via point (n,). Longer and longer transitions are tried; None
    when none of them keeps the limits.
    """
    q, v, _ = state
    transition = 1
    for _ in range(_TRIES):
        geometry = plan_geometry(q + v * (transition * scheduler.period_s))
        schedule = scheduler.plan(request, geometry, v, least=transition, following=following)
        if schedule.transition == transition:  # else the via point lies elsewhere
            segment = segment_of(request, geometry, schedule, clock + transition, scheduler.period_s)
            if _safe(state, segment.velocity, transition, scheduler, settings):
                return segment
            transition = int(_LONGER * transition) + 1
        else:
            transition = schedule.transition
    return None


def _safe(state: Floats, velocity: Floats, transition: int, scheduler: Scheduler, settings: BlendSettings) -> bool:
    """True when the transition keeps the limits wherever it is looked at; for the range see `check_position`."""
    piece = piece_from_state(state, velocity, 0.0, 2.0 * transition)
    return all(
        scheduler.limits.allow(piece.state(probe, settings), state[0])
        for probe in np.linspace(0.0, piece.length, _PROBES + 1)[1:]
    )
