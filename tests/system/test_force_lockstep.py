"""Force control with real contact: program, bridge, servo, emulated board and MuJoCo, on virtual time."""

from __future__ import annotations

import re
import runpy
import sys
from functools import partial
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from qrobot import rccl
from qrobot.config.scene import Scene
from qrobot.errors import ServoFault
from qrobot.modecodes import Mode
from qrobot.motion.force.joint_matching import JointIndices
from qrobot.rccl import EQ, TL, gentr_rot, gentr_trsl, makeposition, t6, yunit
from qrobot.rccl.task import TrajectoryTask
from qrobot.rig.lockstep import LockstepRig, link_factory
from qrobot.servo.calibration.table import load_table
from qrobot.servo.settings import ServoSettings
from qrobot.sim_board.emulator import Emulator
from tests.support.puma import ROBOT
from tests.support.tables import contact_force, crank_angle

ROOT = Path(__file__).parents[2]
EXAMPLES = ROOT / "examples"
TUTORIALS = "".join((ROOT / "docs/tutorials" / name).read_text() for name in ("sensing.md", "force-control.md"))
SAMPLE_US = 28_000
CYCLES_PER_SAMPLE = 28
TABLE_MM = -300.0  # its top in the base frame
FRICTION_N = 15.0  # half of what Coulomb friction of the shoulder, 13.6 N m at 0.48 m, can hide
E = gentr_trsl("E", 0, 0, 156.25)
P = makeposition("P", t6, E, EQ, gentr_rot("TABLE", 500, 0, TABLE_MM, yunit, 180), TL, E)


def rig_with(scene: Scene) -> LockstepRig:
    """As deployed: with a table the potentiometers tell a joint that meets something from a dead encoder."""
    settings = ServoSettings(rate_hz=1000.0, calibration=load_table("puma560", ROBOT))
    return LockstepRig(ROBOT, settings, Emulator(ROBOT, scene=scene))


def rig_with_table() -> LockstepRig:
    return rig_with(Scene(kind="table"))


def run(rig: LockstepRig, name: str, *arguments: str) -> dict[str, object]:
    with rccl.use(partial(link_factory, rig, SAMPLE_US)), pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", [name, *arguments])
        return runpy.run_path(str(EXAMPLES / name), run_name="__main__")


def wait(ms: float) -> None:
    end = rccl.how.t_ns + ms * 1e6
    rccl.waitas(lambda: rccl.how.t_ns >= end)


def go_above(arm: rccl.Channel, mm: float) -> None:
    arm.setmode("cartesian")
    arm.setvel(200, 90)
    arm.distance("dz", -mm)
    arm.move(P)
    arm.waitfor(arm.completed)


def press(arm: rccl.Channel, newtons: float, above_mm: float) -> None:
    arm.comply("fz", newtons)
    arm.distance("dz", -above_mm)
    arm.setime(200, 400)
    P.end = 0
    arm.move(P)
    arm.waitfor(P.end)


def test_a_table_of_unknown_height_is_found_and_pressed(capsys) -> None:
    rig = rig_with_table()
    forces: list[float] = []
    with rccl.use(partial(link_factory, rig, SAMPLE_US)):
        waitas = rccl.Channel.waitas

        def measuring(channel: rccl.Channel, predicate) -> None:
            waitas(channel, predicate)
            forces.append(contact_force(rig.emulator))

        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(rccl.Channel, "waitas", measuring)
            left = runpy.run_path(str(EXAMPLES / "07_guarded_approach.py"), run_name="__main__")
    said = capsys.readouterr().out
    found = float(re.findall(r"the table is ([\d.]+) mm below", said)[0])
    assert found == pytest.approx(-260.0 - TABLE_MM, abs=1.0)
    assert forces == [pytest.approx(20.0, abs=FRICTION_N)]
    assert left["p"].code == rccl.Termination.COMPLETED
    rows = rig.rows()
    assert not rows["fault"].any()
    assert contact_force(rig.emulator) == 0.0


def test_without_a_table_the_guarded_motion_ends_at_its_goal(capsys) -> None:
    run(rig_with(Scene()), "07_guarded_approach.py")
    assert "there is no table" in capsys.readouterr().out


def test_a_compliant_arm_comes_down_on_the_table_and_rests_there_with_the_force_asked_for() -> None:
    rig = rig_with_table()
    with rccl.use(partial(link_factory, rig, SAMPLE_US)), rccl.control("puma560") as arm:
        go_above(arm, 5.0)
        press(arm, 20.0, 5.0)
        wait(1500)
        assert contact_force(rig.emulator) == pytest.approx(20.0, abs=FRICTION_N)
        before = rig.emulator.q
        arm.lock("fz")
        arm.distance("dz", -5.0)
        arm.setime(200, 1000)
        arm.move(P)
        arm.waitfor(arm.completed)
        wait(300)
        assert contact_force(rig.emulator) == 0.0
        assert np.abs(rig.emulator.q - before).max() < 0.05
    rows = rig.rows()
    assert not rows["fault"].any()
    steps = np.abs(np.diff(rows["q_ref"][rows["mode"] == Mode.TRACKING], axis=0))
    assert (steps < 1.1 * ROBOT.limits.v_max * rig.period_ns * 1e-9).all()  # no joint's reference ever jumps


def test_a_program_that_dies_while_it_presses_leaves_the_arm_holding_its_position() -> None:
    rig = rig_with_table()
    with rccl.use(partial(link_factory, rig, SAMPLE_US)):
        arm = rccl.control("puma560")
        go_above(arm, 5.0)
        press(arm, 20.0, 5.0)
        wait(500)
        q = rig.emulator.q
        rig.run_for(1.0)  # nobody says anything any more
        with pytest.raises(ServoFault, match="STREAM_LOST"):
            arm.release()
    assert rig.rows()[-1]["mode"] == Mode.HOLDING
    assert np.abs(rig.emulator.q - q).max() < 0.01
    assert np.abs(rig.rows()["v"][-200:]).max() < 0.02


def watched_joints(monkeypatch: pytest.MonkeyPatch) -> list[tuple[int, JointIndices]]:
    """At each sample from now on its time, and which joints give way."""
    seen: list[tuple[int, JointIndices]] = []
    generate = TrajectoryTask._generate

    def watching(task: TrajectoryTask) -> None:
        generate(task)
        if task.how is not None:
            seen.append((task.how.t_ns, task.force.joints))

    monkeypatch.setattr(TrajectoryTask, "_generate", watching)
    return seen


def test_a_crank_whose_shaft_is_not_where_the_program_thinks_is_turned_four_times_s06(capsys, monkeypatch) -> None:
    rig = rig_with(Scene(kind="crank", clearance_m=0.0015))
    giving_way = watched_joints(monkeypatch)
    run(rig, "08_crank.py")
    assert "turned 4 times" in capsys.readouterr().out
    assert np.degrees(crank_angle(rig.emulator)) == pytest.approx(4 * 360.0, abs=5.0)
    rows = rig.rows()
    assert not rows["fault"].any()
    changes = [t_ns for (_, before), (t_ns, after) in pairwise(giving_way) if before and before != after]
    assert len(changes) > 8
    steps = np.abs(np.diff(rows["tau"], axis=0)) / ROBOT.guard.tau_max
    for t_ns in changes:  # the torque of no joint jumps when another one takes over
        first = np.searchsorted(rows["t_ns"], t_ns)
        assert steps[first : first + CYCLES_PER_SAMPLE].max() < 0.15
    assert (rows["mode"][-500:] == Mode.HOLDING).any()  # released where it stands, with no stop in between
    assert not (rows["mode"] == Mode.FAULT).any()


def crank_farther_out(mm: int, folder: Path) -> str:
    """The program of the crank for a shaft so much farther from the arm, with one turn: it goes in every direction."""
    text = (EXAMPLES / "08_crank.py").read_text()
    assert "TURNS = 4\n" in text
    text = text.replace("TURNS = 4\n", "TURNS = 1\n")
    for known in ('"SHAFT", 500', '"HOLE", 600'):
        name, place = known.split()
        assert text.count(known) == 1
        text = text.replace(known, f"{name} {int(place) + mm}")
    program = folder / "crank.py"
    program.write_text(text)
    return str(program)


@pytest.mark.thorough
@pytest.mark.parametrize(("play_mm", "farther_mm"), [(2.0, 0), (1.0, 100)])
def test_it_is_no_chance_that_the_crank_is_turned_s06(play_mm, farther_mm, tmp_path, capsys) -> None:
    rig = rig_with(
        Scene(kind="crank", clearance_m=play_mm * 1e-3, position_m=(0.5 + farther_mm * 1e-3, 0.0, TABLE_MM * 1e-3))
    )
    run(rig, crank_farther_out(farther_mm, tmp_path))
    assert "turned 1 times" in capsys.readouterr().out
    assert np.degrees(crank_angle(rig.emulator)) == pytest.approx(360.0, abs=5.0)
    assert not rig.rows()["fault"].any()


def test_an_arm_that_gives_way_to_nothing_stays_where_it_is() -> None:
    rig = rig_with(Scene())
    with rccl.use(partial(link_factory, rig, SAMPLE_US)), rccl.control("puma560") as arm:
        go_above(arm, 100.0)
        arm.comply("fx fy fz", 0.0, 0.0, 0.0)
        arm.distance("dz", -100.0)
        arm.move(P)
        wait(500)
        before = rig.emulator.q
        wait(1500)
        assert np.abs(rig.emulator.q - before).max() < 1e-3
    assert not rig.rows()["fault"].any()


def test_a_peg_finds_the_hole_it_is_led_into_and_a_stiff_arm_meets_the_rim(capsys) -> None:
    for off in (("5", "3"), ("0", "5")):
        rig = rig_with(Scene(kind="peg"))
        run(rig, "09_peg_in_hole.py", *off)
        assert "the peg is 26 mm down" in capsys.readouterr().out
        assert not rig.rows()["fault"].any()
    stiff = rig_with(Scene(kind="peg"))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(rccl.Channel, "comply", lambda *_: None)
        patch.setattr(rccl.Channel, "lock", lambda *_: None)
        run(stiff, "09_peg_in_hole.py", "5", "3")
    assert "the peg met something: FORCE_LIMIT" in capsys.readouterr().out


COMMANDS = re.findall(r"qrobot run --lockstep --scene (.*)", TUTORIALS)
OUTCOMES = ["the table is 40", "turned 4 times", "the peg is 26 mm down", "the peg met something: FORCE_LIMIT"]


@pytest.mark.sampled(2)
@pytest.mark.parametrize(("command", "outcome"), list(zip(COMMANDS, OUTCOMES, strict=True)))
def test_what_the_tutorial_says_to_run_ends_as_it_says(command, outcome, capsys) -> None:
    kind, example, *arguments = command.split()
    run(rig_with(Scene(kind=kind)), Path(example).name, *arguments)
    assert outcome in capsys.readouterr().out
