"""`qrobot run --offline` and `qrobot replay`: programs without a robot, and their setpoints on one."""

from __future__ import annotations

import json
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from qrobot import rccl
from qrobot.arcl import ARCL_ROBOT, arcl_close, arcl_open, arcl_setload
from qrobot.arcl.machine import emulated
from qrobot.cli.console import run_app
from qrobot.cli.main import make_app
from qrobot.cli.motion_figures import farthest_off, path_of
from qrobot.config import Robot, load_deployment, load_robot
from qrobot.errors import MotionError
from qrobot.fences.fence_set import fences_of
from qrobot.model.payload_judge import PayloadJudge
from qrobot.motion import Termination, motion_limits
from qrobot.rccl import offline
from qrobot.rccl.offline import OfflineLink
from qrobot.rccl.setpoints import Setpoints, read_setpoints, write_setpoints
from qrobot.rccl.trace import Trace
from qrobot.rci.machine_choice import MachineChoice, use_machine

EXAMPLES = Path(__file__).parents[2] / "examples"
ROBOT = load_robot("puma560")
FILES = {"requests.txt", "requests.jsonl", "setpoints.csv", "joints.png", "path.png"}


def qrobot(*words: str) -> int:
    return run_app(make_app(words[0]), list(words))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What the square traced four times left behind."""
    folder = tmp_path_factory.mktemp("offline")
    assert qrobot("run", "--offline", "--output", str(folder), str(EXAMPLES / "02_four_corners.py")) == 0
    return folder


def requests(folder: Path) -> list[dict[str, object]]:
    return [json.loads(line) for line in (folder / "requests.jsonl").read_text().splitlines()]


def test_the_same_program_leaves_its_requests_setpoints_and_figures(folder: Path) -> None:
    assert {path.name for path in folder.iterdir()} == FILES
    assert all((folder / name).read_bytes().startswith(b"\x89PNG") for name in FILES if name.endswith("png"))


def test_the_trace_names_every_position_in_order_with_times_that_join(folder: Path) -> None:
    traced = requests(folder)
    assert [request["name"] for request in traced] == ["park"] + ["P0", "P1", "P2", "P3"] * 4
    assert {request["code"] for request in traced} == {int(Termination.COMPLETED)}
    assert [request["mode"] for request in traced] == ["joint"] + ["cartesian"] * 16
    for before, after in pairwise(traced):
        assert after["begun_s"] <= before["ended_s"] < after["begun_s"] + 0.3  # in the middle of the transition
    text = (folder / "requests.txt").read_text()
    assert text.count("completed") == 17


def test_the_setpoints_are_a_motion_the_arm_can_do_through_the_corners(folder: Path) -> None:
    motion = read_setpoints(folder / "setpoints.csv")
    path = path_of(ROBOT, motion.q)
    ends = path[np.abs(path[:, 2] - path[:, 2].min()) < 1e-3]
    assert np.ptp(ends[:, 0]) == pytest.approx(100.0, abs=12.0)
    assert np.ptp(ends[:, 1]) == pytest.approx(150.0, abs=12.0)
    assert requests(folder)[-1]["ended_s"] == pytest.approx(motion.t[-1], abs=0.1)


def test_a_motion_that_is_slowed_down_and_held_goes_on_to_the_same_end(tmp_path: Path, capsys) -> None:
    assert qrobot("run", "--offline", "--output", str(tmp_path), str(EXAMPLES / "21_override.py")) == 0
    motion = read_setpoints(tmp_path / "setpoints.csv")
    reached = int(np.argmin(np.abs(motion.q - ROBOT.poses["end"]).max(axis=1)))
    assert motion.q[reached] == pytest.approx(ROBOT.poses["end"], abs=1e-9)
    still = np.flatnonzero(np.abs(np.diff(motion.q, axis=0)).max(axis=1) < 1e-12)
    held = still[(still > 40) & (still < reached - 20)]  # after the first second, and long before the end
    assert len(held) * 0.028 > 0.8
    assert (motion.q[held] == motion.q[held[0]]).all()
    assert "held on its path after" in capsys.readouterr().out
    motion.check(motion_limits(ROBOT), "21_override")


def test_recordings_of_a_hand_are_played_smoothed_and_joined(tmp_path: Path, capsys) -> None:
    assert qrobot("run", "--offline", "--output", str(tmp_path), str(EXAMPLES / "20_led_by_hand.py")) == 0
    assert "2 recordings, joined" in capsys.readouterr().out
    motion = read_setpoints(tmp_path / "setpoints.csv")
    motion.check(motion_limits(ROBOT), "20_led_by_hand")
    assert motion.q[-1] == pytest.approx(motion.q[0], abs=1e-6)
    swing = motion_from(ROBOT.poses["park"])
    once, made = tmp_path / "swing.csv", tmp_path / "both.csv"
    write_setpoints(once, swing)
    assert qrobot("replay", str(once), "--then", str(once), "--smooth", "2", "--save-as", str(made)) == 0
    both = read_setpoints(made)
    both.check(motion_limits(ROBOT), "both")
    assert len(both.q) > 1.8 * len(swing.q)
    assert qrobot("replay", str(once), "--then", str(tmp_path / "none.csv")) == 1
    assert "cannot read" in capsys.readouterr().err


def test_a_fence_refuses_a_motion_and_ends_one_whose_goal_sinks_into_it(tmp_path: Path, capsys) -> None:
    cell = EXAMPLES / "19_fences.toml"
    words = ("--offline", "--deployment", str(cell), "--output", str(tmp_path), str(EXAMPLES / "19_fences.py"))
    assert qrobot("run", *words) == 0
    said = capsys.readouterr().out
    assert "refused: wrist would come" in said
    assert "FENCE: the arm stopped, the lift 208 mm down" in said
    assert [request["name"] for request in requests(tmp_path)] == ["OVER", "LIFT", "LIFT", "OVER"]
    fences = fences_of(load_deployment(cell).arm[0], ROBOT)
    assert fences is not None
    bench, cell_wall, _ = np.array([fences.distances(q) for q in read_setpoints(tmp_path / "setpoints.csv").q]).T
    assert 0.018 < bench.min() < 0.024
    assert cell_wall.min() > 0.05


def test_a_replay_in_lockstep_follows_the_file(tmp_path: Path, capsys) -> None:
    write_setpoints(tmp_path / "swing.csv", motion_from(ROBOT.poses["park"]))
    assert qrobot("replay", "--lockstep", str(tmp_path / "swing.csv")) == 0
    said = capsys.readouterr().out
    degrees = float(said.rpartition("them: ")[2].split()[0])
    assert degrees < 1.0
    assert qrobot("replay", "--lockstep", str(tmp_path / "swing.csv"), "--json") == 0
    errors = json.loads(capsys.readouterr().out)["largest_error"]
    assert list(errors) == list(ROBOT.joint_names)
    assert np.degrees(max(errors.values())) == pytest.approx(degrees, abs=1e-3)


def test_a_replay_of_a_damaged_file_names_the_line_and_moves_nothing(folder: Path, tmp_path, capsys) -> None:
    lines = (folder / "setpoints.csv").read_text().splitlines()
    lines[99] = lines[99].replace(",", ",9", 1)
    (tmp_path / "bad.csv").write_text("\n".join(lines))
    assert qrobot("replay", "--lockstep", str(tmp_path / "bad.csv")) == 1
    assert "line 100" in capsys.readouterr().err


def test_options_that_contradict_each_other_are_refused(capsys) -> None:
    program = str(EXAMPLES / "02_four_corners.py")
    assert qrobot("run", "--offline", "--lockstep", program) == 1
    assert "--offline knows no servo and no board" in capsys.readouterr().err


def test_the_distance_of_a_place_from_a_way_is_that_to_its_nearest_piece() -> None:
    way = np.array([[0.0, 0, 0], [10, 0, 0], [10, 0, 0], [10, 10, 0]])
    for place, distance in [([5, 0, 0], 0.0), ([5, 3, 4], 5.0), ([-3, -4, 0], 5.0), ([12, 5, 0], 2.0)]:
        assert farthest_off(way, np.array([[0.0, 0, 0], place])) == pytest.approx(distance)


def test_a_program_that_fails_leaves_the_trace_of_what_it_did(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    program = tmp_path / "fails.py"
    program.write_text(
        "from qrobot import rccl\n"
        "arm = rccl.control('puma560')\n"
        "p = arm.jposition('over', [10, -90, 180, 0, 0, 0])\n"
        "arm.move(p)\n"
        "arm.waitas(lambda: p.scal > 0.5)\n"
        "raise LookupError('no part')\n"
    )
    assert run_app(make_app("run"), ["run", "--offline", "--output", str(tmp_path / "out"), str(program)]) == 1
    assert capsys.readouterr().err.endswith("LookupError: no part\n")
    (traced,) = requests(tmp_path / "out")
    assert (traced["name"], traced["reason"]) == ("over", "stopped")


@pytest.fixture
def arm():
    with rccl.use(OfflineLink), rccl.control("puma560") as arm:
        yield arm


def test_a_program_that_waits_for_its_own_outputs_goes_on_off_line(arm) -> None:
    arm.signal(1, 16)
    arm.waitas(lambda: arm.how.outputs == 0x8001)
    arm.signal(-16)
    arm.waitas(lambda: arm.how.outputs == 0x0001)
    assert arm.time <= 200.0


def motion_from(q: np.ndarray, period_us: int = 28_000, robot: str = "puma560") -> Setpoints:
    rows = np.tile(q, (41, 1))
    rows[:, 0] += 0.1 * (1.0 - np.cos(2.0 * np.pi * np.linspace(0.0, 1.0, 41)))
    return Setpoints(robot, period_us, rows)


def test_a_list_is_played_only_from_where_the_arm_stands_and_at_its_period(arm) -> None:
    here = ROBOT.poses["park"]
    for wrong, complaint in [
        (motion_from(here + 0.01), "does not begin where the arm is: joint \\d"),
        (motion_from(here, 20_000), "sample period is 28 ms"),
        (motion_from(here, robot="stanford"), "made for stanford, this is puma560"),
    ]:
        with pytest.raises(MotionError, match=complaint):
            arm.play(wrong)
    arm.play(motion_from(here))
    with pytest.raises(MotionError, match="still moves"):
        arm.play(motion_from(here))
    with pytest.raises(MotionError, match="being played"):
        arm.move(arm.pose("park"))
    arm.waitfor(arm.completed)
    arm.waitas(lambda: np.allclose(arm.how.q, here, rtol=0, atol=1e-12))


def test_motions_go_on_from_where_a_list_was_stopped(arm) -> None:
    arm.play(motion_from(ROBOT.poses["park"]))
    arm.waitas(lambda: arm.how.q[0] > ROBOT.poses["park"][0] + 0.1)
    arm.stop()
    arm.waitfor(arm.completed)
    park = arm.pose("park")
    arm.move(park)
    arm.waitfor(park.end)
    assert park.code == Termination.COMPLETED


def test_an_ideal_arm_exerts_nothing_in_any_motion(arm) -> None:
    arm.move(arm.jposition("over", [30, -60, 150, 0, 30, 0]))
    exerted = []
    arm.waitas(lambda: exerted.append(arm.exerted.torque) or arm.completed.count > 0)
    assert np.abs(exerted[5:]).max() < 1e-9


def test_giving_way_is_refused_off_line(arm) -> None:
    where = rccl.gentr_rot("AT", 550, 0, -400, rccl.yunit, 180)
    place = rccl.makeposition("PLACE", rccl.t6, rccl.EQ, where, rccl.TL, where)
    arm.move(place)
    arm.waitfor(place.end)
    arm.comply("fz", 0)
    arm.move(place)
    with pytest.raises(MotionError, match="off line nothing gives way"):
        arm.waitfor(arm.completed)


def test_traces_are_kept_for_every_time_an_arm_is_taken() -> None:
    traces: list[Trace] = []
    with rccl.use(OfflineLink, traces):
        for _ in range(2):
            with rccl.control("stanford") as arm:
                arm.move(arm.pose("park"))
                arm.waitfor(arm.completed)
    assert [trace.robot.name for trace in traces] == ["stanford"] * 2
    assert [trace.requests[0].name for trace in traces] == ["park"] * 2


def test_arms_of_multi_rccl_are_written_down_one_by_one(tmp_path: Path, capfd) -> None:
    program = tmp_path / "two.py"
    program.write_text(
        "from qrobot.multi_rccl import move, pose, rccl_control, rccl_open\n"
        "for name, goal in (('left', 'end'), ('right', 'ready')):\n"
        "    arm = rccl_open(name)\n"
        "    rccl_control(arm)\n"
        "    move(arm, pose(arm, goal))\n"
    )
    assert qrobot("run", "--offline", "--output", str(tmp_path / "out"), str(program)) == 0
    assert [(tmp_path / "out" / f"setpoints{suffix}.csv").is_file() for suffix in ("", "-2")] == [True, True]
    ends = [read_setpoints(tmp_path / "out" / f"setpoints{suffix}.csv").q[-1] for suffix in ("", "-2")]
    assert np.allclose(ends, [ROBOT.poses["end"], ROBOT.poses["ready"]], atol=1e-6)


def test_off_line_too_an_arm_refuses_what_it_could_not_carry() -> None:
    with rccl.use(OfflineLink), rccl.control(ROBOT.name) as arm:
        arm.setload(1.0, (0.0, 0.0, 40.0))
        for kg, centre, why in (
            (5.0, (0, 0, 0), "carries 2.5 kg"),
            (2.4, (0, 0, 900), "would have to hold"),
            (-1.0, (0, 0, 0), "a mass of 0 kg or more"),
        ):
            with pytest.raises(MotionError, match=why):
                arm.setload(kg, centre)
        assert arm.how.payload_mass == 1.0
        arm.setload(0)
        assert arm.how.payload_mass == 0.0


def test_off_line_too_a_robot_of_arcl_refuses_what_it_could_not_carry() -> None:
    with use_machine(MachineChoice("offline")):
        robot = arcl_open(ARCL_ROBOT, ROBOT.name, 0)
        arcl_setload(robot, 1.0)
        with pytest.raises(MotionError, match=r"carries 2\.5 kg"):
            arcl_setload(robot, 5.0)
        arcl_close(robot)


def test_what_an_arm_off_line_can_carry_is_computed_once(monkeypatch: pytest.MonkeyPatch) -> None:
    made = list[str]()

    class Counted(PayloadJudge):
        def __init__(self, robot: Robot) -> None:
            made.append(robot.name)
            super().__init__(robot)

    for module in (offline, emulated):
        monkeypatch.setattr(module, "PayloadJudge", Counted)
    with rccl.use(OfflineLink), rccl.control(ROBOT.name) as arm:
        for kg in (1.0, 2.0, 0.0):
            arm.setload(kg)
    assert len(made) == 1
    with use_machine(MachineChoice("offline")):
        robot = arcl_open(ARCL_ROBOT, ROBOT.name, 0)
        for kg in (1.0, 2.0, 0.0):
            arcl_setload(robot, kg)
        arcl_close(robot)
    assert len(made) == 2
