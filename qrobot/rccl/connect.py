"""Connection of a program to a channel: everything compiled, connected, the right robot, under control."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final
from weakref import WeakValueDictionary

from qrobot.config import Robot, load_robot
from qrobot.errors import ConfigError
from qrobot.fences.fence_set import FenceSet
from qrobot.fences.in_force import fences_for
from qrobot.model.arm import Arm
from qrobot.motion import Blend, kinematics_of, motion_limits, warm_up, warm_up_cartesian, warm_up_force
from qrobot.rccl.arguments import sample_period_us
from qrobot.rccl.channel import Channel
from qrobot.rccl.task import TrajectoryTask
from qrobot.rccl.trace import Trace, add_trace
from qrobot.rci import Link, LinkFactory, TcpLink, hello_for
from qrobot.rci.descriptor import HOST
from qrobot.rci.link import check_welcome
from qrobot.rci.processor_names import cpu_of
from qrobot.realtime.interpreter import prepare_interpreter

_compiled: Final = WeakValueDictionary[tuple[int, Blend], Robot]()
"""Robots that `compile_all` has moved, by their identity and the blend: programs take an arm again and again."""


def open_channel(
    factory: LinkFactory,
    robot: str | Robot,
    period_ms: float | None = None,
    clear_fault: bool = False,
    blend: Blend = Blend.QUARTIC,
    traces: list[Trace] | None = None,
    prepare: Callable[[TrajectoryTask], object] = lambda _task: None,
    processor: str = HOST,
    bridge: str = "",
) -> Channel:
    """Connect to `robot` and take control; see `control`.

    A trace of what is done with it is added to `traces`; `prepare` is called with its task before that runs. `bridge`
    is the address in full at which the program names the arm, "" where it does not.
    """
    if apart := processor != HOST:
        cpu_of(processor)  # which refuses one that is not there
    period_us = 0 if period_ms is None else sample_period_us("control", period_ms)
    arm = load_robot(robot) if isinstance(robot, str) else robot
    link = factory(hello_for(arm.name, period_us))
    fences = fences_for(arm.name, bridge)
    if apart and not link.virtual_time:
        return _open_apart(link, arm, clear_fault, blend, processor, fences)
    compile_all(arm, blend)
    if not link.virtual_time:
        prepare_interpreter()
    try:
        welcome = link.open()
        check_welcome(welcome, arm, "the program")
        trace = add_trace(traces, arm, welcome.period_us)
        task = TrajectoryTask(arm, welcome.period_us * 1e-6, clear_fault, blend, trace, fences)
        prepare(task)
        return Channel(arm, link, task, traces, calls_functions=not apart).start()
    except BaseException as error:
        link.close(str(error))
        raise


def _open_apart(
    link: Link, robot: Robot, clear_fault: bool, blend: Blend, processor: str, fences: FenceSet | None
) -> Channel:
    from qrobot.rccl.process.opening import open_apart

    if not isinstance(link, TcpLink):
        raise ConfigError(f"processor {processor!r}: another process reaches the robot by its bridge alone")
    return open_apart(link, robot, clear_fault, blend, processor, fences)


def compile_joint_motion(robot: str) -> None:
    """The part of `compile_motion` that needs no pose of the arm, the smaller one."""
    _warm_up_joints(load_robot(robot), Blend.QUARTIC)


def compile_motion(robot: str) -> None:
    """Compile what a program moves `robot` by, ahead of it. Raises ConfigError when there is no such robot."""
    arm = load_robot(robot)
    compile_all(arm, Blend.QUARTIC)
    if arm.shape is not None:
        FenceSet(arm, []).compiled()


def compile_all(robot: Robot, blend: Blend) -> None:
    """Compile what moves `robot` by this blend, once: no sample may wait for the compiler."""
    if (id(robot), blend) in _compiled:
        return
    _warm_up_joints(robot, blend)
    if (kinematics := kinematics_of(Arm(robot))) is not None:
        warm_up_cartesian(motion_limits(robot), kinematics, robot.poses["park"], blend)
    _compiled[id(robot), blend] = robot


def _warm_up_joints(robot: Robot, blend: Blend) -> None:
    warm_up(robot.n, blend)
    warm_up_force(robot)
