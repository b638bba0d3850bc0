"""The interpreter of VAL II on an ideal arm: motions, flow, signals, reactions, errors and going on after them."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from qrobot.arrays import Floats
from qrobot.config import load_robot
from qrobot.config.fences import Fence
from qrobot.errors import ProgramError, ServoFault
from qrobot.faultcodes import FaultCode
from qrobot.fences.fence_set import FenceSet
from qrobot.fences.in_force import use_fences
from qrobot.rccl.connect import open_channel
from qrobot.rci import VirtualLink
from qrobot.val.interpreter import Interpreter, RunState
from qrobot.val.monitor import ValMonitor
from qrobot.val.rccl_arm import RcclArm
from qrobot.val.source import SourceFile, print_source, read_source
from qrobot.val.values import (
    JointLocation,
    Transformation,
    joint_location,
    numbers_of,
    stored_numbers,
    transformation,
)
from qrobot.val.workspace import Workspace
from tests.support.fake_robot import FakeRobot
from tests.support.puma import PARK, ROBOT
from tests.support.val_runs import EXAMPLES, faked_arm, interpreter, main_program, number

PLACES = """
.LOCATIONS
a 450 150 0 90 90 0
b 450 -150 0 90 90 0
c 500 0 200 45 0 0
far 2000 0 0 90 90 0
.END
"""
TYPED = {
    "01_pick_and_place": ["the part has been moved by 412 mm"],
    "02_palletise": ["6 parts are on the pallet"],
    "03_light_curtain": ["somebody is there", "nobody is there", "the curtain has stopped the arm 1 time"],
    "04_touch_a_seam": ["the table is 12.0 mm below"],  # from -110 by steps of 2 to the first below -121
    "05_machine_handshake": ["loaded"],
    "06_process_control": ["the glue was switched on 2 times"],  # there, and on the way to READY
    "07_pause_and_proceed": ["done"],
    "08_sort": ["1 2 1"],
    "09_weave": ["woven 120 mm"],
    "10_recover": ["that place is out of reach", "the program goes on", "home"],
    "11_vacuum": ["the plate lies on the tray"],
    "12_touch_a_plane": ["the plate is tilted by 13 degrees", "the tool stands 5 mm above it"],  # slopes of 0.2 and 0.1
}


@pytest.mark.sampled(3)
@pytest.mark.parametrize("file", sorted(EXAMPLES.glob("*.v2")), ids=lambda file: file.stem)
def test_an_example_runs_to_its_end_and_types_what_it_has_done(file) -> None:
    """On RCCL and on ARCL, where it comes to rest at the same places but where it is stopped on its way."""
    rests = {library: _rests(file, library) for library in ("rccl", "arcl")}
    if file.stem not in ("03_light_curtain", "10_recover", "12_touch_a_plane"):
        assert len(rests["arcl"]) == len(rests["rccl"]) > 0
        assert np.array(rests["arcl"]) == pytest.approx(np.array(rests["rccl"]), abs=1e-6)
    assert rests["arcl"][-1] == pytest.approx(rests["rccl"][-1], abs=1e-6)


def _rests(file: Path, library: str) -> list[np.ndarray]:
    """Run an example, and tell the joint positions at which its arm came to rest."""
    with interpreter(file.read_text(), library=library) as (run, typed):
        arm, rests = run.machine.arm, [run.machine.arm.q]
        sample = arm.sample

        def look() -> None:
            sample()
            if arm.idle and np.abs(arm.q - rests[-1]).max() > 1e-4:
                rests.append(arm.q)

        arm.sample = look
        state = run.execute("main")
        if file.stem.startswith("07"):
            assert state is RunState.PAUSED
            state = run.proceed()
        assert state is RunState.COMPLETED, run.message
        assert typed == TYPED[file.stem]
        return [*rests, arm.q]


def result(*lines: str, rest: str = "") -> float:
    """The number x after these lines."""
    with interpreter(main_program(*lines, rest=rest)) as (run, _):
        assert run.execute("main") is RunState.COMPLETED, run.message
        return number(run, "x")


@pytest.mark.parametrize(
    ("expression", "value"),
    [
        ("2+3*4-6/3", 12),
        ("-7 MOD 3", -1),
        ("2 < 3 AND NOT 3 < 2", -1),
        ("1 OR 1 AND 0", -1),
        ("NOT 0 == 1", -1),
        ("NOT 0 AND 0", 0),
        ("0 OR 0", 0),
        ("SIN(30)+COS(60)", 1),
        ("ATAN2(1, -1)", 135),
        ("SQRT(SQR(3)+16)", 5),
        ("INT(-2.7)+FRACT(2.25)", -1.75),
        ("SIGN(-3)*ABS(-2)", -2),
        ("DCB(BCD(1234))", 1234),
        ("DCB(37)", 25),
        ("DISTANCE(TRANS(1,2,3), TRANS(4,6,3))", 5),
        ("DZ(TRANS(,,7,0,90):TRANS(,,5))", 2),  # o = 0, a = 90: the tool's z points down
        ("INRANGE(TRANS(450,,,90,90))", 0),
        ("INRANGE(TRANS(3000,,,90,90))", 1),
        ("DX(INVERSE(TRANS(5)):TRANS(5))", 0),
        ("DY(FRAME(TRANS(), TRANS(,1), TRANS(-1), TRANS()):TRANS(3,0,0))", 3),
        ("DX(SCALE(TRANS(4) BY 2.5))", 10),
    ],
)
def test_expressions_have_the_values_of_the_manual(expression: str, value: float) -> None:
    assert result(f"x = {expression}") == pytest.approx(value, abs=1e-9)


@pytest.mark.parametrize(
    ("lines", "value"),
    [
        ("x = 0|FOR i = 1 TO 5 STEP 2|x = x+i|END", 9),
        ("x = 0|FOR i = 3 TO 1|x = 1|END", 0),
        ("x = 0|FOR j = 1 TO 2|FOR i = 1 TO 3|IF i == 2 GOTO 10|x = x+1|END|10|END", 2),
        ("x = 0|WHILE x < 3 DO|x = x+1|END", 3),
        ("x = 0|DO|x = x+1|UNTIL x == 4", 4),
        ("IF 1 THEN|x = 1|ELSE|x = 2|END", 1),
        ("IF 0 THEN|x = 1|ELSE|x = 2|END", 2),
        ("CASE 5 OF|VALUE 1:|x = 1|VALUE 4, 5:|x = 2|ANY|x = 3|END", 2),
        ("CASE 6 OF|VALUE 1:|x = 1|ANY|x = 3|END", 3),
        ("x = 1|GOTO 20|x = 2|20 x = x+10", 11),
        ("x = 1|CALL twice(x)|CALL twice(x)", 4),
        ("x = 3|CALL twice(x+1)", 3),
        ("a[2] = 5|CALL twice(a[2])|x = a[2]", 10),
        ("SIGNAL 2001, 3|x = SIG(2001, 3, -4)+10*BITS(1, 4)|SIGNAL -3", 39),
        ("TIMER 1 = 5|DELAY 1|x = INT(TIMER(1))", 6),
        ("HALT", None),
    ],
)
def test_control_flow_and_signals(lines: str, value: float | None) -> None:
    text = ("x = 0", "HALT") if value is None else tuple(lines.split("|"))
    assert result(*text, rest=".PROGRAM twice(n)\nn = 2*n\n.END") == (value or 0)


@given(
    st.tuples(*[st.floats(-900, 900)] * 3),
    st.floats(-179, 179), st.floats(-89, 89), st.floats(-179, 179),
)  # fmt: skip
def test_six_numbers_of_a_location_come_back(p: tuple[float, ...], o: float, a: float, t: float) -> None:
    assert numbers_of(transformation((*p, o, a, t)).T) == pytest.approx((*p, o, a, t), abs=1e-6)


def test_ready_has_the_orientation_of_the_manual() -> None:
    robot = load_robot("puma560")
    T = Workspace(robot).tool_at(robot.poses["ready"])
    assert np.allclose(T[:3, :3], transformation((0, 0, 0, 90, -90, 0)).T[:3, :3], atol=1e-12)


def test_moves_end_where_they_should_with_tool_and_base() -> None:
    program = main_program("TOOL TRANS(,,100,90,-90)", "BASE ,,300", "MOVE SHIFT(a BY ,,300)", "BREAK", rest=PLACES)
    with interpreter(program) as (run, _):
        assert run.execute("main") is RunState.COMPLETED
        T = run.machine.frame("here")
        assert T[:3, 3] == pytest.approx([0.45, 0.15, 0.3], abs=1e-6)
        flange = run.machine.space.arm.flange(run.machine.arm.q)
        assert flange[:3, 3] == pytest.approx([0.45, 0.15, 0.1], abs=1e-6)  # the tool points down


def test_motions_are_joined_and_break_parts_them() -> None:
    times = []
    for between in ("", "BREAK"):
        with interpreter(main_program("MOVE a", between, "MOVE b", between, "MOVE a", rest=PLACES)) as (run, _):
            run.execute("main")
            times.append(run.machine.arm.time_s)
    assert times[0] < times[1] - 0.1


def test_monitor_speed_is_a_factor_of_every_speed() -> None:
    times = []
    for speed in (100.0, 25.0):
        with interpreter(main_program("MOVE a", "BREAK", "TIMER 1 = 0", "SPEED 200 MMPS", "MOVES b", "BREAK",
                                      "x = TIMER(1)", rest=PLACES)) as (run, _):  # fmt: skip
            run.machine.arm.override = speed
            run.execute("main")
            times.append(run.machine.values["x", ()])
    assert 1.5 < times[0] < 2.5
    assert 3.5 < times[1] / times[0] < 4.2  # but for the rest behind a motion


@pytest.mark.parametrize("library", ["rccl", "arcl"])
def test_monitor_speed_acts_on_the_line_under_way_which_stays_straight(library: str) -> None:
    with interpreter(main_program("MOVES b", rest=PLACES), library=library) as (run, _):
        arm, line = run.machine.arm, []
        run.do("MOVE a")
        sample, begin = arm.sample, arm.time_s

        def look() -> None:
            sample()
            if arm.override == 20.0 or run.machine.frame("here")[1, 3] < 0.140:
                line.append(run.machine.frame("here")[:3, 3])
                arm.override = 20.0

        arm.sample = look
        assert run.execute("main") is RunState.COMPLETED
    assert np.ptp(np.array(line)[:, [0, 2]], axis=0) == pytest.approx([0.0, 0.0], abs=1e-9)
    assert line[-1] == pytest.approx([0.450, -0.150, 0.0], abs=1e-6)
    assert arm.time_s - begin > 2.0


@pytest.mark.parametrize("library", ["rccl", "arcl"])
def test_a_stop_of_the_servo_pauses_a_program_and_proceed_leads_the_arm_back_to_its_path(library: str) -> None:
    fake = FakeRobot(tuple(PARK))
    with faked_arm(fake, library) as arm:
        run = Interpreter(arm)
        run.machine.load(read_source(main_program("MOVE a", "MOVES b", "x = 7", rest=PLACES))[0])
        for place in ("a", "b"):  # on the way to both
            begin = fake.seq
            fake.before_period = lambda seq, begin=begin: (
                fake.break_down(FaultCode.ESTOP) if seq == begin + 25 else None
            )
            state = run.execute("main") if place == "a" else run.proceed()
            assert state is RunState.PAUSED
            assert "ESTOP" in run.message
            fake.q = tuple(np.array(fake.q) - 0.02)
            for command in (lambda: run.execute("main"), lambda: run.do("READY")):
                with pytest.raises(ProgramError, match="PROCEED leads"):
                    command()
        assert run.proceed() is RunState.COMPLETED, run.message
        assert run.machine.frame("here")[:3, 3] == pytest.approx([0.450, -0.150, 0.0], abs=1e-6)
        assert run.machine.values["x", ()] == 7.0


@pytest.mark.parametrize("library", ["rccl", "arcl"])
def test_what_an_operator_confirms_does_not_move_an_arm_whose_program_is_paused(library: str) -> None:
    """Its reactions would not be looked at, and its hand would come late."""
    fake = FakeRobot(tuple(PARK))
    with faked_arm(fake, library) as arm:
        run = Interpreter(arm)
        run.machine.load(read_source(main_program("MOVE a", "MOVES b", rest=PLACES))[0])
        begin = 0
        fake.before_period = lambda seq: fake.break_down(FaultCode.ESTOP) if seq == begin + 25 else None
        for go_on in (lambda: run.execute("main"), run.proceed):  # the second time it is stopped on the way back
            begin = fake.seq
            assert go_on() is RunState.PAUSED
            stands = fake.q
            for paused in (True, False):
                fake.paused = paused
                for _ in range(400):
                    arm.sample()
            assert fake.q == stands
            assert arm.off_path
            fake.q = tuple(np.array(fake.q) - 0.02)
        fake.before_period = lambda _: None
        assert run.proceed() is RunState.COMPLETED, run.message
        assert run.machine.frame("here")[:3, 3] == pytest.approx([0.450, -0.150, 0.0], abs=1e-6)


@pytest.mark.parametrize("library", ["rccl", "arcl"])
def test_a_pause_of_a_program_beside_stops_the_arm_on_its_path_and_what_it_has_queued_comes_later(library: str) -> None:
    beside = ".PROGRAM p\nWAIT TIMER(1) > 0.5\nPAUSE\n.END\n"
    lines = "SPEED 20 ALWAYS", "TIMER 1 = 0", "PCEXECUTE p", "MOVE a", "MOVES b", "OPEN", "MOVES a"
    with interpreter(main_program(*lines, rest=beside + PLACES), library=library) as (run, _):
        hands: list[float] = []
        run.machine.arm.hand = lambda _: hands.append(run.machine.frame("here")[1, 3])  # type: ignore[method-assign]
        assert run.execute("main") is RunState.PAUSED
        assert run.message == "PAUSE in program p"
        assert run.machine.arm.idle
        for y in (0.150, -0.150):  # it is on its way to the first of them
            assert np.abs(run.machine.frame("here")[:3, 3] - [0.450, y, 0.0]).max() > 0.01
        assert run.proceed() is RunState.COMPLETED, run.message
        assert run.machine.frame("here")[:3, 3] == pytest.approx([0.450, 0.150, 0.0], abs=1e-6)
        assert hands == [pytest.approx(-0.150, abs=0.05)]  # as it leaves b


@pytest.mark.parametrize(
    "step", ["REACTI 1002, p, 9", "REACT 1002, p", "REACTE p", "LOCK 3", "IGNORE 1002", "RUNSIG 3"]
)
def test_what_counts_for_a_program_is_no_step_to_be_typed(step: str) -> None:
    with interpreter(main_program("PAUSE", rest=".PROGRAM p\nx = 1\n.END\n")) as (run, _):
        for _ in range(2):
            with pytest.raises(ProgramError, match="counts for the rest of a program"):
                run.do(step)
            run.execute("main")


def test_an_error_of_no_motion_leaves_the_hand_for_the_next_one() -> None:
    lines = "REACTE r", "MOVE a", "CLOSE", "x = 1/0", "DEPARTS 20"
    with interpreter(main_program(*lines, rest=".PROGRAM r\ny = 1\n.END\n" + PLACES)) as (run, _):
        hands: list[bool] = []
        run.machine.arm.hand = hands.append  # type: ignore[method-assign]
        assert run.execute("main") is RunState.COMPLETED, run.message
        assert hands == [False]


@pytest.mark.parametrize("library", ["rccl", "arcl"])
def test_the_way_out_of_an_error_does_not_open_the_hand_for_the_motion_that_failed(library: str) -> None:
    recover = '.PROGRAM recover\nDEPARTS 50\nBREAK\nTYPE "out"\n.END\n'
    lines = "REACTE recover", "MOVE a", "OPEN", "MOVES far", "MOVE b"
    with interpreter(main_program(*lines, rest=recover + PLACES), library=library) as (run, typed):
        hands: list[bool] = []
        run.machine.arm.hand = hands.append  # type: ignore[method-assign]
        run.execute("main")
        assert typed == ["out"]
        assert hands == []


def test_quit_gives_up_the_path_of_an_arm_that_the_servo_has_stopped_and_tells_why() -> None:
    fake = FakeRobot(tuple(PARK))
    channel = open_channel(lambda hello: VirtualLink(hello, fake.transfer), "puma560")
    run = Interpreter(RcclArm(channel))
    monitor, begin = ValMonitor(run), fake.seq
    fake.before_period = lambda seq: fake.break_down(FaultCode.ESTOP) if seq == begin + 25 else None
    assert re.search(r"ESTOP.*PROCEED leads", monitor.obey("DO READY"))
    assert monitor.obey("QUIT") == ""
    with pytest.raises(ServoFault, match="ESTOP"):
        channel.finish()
    channel.release()


@pytest.mark.parametrize(
    "words", ["RIGHTY ABOVE NOFLIP", "RIGHTY BELOW FLIP", "LEFTY BELOW NOFLIP", "LEFTY ABOVE FLIP"]
)
def test_a_configuration_is_taken_with_the_next_motion(words: str) -> None:
    letters = "".join(
        {"NOFLIP": "n", "RIGHTY": "r", "ABOVE": "u", "BELOW": "d"}.get(w, w[0].lower()) for w in words.split()
    )
    with interpreter(main_program(*words.split(), "MOVE c", "MOVES SHIFT(c BY 5)", rest=PLACES)) as (run, _):
        assert run.execute("main") is RunState.COMPLETED, run.message
        assert run.machine.space.branch(run.machine.arm.q).letters == letters


def test_a_place_that_another_configuration_reaches_is_told_with_its_words() -> None:
    places = ".LOCATIONS\nd 500 100 -150 90 90 0\n.END"
    with interpreter(main_program("READY", "MOVE d", rest=places)) as (run, _):
        assert run.execute("main") is RunState.FAILED
        words = run.message.partition("; ")[2].removesuffix(" before a MOVE gets there").split()
        assert words
        assert set(words) <= {"LEFTY", "BELOW", "FLIP"}
    with interpreter(main_program("READY", *words, "MOVE d", rest=places)) as (run, _):
        assert run.execute("main") is RunState.COMPLETED, run.message


@pytest.mark.parametrize("word", ["MOVE", "MOVES"])
def test_a_speed_that_no_joint_has_is_told_with_one_that_gets_there(word: str) -> None:
    with interpreter(main_program("MOVE a", "SPEED 1000 MMPS", f"{word} b", rest=PLACES)) as (run, _):
        assert run.execute("main") is RunState.FAILED
        assert " ms or more" not in run.message
        speed = run.message.partition("allowed; ")[2].removesuffix(" or less gets there")
        assert speed.endswith(" MMPS")
        run.machine.load(read_source(main_program("MOVE a", speed, f"{word} b", rest=PLACES))[0])
        assert run.execute("main") is RunState.COMPLETED, run.message
        assert run.machine.frame("here")[:3, 3] == pytest.approx([0.45, -0.15, 0.0], abs=1e-6)


@pytest.mark.parametrize("library", ["rccl", "arcl"])
def test_an_error_stops_the_arm_and_retry_goes_on_from_the_step(library: str) -> None:
    program = main_program("MOVE a", "MOVES far", "MOVE b", "BREAK", 'TYPE "end"', rest=PLACES)
    with interpreter(program, library=library) as (run, typed):
        assert run.execute("main") is RunState.FAILED
        assert run.message.startswith("program main, line 3, column 1: ")
        assert run.machine.arm.idle
        run.machine.values["far", ()] = run.machine.values["b", ()]
        assert run.retry() is RunState.COMPLETED
        assert typed == ["end"]
        assert run.machine.frame("here")[:3, 3] == pytest.approx([0.45, -0.15, 0.0], abs=1e-6)


@pytest.mark.parametrize(
    ("single", "times", "library"), [(False, 1, "rccl"), (False, 4, "rccl"), (True, 2, "rccl"), (False, 4, "arcl")]
)
def test_a_motion_that_is_interrupted_is_taken_up_by_proceed(single: bool, times: int, library: str) -> None:
    """Also by Ctrl-C again while the arm comes to rest, and by one while NEXT waits for its motion's end."""
    lines = "MOVE a", "BREAK", "SPEED 20", "MOVES b", "BREAK", "x = y", 'TYPE "end"'
    with interpreter(main_program(*lines, rest=PLACES), library=library) as (run, typed):
        count = iter(range(1000))
        sample = run.machine.arm.sample

        def interrupted() -> None:
            sample()
            if 60 <= next(count) < 60 + times:
                raise KeyboardInterrupt

        run.machine.arm.sample = interrupted  # type: ignore[method-assign]
        with pytest.raises(KeyboardInterrupt):
            _run_on(run, single)
        assert run.state is RunState.PAUSED
        where = run.machine.frame("here")[:3, 3]
        assert where[[0, 2]] == pytest.approx([0.45, 0.0], abs=1e-4)  # on its straight line
        assert -0.149 < where[1] < 0.149
        assert run.proceed() is RunState.FAILED  # y is not defined
        assert run.machine.frame("here")[:3, 3] == pytest.approx([0.45, -0.15, 0.0], abs=1e-6)
        run.machine.values["y", ()] = 1.0
        assert run.retry() is RunState.COMPLETED
        assert typed == ["end"]


def _run_on(run: Interpreter, single: bool) -> None:
    """Run `main` to its end, by single steps or in one go."""
    run.execute("main", single=single)
    while single and run.state is RunState.PAUSED:
        run.proceed(single=True)


def test_a_question_that_is_interrupted_is_asked_again() -> None:
    with interpreter(main_program('PROMPT "n", x', "y = x"), "7") as (run, typed):
        answer, run.machine.ask = typed.ask, _interrupted
        with pytest.raises(KeyboardInterrupt):
            run.execute("main")
        run.machine.ask = answer
        assert run.proceed() is RunState.COMPLETED
        assert run.machine.values["y", ()] == 7.0


def _interrupted(_text: str) -> str:
    raise KeyboardInterrupt


def test_a_mistake_in_a_reaction_is_retried_and_the_stopped_motion_counts_as_ended() -> None:
    lines = "REACTI 2001, r", "PCEXECUTE p", "MOVE a", "BREAK", "SPEED 20", "MOVES b", "BREAK", "y = DY(HERE)"
    r, p = ".PROGRAM r\nx = z\n.END\n", ".PROGRAM p\nWAIT DY(HERE) < 50 AND DY(HERE) > 0 AND y\nSIGNAL 2001\n.END"
    with interpreter(main_program(*lines, rest=r + p + PLACES)) as (run, _):
        run.machine.values["y", ()] = 1.0
        assert run.execute("main") is RunState.FAILED
        assert run.message.startswith("program r, line 12, column 5: the value of z is not defined")
        assert run.retry() is RunState.FAILED  # the same step
        run.machine.values["z", ()] = 1.0
        assert run.retry() is RunState.COMPLETED
        assert -20.0 < number(run, "y") < 50.0


def test_next_does_single_steps() -> None:
    with interpreter(main_program("x = 1", "; nothing", "x = 2", "x = 3")) as (run, _):
        states = [run.execute("main", single=True)]
        seen = [run.machine.values["x", ()]]
        while states[-1] is RunState.PAUSED:
            states.append(run.proceed(single=True))
            seen.append(run.machine.values["x", ()])
        assert seen[:3] == [1.0, 2.0, 3.0]
        assert states[-1] is RunState.COMPLETED
        run.execute("main", single=True)  # the last step of before does not count
        assert run.machine.values["x", ()] == 1.0
        assert run.state is RunState.PAUSED


def test_an_analogue_output_is_set_on_either_library() -> None:
    with interpreter(main_program("DAC 2 = 3.5", "x = 1")) as (run, _):
        assert run.execute("main") is RunState.COMPLETED
    with interpreter(main_program("DAC 2 = 3.5"), library="arcl") as (run, _):
        assert run.execute("main") is RunState.FAILED  # no deployment file tells of one
        assert "there is no analogue output 2 of puma560" in run.message


@pytest.mark.parametrize(
    ("lines", "said"),
    [
        ("x = y", "line 2, column 5: the value of y is not defined"),
        ("x = 1/0", "line 2, column 6: 1 / 0 is no number"),
        ("x = DCB(485)", "DCB of 485 is no number"),  # 0x1e5
        ("x = DCB(26)", "DCB of 26 is no number"),
        ("CALL main", "calls are 100 deep"),
        ("SIGNAL 1001", "is an input"),
        ("SIGNAL 99", "there is no signal 99"),
        ("FOR i = 1 TO 2 STEP 0|END", "never ends"),
        ("DAC 9 = 0", "there is no analogue output 9; there are 1 to 8"),
        ("DAC 1.5 = 0", "expected a whole number"),
        ("TIMER 99 = 0", "timers are 0 to 15"),
        ("MOVE x", "the value of x is not defined"),
        ("x = 3|MOVE x", "line 3, column 6: expected a location, not a number"),
        ("SET #p = TRANS()", "a precision point has a # in front"),
        ("DRIVE 7, 1, 10", "joints are 1 to 6"),
        ("SPEED 0", "SPEED: 0.1 to 1000 per cent is needed, not 0"),
        ("x = 0|SPEED x MMPS", "SPEED: a number above 0 and up to 1000 is needed, not 0"),
        ("x = 0|PCEXECUTE main, x", "cycles: expected 1 or more, or a negative number"),
        ("PCEXECUTE main|DELAY 1", "beside"),
        ("DELAY -1", "DELAY: expected 0 to 86400 seconds, not -1"),
        ("DELAY 1E12", "DELAY: expected 0 to 86400 seconds, not 1e+12"),
        ("LOCK 128", "LOCK: expected a priority from 0 to 127, not 128"),
        ("LOCK 1E20", "1e+20 is too large a whole number"),
        ("REACT 2001, main, 0", "REACT: expected a priority from 1 to 127, not 0"),
        ("x = SIG(1E30)", "1e+30 is no signal"),
        ("MOVE TRANS(1E308)", "1e+308 is too large for a location"),
        ("MOVE #PPOINT(1E308,0,0,0,0,0)", "1e+308 is too large for a location"),
        ("TOOL SHIFT(NULL BY 1E200)", "1e+200 is too large for a location"),
        ("SET p = SCALE(TRANS(1E5) BY 1E5)", "1e+10 is too large for a location"),
        ("BASE 1E308", "1e+308 is too large for a location"),
        ("READY|APPRO HERE, 1E200", "is too large for a location"),
    ],
)
def test_a_mistake_while_it_runs_names_its_line(lines: str, said: str) -> None:
    with interpreter(main_program(*lines.split("|"))) as (run, _):
        assert run.execute("main") is RunState.FAILED
        assert said in run.message
        assert isinstance(run.error, ProgramError)


def test_a_reaction_with_a_higher_priority_alone_interrupts() -> None:
    lines = "LOCK 2", "REACT 2001, low, 1", "REACT 2002, high, 3", "SIGNAL 2001, 2002", "x = 1", "LOCK 0", "x = 2"
    low, high = '.PROGRAM low\nTYPE "low", x\n.END\n', '.PROGRAM high\nTYPE "high"\n.END'
    program = main_program(*lines, rest=low + high)
    with interpreter(program) as (run, typed):
        assert run.execute("main") is RunState.COMPLETED
        assert typed == ["high", "low 1"]


def test_a_number_without_a_format_has_a_blank_before_it() -> None:
    lines = 'TYPE "label", TRUE, FALSE', "TYPE INT(-3.7), FRACT(3.25), /I3, 7, 8"
    with interpreter(main_program(*lines)) as (run, typed):
        assert run.execute("main") is RunState.COMPLETED
        assert typed == ["label -1 0", " -3 0.25  7  8"]


def test_do_leaves_a_paused_program_where_it_is() -> None:
    with interpreter(main_program("x = 1", "PAUSE", "x = x+1")) as (run, _):
        run.execute("main")
        run.do("x = 41")
        with pytest.raises(ProgramError, match="no part of a structure"):
            run.do("GOTO 10")
        with pytest.raises(ProgramError, match="not defined"):
            run.do("MOVE nowhere")
        assert run.proceed() is RunState.COMPLETED
        assert run.machine.values["x", ()] == 42.0


def test_what_was_taught_is_stored_and_read_again() -> None:
    with interpreter(main_program("HERE #p", "HERE q[1]", "x = 2.5")) as (run, _):
        run.execute("main")
        text = print_source(run.machine.source())
        again, errors = read_source(text)
        assert errors == []
        assert again.numbers == {"x": 2.5}
        assert again.locations["#p"] == pytest.approx([0, -45, 180, 0, 45, 0])
        assert print_source(again) == text


LENGTHS = st.one_of(st.floats(-3000.0, 3000.0), st.integers(-3000, 3000).map(float))
TURNS = st.one_of(st.floats(-180.0, 180.0), st.sampled_from([-180.0, -90.0, 0.0, 45.0, 90.0, 180.0]))
POSES = st.tuples(LENGTHS, LENGTHS, LENGTHS, TURNS, TURNS, TURNS).map(transformation)
STORED = st.one_of(
    POSES,
    st.tuples(POSES, POSES).map(lambda two: Transformation(two[0].T @ two[1].T)),
    st.lists(TURNS, min_size=6, max_size=6).map(lambda degrees: joint_location("#p", degrees, ROBOT)),
)


@given(STORED)
def test_a_location_that_is_stored_is_the_same_when_it_is_read_and_stored_again(
    value: Transformation | JointLocation,
) -> None:
    name = "#p" if isinstance(value, JointLocation) else "p"
    text = print_source(SourceFile(locations={name: stored_numbers(value, ROBOT)}))
    source, errors = read_source(text)
    assert errors == []
    numbers = source.locations[name]
    back = joint_location("#p", numbers, ROBOT) if isinstance(value, JointLocation) else transformation(numbers)
    assert np.abs(np.ravel(_array(back) - _array(value))).max() < 1e-9
    assert print_source(SourceFile(locations={name: stored_numbers(back, ROBOT)})) == text


def _array(value: Transformation | JointLocation) -> Floats:
    return value.q if isinstance(value, JointLocation) else value.T


def test_what_rounding_adds_is_not_stored() -> None:
    steps = [
        "SET a = TRANS(450, 0, 0, 90, -90, 0):TRANS(0.1, 0.2, 0, 90, -90, 0)",
        "SET b = SHIFT(a BY 0.2)",
        "HERE #p",
    ]
    with interpreter(main_program(*steps)) as (run, _):
        run.execute("main")
        lines = print_source(run.machine.source()).splitlines()
        places = [line for line in lines if line.startswith(("a ", "b ", "#p "))]
        assert places == ["#p 0 -45 180 0 45 0", "a 450.1 0.2 0 0 -90 90", "b 450.3 0.2 0 0 -90 90"]


def test_a_motion_into_a_fence_is_refused_in_its_words_and_the_next_one_is_done() -> None:
    bench = FenceSet(load_robot("puma560"), [Fence(name="bench", shape="plane", position_m=(0.0, 0.0, -0.3))])
    rest = ".LOCATIONS\na 450 150 0 90 90 0\nlow 450 0 -320 90 90 0\n.END"
    with use_fences(bench), interpreter(main_program("MOVE low", rest=rest)) as (run, _):
        stood = run.machine.arm.q
        assert run.execute("main") is not RunState.COMPLETED
        assert "would be" in run.message
        assert "fence 'bench'" in run.message
        assert run.machine.arm.q == pytest.approx(stood)
        run.machine.load(read_source(main_program("MOVE a", rest=rest))[0])
        assert run.execute("main") is RunState.COMPLETED
        assert bench.distances(run.machine.arm.q)[0] > 0.02
