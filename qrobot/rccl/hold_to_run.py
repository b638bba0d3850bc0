"""Jog by the keys of a terminal: an arm that moves as long as a key is held (`rccl.held_motion`)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Final

from qrobot.errors import LinkError, QRobotError, ServoFault
from qrobot.rccl.channel import Channel
from qrobot.rccl.held_key import HeldKey
from qrobot.rccl.held_motion import AXIS_DEG_S, AXIS_MM_S, JOINT_RAD_S, HeldMotion
from qrobot.rccl.jog import measure, place
from qrobot.rccl.transforms import Transform

PLUS, MINUS = ".", ","  # neighbours on every keyboard
AXES: Final = {"x": "dx", "y": "dy", "z": "dz", "u": "rx", "v": "ry", "w": "rz"}
SPEEDS: Final = (0.1, 0.25, 0.5, 1.0, 2.0, 4.0)
MOVING_KEYS: Final = """\
1 2 ...     choose a joint
x y z       choose an axis to move along; u v w to turn about it
b t         axes of the base; of the last link
. ,         HOLD to move one way; the other way
f s         faster; slower"""
KEYS: Final = f"{MOVING_KEYS}\nn           axes of the frame that was named, if any\nq           quit"

NO_OTHERS: Final[Mapping[str, Callable[[], object]]] = {}


class HeldJog:
    """Obeys keys.

    Args:
        arm: under control, at rest, with a sample period of 60 ms at most. Its stream moves by a key from now on.
        read_keys: what has been typed since it was asked last; called at each sample, it must not wait.
        tell: takes a line for people.
        others: what other keys do, with the arm at rest; true ends it.
        frame: whose axes the key n chooses, None for none.
    """

    def __init__(
        self,
        arm: Channel,
        read_keys: Callable[[], str],
        tell: Callable[[str], None],
        others: Mapping[str, Callable[[], object]] = NO_OTHERS,
        frame: Transform | None = None,
    ) -> None:
        self._arm, self._read_keys, self._tell, self._others = arm, read_keys, tell, others
        self._keys = HeldKey()
        self._joint, self._axis, self._along, self._speed = 0, "", "b", SPEEDS.index(1.0)
        self._frame = frame
        self._motion = HeldMotion(arm, self._held_key)

    def run(self) -> None:
        """Obey until `q`. Raises LinkError or ServoFault when the arm is lost."""
        with self._motion.watched():
            self._tell(self._chosen())
            while self._obeyed():
                pass

    def _held_key(self) -> str | None:
        """The one of the two keys that move which is held, None for neither."""
        key = self._keys.hear(self._read_keys(), self._arm.time)
        return key if key in (PLUS, MINUS) else None

    def _obeyed(self) -> bool:
        """Wait for a key and do what it says; False for the one that ends."""
        self._arm.waitas(lambda: self._keys.pressed or self._motion.held)
        while self._keys.pressed:
            if (key := self._keys.pressed.pop(0)) == "q" or (key in self._others and self._others[key]()):
                return False
            if key not in self._others:
                self._choose(key)
        if self._motion.held:
            self._move(1.0 if self._motion.held == PLUS else -1.0)
        return True

    def _choose(self, key: str) -> None:
        if key.isdecimal() and 0 < int(key) <= self._arm.robot.n:
            self._joint, self._axis = int(key) - 1, ""
        elif key in AXES:
            self._axis = AXES[key]
        elif key in ("b", "t") or (key == "n" and self._frame is not None):
            self._along = key
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
        return f"{self._axis} along the axes of {self._whose()} at {speed}"

    def _whose(self) -> str:
        named = "" if self._frame is None else self._frame.name
        return {"b": "the base", "t": "the last link", "n": named}[self._along]

    def _joint_speed(self) -> float:
        return JOINT_RAD_S * SPEEDS[self._speed]

    def _move(self, way: float) -> None:
        """Move until the key is let go, the path ends, or the arm cannot go on."""
        share = SPEEDS[self._speed]
        try:
            if self._axis:
                axes = self._frame.value[:3, :3] if self._frame is not None and self._along == "n" else None
                self._motion.go_along(self._axis, way, share, self._along == "b", axes=axes)
            else:
                self._motion.turn_joint(self._joint, way, share)
        except (LinkError, ServoFault):
            raise
        except QRobotError as error:
            self._tell(f"error: {error}")
        self._tell(place(measure(self._arm, "HERE").value))
