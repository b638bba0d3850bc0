"""What a busy machine makes of a `FakeRobot`: it hears requests late, and loses streams that have just begun."""

from __future__ import annotations

from qrobot.faultcodes import FaultCode
from qrobot.wire import Mode
from tests.support.fake_robot import FakeRobot

LATE = 20  # samples; more than an answer may take, fewer than the same one may


def hear_power_late(robot: FakeRobot) -> None:
    """Its newest event tells why the program before was stopped, until it hears at sample `LATE` of the request."""

    def period(seq: int) -> None:
        if seq < LATE and robot.mode is Mode.POWERING:
            robot.mode = Mode.OFF
        elif seq == LATE:
            robot.mode, robot.event = Mode.POWERING, FaultCode.NONE

    robot.event, robot.before_period = FaultCode.STREAM_LOST, period


def lose_streams(robot: FakeRobot, count: int, stops: bool = False, move: float = 0.0, since: int = 0) -> None:
    """It loses `count` streams one after another, from sample `since` on, when it has just begun to follow them.

    Args:
        stops: it still brakes in the sample that tells so; otherwise it holds again.
        move: how far joint 1 has gone by then, rad.
    """
    left = iter(range(count))

    def period(seq: int) -> None:
        if robot.mode is Mode.STOPPING:
            robot.mode = Mode.HOLDING
        elif seq >= since and robot.mode is Mode.TRACKING and next(left, None) is not None:
            robot.halt(FaultCode.STREAM_LOST)
            robot.mode = Mode.STOPPING if stops else Mode.HOLDING
            robot.q = (robot.q[0] + move, *robot.q[1:])

    robot.before_period = period


def lose_power(robot: FakeRobot) -> None:
    """Somebody has taken its power: it brakes until sample `LATE`, and is off then."""

    def period(seq: int) -> None:
        if seq == LATE:
            robot.mode = Mode.OFF

    robot.mode, robot.before_period = Mode.STOPPING, period


def stop_power_up(robot: FakeRobot) -> None:
    """Somebody else has asked for its power, and somebody stops it before that is on, at sample `LATE`."""

    def period(seq: int) -> None:
        if seq < LATE:
            robot.mode, robot._powering = Mode.POWERING, 0
        elif seq == LATE:
            robot.mode, robot.event = Mode.OFF, FaultCode.POWER_STOPPED

    robot.mode, robot.before_period = Mode.POWERING, period
