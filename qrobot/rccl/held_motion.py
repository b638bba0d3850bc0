"""Motions of an arm that last as long as something is held: one joint, along or about one axis, or to a place.

Whatever is held, a key of a terminal or a button of a page, is asked for at each sample. A release is heeded twice:
this program brakes the arm on its path, and the servo stops it by itself when it does not hear of the key, or of a
brake that has not ended after `BRAKE_MS` (`servo.checks.hold_to_run`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Final, Generic, TypeVar

import numpy as np

from qrobot.arrays import Floats
from qrobot.errors import FenceCrossed, LinkError, MotionError, QRobotError, ServoFault, TooFast
from qrobot.motion import Termination
from qrobot.rccl.channel import Channel
from qrobot.rccl.jog import SETTLING_MS, asked_joints, fixed_position, measure
from qrobot.rccl.position import Position
from qrobot.rccl.straight_jog import StraightWay
from qrobot.rccl.trace import reason_of
from qrobot.units import DEG_PER_RAD, MM_PER_M

JOINT_RAD_S, AXIS_MM_S, AXIS_DEG_S = 0.1, 50.0, 10.0  # at a share of 1 [A]
MOST_JOINT: Final = (
    5.0  # [A] times the speed of a joint that is turned: what a joint may do while the tool goes straight
)
AHEAD: Final = 2  # pieces that wait
MARGIN: Final = 0.01  # [A] rad or m that a joint stays away from its ends,
MARGIN_SHARE: Final = 0.1  # [A] but no more than this share of its range
WITHIN: Final = 0.95  # [A] of the speed allowed, for the rounding of a plan to sample periods
LAST_PIECE: Final = 2.0  # [A] mm or degrees: one as short as this is not made shorter before a fence
BRAKE_MS: Final = 500.0  # [A] from the release to rest

HeldT = TypeVar("HeldT")


class HeldMotion(Generic[HeldT]):
    """Moves an arm while the same thing is held.

    Args:
        arm: under control, at rest, with a sample period of 60 ms at most. Its stream moves by a key from now on.
        look: what is held, None for nothing; called at each sample, it must not wait.

    Attributes:
        held: what was held at the newest sample.
    """

    def __init__(self, arm: Channel, look: Callable[[], HeldT | None]) -> None:
        self.held: HeldT | None = None
        self._arm, self._look = arm, look
        self._brake_until_ms = 0.0
        arm.chg.hold_to_run = True

    @contextmanager
    def watched(self) -> Iterator[None]:
        """Tell the servo at each sample of the block whether the arm may move."""
        self._arm.each_sample(self._tell_servo)
        try:
            yield
        finally:
            self._arm.each_sample(None)
            self._arm.chg.key_held = False

    def turn_joint(self, joint: int, way: float, share: float, step: float = 0.0) -> None:
        """Turn or slide `joint` (from 0), by `step` rad or m, or for 0 towards the end of its range.

        Raises:
            MotionError: the arm cannot go on. LinkError, ServoFault: it is lost.
        """
        with self._brought_to_rest():
            arm = self._arm
            goal = asked_joints(arm)
            end = self._before_fences(goal, joint, self._end_of(joint, goal[joint], way, step))
            if end == goal[joint]:  # it goes no farther that way
                return
            goal[joint] = end
            arm.setmode("joint")
            arm.setjvel(self._joint_speed(share, [joint]))
            self._follow(arm.jposition(f"joint {joint + 1}", goal.tolist()))

    def go_along(
        self, axis: str, way: float, share: float, in_base: bool, step: float = 0.0, axes: Floats | None = None
    ) -> None:
        """Go straight along an axis (dx dy dz) or turn about it (rx ry rz), by `step` mm or degrees, 0 for on and on.

        The axes are those of the base or of the last link, or the columns of `axes` (3, 3), in the base.

        Near a singular pose the tool goes slower, still straight, so that no joint is faster than MOST_JOINT allows.

        Raises what `turn_joint` raises.
        """
        speed = way * share * (AXIS_DEG_S if axis.startswith("r") else AXIS_MM_S)
        with self._brought_to_rest():
            start = measure(self._arm, "HERE").value
            straight = StraightWay(self._arm.robot, start, np.array(self._arm.how.q_setpoint), self._most_speeds(share))
            straight.choose(axis, speed, in_base, step, axes)
            pieces: list[Position] = []
            try:
                while self._goes_on(pieces) and not straight.done:
                    pieces.append(self._ask_piece(straight, share))
                    self._arm.waitas(lambda: self._arm.nbrequest < AHEAD or not self._goes_on(pieces))
            finally:  # also where it leads no further
                self._until_done(pieces)

    def go_to(self, position: Position, share: float) -> None:
        """Go to a place by a joint motion. Raises what `turn_joint` raises."""
        with self._brought_to_rest():
            self._arm.setmode("joint")
            self._arm.setjvel(self._joint_speed(share, list(range(self._arm.robot.n))))
            self._follow(position)

    def _tell_servo(self) -> None:
        self.held = self._look()
        self._arm.chg.key_held = self.held is not None or self._arm.time < self._brake_until_ms

    @contextmanager
    def _brought_to_rest(self) -> Iterator[None]:
        """Begin with what is held now; afterwards brake, and wait until the arm is at rest, unless it is lost."""
        self._begun, failure = self.held, None
        try:
            yield
        except (LinkError, ServoFault):
            raise
        except QRobotError as error:
            failure = error
        self._brake_until_ms = self._arm.time + BRAKE_MS
        if not self._arm.completed.count:
            self._arm.stop()
        self._rest()
        if failure is not None:
            raise failure

    def _rest(self) -> None:
        self._arm.waitfor(self._arm.completed)
        settled_ms = self._arm.time + SETTLING_MS
        self._arm.waitas(lambda: self._arm.time >= settled_ms)
        self._brake_until_ms = 0.0

    def _joint_speed(self, share: float, joints: list[int]) -> float:
        """Speed at a share, rad/s or m/s: within what the servo allows each of these joints, less at reduced speed."""
        allowed = self._arm.robot.limits.v_max[joints] * self._arm.how.speed_limit
        return min(JOINT_RAD_S * share, WITHIN * float(allowed.min()))

    def _end_of(self, joint: int, place: float, way: float, step: float) -> float:
        """Goal of a joint, degrees or mm, from `place`: within its range less the margin, or where it is."""
        limits = self._arm.robot.limits
        per_unit = MM_PER_M if self._arm.robot.prismatic[joint] else DEG_PER_RAD
        q_min, q_max = limits.q_min[joint], limits.q_max[joint]
        margin = min(MARGIN, MARGIN_SHARE * (q_max - q_min))
        end = max(place, (q_max - margin) * per_unit) if way > 0.0 else min(place, (q_min + margin) * per_unit)
        if not step:
            return float(end)
        goal = place + way * step * per_unit
        return float(min(goal, end) if way > 0.0 else max(goal, end))

    def _before_fences(self, start: Floats, joint: int, end: float) -> float:
        """The furthest place of a joint turned from `start` (n,) towards `end`, before any fence; degrees or mm."""
        goal = start.copy()
        goal[joint] = end
        return float(start[joint] + self._arm.clear_share(start, goal) * (end - start[joint]))

    def _most_speeds(self, share: float) -> Floats:
        """Greatest speed of each joint at a share of the jog's, rad/s or m/s. Shape (n,)."""
        allowed = self._arm.robot.limits.v_max * self._arm.how.speed_limit
        most: Floats = np.minimum(MOST_JOINT * JOINT_RAD_S * share, WITHIN * allowed)
        return most

    def _ask_piece(self, straight: StraightWay, share: float) -> Position:
        """Ask for the next piece of a straight way, as long as the arm can do it in its time. Raises MotionError."""
        while True:
            position = fixed_position("JOG", straight.propose())
            self._go_straight(share * straight.share)
            try:
                self._arm.move(position)
            except TooFast as error:  # what lies between is more than the joints can do
                straight.shorten(error)
                continue
            except FenceCrossed as error:
                if straight.piece < LAST_PIECE:
                    raise
                straight.shorten(error)
                continue
            straight.accept()
            return position

    def _go_straight(self, share: float) -> None:
        self._arm.setmode("cartesian")
        self._arm.setvel(AXIS_MM_S * share, AXIS_DEG_S * share)

    def _follow(self, position: Position) -> None:
        self._arm.move(position)
        self._until_done([position])

    def _until_done(self, pieces: list[Position]) -> None:
        """Wait until all is let go, or the arm is at rest where it was to go: a stop before would change the place."""
        if pieces:
            self._arm.waitas(lambda: not self._goes_on(pieces) or self._arm.completed.count)

    def _goes_on(self, pieces: list[Position]) -> bool:
        """The same is held, and no piece has ended before its goal. Raises MotionError with why one has."""
        for piece in pieces:
            if piece.code not in (Termination.NONE, Termination.COMPLETED):
                raise MotionError(f"the arm cannot go on: {reason_of(piece.code)}")
        return self.held is not None and self.held == self._begun
