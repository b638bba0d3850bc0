"""What a program says about its motions before it asks for them: parameters that stick, and those of the next alone.

Every call only fills in a `MoveRequest` (Hayward & Paul 1986, section 3.2). Units of the papers: mm, degrees, ms.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import isfinite, nan
from typing import Final, SupportsFloat

import numpy as np

from qrobot.arrays import Floats
from qrobot.errors import ConfigError, MotionError
from qrobot.model.branch import Branch, branch_of
from qrobot.model.transform import so3_exp, transform
from qrobot.motion import (
    Compliance,
    Drift,
    Duration,
    Equation,
    ForceLimits,
    Goal,
    JointSpeed,
    MotionMode,
    MotionSpeed,
    MoveRequest,
    OrientationInterpolation,
    SpeedShare,
    ToolSpeed,
    Trsf,
)
from qrobot.motion.request import Here
from qrobot.rccl.position import Position
from qrobot.units import M_PER_MM, RAD_PER_DEG, S_PER_MS, US_PER_MS
from qrobot.wire.vocabulary import LONGEST_PERIOD_US, SHORTEST_PERIOD_US

DEFAULT_SPEED: Final = SpeedShare(0.3)
_MODES: Final = {
    "joint": MotionMode.JOINT,
    "j": MotionMode.JOINT,
    "cartesian": MotionMode.CARTESIAN,
    "c": MotionMode.CARTESIAN,
}
_TURNS: Final = {turn.value: turn for turn in OrientationInterpolation}
_DIRECTIONS: Final = ("dx", "dy", "dz", "rx", "ry", "rz")
_FORCES: Final = ("fx", "fy", "fz", "mx", "my", "mz")


@dataclass(frozen=True)
class Update:
    """Solve `equation` for `trsf` with the measured T6 when the motion ends or is interrupted."""

    trsf: Trsf
    equation: Equation


@dataclass(frozen=True, eq=False)
class MoveOrder:
    """A motion as a program asked for it.

    Attributes:
        request: for the generator.
        position: whose fields tell how it goes.
        updates: to be done when it ends or is interrupted.
    """

    request: MoveRequest
    position: Position
    updates: tuple[Update, ...] = ()


@dataclass(frozen=True)
class NextMoveOptions:
    """Parameters of the next motion alone; see the calls of the same names."""

    setime: tuple[float, float] | None = None
    evalfn: Callable[[], object] | None = None
    distance: Floats | None = None
    updates: tuple[Update, ...] = ()
    limit: ForceLimits | None = None


class Parameters:
    """What is said about the motions of one arm.

    Attributes:
        once: of the next motion alone.
    """

    def __init__(self) -> None:
        self.once = NextMoveOptions()
        self._speed: MotionSpeed = DEFAULT_SPEED
        self._mode = MotionMode.JOINT
        self._turn = OrientationInterpolation.ONE_AXIS
        self._branch: Branch | None = None
        self._drift = Drift()
        self._compliance: Compliance | None = None

    def setvel(self, tv: float, rv: float) -> None:
        """See `Channel.setvel`."""
        tv, rv = numbers("setvel", tv, rv)
        self._speed = ToolSpeed(tv * M_PER_MM, rv * RAD_PER_DEG)

    def setjvel(self, speed: float | None, share: float | None) -> None:
        """See `Channel.setjvel`."""
        if (speed is None) == (share is None):
            raise MotionError("setjvel takes either a speed or a share")
        (value,) = numbers("setjvel", share if speed is None else speed)
        self._speed = SpeedShare(value) if speed is None else JointSpeed(value)

    def setmode(self, mode: str, turn: str) -> None:
        """See `Channel.setmode`."""
        if mode not in _MODES:
            raise MotionError(f"mode {mode!r} is neither 'joint' nor 'cartesian'")
        if turn not in _TURNS:
            raise MotionError(f"turn {turn!r} is neither {' nor '.join(map(repr, _TURNS))}")
        self._mode, self._turn = _MODES[mode], _TURNS[turn]

    def setconf(self, letters: str) -> None:
        """See `Channel.setconf`."""
        if not isinstance(letters, str):
            raise MotionError(f'setconf: letters are needed, as in "lun", not {letters!r}')
        try:
            self._branch = branch_of(letters) if letters else None
        except ConfigError as error:
            raise MotionError(str(error)) from error

    def update(self, trsf: Trsf, position: Position) -> None:
        """See `Channel.update`."""
        if any(known.trsf is trsf for known in self.once.updates):
            raise MotionError(
                f"update({trsf.name}, {position.name}): the next motion has to update {trsf.name} already; "
                "call `move` between the two"
            )
        self.once = replace(self.once, updates=(*self.once.updates, Update(trsf, position.equation)))

    def comply(self, dirs: str, values: tuple[float, ...]) -> None:
        """See `Channel.comply`."""
        asked = named_values("comply", dirs, values, _FORCES)
        before = self._compliance
        wrench = np.zeros(len(_FORCES)) if before is None else before.wrench.copy()
        axes = set() if before is None else set(before.axes)
        for axis, value in asked.items():
            wrench[axis] = value
        self._compliance = Compliance(wrench, tuple(sorted(axes | set(asked))), self._drift)

    def lock(self, dirs: str) -> None:
        """See `Channel.lock`."""
        nothing = (0.0,) * len(str(dirs).split())
        locked = set(named_values("lock", dirs, nothing, _FORCES))
        before = () if self._compliance is None else self._compliance.axes
        if self._compliance is None or not locked <= set(before):
            complying = " ".join(_FORCES[axis] for axis in before) or "nothing"
            raise MotionError(f"lock({dirs!r}): the arm complies along {complying}")
        axes = tuple(axis for axis in before if axis not in locked)
        wrench = np.where(np.isin(np.arange(len(_FORCES)), axes), self._compliance.wrench, 0.0)
        self._compliance = Compliance(wrench, axes, self._drift) if axes else None

    def order(self, position: Position) -> MoveOrder:
        """The motion that a call of `move` asks for; what was said for one motion is used up."""
        once, self.once = self.once, NextMoveOptions()
        speed, ta = (self._speed, None) if once.setime is None else (Duration(once.setime[1]), once.setime[0])
        goal = _goal(position, once.distance, self._compliance)
        request = MoveRequest(
            position.name, goal, speed, ta, self._mode, self._branch, once.evalfn, once.limit, self._turn
        )
        return MoveOrder(request, position, once.updates)


def _goal(position: Position, distance: Floats | None, compliance: Compliance | None) -> Floats | Goal | Here:
    if isinstance(position.target, Equation):
        return position.target.goal(distance, compliance)
    if compliance is not None and isinstance(position.target, np.ndarray):
        raise MotionError(
            f"move to {position.name}: to comply it needs an equation, which names a frame; or lock first"
        )
    if distance is not None:
        raise MotionError(f"move to {position.name}: distance modifies positions that have an equation")
    return position.target


def milliseconds(ta: float, ts: float) -> tuple[float, float]:
    """Times of a motion in seconds. Raises MotionError: the segment takes no time, or the transition less than none."""
    ta, ts = numbers("setime", ta, ts)
    if ta < 0.0 or ts <= 0.0:
        raise MotionError(f"setime({ta:g}, {ts:g}): the transition may take 0 ms, the motion more than that")
    return ta * S_PER_MS, ts * S_PER_MS


def sample_period_us(call: str, ms: float) -> int:
    """A sample period, microseconds. Raises MotionError when the bridge has no such period."""
    (period_ms,) = numbers(call, ms)
    period_us = round(period_ms * US_PER_MS)
    if not SHORTEST_PERIOD_US <= period_us <= LONGEST_PERIOD_US:
        possible = f"{SHORTEST_PERIOD_US / US_PER_MS:g} to {LONGEST_PERIOD_US / US_PER_MS:g} ms"
        raise MotionError(f"{call}: a sample period of {ms:g} ms; {possible} are possible")
    return period_us


def numbers(call: str, *values: object) -> tuple[float, ...]:
    """The arguments of a call. Raises MotionError when one is no finite number."""
    found = [float(value) if isinstance(value, SupportsFloat) else nan for value in values]
    for value, number in zip(values, found, strict=True):
        if not isfinite(number):
            raise MotionError(f"{call}: {value!r} is not a finite number")
    return tuple(found)


def require_function(call: str, given: object) -> None:
    """Raises MotionError when an argument that has to be called later on cannot be called."""
    if not callable(given):
        raise MotionError(f"{call}: a function is needed, not {given!r}")


def named_values(call: str, spec: str, values: tuple[float, ...], allowed: tuple[str, ...]) -> dict[int, float]:
    """Values by the place of their names in `allowed`.

    Raises:
        MotionError: an unknown name, one twice, none, or not one finite value for each.
    """
    names = spec.split() if isinstance(spec, str) else []
    if not names or len(names) != len(values) or not set(names) <= set(allowed) or len(set(names)) != len(names):
        raise MotionError(
            f"{call}({spec!r}, ...): name directions out of {' '.join(allowed)!r}, each once, one value each"
        )
    return {allowed.index(name): value for name, value in zip(names, numbers(call, *values), strict=True)}


def force_limits(spec: str, values: tuple[float, ...]) -> ForceLimits:
    """The limits of `limit`: N, N m, mm and degrees.

    Raises:
        MotionError: an unknown direction, not one value for each, or one that is not positive.
    """
    bounds = np.full(len(_FORCES + _DIRECTIONS), np.inf)
    for place, value in named_values("limit", spec, values, _FORCES + _DIRECTIONS).items():
        bounds[place] = value
    force, shift, turn = bounds[:6], bounds[6:9] * M_PER_MM, bounds[9:] * RAD_PER_DEG
    return ForceLimits(force, np.concatenate((shift, turn)))


def small_move(spec: str, values: tuple[float, ...]) -> Floats:
    """The transform of `distance`: named directions of the controlled frame, mm and degrees. Shape (4, 4).

    Raises:
        MotionError: an unknown direction, or not one value for each.
    """
    parts = np.zeros(6)
    for direction, value in named_values("distance", spec, values, _DIRECTIONS).items():
        parts[direction] = value
    return transform(so3_exp(parts[3:] * RAD_PER_DEG), parts[:3] * M_PER_MM)
