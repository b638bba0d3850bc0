"""Hold-to-run jog: an arm that moves as long as a key is held, one joint, or along or about one axis.

A key that is let go is heeded twice: this program brakes the arm on its path, and the servo stops it by itself when it
does not hear of the key, or of a brake that has not ended after `BRAKE_MS` (`servo.checks.hold_to_run`).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np

from qrobot.errors import LinkError, MotionError, QRobotError, ServoFault
from qrobot.motion import Termination
from qrobot.rccl.arguments import small_move
from qrobot.rccl.channel import Channel
from qrobot.rccl.held_key import HeldKey
from qrobot.rccl.jog import SETTLING_MS, measure, moved_by, place, position_of
from qrobot.rccl.position import Position
from qrobot.rccl.trace import reason_of
from qrobot.rccl.transforms import newtrans
from qrobot.units import DEG_PER_RAD, MM_PER_M

PLUS, MINUS = ".", ","  # neighbours on every keyboard
AXES: Final = {"x": "dx", "y": "dy", "z": "dz", "u": "rx", "v": "ry", "w": "rz"}
SPEEDS: Final = (0.1, 0.25, 0.5, 1.0, 2.0, 4.0)
JOINT_RAD_S, AXIS_MM_S, AXIS_DEG_S = 0.1, 50.0, 10.0  # at speed 1 [A]
PIECE_S: Final = 0.4  # [A] of a straight path: so far ahead it is planned
AHEAD: Final = 2  # pieces that wait
MARGIN: Final = 0.01  # rad or m that a joint stays away from its ends
BRAKE_MS: Final = 500.0  # [A] from the release to rest
KEYS: Final = """\
1 2 ...     choose a joint
x y z       choose an axis to move along; u v w to turn about it
b t         axes of the base; of the last link
. ,         HOLD to move one way; the other way
f s         faster; slower
q           quit"""


class HeldJog:
    """Obeys keys.

    Args:
        arm: under control, at rest, with a sample period of 60 ms at most. Its stream moves by a key from now on.
        read_keys: what has been typed since it was asked last; called at each sample, it must not wait.
        tell: takes a line for people.
    """

    def __init__(self, arm: Channel, read_keys: Callable[[], str], tell: Callable[[str], None]) -> None:
        self._arm, self._read_keys, self._tell = arm, read_keys, tell
        self._keys, self._held = HeldKey(), ""
        self._brake_until_ms = 0.0
        self._joint, self._axis, self._in_base, self._speed = 0, "", True, SPEEDS.index(1.0)
        arm.chg.hold_to_run = True

    def run(self) -> None:
        """Obey until `q`. Raises LinkError or ServoFault when the arm is lost."""
        self._arm.each_sample(self._look_at_key)
        try:
            self._tell(self._chosen())
            while self._obeyed():
                pass
        finally:
            self._arm.each_sample(None)
            self._arm.chg.key_held = False

    def _look_at_key(self) -> None:
        """Tell at each sample whether the servo may let the arm move."""
        now_ms = self._arm.time
        self._held = self._keys.hear(self._read_keys(), now_ms)
        self._arm.chg.key_held = self._held in (PLUS, MINUS) or now_ms < self._brake_until_ms

    def _obeyed(self) -> bool:
        """Wait for a key and do what it says; False for the one that ends."""
        self._arm.waitas(lambda: self._keys.pressed or self._held in (PLUS, MINUS))
        while self._keys.pressed:
            if (key := self._keys.pressed.pop(0)) == "q":
                return False
            self._choose(key)
        if self._held in (PLUS, MINUS):
            self._move(self._held)
        return True

    def _choose(self, key: str) -> None:
        if key.isdecimal() and 0 < int(key) <= self._arm.robot.n:
            self._joint, self._axis = int(key) - 1, ""
        elif key in AXES:
            self._axis = AXES[key]
        elif key in ("b", "t"):
            self._in_base = key == "b"
        elif key in ("f", "s"):
            self._speed = min(max(self._speed + (1 if key == "f" else -1), 0), len(SPEEDS) - 1)
        elif key in (PLUS, MINUS):
            return
        else:
            self._tell(KEYS)
            return
        self._tell(self._chosen())

    def _chosen(self) -> str:
        """Motion that a held key would make, for people."""
        share = SPEEDS[self._speed]
        if not self._axis:
            name = self._arm.robot.joint_names[self._joint]
            return f"joint {self._joint + 1} ({name}) at {self._joint_speed():.3g} rad/s or m/s"
        turns = self._axis.startswith("r")
        speed = f"{AXIS_DEG_S * share:g} deg/s" if turns else f"{AXIS_MM_S * share:g} mm/s"
        return f"{self._axis} along the axes of the {'base' if self._in_base else 'last link'} at {speed}"

    def _joint_speed(self) -> float:
        return JOINT_RAD_S * SPEEDS[self._speed]

    def _move(self, key: str) -> None:
        """Move until the key is let go, the path ends, or the arm cannot go on."""
        way = 1.0 if key == PLUS else -1.0
        try:
            self._go_along_axis(key, way) if self._axis else self._turn_joint(key, way)
        except (LinkError, ServoFault):
            raise
        except QRobotError as error:
            self._tell(f"error: {error}")
        finally:
            self._brake_until_ms = self._arm.time + BRAKE_MS
        self._arm.stop()
        self._arm.waitfor(self._arm.completed)
        settled_ms = self._arm.time + SETTLING_MS
        self._arm.waitas(lambda: self._arm.time >= settled_ms)
        self._brake_until_ms = 0.0
        self._tell(place(measure(self._arm, "HERE").value))

    def _turn_joint(self, key: str, way: float) -> None:
        """One motion towards the end of the joint's range."""
        arm, limits = self._arm, self._arm.robot.limits
        per_unit = np.where(arm.robot.prismatic, MM_PER_M, DEG_PER_RAD)
        goal = arm.joints
        ends = (limits.q_max - MARGIN) if way > 0.0 else (limits.q_min + MARGIN)
        goal[self._joint] = (ends * per_unit)[self._joint]
        arm.setmode("joint")
        arm.setjvel(self._joint_speed())
        self._follow(key, [arm.jposition(f"joint {self._joint + 1}", goal.tolist())])

    def _go_along_axis(self, key: str, way: float) -> None:
        """Straight pieces, one after the other, as far as the arm reaches."""
        arm, share = self._arm, SPEEDS[self._speed]
        turns = self._axis.startswith("r")
        speed = (AXIS_DEG_S if turns else AXIS_MM_S) * share
        step = small_move(self._axis, (way * speed * PIECE_S,))
        value = measure(arm, "HERE").value
        arm.setmode("cartesian")
        arm.setvel(AXIS_MM_S * share, AXIS_DEG_S * share)
        pieces: list[Position] = []
        while self._goes_on(key, pieces):
            value = moved_by(value, step, self._in_base)
            goal = newtrans("JOG")
            goal.set(value)
            pieces.append(position_of(goal))
            arm.move(pieces[-1])
            arm.waitas(lambda: arm.nbrequest < AHEAD or not self._goes_on(key, pieces))

    def _follow(self, key: str, pieces: list[Position]) -> None:
        self._arm.move(pieces[-1])
        self._arm.waitas(lambda: not self._goes_on(key, pieces) or self._arm.unserved == 0)

    def _goes_on(self, key: str, pieces: list[Position]) -> bool:
        """The key is held, and no piece has ended before its goal. Raises MotionError with why one has."""
        for piece in pieces:
            if piece.code not in (Termination.NONE, Termination.COMPLETED):
                raise MotionError(f"the arm cannot go on: {reason_of(piece.code)}")
        return self._held == key
