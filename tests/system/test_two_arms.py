"""Two arms side by side from one deployment file; what happens to one is nothing to the other."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from qrobot import rci
from qrobot.errors import ServoFault
from qrobot.faultcodes import FaultCode
from qrobot.hwif.board_memory import Lane, attach_board_memory
from qrobot.log.read import read_log
from qrobot.modecodes import Mode
from qrobot.model.transform import inverse
from qrobot.multi_rccl import wait_as, wait_for
from qrobot.rccl.program import ending
from qrobot.rccl_bridge.servo_port import STALLED_NS
from qrobot.rci import LinkFactory, TcpLink
from qrobot.servo.memory.telemetry import Rows
from qrobot.units import NS_PER_MS, NS_PER_S
from tests.support.c_programs import EXAMPLES, compiled_text, needs_compiler
from tests.support.carried_object import (
    PERIOD_S,
    SPEED_M_S,
    assert_it_rests_on_the_way_up,
    carrying,
    last_frame,
    newest_frame,
    require_in_time,
    rows_of,
    rows_since,
    slower_frame,
    torn,
)
from tests.support.missed_frames import in_time
from tests.support.patience import PATIENCE_S, STALL_MS, wait_until
from tests.support.processes import CREEP_COUNTS, GUARDIAN_MS, RunningArm, events_of, processes_of, qrobot, running_arms
from tests.support.shared_arm import settle
from tests.support.stall_watch import unless_stalled
from tests.support.two_hands import GRIP, HERE, TOOL, WORLD, approach, hand_of, off

pytestmark = pytest.mark.realtime

GOAL = WORLD["right"].value @ HERE.value @ GRIP["right"].value @ inverse(TOOL.value)  # of the right arm, T6
APART_M = 1e-3  # at 100 mm/s: 10 ms
FRAME_STOPS_M = 5e-3  # way of an object's frame from 100 mm/s to rest, with the 5 m/s^2 of a frame and without a jerk
TRACKING_M = 2e-3  # [A] of both arms together
KEPT_S = 0.3
BACK_AND_FORTH = """
import sys
from qrobot import rccl

with rccl.control("puma560") as arm:
    for _ in range(100):
        for name in ("end", "park"):
            arm.move(arm.pose(name))
            arm.waitfor(arm.completed)
"""

TWO_IN_C = """
main()
{{
    MANIP *left = rccl_open("left", "puma560", "{}"), *right = rccl_open("right", "puma560", "{}");
    int i;
    rccl_control(left);
    rccl_control(right);
    for (i = 0; i < 100; i++) {{
        move(left, rccl_pose(left, i % 2 ? "park" : "end"));
        move(right, rccl_pose(right, i % 2 ? "park" : "end"));
        waitfor(left->completed)
        waitfor(right->completed)
    }}
}}
"""


@pytest.fixture(scope="module")
def arms(tmp_path_factory: pytest.TempPathFactory) -> Iterator[list[RunningArm]]:
    with running_arms(tmp_path_factory.mktemp("two"), arms=2) as running:
        yield running


@pytest.fixture(autouse=True)
def settled(arms: list[RunningArm]) -> Iterator[None]:
    """Both arms are as they were at first again, whatever a test, or a first try of one, has left."""
    yield
    for arm in arms:
        settle(arm)


@pytest.fixture
def program(tmp_path: Path) -> Path:
    path = tmp_path / "back_and_forth.py"
    path.write_text(BACK_AND_FORTH)
    return path


def test_a_program_moves_its_own_arm_alone(arms: list[RunningArm]) -> None:
    left, right = arms
    stood = right.encoders()
    with left.swinging(rad_s=0.2):
        assert np.abs(np.subtract(right.encoders(), stood)).max() <= CREEP_COUNTS
        assert right.mode is Mode.OFF
        assert not right.powered


@pytest.mark.thorough
def test_each_arm_has_a_log_of_its_own(arms: list[RunningArm]) -> None:
    directory = Path(arms[0].arm.log.directory)
    for arm in arms:
        with arm.swinging(rad_s=0.2):
            pass
        paths = sorted(directory.glob(f"{arm.name}-*.mcap"))
        assert paths
        wait_until(lambda path=paths[0]: read_log(path).rows.size > 0, "the log is written")
        attached = read_log(paths[0]).attachments["arms.toml"]
        assert arm.name.encode() in attached
        assert np.all(np.diff(read_log(paths[0]).rows["tick"]) == 1)


def estop(arm: RunningArm, pressed: bool) -> None:
    with attach_board_memory(arm.name) as board:
        board.memory.panel.estop = int(pressed)


def test_when_one_arm_of_a_program_loses_its_power_the_other_stops_on_its_path(arms: list[RunningArm]) -> None:
    left, right = arms
    addresses = [(each.arm.bridge.host, each.arm.bridge.port) for each in arms]
    links: dict[str, LinkFactory] = {n: partial(TcpLink, address=at) for n, at in zip(WORLD, addresses, strict=True)}
    before = right.snapshot().tick
    with rci.use(links, virtual_time=False), ending():
        _, robots = approach()
        wait_as(lambda: all(max(np.abs(robot.channel.how.v)) > 0.2 for robot in robots))
        lost = right.snapshot().tick
        estop(left, pressed=True)
        try:
            with pytest.raises(ServoFault, match="ESTOP"):
                wait_for(robots[1].completed)
        finally:
            estop(left, pressed=False)
    right.wait_for(Mode.HOLDING)
    rows = right.telemetry()
    rows = rows[rows["tick"] > before]
    way = (rows["q_ref"] - rows["q_ref"][0])[in_time(rows)]
    line = way[-1] / np.linalg.norm(way[-1])
    assert way == pytest.approx(np.outer(way @ line, line), abs=1e-9)  # that of its joints
    assert np.abs(rows["v_ref"][rows["tick"] >= lost]).max() > 0.1
    assert not rows["v_ref"][-1].any()
    assert np.linalg.norm((inverse(robots[1].trans.value) @ GOAL)[:3, 3]) > 0.02  # m: it has not arrived
    assert not events_of(rows)


def assert_hands_keep_their_grip(rows: dict[str, Rows], begun_ns: int) -> None:
    """What they hold is not torn: they differ from their constant offset by their tracking errors, and little more.

    Both servos are asked at one instant. Setpoints of one instant reach them with delays that differ by what
    the machine takes for them; before the samples were in step, it was up to a sample period, 10 mm here.
    """
    held = inverse(GRIP["left"].value) @ GRIP["right"].value
    rows = {name: own[own["t_ns"] >= begun_ns] for name, own in rows.items()}
    end_ns = min(own["t_ns"][-1] for own in rows.values())
    assert end_ns - begun_ns > 2e9
    instants = [t_ns for t_ns in range(begun_ns, int(end_ns), 20_000_000) if all(heard_in_time(rows, t_ns))]
    assert instants
    for t_ns in instants:
        left, right = ([hand_of(name, rows[name], t_ns, what) for what in ("q_ref", "q")] for name in WORLD)
        found = inverse(left[1]) @ right[1]
        errors = [off(*left), off(*right)]
        tracking = sum(far for far, _ in errors) + np.linalg.norm(found[:3, 3]) * sum(turned for _, turned in errors)
        assert off(held, found)[0] <= tracking + APART_M


def heard_in_time(rows: dict[str, Rows], t_ns: int) -> Iterator[bool]:
    """Whether no late setpoint has bent what each arm does at an instant."""
    for own in rows.values():
        yield bool(in_time(own)[np.searchsorted(own["t_ns"], t_ns)])


def test_a_program_of_two_arms_that_is_run_as_the_guide_says_grasps_and_carries_s08(
    arms: list[RunningArm], tmp_path: Path
) -> None:
    unless_either_stalled(arms, lambda: grasp_and_carry(arms, tmp_path))


def grasp_and_carry(arms: list[RunningArm], directory: Path) -> None:
    """Raises StreamLostError: something came too late."""
    text = (EXAMPLES / "22_two_hands.py").read_text()
    for name, arm in zip(WORLD, arms, strict=True):
        text = text.replace(f'"{name}"', f'"{arm.name}"')
    text = text.replace("grasp(robot2)", "grasp(robot2)\nprint('grasped at', robot1.channel.how.t_ns)")
    program = directory / "two_hands.py"
    program.write_text(text)
    wait_until(lambda: abs(slipped_ns(arms[0]) - slipped_ns(arms[1])) < NS_PER_MS, "both arms are in step")
    before = [arm.snapshot().tick for arm in arms]
    printed, complaint = qrobot("run", "--deployment", arms[0].deployment, program).communicate(timeout=PATIENCE_S)
    require_in_time("STREAM_LOST" not in complaint, complaint)
    found = re.search(r"the hands came ([0-9.]+) mm closer", printed)
    assert found is not None, complaint
    assert 0.0 < float(found[1]) < 3.0  # mm
    grasped = re.search(r"grasped at (\d+)", printed)
    assert grasped is not None
    rows = {}
    for name, arm, tick in zip(WORLD, arms, before, strict=True):
        arm.wait_for(Mode.HOLDING)
        rows[name] = arm.telemetry()
        assert not events_of(rows[name][rows[name]["tick"] > tick])
    assert_hands_keep_their_grip(rows, int(grasped[1]) + 500_000_000)  # the servos are five setpoints behind


def unless_either_stalled(arms: list[RunningArm], run: Callable[[], None]) -> None:
    """See `unless_stalled`."""

    def settle_both() -> None:
        for arm in arms:
            settle(arm)

    unless_stalled(run, settle_both)


def lost_on_the_way(arms: list[RunningArm], directory: Path, process: str) -> tuple[str, dict[str, int], int]:
    """Kill a process of the left arm of two that carry an object.

    What their program says, the arms' ticks before, and the right arm's time right after. Raises StreamLostError.
    """
    left, right = arms
    with carrying(arms, directory) as program:
        before = {name: arm.snapshot().tick for name, arm in zip(WORLD, arms, strict=True)}
        left.kill(process)
        gone_ns = right.now_ns()
        complaint = program.communicate(timeout=PATIENCE_S)[1]
    require_in_time("STREAM_LOST" not in complaint, complaint)
    assert program.returncode == 1
    return complaint, before, gone_ns


@pytest.mark.thorough
def test_when_the_bridge_of_one_arm_is_killed_the_other_stops_within_two_frames_and_their_object_is_not_torn(
    arms: list[RunningArm], tmp_path: Path
) -> None:
    """From when the bridge is gone: its connection is closed while the system clears away what it was."""
    unless_either_stalled(arms, lambda: lose_a_bridge(arms, tmp_path))


def lose_a_bridge(arms: list[RunningArm], tmp_path: Path) -> None:
    """Raises StreamLostError: something came too late."""
    left = arms[0]
    complaint, before, gone_ns = lost_on_the_way(arms, tmp_path, "bridge")
    assert re.search(f":{left.arm.bridge.port} (closed the connection|has fallen silent)", complaint)
    rows = rows_since(arms, before)
    slower = slower_frame("right", rows["right"])
    newest = newest_frame(rows["right"], gone_ns)
    require_in_time(slower <= newest + 2, f"frame {slower} is the first slower one, {newest} was made by then")
    for name, own in rows.items():
        assert_it_rests_on_the_way_up(name, own)
    assert not rows["right"]["fault"].any()
    assert rows["left"]["fault"][-1] == FaultCode.STREAM_LOST
    frames = slower - last_frame(rows["left"])  # by which the right arm went on for longer than the left one
    bound, apart = frames * PERIOD_S * SPEED_M_S + FRAME_STOPS_M + TRACKING_M, torn(rows)
    require_in_time(frames > 0 and apart < bound, f"{apart} m of {bound}, with {frames} frames between them")


def test_when_the_servo_of_one_arm_is_killed_the_other_stops_within_two_frames_after_its_guardian_has_acted(
    arms: list[RunningArm], tmp_path: Path
) -> None:
    unless_either_stalled(arms, lambda: lose_a_servo(arms, tmp_path))


def lose_a_servo(arms: list[RunningArm], tmp_path: Path) -> None:
    """Raises StreamLostError: something came too late."""
    left, right = arms
    complaint, before, _ = lost_on_the_way(arms, tmp_path, "servo")
    assert f"the servo of {left.name} does not run" in complaint
    wait_until(lambda: not left.powered, "the guardian of the left arm acts")
    right.wait_for(Mode.HOLDING)
    rows = rows_of(right, before["right"])
    last_ns = left.word("heartbeat", "t_ns") + slipped_ns(left) - slipped_ns(right)
    known_ns = last_ns + max(STALLED_NS, round((1.2 * GUARDIAN_MS + STALL_MS) * NS_PER_MS))
    slower, newest = slower_frame("right", rows), newest_frame(rows, known_ns)
    late = f"frame {slower} is the first slower one, {newest} was made by then"
    require_in_time(slower <= newest + 3, late)  # the bridge looks at the servo each period
    assert_it_rests_on_the_way_up("right", rows)
    assert not rows["fault"].any()


def test_when_the_program_is_killed_both_arms_stop_and_their_object_is_not_torn(
    arms: list[RunningArm], tmp_path: Path
) -> None:
    unless_either_stalled(arms, lambda: lose_a_program(arms, tmp_path))


def lose_a_program(arms: list[RunningArm], tmp_path: Path) -> None:
    """Raises StreamLostError: something came too late."""
    left, right = arms
    with carrying(arms, tmp_path) as program:
        before = {name: arm.snapshot().tick for name, arm in zip(WORLD, arms, strict=True)}
        program.kill()
        apart_s = abs(slipped_ns(left) - slipped_ns(right)) * 1e-9
    rows = rows_since(arms, before)
    for name, own in rows.items():
        slower, last = slower_frame(name, own), last_frame(own)
        late = f"frame {slower} of the {name} arm is the first slower one, {last} the last that came"
        require_in_time(slower <= last + 3, late)  # two and a quarter when its connections close late
        assert_it_rests_on_the_way_up(name, own)
        assert events_of(own) <= {FaultCode.STREAM_LOST}
    lasts = [last_frame(own) for own in rows.values()]
    require_in_time(abs(np.diff(lasts)[0]) <= 1 + apart_s / PERIOD_S, f"last frames {lasts}, {apart_s} s apart")
    bound, apart = (2.0 * PERIOD_S + apart_s) * SPEED_M_S + TRACKING_M, torn(rows)
    require_in_time(apart < bound, f"{apart} m of {bound}")


def test_when_one_arm_alone_is_kept_from_running_the_other_waits_for_it(arms: list[RunningArm]) -> None:
    left, right = arms
    before, kept = slipped_ns(right), list(processes_of(left.name))
    assert kept
    try:
        for pid in kept:
            os.kill(pid, signal.SIGSTOP)
        time.sleep(KEPT_S)
    finally:
        for pid in kept:
            os.kill(pid, signal.SIGCONT)
    wait_until(lambda: slipped_ns(right) - before > 0.5 * KEPT_S * NS_PER_S, "the other has waited")
    wait_until(lambda: abs(slipped_ns(left) - slipped_ns(right)) < NS_PER_MS, "both arms are in step")


def slipped_ns(arm: RunningArm) -> int:
    """How far the time of an emulated arm is behind: both are stopped at one instant of the wall's clock."""
    return arm.word("heartbeat", "slipped_ns")


@pytest.mark.thorough
@needs_compiler
def test_when_a_program_in_c_of_two_arms_is_killed_both_come_to_rest(
    arms: list[RunningArm], tmp_path: Path, own_cache: None
) -> None:
    addresses = [f"{each.arm.bridge.host}:{each.arm.bridge.port}" for each in arms]
    program = compiled_text(TWO_IN_C.format(*addresses), tmp_path)
    before = [arm.snapshot().tick for arm in arms]
    started = subprocess.Popen([program])
    try:
        wait_until(lambda: all(np.abs(arm.snapshot().v).max() > 0.1 for arm in arms), "both move")
    finally:
        started.kill()
        started.wait()
    for arm, tick in zip(arms, before, strict=True):
        arm.wait_for(Mode.HOLDING)
        rows = arm.telemetry()
        assert events_of(rows[rows["tick"] > tick]) <= {FaultCode.STREAM_LOST}  # its connections may close late


def test_one_arm_goes_on_while_the_others_servo_and_bridge_are_killed(arms: list[RunningArm], program: Path) -> None:
    left, right = arms
    with left.moving(program, rad_s=0.2) as lefts, right.swinging(rad_s=0.2):
        tick = right.snapshot().tick
        left.kill("servo")
        left.kill("bridge")
        wait_until(lambda: not left.powered, "the guardian of the left arm acts")
        wait_until(lambda: right.snapshot().tick > tick + 1000, "a second goes by")
        assert lefts.wait() == 1
        rows = right.telemetry()
    assert (rows["mode"][rows["tick"] > tick] == Mode.TRACKING).all()
    assert (right.trace()[:, 1] == Lane.SERVO).all()
