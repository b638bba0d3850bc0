"""The parameters of motions: the calls that set them for all following motions, or for the next one alone.

Every call only fills in a `MoveRequest` (Hayward & Paul 1986, section 3.2). Units of the papers: mm, degrees, ms.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from qrobot.arrays import Floats
from qrobot.errors import ConfigError, MotionError
from qrobot.model.branch import Branch, branch_of
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
from qrobot.rccl.arguments import (
    FORCES,
    force_limits,
    milliseconds,
    named_values,
    require_function,
    small_move,
)
from qrobot.rccl.position import Position
from qrobot.rci.arguments import numbers
from qrobot.units import M_PER_MM, RAD_PER_DEG

DEFAULT_SPEED: Final = SpeedShare(0.3)
_MODES: Final = {
    "joint": MotionMode.JOINT,
    "j": MotionMode.JOINT,
    "cartesian": MotionMode.CARTESIAN,
    "c": MotionMode.CARTESIAN,
}
_TURNS: Final = {turn.value: turn for turn in OrientationInterpolation}


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

    def over(self, refused: NextMoveOptions) -> NextMoveOptions:
        """Options of the motion that was `refused`, with these in place of those that were said anew."""
        said = {name: value for name, value in vars(self).items() if value is not None}
        anew = [update.trsf for update in self.updates]
        kept = (update for update in refused.updates if not any(update.trsf is trsf for trsf in anew))
        return replace(refused, **{**said, "updates": (*kept, *self.updates)})


class MotionParameters:
    """The calls that say how motions are to go; `Channel` inherits them, and C programs call them too."""

    def __init__(self) -> None:
        self._next = NextMoveOptions()
        self._refused: tuple[Position, NextMoveOptions] | None = None  # and what was said for the motion to it
        self._speed: MotionSpeed = DEFAULT_SPEED
        self._mode = MotionMode.JOINT
        self._turn = OrientationInterpolation.ONE_AXIS
        self._branch: Branch | None = None
        self._drift = Drift()
        self._compliance: Compliance | None = None

    # ---------------------------------------------------------------------------------------- all following motions

    def setmode(self, mode: str, turn: str = "axis") -> None:
        """Choose the coordinates in which the following motions are straight: the joints', or the controlled frame's.

        Positions that are given by their joints are gone to in joint mode always.

        Args:
            mode: "joint" or "cartesian", or their first letters.
            turn: how the controlled frame turns in Cartesian mode: about one "axis" on the shortest way, as the
                interpolation of quaternions does, or in the two "angles" of Paul's older drive.

        Raises:
            MotionError: neither.
        """
        if mode not in _MODES:
            raise MotionError(f"mode {mode!r} is neither 'joint' nor 'cartesian'")
        if turn not in _TURNS:
            raise MotionError(f"turn {turn!r} is neither {' nor '.join(map(repr, _TURNS))}")
        self._mode, self._turn = _MODES[mode], _TURNS[turn]

    def setvel(self, tv: float, rv: float) -> None:
        """Speed of the controlled frame in the following motions of either mode: mm/s and degrees/s.

        Raises:
            MotionError: it is no speed.
        """
        tv, rv = numbers("setvel", tv, rv)
        self._speed = ToolSpeed(tv * M_PER_MM, rv * RAD_PER_DEG)

    def setjvel(self, speed: float | None = None, *, share: float | None = None) -> None:
        """Speed of the following motions; ours, not historical.

        Args:
            speed: of the fastest joint, rad/s (m/s on a sliding joint).
            share: of its own limit that the busiest joint uses, above 0 to 1.

        Raises:
            MotionError: not exactly one of them is given, or it is no speed.
        """
        if (speed is None) == (share is None):
            raise MotionError("setjvel takes either a speed or a share")
        (value,) = numbers("setjvel", share if speed is None else speed)
        self._speed = SpeedShare(value) if speed is None else JointSpeed(value)

    def setconf(self, letters: str) -> None:
        """Configuration at the goals of the following motions, as in "lun"; "" keeps the present one.

        Raises:
            MotionError: unknown letters.
        """
        if not isinstance(letters, str):
            raise MotionError(f'setconf: letters are needed, as in "lun", not {letters!r}')
        try:
            self._branch = branch_of(letters) if letters else None
        except ConfigError as error:
            raise MotionError(str(error)) from error

    def comply(self, dirs: str, *values: float) -> None:
        """Give way along or about `dirs` from the next motion on, exerting `values` there, until they are locked.

        The axes are those of the controlled frame of each motion; along all others the goal remains exact. One joint
        per direction leaves its position servo for it.

        Args:
            dirs: out of fx fy fz (N) and mx my mz (N m), as in "fx fz".
            values: what the arm exerts, one for each.

        Raises:
            MotionError: an unknown direction, or not one value for each; or nobody knows the arm's torques, or the arm
                carries a load that this program has not told. `move` raises it when no joints match the directions at
                the goal, or when they are too weak for the forces.
        """
        asked = named_values("comply", dirs, values, FORCES)
        self._require_forces("comply")
        before = self._compliance
        wrench = np.zeros(len(FORCES)) if before is None else before.wrench.copy()
        axes = set() if before is None else set(before.axes)
        for axis, value in asked.items():
            wrench[axis] = value
        self._compliance = Compliance(wrench, tuple(sorted(axes | set(asked))), self._drift)

    def lock(self, dirs: str) -> None:
        """Hold position again along or about `dirs` from the next motion on, from where they have drifted to.

        Raises:
            MotionError: the arm does not comply there.
        """
        nothing = (0.0,) * len(str(dirs).split())
        locked = set(named_values("lock", dirs, nothing, FORCES))
        before = () if self._compliance is None else self._compliance.axes
        if self._compliance is None or not locked <= set(before):
            complying = " ".join(FORCES[axis] for axis in before) or "nothing"
            raise MotionError(f"lock({dirs!r}): the arm complies along {complying}")
        axes = tuple(axis for axis in before if axis not in locked)
        wrench = np.where(np.isin(np.arange(len(FORCES)), axes), self._compliance.wrench, 0.0)
        self._compliance = Compliance(wrench, axes, self._drift) if axes else None

    # ---------------------------------------------------------------------------------------- the next motion alone

    def setime(self, ta: float, ts: float) -> None:
        """Times of the next motion alone: `ta` of its transition (half its length), `ts` of the segment, in ms."""
        self._set_next(setime=milliseconds(ta, ts))

    def evalfn(self, function: Callable[[], object]) -> None:
        """A function to be called at each sample of the next motion alone; a true result ends it with that code."""
        require_function("evalfn", function)
        self._set_next(evalfn=function)

    def distance(self, spec: str, *values: float) -> None:
        """Modify the goal of the next motion alone in its controlled frame: `distance("dz", -10)` backs up 10 mm.

        Args:
            spec: directions out of dx dy dz (mm) and rx ry rz (a turn about them, degrees).
            values: one for each.

        Raises:
            MotionError: an unknown direction, or not one value for each.
        """
        self._set_next(distance=small_move(spec, values))

    def limit(self, spec: str, *values: float) -> None:
        """End the next motion alone when the arm surely exerts more, or is pushed farther off, than `values`.

        Its position then has the code FORCE_LIMIT or MOTION_LIMIT of `Termination`. "Surely" means beyond what
        friction may falsify; see `exerted`.

        Args:
            spec: out of fx fy fz (N), mx my mz (N m) and dx dy dz (mm), rx ry rz (degrees), in the controlled frame.
            values: one for each.

        Raises:
            MotionError: an unknown direction, or not one positive value for each; or a force, and nobody knows the
                arm's torques, or the arm carries a load that this program has not told.
        """
        limits = force_limits(spec, values)
        if np.isfinite(limits.force).any():
            self._require_forces("limit")
        self._set_next(limit=limits)

    def _require_forces(self, call: str) -> None:
        """Raise MotionError for a call that acts by what the arm exerts, and that cannot be known."""

    def _update_next(self, trsf: Trsf, position: Position) -> None:
        """Have the next motion update `trsf`. Raises MotionError: it is to do that already."""
        if any(known.trsf is trsf for known in self._next.updates):
            raise MotionError(
                f"update({trsf.name}, {position.name}): the next motion has to update {trsf.name} already; "
                "call `move` between the two"
            )
        self._next = replace(self._next, updates=(*self._next.updates, Update(trsf, position.equation)))

    def _set_next(self, **options: Any) -> None:
        self._next = replace(self._next, **options)

    def _order(self, position: Position) -> MoveOrder:
        """The motion that a call of `move` asks for; what was said for it counts again if it is not `_taken`."""
        options = self._next
        if self._refused is not None and self._refused[0] is position:
            options = options.over(self._refused[1])
        self._refused, self._next = (position, options), NextMoveOptions()
        speed, ta = (self._speed, None) if options.setime is None else (Duration(options.setime[1]), options.setime[0])
        goal = _goal(position, options.distance, self._compliance)
        request = MoveRequest(
            position.name, goal, speed, ta, self._mode, self._branch, options.evalfn, options.limit, self._turn
        )
        return MoveOrder(request, position, options.updates)

    def _taken(self) -> None:
        """Use up what was said for the motion: it was not refused."""
        self._refused = None


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
