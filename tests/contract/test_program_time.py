"""One virtual time for all that a program runs: tasks of RCI beside arms of RCCL and machines of ARCL."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator

import numpy as np
import pytest

from qrobot import rccl, rci
from qrobot.arcl.machine import MachineSettings, machine
from qrobot.config import load_robot
from qrobot.errors import ConfigError, LinkLost, MotionError
from qrobot.rccl.offline import OfflineLink
from qrobot.rci import TcpLink
from qrobot.wire import Hello
from tests.support.fake_robot import FakeRobot, SocketRobot
from tests.support.patience import wait_until

ROBOT = load_robot("puma560")
SAMPLE_TICKS = 28  # of the clock of 1000 Hz; the arm's sample period is 28 ms
LINGERS_NS = 100_000_000  # of the time of an arm with samples of 4 ms


class BreakingLink(OfflineLink):
    """An arm whose link breaks when it is told to."""

    broken = False

    def exchange(self, command):
        if type(self).broken:
            raise LinkLost("it broke")
        return super().exchange(command)


@pytest.fixture
def arm() -> Iterator[rccl.Channel]:
    """An ideal arm beside a common clock of 1000 Hz."""
    BreakingLink.broken = False
    with rccl.use(BreakingLink), rci.use(BreakingLink):
        channel = rccl.control()
        rci.rci_clock(1000)
        yield channel
        rci.rci_close()
        channel.release()


def task(name: str, function, interval: int, offset: int = 0, priority: int = 0) -> rci.TaskDescriptor:
    td = rci.rci_create(name, priority=priority)
    rci.rci_control(td, function)
    rci.rci_onclock(td, interval, offset)
    return td


def test_tasks_take_their_turn_before_and_behind_the_arms_sample_whoever_waits(arm: rccl.Channel) -> None:
    """At one instant: what has a higher priority than the trajectory task, that task, what was created after it."""
    seen: list[tuple[str, int]] = []

    def note(td: rci.TaskDescriptor) -> None:
        seen.append((td.name, rci.rci_ticks()))

    tasks = [task("behind", note, SAMPLE_TICKS), task("before", note, SAMPLE_TICKS, priority=1)]
    tasks.append(task("between", note, SAMPLE_TICKS, offset=9))
    arm.each_sample(lambda: seen.append(("arm", rci.rci_ticks())))
    rci.rci_start(sum(td.bit for td in tasks))
    rci.rci_wait(lambda: rci.rci_ticks() == 1)
    for wait in (arm.waitas, rci.rci_wait, arm.waitas):
        seen.clear()
        wait(lambda: sum(name == "behind" for name, _ in seen) >= 4)
        order = ["before", "arm", "behind"]
        assert [name for name, _ in seen if name != "between"][:12] == order * 4
        assert {tick % SAMPLE_TICKS for name, tick in seen if name != "between"} == {0}
        assert {tick % SAMPLE_TICKS for name, tick in seen if name == "between"} == {9}


def test_two_arms_are_sampled_in_the_order_in_which_they_were_taken_whichever_is_waited_for(arm: rccl.Channel) -> None:
    """A task created between the two takes its turn between them; another sample period changes no place."""
    seen: list[str] = []
    between = task("between", lambda _td: seen.append("between"), 14)
    other = rccl.control("stanford", period_ms=14)
    arm.sample(14)
    rci.rci_start(between.bit)
    arm.each_sample(lambda: seen.append("arm"))
    other.each_sample(lambda: seen.append("other"))
    for waited in (other, arm, other):
        waited.waitas(lambda: seen[-1:] == ["other"])
        seen.clear()
        waited.waitas(lambda: len(seen) >= 12)
        assert seen[:12] == ["arm", "between", "other"] * 4
    other.release()


def test_a_sample_passes_for_the_arm_and_none_is_left_behind_when_the_program_waits_for_a_task(arm) -> None:
    begun = arm.time
    counted = task("counted", lambda _: None, 10)
    rci.rci_start(counted.bit)
    rci.rci_wait(lambda: counted.runs > 28)
    assert arm.time - begun == 280.0


def test_a_task_finds_the_descriptor_of_the_trajectory_task_by_the_name_of_the_arm(arm: rccl.Channel) -> None:
    heard: list[tuple[int, bool, int]] = []

    def look(_td: rci.TaskDescriptor) -> None:
        trajectory = rci.rci_descriptor("puma560")
        heard.append((trajectory.how.t_ns, trajectory.active, trajectory.runs))

    looks = task("looks", look, SAMPLE_TICKS)
    rci.rci_start(looks.bit)
    rci.rci_wait(lambda: looks.runs == 4)
    assert np.diff([t_ns for t_ns, _, _ in heard]).tolist() == [28_000_000] * 3
    assert [active for _, active, _ in heard] == [True] * 4
    assert np.diff([runs for _, _, runs in heard]).tolist() == [1] * 3
    trajectory = rci.rci_descriptor("puma560")
    with pytest.raises(ConfigError, match="names no control task"):
        rci.rci_start(trajectory.bit)
    with pytest.raises(ConfigError, match="no task 'puma560'"):
        rci.rci_control(trajectory, look)
    arm.release()
    assert trajectory.state is rci.TaskState.RELEASED
    with pytest.raises(ConfigError, match="no task 'puma560'"):
        rci.rci_descriptor("puma560")


def test_nobody_waits_while_time_passes(arm: rccl.Channel) -> None:
    waits = task("waits", lambda _: arm.waitas(lambda: True), 1)
    rci.rci_start(waits.bit)
    with pytest.raises(MotionError, match="must not wait"):
        rci.rci_wait(lambda: False)
    arm.each_sample(lambda: rci.rci_wait(lambda: waits.active))
    with pytest.raises(MotionError, match="must not wait"):
        arm.waitas(lambda: False)


def test_a_task_goes_on_when_the_arm_is_lost_and_the_arm_when_a_task_ends(arm: rccl.Channel) -> None:
    fails, counted = task("fails", lambda _: 1 / 0, 5), task("counted", lambda _: None, 5)
    rci.rci_start(fails.bit | counted.bit)
    arm.waitas(lambda: arm.time > 1000.0)  # the arm's program hears of it where it waits for tasks
    with pytest.raises(ZeroDivisionError):
        rci.rci_wait(lambda: False)
    BreakingLink.broken = True
    runs = counted.runs
    rci.rci_wait(lambda: counted.runs > runs + 20)
    with pytest.raises(LinkLost, match="it broke"):
        arm.check()
    with pytest.raises(LinkLost, match="it broke"):
        arm.waitas(lambda: False)


def test_a_wait_that_is_over_when_the_arm_is_lost_leaves_its_loss_to_be_told(arm: rccl.Channel) -> None:
    over = task("over", lambda _: setattr(BreakingLink, "broken", True), SAMPLE_TICKS, priority=1)
    rci.rci_start(over.bit)
    arm.waitas(lambda: BreakingLink.broken)
    with pytest.raises(LinkLost, match="it broke"):
        arm.release()


def test_an_arm_stops_when_the_task_that_it_follows_has_failed(arm: rccl.Channel) -> None:
    def fail_at_last(td: rci.TaskDescriptor) -> None:
        seen[0] += 0.5
        if td.runs == 200:
            raise LookupError("no picture")

    def follow(t: rccl.Transform) -> None:
        if not camera.active:
            raise RuntimeError("the camera has failed")
        t.p.y = seen[0]

    seen = [0.0]
    camera = task("camera", fail_at_last, 10, priority=1)
    here = rccl.gentr_trsl("HERE", 0, 0, 0)
    arm.update(here, rccl.makeposition("STARTS", rccl.t6, rccl.EQ, here, rccl.TL, here))
    arm.move(arm.there)
    arm.waitfor(arm.completed)
    rci.rci_start(camera.bit)
    arm.setmode("cartesian")
    arm.setime(300, 600)
    arm.move(rccl.makeposition("ON", rccl.t6, rccl.EQ, here, rccl.newtrans("PART", follow), rccl.TL, here))
    arm.waitfor(arm.completed)
    assert camera.runs < 200
    with pytest.raises(RuntimeError, match="the camera has failed"):
        arm.waitas(lambda: False)
    assert camera.state is rci.TaskState.ENDED
    with pytest.raises(LookupError, match="no picture"):
        rci.rci_close()


def test_an_arcl_machine_shares_the_time_of_an_rccl_arm() -> None:
    place = ROBOT.poses["park"]
    with rccl.use(lambda hello: OfflineLink(hello, period_us=14_000)), rccl.control() as arm:
        begun = arm.time
        offline = machine("offline", MachineSettings(ROBOT, np.zeros(6), 28.0, start=place))
        offline.open()
        samples: list[float] = []
        offline.start(lambda sample: (samples.append(sample.t_ms), place)[1])
        offline.wait(lambda: len(samples) == 10)
        assert arm.time - begun == 280.0
        arm.waitas(lambda: arm.time - begun >= 560.0)
        assert len(samples) == 20
        offline.close(power_off=False)
        arm.waitas(lambda: arm.time - begun >= 700.0)
        assert len(samples) == 20


def test_a_wait_for_an_arm_that_was_let_go_says_so() -> None:
    with rccl.use(lambda hello: OfflineLink(Hello(hello.role, hello.robot, hello.program))):
        arm = rccl.control()
        arm.release()
        with pytest.raises(LinkLost, match="released: nothing can happen"):
            arm.waitas(lambda: False)


@pytest.mark.realtime
def test_in_real_time_a_slow_task_does_not_delay_the_arm_beside_it() -> None:
    """The arm has a thread of its own; the processor `host` another."""
    fake = FakeRobot(tuple(ROBOT.poses["park"].tolist()), name="puma560", period_us=4_000, patience=100_000)
    with SocketRobot(fake) as server:
        link = lambda hello: TcpLink(hello, ("test", 0), lambda _: server.socket)  # noqa: E731
        with rccl.use(link), rci.use(link, virtual_time=False), rccl.control() as arm:
            beside: list[int] = []

            def linger(_td: rci.TaskDescriptor) -> None:
                first = arm.how.t_ns
                wait_until(lambda: arm.how.t_ns - first > LINGERS_NS, "samples of the arm pass while the task runs")
                beside.append(arm.how.t_ns - first)

            slow = task("slow", linger, 2)
            rci.rci_start(slow.bit)
            rci.rci_wait(lambda: slow.runs >= 2)
            assert rci.rci_descriptor("puma560").active
            rci.rci_close()
        wait_until(lambda: fake.goodbyes)
    assert min(beside) > LINGERS_NS


def test_a_program_that_is_interrupted_in_a_sample_has_its_arm_still(arm: rccl.Channel) -> None:
    def hit(_td: rci.TaskDescriptor) -> None:
        if not done:
            os.kill(os.getpid(), signal.SIGINT)
        done.append(rci.rci_ticks())

    done: list[int] = []
    td = task("hit", hit, 100 * SAMPLE_TICKS)
    rci.rci_start(td.bit)
    with pytest.raises(KeyboardInterrupt):
        rci.rci_wait(lambda: False)
    assert len(done) == 1
    arm.move(arm.pose("end"))
    arm.waitfor(arm.completed)
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_a_function_without_an_end_is_ended_by_a_second_ctrl_c(arm: rccl.Channel) -> None:
    def endless(_td: rci.TaskDescriptor) -> None:
        while True:
            os.kill(os.getpid(), signal.SIGINT)

    rci.rci_start(task("endless", endless, SAMPLE_TICKS).bit)
    with pytest.raises(KeyboardInterrupt):
        rci.rci_wait(lambda: False)
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
