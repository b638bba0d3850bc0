"""The programs of Hayward & Paul 1986 in C, beside their twins in Python."""

from __future__ import annotations

import io
import re
import shutil
import sys
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from qrobot import rccl
from qrobot.cli.console import run_app
from qrobot.cli.main import make_app
from qrobot.config.scene import Scene
from qrobot.motion import Termination
from qrobot.rccl.c.program import run_executable
from qrobot.rccl.offline import OfflineLink
from qrobot.rccl.setpoints import read_setpoints
from qrobot.rccl.trace import Trace
from qrobot.rci import VirtualLink
from qrobot.rig.lockstep import LockstepRig, link_factory
from qrobot.servo.calibration.table import load_table
from qrobot.servo.settings import ServoSettings
from qrobot.sim_board.emulator import Emulator
from qrobot.wire import Command
from tests.support.c_programs import (
    CHECKED,
    EXAMPLES,
    compiled,
    compiled_text,
    keyboard,
    needs_compiler,
    offline,
    way_of_c,
    way_of_python,
)
from tests.support.fake_robot import FakeRobot
from tests.support.puma import ROBOT

pytestmark = [needs_compiler, pytest.mark.usefixtures("own_cache")]

TWINS = {
    "s01_four_corners": ("02_four_corners.py", "starting fourth square\ndone; corners passed 0 4 4 4 times"),
    "s02_grasp": ("03_grasp.py", "hand closed at "),
    "s03_data_base": ("04_data_base.py", "5 locations visited"),
    "s04_stop_on_keyboard": ("05_stop_on_keyboard.py", "hit <return> to stop the arm\nLOC is now"),
    "s05_follow_a_surface": ("10_follow_a_surface.py", "over a surface that goes up and down by 10"),
    "s07_stack_blocks": ("11_stack_blocks.py", "two blocks stacked"),
}
ROUNDING = 2e-6  # rad: fields of C programs are single precision, a part in 1e7 of some hundred millimetres or degrees


@pytest.mark.sampled(3)
@pytest.mark.parametrize("name", TWINS)
def test_under_sanitizers_a_program_sends_the_setpoints_of_its_twin(
    name: str, tmp_path: Path, capfd, monkeypatch
) -> None:
    twin, said = TWINS[name]
    program = compiled(EXAMPLES / "c" / f"{name}.c", tmp_path, *CHECKED)
    with keyboard("\n"):
        in_c = way_of_c(program)
    assert said in capfd.readouterr().out
    monkeypatch.setattr(sys, "stdin", io.StringIO("\n"))
    in_python = way_of_python(twin)
    assert in_c.shape == in_python.shape
    assert np.abs(in_c - in_python).max() < ROUNDING


def test_a_program_that_uses_every_call_finds_all_as_it_should_be(tmp_path: Path, capfd) -> None:
    program = compiled(EXAMPLES / "c" / "s08_all_calls.c", tmp_path, "-O2")
    with keyboard("q\nworld dz -20\nrecord\nq\ny\n"):
        way_of_c(program, str(tmp_path / "cell.db"))
    said = capfd.readouterr().out
    assert said.count("as it should be") == 14
    assert "WRONG" not in said
    assert "teach mode V1.0, transform CORNER, position CORNER" in said
    assert said.endswith("all calls made\n")
    assert {"PLACE", "CORNER"} <= set((tmp_path / "cell.db").read_text().split())


def test_a_task_without_a_main_is_called_with_the_arm_under_control(tmp_path: Path, capfd) -> None:
    program = compiled_text('pumatask() { printf("%d joints\\n", how.n); move(park); waitfor(completed) }', tmp_path)
    assert len(way_of_c(program)) > 3
    assert capfd.readouterr().out == "6 joints\n"


def test_another_robot_is_named_by_a_variable(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setenv("QROBOT_ROBOT", "stanford")
    program = compiled_text("main() { move(park); waitfor(completed) return how.mode == 5; }", tmp_path)
    status, (trace,) = offline(lambda: run_executable(program))
    assert (status, trace.robot.name) == (1, "stanford")


def test_the_robot_of_the_deployment_file_is_that_of_a_program_in_c(tmp_path: Path, capfd) -> None:
    file = tmp_path / "cell.toml"
    file.write_text('[[arm]]\nname = "a"\nrobot = "stanford"\nboard = {}\nbridge = { port = 5600 }\n')
    text = 'main() { move(park); waitfor(completed) printf("%d joints\\n", how.n); return 3; }'
    program = compiled_text(text, tmp_path)
    out = tmp_path / "out"
    arguments = ["run", "--offline", "--deployment", str(file), "--output", str(out), str(program)]
    assert run_app(make_app("run"), arguments) == 3
    assert "6 joints" in capfd.readouterr().out
    assert read_setpoints(out / "setpoints.csv").robot == "stanford"
    assert {path.name for path in out.iterdir()} == {
        "requests.txt", "requests.jsonl", "setpoints.csv", "joints.png", "path.png"
    }  # fmt: skip


@pytest.mark.sampled(2)
@pytest.mark.parametrize("compiler", ["gcc", "clang"])
@pytest.mark.parametrize("warnings", [(), ("-Wall",)])
def test_what_compilers_of_today_call_errors_is_c_as_it_was(compiler: str, warnings, tmp_path, monkeypatch) -> None:
    if not shutil.which(compiler):
        pytest.skip(f"no {compiler}: apt install {compiler}")
    monkeypatch.setenv("CC", compiler)
    text = """
    #include <signal.h>
    extern char *malloc();
    static count;
    float half(x) float x; { return x / 2; }
    interrupted(n, code) { if (n) return; count = code; }
    int *somewhere;
    double (*f)() = half;
    main(argc, argv)
    char *argv[];
    {
        register i;
        signal(SIGUSR1, interrupted);
        somewhere = 0x1000;
        i = somewhere;
        later(3, 4.5);
        return i == 0x1000 && count == 7 ? 3 : 4;
    }
    later(a, b) double b; { count = a + b; }
    """
    assert run_executable(compiled_text(text, tmp_path, *warnings)) == 3


def test_two_sources_with_common_variables_and_old_definitions_are_one_program(tmp_path: Path, capfd) -> None:
    (tmp_path / "other.c").write_text('#include "rccl.h"\nint shared;\ncount(n) float n; { shared += n; }\n')
    text = 'int shared;\nregister_all() { count(2.5); count(3.); }\nmain() { register_all(); printf("%d\\n", shared); }'
    program = compiled_text(text, tmp_path, str(tmp_path / "other.c"))
    assert run_executable(program) in (0, 2)  # of old, a main without a return returned anything
    assert capfd.readouterr().out == "5\n"


@pytest.mark.thorough
def test_a_cell_written_from_the_documentation_alone_finds_its_plate_and_fits_its_parts_s09(
    tmp_path: Path, capfd, monkeypatch
) -> None:
    monkeypatch.setenv("CELL_DB", str(tmp_path / "cell.db"))
    program = compiled(EXAMPLES / "c" / "s09_assembly_cell.c", tmp_path, "-O2", "-lm")
    scene = Scene(kind="peg")
    settings = ServoSettings(rate_hz=1000.0, calibration=load_table("puma560", ROBOT))  # as packaged deployments do
    rig = LockstepRig(ROBOT, settings, Emulator(ROBOT, scene=scene))
    lesson = "joint 6 5\nq\nworld dx -150 dy 120 dz -50\nrecord\nq\ny\n"
    with rccl.use(partial(link_factory, rig, 28_000)), keyboard(lesson):
        assert run_executable(program) == 0
    said = capfd.readouterr().out
    assert re.findall(r"part \d: ended with (\d)", said) == ["7", "7"]
    mouth, clearance = 1e3 * np.array(scene.position_m), 1e3 * scene.clearance_m
    assert float(re.findall(r"plate found at z = (\S+)", said)[0]) == pytest.approx(mouth[2], abs=1.0)
    tip = np.array([float(row.split()[-1]) for row in said.partition("A:\n")[2].splitlines()[:3]])
    assert np.hypot(*(tip - mouth)[:2]) < clearance + 0.5  # the program begins 3 and 2 mm beside it
    assert tip[2] == pytest.approx(mouth[2] - 15.0, abs=1.0)
    assert said.count("\nfitted: ") == 2
    assert "stopped with -2\ndone: mode 5, hand 1, inputs 1, waist " in said
    assert {"PALLET", "PLATE"} <= set((tmp_path / "cell.db").read_text().split())


@pytest.mark.sampled(1)
@pytest.mark.parametrize("arm", ["off line", "in lock-step"])
def test_boxes_are_taken_off_a_moving_belt_by_a_program_in_the_way_of_the_time_s10(arm, tmp_path, capfd) -> None:
    """One box is taken; the others have gone by: one runs away during the dwell, one was out of reach before."""
    program = compiled(EXAMPLES / "c" / "s10_belt_to_rack.c", tmp_path, "-lm")
    rig = LockstepRig(ROBOT, ServoSettings(), Emulator(ROBOT), keep_telemetry=False)
    traces: list[Trace] = []
    with rccl.use(OfflineLink if arm == "off line" else partial(link_factory, rig, 28_000), traces):
        assert run_executable(program, ("2",)) == 0
        assert run_executable(program, ("2", "8")) == 0
    said = capfd.readouterr().out
    assert "2 of 2 boxes in the rack, 2 labels, 0 lost" in said
    assert "box 9: lost\nbox 10: lost\n0 of 2 boxes in the rack" in said
    for closed, behind in re.findall(r"hand closed (\d+) ms into the dwell, (\S+) mm behind", said):
        assert 200 < int(closed) <= 228
        assert abs(float(behind)) < 3.0
    for passing, nearest in re.findall(r"over the wall (\S+) mm from its top, (\S+) at the nearest", said):
        assert float(passing) - float(nearest) < (9.0 if arm == "off line" else 20.0)  # by which the arm lags, mm
    for label, stands in re.findall(r"label seen at y = (\S+), the arm stands at (\S+)", said):
        assert float(label) == pytest.approx(-150.0, abs=15.0)
        assert float(stands) < float(label) - 3.0  # it was measured where it was interrupted
    for trace in traces:  # the last motion of the program, which does not wait for it
        assert (trace.requests[-1].name, trace.requests[-1].code) == ("park", Termination.COMPLETED)


def test_the_hand_keeps_what_it_holds_while_the_arm_is_let_go_and_taken_again(tmp_path: Path) -> None:
    text = "main() { control(); CLOSE suspendfg(); release(); control(); suspendfg(); suspendfg(); release(); }"
    program, robot = compiled_text(text, tmp_path), FakeRobot(tuple(ROBOT.poses["park"]))
    with rccl.use(lambda hello: VirtualLink(hello, robot.transfer)):
        run_executable(program, ())
    hands = [command.hand for command in robot.commands]
    assert robot.goodbyes == 2
    assert set(hands[hands.index(2) :]) == {2}


@pytest.mark.parametrize("functions", [False, True])
def test_hand_and_outputs_are_the_programs_at_any_time(functions: bool, tmp_path: Path, capfd, monkeypatch) -> None:
    text = """
    int samples;
    blink() { ++samples; if (samples == 13) chg.outputs = 8; if (samples == 17) OPEN }
    show() { suspendfg(); suspendfg(); printf("%d %d, ", how.hand, chg.outputs); }
    main(argc) {
        chg.hand = 1;
        if (argc > 1) control(blink); else control();
        chg.outputs = ~0;       show();
        CLOSE                   show();
        chg.hand = 1; CLOSE     show();
        CLOSE; chg.hand = 1;    show();
        chg.outputs = 4;        show();
        chg.hand = 2;           while (samples && samples < 20) suspendfg(); show();
        chg.outputs = 2; release();
    }
    """
    commands: list[Command | None] = []
    exchange = OfflineLink.exchange
    monkeypatch.setattr(OfflineLink, "exchange", lambda link, told: (commands.append(told), exchange(link, told))[1])
    program = compiled_text(text, tmp_path)
    offline(lambda: run_executable(program, ("functions",) * functions))
    assert capfd.readouterr().out == f"1 -1, 2 -1, 2 -1, 1 -1, 1 4, {'1 8' if functions else '2 4'}, "
    assert commands[-1] is not None
    assert (commands[-1].hand, commands[-1].outputs) == (1 if functions else 2, 2)
