"""The path of one arm, piece by piece: the segment being followed, and how it is entered and left.

Path time is counted in samples. Every piece begins exactly where, and as fast as, the one before it is at that instant.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from qrobot.arrays import Floats
from qrobot.motion.path.coordinates import JOINTS, Coordinates
from qrobot.motion.path.path_piece import BlendSettings, PathPiece, piece_from_state, piece_joining_line, rest
from qrobot.motion.path.phase import TRANSITIONS, Phase, PhaseStep
from qrobot.motion.path.segment import Segment


class Path:
    """Desired position of the arm, as a function of path time.

    Args:
        q: where it stands at path time 0. Shape (n,).
        settings: of the pieces.

    Attributes:
        phase: how the arm is moved at present.
        coordinates: of the present piece.
        piece: the piece being followed.
        segment: the request being served, None at rest.
        settings: of the pieces.
    """

    def __init__(self, q: Floats, settings: BlendSettings) -> None:
        self.phase = Phase.RESTING
        self.coordinates: Coordinates = JOINTS
        self.piece = rest(np.array(q, dtype=np.float64), 0.0)
        self.segment: Segment | None = None
        self.settings = settings

    def state(self, clock: float, rate: float = 1.0, slope: float = 0.0) -> Floats:
        """Coordinates, velocity and acceleration; shape (3, m), SI units.

        Path time passes at `rate` (1: as fast as time), which changes by `slope` per sample.
        """
        return self.piece.state(clock, self.settings, rate, slope / self.settings.period_s)

    def joints(self, clock: float) -> Floats:
        """Joint positions (n,) at the newest sample. Raises Unreachable, JointLimit or Singular."""
        return self.coordinates.solve_next(self.state(clock)[0])

    def goal_joints(self, near: Floats) -> Floats:
        """Joint positions (n,) at the end of the present segment, or where the arm rests. Raises as `joints`.

        Where several are possible, whole turns apart or more, those to which the way leads; at rest, and with a goal
        that moves, those nearest to `near` (n,), where the arm is.
        """
        segment = self.segment
        if segment is None:
            return self.coordinates.solve_at(self.piece.rows[0], near)
        return self.coordinates.solve_at(segment.target, segment.end_joints if self.coordinates.fixed else near)

    def hold(self, x: Floats, clock: float) -> None:
        """Stand at `x` (m,): still, or with the goal when the goal moves."""
        self._take(PhaseStep.REST)
        self.piece, self.segment = rest(x, clock), None

    def rest_on(self, coordinates: Coordinates, clock: float) -> None:
        """Stand at the goal of Cartesian `coordinates`, at rest until now."""
        self.coordinates, self.piece = coordinates, rest(np.zeros(6), clock)

    def rest_at(self, q: Floats, clock: float) -> None:
        """Stand at the joint positions `q` (n,), at rest until now."""
        self.coordinates, self.piece = JOINTS, rest(q, clock)

    def enter(self, segment: Segment, begin: float, state: Floats) -> None:
        """Turn into `segment`, beginning at path time `begin` with `state` (3, m) in the segment's coordinates."""
        self._take(PhaseStep.ENTER)
        self.piece = piece_joining_line(
            state, segment.via, segment.begin, segment.velocity, begin, 2.0 * segment.schedule.transition,
            self.settings.period_s,
        )  # fmt: skip
        self.coordinates, self.segment = segment.coordinates, segment

    def end_segment(self, segment: Segment, begin: float) -> None:
        """Turn into the transition to rest at the target of `segment`, the present one."""
        self._take(PhaseStep.END)
        self.piece = self._piece_to_rest(segment, begin)

    def begin_path_stop(self) -> None:
        """Stay on the path, while path time slows down."""
        self._take(PhaseStep.PATH_STOP)

    def begin_joint_stop(self, state: Floats, clock: float, length: float, fading: Floats) -> None:
        """Bring the joints to rest from `state` (3, n) within `length` samples, wherever that is.

        Their accelerations fade out in the shares `fading` (n,) of that.
        """
        self._take(PhaseStep.JOINT_STOP)
        self.coordinates = JOINTS
        self.piece = piece_from_state(state, np.zeros_like(state[1]), clock, length, fading)

    def states_ahead(self, moments: Iterator[tuple[float, float, float]]) -> Iterator[Floats]:
        """States (3, m) at future (path time, rate, slope per sample), if nothing follows the present segment.

        Of an arm that is on its path: not in a joint stop.
        """
        final, final_from = self.piece, float("inf")
        if self.segment is not None and not self.phase.ending:
            final_from = self.segment.rest_begin
            final = self._piece_to_rest(self.segment, final_from)
        for clock, rate, slope in moments:
            piece = final if clock >= final_from else self.piece
            yield piece.state(clock, self.settings, rate, slope / self.settings.period_s)

    def _piece_to_rest(self, segment: Segment, begin: float) -> PathPiece:
        length = (1.0 if segment.dwells else 2.0) * (segment.end - begin)
        return piece_from_state(self.state(begin), np.zeros_like(segment.velocity), begin, length)

    def _take(self, step: PhaseStep) -> None:
        self.phase = TRANSITIONS[self.phase][step]
