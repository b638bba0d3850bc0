"""Connection of a program to a channel: everything compiled, connected, the right robot, under control."""

from __future__ import annotations

from collections.abc import Callable

from qrobot.config import Robot, load_robot
from qrobot.fences.in_force import fences_for
from qrobot.model.arm import Arm
from qrobot.motion import Blend, kinematics_of, motion_limits, warm_up, warm_up_cartesian, warm_up_force
from qrobot.rccl.arguments import sample_period_us
from qrobot.rccl.channel import Channel
from qrobot.rccl.task import TrajectoryTask
from qrobot.rccl.trace import Trace, add_trace
from qrobot.rci import LinkFactory, hello_for
from qrobot.rci.link import check_welcome
from qrobot.realtime.interpreter import prepare_interpreter


def open_channel(
    factory: LinkFactory,
    robot: str | Robot,
    period_ms: float | None = None,
    clear_fault: bool = False,
    blend: Blend = Blend.QUARTIC,
    traces: list[Trace] | None = None,
    prepare: Callable[[TrajectoryTask], object] = lambda _task: None,
) -> Channel:
    """Connect to `robot` and take control; see `control`.

    A trace of what is done with it is added to `traces`; `prepare` is called with its task before that runs.
    """
    period_us = 0 if period_ms is None else sample_period_us("control", period_ms)
    arm = load_robot(robot) if isinstance(robot, str) else robot
    fences = fences_for(arm.name)
    _warm_up(arm, blend)
    link = factory(hello_for(arm.name, period_us))
    if not link.virtual_time:
        prepare_interpreter()
    try:
        welcome = link.open()
        check_welcome(welcome, arm, "the program")
        trace = add_trace(traces, arm, welcome.period_us)
        task = TrajectoryTask(arm, welcome.period_us * 1e-6, clear_fault, blend, trace, fences)
        prepare(task)
        return Channel(arm, link, task, traces).start()
    except BaseException as error:
        link.close(str(error))
        raise


def compile_joint_motion(robot: str) -> None:
    """The part of `compile_motion` that needs no pose of the arm, the smaller one."""
    _warm_up_joints(load_robot(robot), Blend.QUARTIC)


def compile_motion(robot: str) -> None:
    """Compile what a program moves `robot` by, ahead of it. Raises ConfigError when there is no such robot."""
    _warm_up(load_robot(robot), Blend.QUARTIC)


def _warm_up(robot: Robot, blend: Blend) -> None:
    """No sample may wait for the compiler."""
    _warm_up_joints(robot, blend)
    if (kinematics := kinematics_of(Arm(robot))) is not None:
        warm_up_cartesian(motion_limits(robot), kinematics, robot.poses["park"], blend)


def _warm_up_joints(robot: Robot, blend: Blend) -> None:
    warm_up(robot.n, blend)
    warm_up_force(robot)
