"""Another arm that an arm keeps off: who looks how far off it is, and what the servo is told of it.

The look is taken beside the servo's cycle (`servo.process.neighbour_look`), because it needs the memory of another
process, which may end at any time. The cycle obeys the verdict, and stops the arm when no new one comes
(`servo.checks.neighbour_watch`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from qrobot.arrays import Floats
from qrobot.config import Robot
from qrobot.config.deployment import DeployedArm
from qrobot.errors import ConfigError
from qrobot.fences.deployed import tool_of
from qrobot.fences.fence_set import FenceSet
from qrobot.fences.gate import CREEP_M, DEEPER_M, REACTION_S, way_of_stop
from qrobot.fences.two_arms import ArmPair, pose_between
from qrobot.modecodes import Mode
from qrobot.servo.memory.published_state import FLAG_CALIBRATED, ServoSnapshot
from qrobot.units import NS_PER_S

FREE, TOO_NEAR, NOT_HEARD_OF = 0.0, 1.0, 2.0  # verdicts
VERDICT, DISTANCE, MARGIN, LOOKS, LOOKS_SEEN, SILENT_CYCLES, N_NEIGHBOUR = range(7)  # words of `ServoState.neighbour`
LOOK_S: Final = 0.005  # [A] between two looks
PATIENCE_S: Final = 0.1  # [A] without a new state of the other arm, and of the cycle without a look
STOP_PLACES: Final = 4  # [A] of the ways of both stops at which the arms are looked at

Hear = Callable[[], "ServoSnapshot | None"]


@dataclass(frozen=True)
class Neighbour:
    """An arm that another one keeps off.

    Attributes:
        name: of the arm in the deployment.
        robot: name of its robot; a servo of another one is not believed.
        pair: this arm and that one.
        a_stop, other_a_stop: decelerations of a stop. Shapes (n,).
        overshoot_s, other_overshoot_s: how far an arm outruns its reference in a stop, in seconds of its speed.
        margin_m: kept between the two.
    """

    name: str
    robot: str
    pair: ArmPair
    a_stop: Floats
    other_a_stop: Floats
    overshoot_s: float
    other_overshoot_s: float
    margin_m: float


def neighbour_between(arm: DeployedArm, other: DeployedArm, robot: Robot, other_robot: Robot) -> Neighbour:
    """Two arms of a deployment, which both have a stand. Raises ConfigError when a robot file tells no body."""
    if arm.fences is None or arm.stand is None or other.stand is None:
        raise ConfigError(f"{arm.name} and {other.name} need [arm.stand] each")
    bodies = [
        FenceSet(each, (), tool=tool_of(each, deployed.servo.tool_mm, (deployed.fences or arm.fences).tool_radius_m))
        for deployed, each in ((arm, robot), (other, other_robot))
    ]
    pair = ArmPair(bodies[0], bodies[1], pose_between(arm.stand, other.stand))
    overshoot_s, other_overshoot_s = (float(each.control.stop_overshoot_s.max()) for each in (robot, other_robot))
    return Neighbour(
        other.name, other_robot.name, pair, robot.guard.a_stop, other_robot.guard.a_stop,
        overshoot_s, other_overshoot_s, arm.fences.arm_margin_m,
    )  # fmt: skip


def distances_at_stops(neighbour: Neighbour, own: ServoSnapshot, other: ServoSnapshot, late_s: float) -> Floats:
    """Distances of the arms where they are, and on the ways of a stop of both; `late_s` until it begins.

    Shape (1 + STOP_PLACES,).
    """
    found = [neighbour.pair.distance(own.q, other.q)]
    late_s += REACTION_S
    way = way_of_stop(own.v, neighbour.a_stop, late_s + neighbour.overshoot_s)
    other_way = way_of_stop(other.v, neighbour.other_a_stop, late_s + neighbour.other_overshoot_s)
    for share in np.arange(1, STOP_PLACES + 1) / STOP_PLACES:
        found.append(neighbour.pair.distance(own.q + share * way, other.q + share * other_way))
    return np.array(found)


class NeighbourLook:
    """Looks at one other arm.

    How long that has been silent counts on the own servo's time as well as on `clock`, whichever goes on less between
    two looks: the first stands still where that of the world does, the second while the own servo alone does not run.

    Args:
        neighbour: that arm.
        own, other: newest states; None where there is none.
        told: words of `ServoState.neighbour`, of which verdict, distance, margin and number of looks are filled.
        clock: seconds.
        period_s: of the servo: its time may have gone on by as much since its newest state.
    """

    def __init__(
        self, neighbour: Neighbour, own: Hear, other: Hear, told: Floats, clock: Callable[[], float], period_s: float
    ) -> None:
        self.neighbour = neighbour
        self._own, self._other, self._told, self._clock, self._late_s = own, other, told, clock, LOOK_S + period_s
        self._tick, self._silence_s, self._looked = -1, np.inf, (0.0, 0.0)
        self._least_near = -np.inf  # of this run of setpoints, while the arms are too near

    def look(self) -> float:
        """Judge, tell, and return the verdict."""
        own, other = self._own(), self._other()
        verdict, distance, margin = NOT_HEARD_OF, 0.0, 0.0
        silent_s = np.inf if own is None or other is None else self._silent_s(own, other)
        if own is not None and other is not None and silent_s < PATIENCE_S:
            found = distances_at_stops(self.neighbour, own, other, silent_s + self._late_s)
            verdict = self._judge(found, own.mode == Mode.TRACKING)
            distance, margin = float(found.min()), self.neighbour.margin_m
        self._told[DISTANCE], self._told[MARGIN], self._told[VERDICT] = distance, margin, verdict
        self._told[LOOKS] += 1.0
        return verdict

    def _silent_s(self, own: ServoSnapshot, other: ServoSnapshot) -> float:
        """Seconds since the other arm told where it is; infinite while it cannot, for its counters tell no place."""
        before, self._looked = self._looked, (own.t_ns / NS_PER_S, self._clock())
        self._silence_s += min(now_s - before_s for now_s, before_s in zip(self._looked, before, strict=True))
        if other.tick != self._tick:
            self._tick, self._silence_s = other.tick, 0.0
        return self._silence_s if other.flags & FLAG_CALIBRATED else np.inf

    def _judge(self, found: Floats, tracks: bool) -> float:
        """Too near when a stop of both would end within the margin; arms that are there already may part.

        However slowly, they come no nearer than they have been in this run of setpoints.
        """
        now, nearest, margin = float(found[0]), float(found[1:].min()), self.neighbour.margin_m
        self._least_near = max(self._least_near, now) if tracks and now < margin else -np.inf
        nearer = not now < margin or now - nearest > DEEPER_M or self._least_near - nearest > CREEP_M
        return TOO_NEAR if not nearest >= margin and nearer else FREE
