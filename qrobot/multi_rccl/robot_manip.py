"""One arm of a Multi-RCCL program: a channel of RCCL in the company of others."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Final

import numpy as np

from qrobot.arrays import Floats
from qrobot.errors import LinkError, MotionError
from qrobot.model.arm import Arm
from qrobot.model.transform import inverse, so3_log
from qrobot.motion import Equation
from qrobot.multi_rccl.manip import Manip, absolute_stop, follows
from qrobot.multi_rccl.moving_transform import MovingTransform
from qrobot.multi_rccl.positions import goal_for
from qrobot.rccl import Channel, Position
from qrobot.rccl.connect import open_channel
from qrobot.rccl.event import Event
from qrobot.rccl.program import traces_wanted
from qrobot.rccl.task import TrajectoryTask
from qrobot.rccl.task_group import TaskGroup
from qrobot.rci import LinkFactory
from qrobot.rci.robot_data import KnownRobot
from qrobot.units import DEG_PER_RAD, MM_PER_M, RAD_PER_DEG

NEAR_M: Final = 0.005  # and a degree: a position that an arm can be said to be at [A]

OpenChannel = Callable[..., Channel]


class RobotManip(Manip):
    """See `Manip`.

    Args:
        known: its name, its file and its bridge.
        factory: makes the link to it.
        group: the program's arms.

    Attributes:
        bridge: address of its bridge, "" for where the program's is.
    """

    def __init__(self, known: KnownRobot, factory: LinkFactory, group: TaskGroup) -> None:
        name, robot, self.bridge = known.name, known.file, known.bridge
        self.name, self.completed = name, Event(f"{name}.completed")
        self.trans = MovingTransform(f"{name}.trans", name)
        self._open: OpenChannel = partial(
            open_channel, factory, robot, traces=traces_wanted(), prepare=self._prepare, bridge=known.place
        )
        self._group = group
        self._channel: Channel | None = None
        self._task: TrajectoryTask | None = None
        self._arm: Arm | None = None
        self._j6 = np.zeros(0)
        self._tracks = self._track_next = False

    # ------------------------------------------------------------------------------------------- from the program

    def control(self, clear_fault: bool, period_ms: float | None) -> None:
        """See `Manip.control`."""
        if self.on:
            raise MotionError(f"{self.name} is under control already")
        if period_ms is None and self._group.period_s:
            period_ms = self._group.period_s * 1e3
        self._channel = self._open(period_ms=period_ms, clear_fault=clear_fault)
        self.completed = self._channel.completed

    def release(self, power_off: bool) -> None:
        """Let go of the arm; see `Channel.release`."""
        if self._channel is not None:
            self._channel.release(power_off)

    @property
    def on(self) -> bool:
        """True while it is under control."""
        return self._channel is not None and not self._channel.released

    @property
    def begun(self) -> bool:
        """True once it has been under control."""
        return self._channel is not None

    @property
    def channel(self) -> Channel:
        """The arm under control. Raises LinkError before `control` and after `release`."""
        if self._channel is None or self._channel.released:
            raise LinkError(f"{self.name} is not under control; call rccl_control first")
        return self._channel

    @property
    def task(self) -> TrajectoryTask:
        """Its trajectory task, also after `release`. Raises LinkError before `control`."""
        if self._task is None:
            raise LinkError(f"{self.name} is not under control; call rccl_control first")
        return self._task

    @property
    def parameters(self) -> Channel:
        """See `Manip.parameters`."""
        return self.channel

    @property
    def j6(self) -> Floats:
        """Joint positions at the newest sample, as they are sent: degrees (mm on a sliding joint). Shape (n,).

        Raises LinkError before `control`.
        """
        units = np.where(self.task.robot.prismatic, MM_PER_M, DEG_PER_RAD)
        return np.asarray(self._j6 * units)

    @property
    def sample(self) -> int:
        """Number of its newest sample: samples of two arms that have the same number are of one instant.

        Where their bridges share no clock they are less than a sample period apart. Raises LinkError before `control`.
        """
        return self.task.tick

    @property
    def eventful(self) -> bool:
        """See `Manip.eventful`."""
        return self._task is not None and self._task.eventful

    @property
    def waiting(self) -> int:
        """See `Manip.waiting`."""
        return 0 if self._task is None or not self.on else self._task.generator.waiting

    def skip(self, code: int) -> None:
        """See `Manip.skip`."""
        self.channel.nextmove(code)

    def check(self) -> None:
        """See `Manip.check`."""
        if self._channel is not None and self.on:
            self._channel.check()

    def move(self, position: Position) -> None:
        """See `Manip.move`."""
        goal_for("move", position, self.trans, self.name)
        self._go(position, self._track_next)

    def _go(self, position: Position, tracks: bool) -> None:
        with self._group.sampled:
            self.channel.move(position)
            self._tracks, self._track_next = tracks, False

    def stand(self, ms: float) -> None:
        """See `Manip.stand`."""
        with self._group.sampled:
            self.channel.check()
            self.task.push(absolute_stop(ms))

    def cancel(self, ms: float) -> None:
        """See `Manip.cancel`."""
        self.channel.stop(ms)

    def maintain(self, position: Position) -> None:
        """See `Manip.maintain`. Raises MotionError: the arm is not there."""
        goal_for("maintain", position, self.trans, self.name)
        with self._group.sampled:
            self._require_near(position)
            self._go(position, tracks=True)

    def track(self) -> None:
        """See `Manip.track`."""
        self._track_next = True

    def _require_near(self, position: Position) -> None:
        if not isinstance(position.target, Equation):
            raise MotionError(f"maintain: position {position.name} is given by joints; only an equation can move")
        if self.eventful:
            raise MotionError(f"maintain: {self.name} still moves; wait for `completed` first")
        away = inverse(self.trans.value) @ position.equation.goal().pose(self._group.tick)
        far, turned = float(np.linalg.norm(away[:3, 3])), float(np.linalg.norm(so3_log(away[:3, :3])))
        if far > NEAR_M or turned > RAD_PER_DEG:
            where = f"{far * MM_PER_M:.1f} mm and {turned * DEG_PER_RAD:.1f} degrees from {position.name}"
            raise MotionError(f"maintain: {self.name} is {where}; move there first, an arm cannot be put")

    # -------------------------------------------------------------------------------------------- once per sample

    def _prepare(self, task: TrajectoryTask) -> None:
        """Have its samples count as those of the others."""
        self._task, self._arm = task, Arm(task.robot)
        task.group, task.generated = self._group, self._generated
        self._group.arms[self.trans] = task
        task.td.name = self.name

    def _generated(self, q: Floats) -> None:
        task, arm = self._task, self._arm
        if task is None or arm is None:
            return
        self._j6 = np.array(q)
        self.trans.record(task.tick, arm.forward(q))
        if not self._tracks and follows(task.generator):
            task.push(absolute_stop())
