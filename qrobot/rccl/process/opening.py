"""Taking control of an arm by a generator in a process of its own, and the program's driver and link of it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from typing import cast

from qrobot.config import Robot
from qrobot.errors import LinkError, LocalProtocolError
from qrobot.fences.fence_set import FenceSet
from qrobot.motion import Blend
from qrobot.rccl.arm_session import ArmSession
from qrobot.rccl.channel import Channel
from qrobot.rccl.process.generator_host import GeneratorOptions
from qrobot.rccl.process.generator_process import LOOK_S, GeneratorProcess
from qrobot.rccl.process.remote_task import RemoteTask
from qrobot.rccl.task import TrajectoryTask
from qrobot.rci import TcpLink, arm_tasks
from qrobot.rci.client import Beside, ServoLoss
from qrobot.rci.processor_names import claim_processor, cpu_of
from qrobot.rci.robot_samples import told_later
from qrobot.wire import Command, State, Welcome


def open_apart(
    link: TcpLink, robot: Robot, clear_fault: bool, blend: Blend, processor: str, fences: FenceSet | None
) -> Channel:
    """Take control of `robot` at the far end of `link`, which is not opened here, inside its `fences`; see `control`.

    Raises:
        ConfigError: no such processor. LinkBusy: another program has it.
        QRobotError: what `control` raises.
    """
    cpu = cpu_of(processor)
    process = GeneratorProcess(None if cpu is None else claim_processor(processor))
    remote = RemoteLink(link, process)
    try:
        welcome: Welcome = process.ask(
            "open", GeneratorOptions(robot, link.hello, link.address, link.answer_s, clear_fault, blend, cpu, fences)
        )
        task = RemoteTask(robot, welcome.period_us * 1e-6, process, processor, fences)
        local = cast(TrajectoryTask, task)  # as far as a channel knows it (tests/unit/rccl/test_remote_task.py)
        session = ArmSession(robot.name, remote, local, lambda: RemoteDriver(process, task))
        session.settings.accepted = lambda collision: process.ask("tell_again", collision)
        return Channel(robot, remote, local, session=session, calls_functions=False).start()
    except BaseException as error:
        remote.close(str(error))
        raise


class RemoteDriver:
    """See `SampleDriver`: a thread of another process answers every STATE.

    Args:
        process: of that thread.
        task: as the program sees it.
    """

    share = None

    def __init__(self, process: GeneratorProcess, task: RemoteTask) -> None:
        self._process, self._task = process, task

    @property
    def error(self) -> BaseException | None:
        """See `SampleDriver.error`."""
        return self._process.error

    def start(self) -> None:
        """See `SampleDriver.start`."""
        self._task.td.begin()
        arm_tasks.hold(self._task.td)
        self._process.ask("start")

    def fail(self, error: BaseException) -> None:
        """See `SampleDriver.fail`."""
        with self._process.sampled:
            self._process.fail(told_later(error))

    @contextmanager
    def _locked(self) -> Iterator[None]:
        with self._process.sampled:
            yield
            self._task.tell_changes()

    def lock(self) -> AbstractContextManager[object]:
        """The lock between program and reports; what the program changes in `chg` with it is handed over at its end."""
        return self._locked()

    def wait(self, predicate: Callable[[], bool], ours: bool = False) -> None:  # noqa: ARG002 (all are asked in the program's thread)
        """See `SampleDriver.wait`; `predicate` is asked at each report, which may be of several samples."""
        with self._process.sampled:
            while not predicate():
                if self._process.error is not None:
                    raise self._process.error
                self._process.sampled.wait(LOOK_S)

    def end(self) -> None:
        """See `SampleDriver.end`."""
        arm_tasks.let_go(self._task.td)
        with suppress(LinkError):  # then it has ended already
            self._process.ask("end")


class RemoteLink:
    """The link that the generator's process has to the bridge; see `Link`.

    Args:
        link: how it was to be opened.
        process: that has opened it.
    """

    virtual_time = False

    def __init__(self, link: TcpLink, process: GeneratorProcess) -> None:
        self._link, self._process = link, process

    def open(self) -> Welcome:
        """Refuse: it is open."""
        raise LocalProtocolError("the generator's process has opened the link")

    def exchange(self, command: Command | None) -> State:  # noqa: ARG002
        """Refuse: the program takes no part in it."""
        raise LocalProtocolError("the generator's process answers the robot")

    def tell(self, packet: Beside) -> None:
        """See `Link.tell`."""
        self._process.ask("tell", packet)

    def refusal(self, kind: type[Beside]) -> str:
        """See `Link.refusal`."""
        return self._process.refusals.get(kind, "")

    def take_servo_loss(self) -> ServoLoss:
        """See `Link.take_servo_loss`: whoever answers the robot has taken it."""
        return ServoLoss.NONE

    def now_ns(self) -> int:
        """See `Link.now_ns`."""
        return self._link.now_ns()

    def reopen(self, period_us: int) -> Welcome:
        """See `Link.reopen`."""
        welcome: Welcome = self._process.ask("reopen", period_us)
        return welcome

    def close(self, reason: str = "") -> None:  # noqa: ARG002 (it says goodbye by itself)
        """Let the process end."""
        self._process.close()
