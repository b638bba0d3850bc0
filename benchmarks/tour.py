"""Ten queued motions beside a conveyor, as the generator plans them and as its kernels alone walk them again.

    Z T6 E = CONV P_k        so that a setpoint is   T6 = Z^-1 CONV(t) P_k DRIVE(x(t)) E^-1

The generator plans and decides; the pieces it made of that are kept. `walk` then evaluates each piece, multiplies the
products, solves for the joints and judges the setpoint: the sample of the generator from the same kernels, without the
interpreter between them.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Final, NamedTuple

import numpy as np

from qrobot.arrays import Floats
from qrobot.config import load_robot
from qrobot.errors import MotionError
from qrobot.model.arm import Arm
from qrobot.model.kinematics import KinematicsParams
from qrobot.model.puma import OK, puma_inverse
from qrobot.model.transform import inverse, rot_z, transform
from qrobot.motion import (
    T6,
    ArmKinematics,
    Duration,
    Equation,
    Generator,
    MotionMode,
    MoveRequest,
    TransformKind,
    Trsf,
    kinematics_of,
    motion_limits,
)
from qrobot.motion.path.blend import PEAK, Blend, Correction
from qrobot.motion.path.path_piece import PathPiece, evaluate
from qrobot.motion.planning.setpoint_check import NONE, judge_rows
from qrobot.motion.world.drive_transform import drive_between
from qrobot.motion.world.product import multiply_chain
from qrobot.realtime.jit import lean_kernel

MOTIONS: Final = 10
PERIOD_S: Final = 0.001
DRIFT_M: Final = 0.05  # how far the conveyor goes meanwhile
CORNERS: Final = ((0.05, 0.04, 0.3), (0.05, -0.04, 0.0), (-0.05, -0.04, -0.3), (-0.05, 0.04, 0.0))  # m, m, rad
QUARTIC, SMOOTH, PEAK_SHARE = int(Blend.QUARTIC), int(Correction.SMOOTH), PEAK[Blend.QUARTIC]


class Tour(NamedTuple):
    """All that a sample needs; the kernel changes the scratch space alone.

    Attributes:
        rows, start, length: of the pieces; shapes (pieces, 5, 6), (pieces,), (pieces,), times in samples.
        place: which P each piece goes to. Shape (pieces,).
        piece: of each sample. Shape (samples,).
        q_before: the two setpoints before the first. Shape (2, 6).
        parts, inverted: Z, CONV and P; shapes (3, 4, 4), (3,).
        places: P_k. Shape (k, 4, 4).
        behind: E^-1. Shape (4, 4).
        params, branch, limits: of the arm.
        first: number of the first sample.
        speed: of the conveyor, m/sample.
    """

    rows: Floats
    start: Floats
    length: Floats
    place: Any
    piece: Any
    q_before: Floats
    parts: Floats
    inverted: Any
    places: Floats
    behind: Floats
    params: KinematicsParams
    branch: int
    limits: Floats
    first: int
    speed: float


@lean_kernel
def _copy(pose: Any, out: Any) -> None:
    for i in range(3):
        for j in range(4):
            out[i, j] = pose[i, j]


@lean_kernel
def _remember(recent: Any, q: Any) -> None:
    """Put `q` (n,) before the newest setpoints, newest first. Shape (3, n)."""
    for j in range(q.size):
        recent[2, j], recent[1, j], recent[0, j] = recent[1, j], recent[0, j], q[j]


@lean_kernel
def walk(tour: Tour, left: Any, state: Any, D: Any, T: Any, recent: Any, q: Any) -> int:
    """Fill in the setpoints `q` (samples, 6); the number of those that must not be.

    Scratch: left, D and T (4, 4), state and recent (3, 6).
    """
    failed = 0
    _remember(recent, tour.q_before[0])
    _remember(recent, tour.q_before[1])
    for i in range(tour.piece.size):
        piece, tick = tour.piece[i], tour.first + i
        tour.parts[1, 0, 3] = tour.speed * tick
        _copy(tour.places[tour.place[piece]], tour.parts[2])
        elapsed_s, length_s = (tick - tour.start[piece]) * PERIOD_S, tour.length[piece] * PERIOD_S
        evaluate(tour.rows[piece], QUARTIC, SMOOTH, length_s, elapsed_s, 1.0, 0.0, state)
        multiply_chain(tour.parts, tour.inverted, left)
        drive_between(left, state[0], False, tour.behind, D, T)
        status = puma_inverse(T, tour.params, tour.branch, recent[0], q[i])
        _remember(recent, q[i])
        failed += status != OK or judge_rows(recent, PERIOD_S, PERIOD_S, tour.limits, PEAK_SHARE) != NONE
    return failed


class Recorder(Generator):
    """Keeps what the samples were made of, from the first on that is relative to a position.

    Attributes:
        first: number of that sample.
        pieces: in turn.
        names: of the positions they go to.
        piece: of each sample.
        q: all setpoints, of samples before the first as well. Shape (n,) each.
    """

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self.first = 0
        self.pieces, self.names = list[PathPiece](), list[str]()
        self.piece, self.q = list[int](), list[Floats]()

    def record(self, tick: int) -> None:
        """Sample `tick`."""
        self.q.append(self.update(tick).q)
        if self.goal is None:
            return
        self.first = self.first or tick
        if not self.pieces or self._path.piece is not self.pieces[-1]:
            self.pieces.append(self._path.piece)
            self.names.append(self.goal.name)
        self.piece.append(len(self.pieces) - 1)


class Conveyor:
    """A frame that moves along x at constant speed."""

    def __init__(self, speed: float) -> None:
        self.tick, self._speed = 0, speed
        self.trsf = Trsf("CONV", TransformKind.FUNCTION, function=self._carry)

    def _carry(self, trsf: Trsf) -> None:
        trsf.value = transform(translation=[self._speed * self.tick, 0.0, 0.0])


def bench_arm() -> tuple[Arm, ArmKinematics, Floats]:
    """The PUMA, its kinematics and where it stands."""
    arm = Arm(load_robot("puma560"))
    kinematics = kinematics_of(arm)
    assert kinematics is not None, "the PUMA has a closed form"
    return arm, kinematics, np.array(arm.robot.poses["park"])


class World(NamedTuple):
    """The constant frames. Shapes (4, 4), and (k, 4, 4) of the P."""

    Z: Floats
    E: Floats
    places: Floats


def world_around(arm: Arm, q: Floats) -> World:
    """Frames such that the corners lie around where the arm is at `q` (n,)."""
    Z, E = transform(rot_z(0.4), [0.1, -0.2, 0.3]), transform(translation=[0.0, 0.0, 0.1])
    home = Z @ arm.forward(q) @ E
    corners = [CORNERS[k % len(CORNERS)] for k in range(MOTIONS)]
    return World(Z, E, np.array([home @ transform(rot_z(turn), [x, y, 0.0]) for x, y, turn in corners]))


def planned_tour(samples: int) -> tuple[Tour, Floats]:
    """The tour of so many samples, and the setpoints (samples, 6) that the generator gave.

    Raises MotionError: the generator came to rest before.
    """
    arm, kinematics, park = bench_arm()
    generator = Recorder(motion_limits(arm.robot), PERIOD_S, park, kinematics=kinematics)
    speed, world = DRIFT_M / samples, world_around(arm, park)
    conveyor = Conveyor(speed)
    for request in requests(world, conveyor.trsf, samples):
        generator.push(request)
    while len(generator.piece) < samples:
        conveyor.tick += 1
        generator.record(conveyor.tick)
        if generator.first and generator.goal is None:
            raise MotionError(f"the tour ended after {len(generator.piece)} of {samples} samples")
    tour = tour_of(generator, world, arm, int(kinematics.branch(park)), speed)
    return tour, np.array(generator.q[generator.first - 1 :])


def requests(world: World, conveyor: Trsf, samples: int) -> Iterator[MoveRequest]:
    """The motions, which share the samples."""
    z, e = Trsf("Z", TransformKind.CONST, world.Z), Trsf("E", TransformKind.CONST, world.E)
    speed = Duration(samples / MOTIONS * PERIOD_S)
    for k, place in enumerate(world.places):
        equation = Equation(str(k), [z, T6, e], [conveyor, Trsf("P", TransformKind.CONST, place)], e)
        yield MoveRequest(str(k), equation.goal(), speed, mode=MotionMode.CARTESIAN)


def tour_of(generator: Recorder, world: World, arm: Arm, branch: int, speed: float) -> Tour:
    """What was recorded, for `walk`."""
    pieces, first = generator.pieces, generator.first
    return Tour(
        rows=np.array([piece.rows for piece in pieces]),
        start=np.array([piece.start for piece in pieces]),
        length=np.array([piece.length for piece in pieces]),
        place=np.array([int(name) for name in generator.names]),
        piece=np.array(generator.piece),
        q_before=np.array(generator.q[first - 3 : first - 1]),
        parts=np.array([world.Z, np.eye(4), np.eye(4)]),
        inverted=np.array([True, False, False]),
        places=world.places,
        behind=inverse(world.E),
        params=arm.params,
        branch=branch,
        limits=motion_limits(arm.robot).table,
        first=first,
        speed=speed,
    )


def walk_again(tour: Tour) -> tuple[int, Floats]:
    """`walk` with scratch space of its own: failures and setpoints."""
    q = np.empty((tour.piece.size, 6))
    return walk(tour, *scratch(), q), q


def scratch() -> tuple[Floats, ...]:
    """left, state, D, T and recent for `walk`."""
    return tuple(np.zeros(shape) for shape in ((4, 4), (3, 6), (4, 4), (4, 4), (3, 6)))
