"""All the arithmetic of an identification, from the rows of a log to what they tell."""

from __future__ import annotations

from qrobot.config import Robot
from qrobot.errors import IdentificationError
from qrobot.ident.base import base_of_robot
from qrobot.ident.change import counter_slip, load_change
from qrobot.ident.exchanged import check_torques
from qrobot.ident.inertia import InertialModel, identify_inertia
from qrobot.ident.model import Identified, identify
from qrobot.ident.motion import observe_motion
from qrobot.ident.observe import Observer
from qrobot.ident.physical_gravity import with_gravity
from qrobot.ident.recording import check_recording
from qrobot.ident.regressor import gravity_regressor, inertial_regressor
from qrobot.ident.terms import FrictionTermKind
from qrobot.servo.memory.telemetry import Rows


def identify_log(
    robot: Robot,
    rows: Rows,
    period_s: float,
    loaded: Rows | None = None,
    known_torque: bool = False,
    load_kg: float | None = None,
    kinds: tuple[FrictionTermKind, ...] | None = None,
) -> Identified:
    """Gravity, friction and torque scales from a log; rows of several logs may follow each other.

    Twice: the inertial torque is taken off first with the links of the robot file, then with those found.

    Args:
        robot: the robot file.
        rows: of the arm with an empty hand, or with what it always carries. Shape (r,).
        period_s: from row to row.
        loaded: rows of the same arm with a load besides, recorded afterwards, which is sought too.
        known_torque: no torque scales are sought, see `identify`.
        load_kg: mass of that load, if it was weighed: then torque scales are of true torque.
        kinds: of terms of friction that are sought of every motor (`ident.terms`); default those that residuals show.

    Raises:
        IdentificationError: the rows do not tell them, no bodies have that gravity, or the recording is bad: an encoder
            that stands still, a joint at its torque limit, a load that changed half way.
    """
    for log in (rows,) if loaded is None else (rows, loaded):
        check_recording(robot, log, period_s)
    regressor = gravity_regressor(robot)
    base = base_of_robot(robot, regressor)

    def found(observer: Observer) -> Identified:
        observations = observer.observe(rows, period_s)
        check_torques(robot, observations)
        if loaded is not None:
            observations = observations.followed_by(observer.observe(loaded, period_s, loaded=True))
        return identify(robot, base, regressor, observations, known_torque, load_kg, kinds)

    first = found(Observer(robot, regressor, base))
    better = with_gravity(robot, base, first.beta)
    return _unchanged(found(Observer(robot, regressor, base, better, first.scale)))


def inertia_of_log(found: Identified, rows: Rows, period_s: float) -> InertialModel:
    """Inertia beside what was found, from a log of fast motion of the same arm with the same in its hand.

    Args:
        found: gravity, friction and torque scales of the arm.
        rows: of the runs of `ident.excitation`. Shape (r,).
        period_s: from row to row.

    Raises:
        IdentificationError: the recording is bad, its motions do not tell everything, or no bodies have what they tell.
    """
    check_recording(found.robot, rows, period_s)
    regressor = inertial_regressor(found.robot)
    base = base_of_robot(found.robot, regressor)
    return identify_inertia(found, regressor, base, observe_motion(found.robot, regressor, base, rows, period_s))


def _unchanged(found: Identified) -> Identified:
    """The same, if the hand carried the same from beginning to end and no counter slipped.

    Raises:
        IdentificationError: names what changed, and when.
    """
    if (slip := counter_slip(found)) is not None:
        raise IdentificationError(
            f"from {slip.time_s:.0f} s on the counter of {found.robot.joint_names[slip.motor]} is off by some "
            f"{slip.counts:+.0f} counts, as gravity shows: look at encoder and coupling, calibrate, and record again"
        )
    change = load_change(found)
    if change is not None:
        raise IdentificationError(
            f"from {change.time_s:.0f} s on the hand carries {change.kg:+.1f} kg: something was dropped or taken up. "
            "Record again, or fit what was recorded before and after it by themselves"
        )
    return found
