"""RCI for programs in C: tasks on virtual time, in real time, and on an arm that runs."""

from __future__ import annotations

import json
import os
import re
import select
import signal
import subprocess
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from qrobot import rccl, rci
from qrobot.cli import toolchain
from qrobot.cli.console import run_app
from qrobot.cli.main import make_app
from qrobot.errors import ConfigError
from qrobot.faultcodes import FaultCode
from qrobot.modecodes import Mode
from qrobot.rccl.c.program import run_executable
from qrobot.rccl.offline import OfflineLink
from qrobot.rci import VirtualLink
from qrobot.rci.robot_cycle import MOST_STARTS
from qrobot.rci.robot_data import RobotData
from qrobot.realtime.setup import may_lock_all
from qrobot.rig.lockstep import LockstepRig, link_factory
from qrobot.servo.settings import ServoSettings
from qrobot.sim_board.emulator import Emulator
from tests.support.c_programs import (
    CHECKED,
    EXAMPLES,
    FOUND,
    VALGRIND,
    needs_compiler,
    needs_cpp_compiler,
    needs_valgrind,
    ran,
)
from tests.support.fake_robot import FakeRobot, TcpRobot
from tests.support.late_robot import LATE, hear_power_late, lose_power, lose_streams, stop_power_up
from tests.support.patience import PATIENCE_S, wait_until
from tests.support.processes import FIRST_START_S, RunningArm
from tests.support.puma import PARK, ROBOT
from tests.system.test_rci_programs import TABLE

SUPPORT = Path(__file__).parents[1] / "support"
LIVE = SUPPORT / "rci_live.c", SUPPORT / "rci_live_more.c"
STRICT = ("-std=c99", "-D_GNU_SOURCE", "-Wall", "-Wextra", "-Werror", "-g", "-O1")
BLOCKED = """
#include "rci.h"
#include <stdio.h>
#include <unistd.h>
static int ends[2], begun;
static void wait_for_a_letter(RCI_TASK *td)
{
    char letter;
    __atomic_store_n(&begun, 1, __ATOMIC_RELEASE);
    td->user = read(ends[0], &letter, 1) == 1 ? td : 0;
}
static int blocks(void) { return __atomic_load_n(&begun, __ATOMIC_ACQUIRE); }
int main(void)
{
    RCI_TASK *td = rci_create("sensor", "aux");
    if (td == 0 || pipe(ends) || rci_control(td, wait_for_a_letter, 0, 0) || rci_onclock(td, 1, 0))
        return 1;
    if (rci_timeout(td, 0.2) || rci_start(td->bit) || rci_wait(blocks))
        return 2;
    printf("rci_close: %d\\n", rci_close());
    return 0;
}
"""
FORKS = """
#include "rci.h"
#include <malloc.h>
#include <sys/wait.h>
#include <unistd.h>
static RCI_TASK *td;
static int ends[2];
static void wait_for_a_letter(RCI_TASK *td)
{
    char letter;
    td->user = read(ends[0], &letter, 1) == 1 ? td : 0;
}
static int child_keeps_what_it_closes(void)
{
    size_t kept = 0;
    int i, status;
    if (fork()) {
        wait(&status);
        return WEXITSTATUS(status);
    }
    for (i = 0; i < 40; i++) {
        if (rci_create("own", "") == 0 || rci_close())
            _exit(4);
        if (i == 19) /* malloc sets a few pieces aside at first */
            kept = mallinfo2().uordblks;
    }
    _exit(mallinfo2().uordblks == kept ? 0 : 5);
}
int main(void)
{
    td = rci_create("sensor", "aux");
    if (td == 0 || pipe(ends) || rci_control(td, wait_for_a_letter, 0, 0) || rci_onclock(td, 1, 0))
        return 1;
    if (rci_timeout(td, 0.2) || rci_start(td->bit))
        return 2;
    while (rci_state(td) != RCI_ENDED)
        usleep(1000);
    if (child_keeps_what_it_closes())
        return 3;
    return rci_close() ? 6 : child_keeps_what_it_closes();
}
"""
HANDLED = """
#include "rci.h"
#include <signal.h>
#include <stdlib.h>
#include <sys/time.h>
static RCI_TASK *td;
static void rest(RCI_TASK *td) { (void) td; }
static void on_alarm(int number)
{
    static int count;
    if (number != SIGALRM || rci_state(td) != RCI_ACTIVE)
        _Exit(3);
    if (++count == 500)
        exit(0);
}
int main(void)
{
    const struct itimerval often = {{0, 100}, {0, 100}};
    if ((td = rci_create("watch", "aux")) == 0 || rci_control(td, rest, 0, 0) || rci_onclock(td, 1, 0))
        return 1;
    if (rci_start(td->bit) || signal(SIGALRM, on_alarm) == SIG_ERR || setitimer(ITIMER_REAL, &often, 0))
        return 2;
    for (;;)
        rci_runs(td);
}
"""
BOTH = """
#include "rccl.h"
#include "rci.h"
static RCI_TASK *td;
static void rest(RCI_TASK *td) { (void) td; }
static int over(void) { return rci_runs(td) > 2; }
int main(int n, char **words)
{
    (void) words;
    if (n > 1)
        control();
    if ((td = rci_create("watch", "")) == 0 || rci_control(td, rest, 0, 0) || rci_onclock(td, 1, 0))
        return 6;
    if (rci_start(td->bit))
        return 7;
    if (rci_wait(over))
        return 8;
    control();
    return 9;
}
"""
LOCKED = """
#include "rci.h"
#include <stdio.h>
static RCI_TASK *td;
static void rest(RCI_TASK *td) { (void) td; }
static int over(void) { return rci_runs(td) > 2; }
int main(void)
{
    char line[256];
    FILE *status;
    if ((td = rci_create("watch", "")) == 0 || rci_control(td, rest, 0, 0) || rci_onclock(td, 1, 0) ||
        rci_start(td->bit) || rci_wait(over) || (status = fopen("/proc/self/status", "r")) == NULL)
        return 1;
    while (fgets(line, sizeof line, status))
        fputs(line, stdout);
    return fclose(status);
}
"""
TURN = """
#include "rci.h"
static RCI_TASK *td;
static void turn(RCI_TASK *td)
{
    double q[6];
    int j;
    for (j = 0; j < 6; j++) q[j] = td->how.q_setpoint[j] + (j == 0 ? 0.001 : 0.0);
    rci_goto(td, q);
}
static int over(void) { return rci_runs(td) > 9; }
int main(void)
{
    if ((td = rci_create("puma560", "")) == 0 || rci_control(td, turn, 0, 0))
        return 6;
    if (rci_start(td->bit))
        return 7;
    if (rci_wait(over))
        return 8;
    return rci_close();
}
"""
LEFT = """
#include "rci.h"
#include <string.h>
static RCI_TASK *td;
static int fails;
static void rest(RCI_TASK *td) { if (fails && rci_runs(td) > 4) td->chg.hand = 9; }
static int over(void) { return rci_runs(td) > 6; }
int main(int n, char **words)
{
    fails = n > 1 && strcmp(words[1], "fails") == 0;
    if ((td = rci_create("puma560", "")) == 0 || rci_control(td, rest, 0, 0))
        return 6;
    if (rci_start(td->bit))
        return 7;
    if (rci_wait(over) != -fails || rci_release(td->bit))
        return 8;
    if (n > 2)
        return 0;
    if (rci_powerOff(td->bit) || rci_powerOff(td->bit))
        return 9;
    return rci_state(td) != (fails ? RCI_ENDED : RCI_RELEASED) || rci_close();
}
"""
RELEASED = """
#include "rci.h"
#include <time.h>
static RCI_TASK *td;
static volatile int inside;
static void turn(RCI_TASK *td)
{
    double q[6];
    int j;
    for (j = 0; j < 6; j++) q[j] = td->how.q_setpoint[j] + (j == 0 ? 0.005 : 0.0);
    rci_goto(td, q);
    if (rci_runs(td) > 9) {
        const struct timespec moment = {0, 200000000};
        inside = 1;
        nanosleep(&moment, 0);
    }
}
static int is_inside(void) { return inside; }
int main(void)
{
    if ((td = rci_create("puma560", "")) == 0 || rci_control(td, turn, 0, 0))
        return 6;
    if (rci_start(td->bit))
        return 7;
    if (rci_wait(is_inside))
        return 8;
    return rci_release(td->bit) || rci_close();
}
"""
HEARD = """
#include "rci.h"
#include <stdio.h>
static RCI_TASK *td;
static void stay(RCI_TASK *td)
{
    rci_goto(td, td->how.q_setpoint);
    printf("%ld %.6f\\n", rci_missed(td), td->how.time);
    fflush(stdout);
}
static int over(void) { return rci_runs(td) > 9; }
int main(void)
{
    if ((td = rci_create("puma560", "")) == 0 || rci_control(td, stay, 0, 0))
        return 6;
    if (rci_start(td->bit))
        return 7;
    if (rci_wait(over))
        return 8;
    return rci_close();
}
"""
CONVERSIONS = """
#include "rci.h"
#include <stdio.h>
int main(void)
{
    RCI_TASK *td = rci_create("puma560", "");
    double q[6], tau[6], back[6];
    long counts[6], dac[6];
    int i;
    while (scanf("%lf %lf %lf %lf %lf %lf", q, q + 1, q + 2, q + 3, q + 4, q + 5) == 6) {
        rci_angtoenc(td->robot, q, counts);
        rci_enctoang(td->robot, counts, back);
        for (i = 0; i < 6; i++) tau[i] = 20. * q[i];
        rci_tortodac(td->robot, tau, dac);
        rci_dactotor(td->robot, dac, tau);
        for (i = 0; i < 6; i++) printf("%ld %.17g %ld %.17g\\n", counts[i], back[i], dac[i], tau[i]);
    }
    for (i = 0; i < 6; i++) printf("%.17g %.17g %.17g %.17g\\n", td->robot->q_min[i], td->robot->q_max[i],
                                   td->robot->v_max[i], td->robot->tau_max[i]);
    return rci_close();
}
"""

pytestmark = needs_compiler
Make = Callable[..., Path]


@pytest.fixture(scope="module")
def make(tmp_path_factory: pytest.TempPathFactory) -> Make:
    """Compiles a program of several sources, or of one that is given as text."""
    folder = tmp_path_factory.mktemp("rci")

    def made(*sources: Path | str, flags: tuple[str, ...] = STRICT) -> Path:
        target = folder / f"program{len(os.listdir(folder))}"
        if isinstance(text := sources[0], str):
            sources = (target.with_suffix(".c"),)
            sources[0].write_text(text)
        command = toolchain.command_line([*flags, *map(str, sources), "-o", str(target)])
        subprocess.run(command, check=True)
        return target

    return made


def example(make: Make, name: str) -> Path:
    return make(EXAMPLES / "c" / f"{name}.c")


@pytest.mark.parametrize(
    ("language", "standard"), [("c", "-std=c89"), pytest.param("c++", "-std=c++11", marks=needs_cpp_compiler)]
)
def test_the_header_is_c89_and_cpp11(language: str, standard: str) -> None:
    include = toolchain.RCI / "include" / "rci.h"
    command = [*toolchain.compiler(), "-x", language, standard, "-Wall", "-Wextra", "-Wpedantic", "-Werror"]
    subprocess.run([*command, "-fsyntax-only", include], check=True)


def test_the_table_of_two_tasks_in_c_is_that_of_the_example_in_python_s10(
    make: Make, capfd: pytest.CaptureFixture[str]
) -> None:
    program = example(make, "rci_tasks")
    virtual = os.environ | {"QROBOT_RCI_TIME": "virtual"}
    assert subprocess.run([program], env=virtual, capture_output=True, text=True, check=True).stdout == TABLE
    assert run_app(make_app("run"), ["run", "--lockstep", str(program)]) == 0
    assert capfd.readouterr().out == TABLE


def test_tasks_beside_an_arm_of_rccl_are_refused_on_virtual_time_whichever_comes_first(
    make: Make, capfd: pytest.CaptureFixture[str]
) -> None:
    """Each would have a time of its own, which stands still while the program waits for the other."""
    program = make(BOTH, flags=("-Wall", "-Werror"))
    with rci.use(OfflineLink), rccl.use(OfflineLink):
        for words, status, told in (
            ([], 1, "tasks of RCI are active on virtual time"),
            (["x"], 7, "rci_start: on virtual"),
        ):
            assert run_executable(program, words) == status
            assert told in capfd.readouterr().err


def test_every_call_does_on_virtual_time_what_the_papers_say(make: Make) -> None:
    program = make(SUPPORT / "rci_calls.c", flags=(*STRICT, *CHECKED))
    checked = os.environ | {"QROBOT_RCI_TIME": "virtual", "UBSAN_OPTIONS": "halt_on_error=1"}
    done = subprocess.run([program], env=checked, capture_output=True, text=True, check=False)
    assert (done.stdout, done.returncode) == ("", 0), done.stderr


def test_conversions_and_limits_are_those_of_python_to_the_last_count(make: Make) -> None:
    poses = np.random.default_rng(3).uniform(ROBOT.limits.q_min, ROBOT.limits.q_max, (20, 6))
    text = "\n".join(" ".join(repr(x) for x in pose) for pose in poses.tolist())
    said = subprocess.run([make(CONVERSIONS)], input=text, capture_output=True, text=True, check=True).stdout
    found = np.array([line.split() for line in said.splitlines()], float).reshape(-1, 6, 4)
    data = RobotData(ROBOT)
    for pose, (counts, back, dac, tau) in zip(poses, found[:-1].transpose(0, 2, 1), strict=True):
        assert (counts == data.counts(pose)).all()
        assert back == pytest.approx(data.joints(data.counts(pose)), abs=1e-12)
        assert (dac == data.dac(20.0 * pose)).all()
        assert tau == pytest.approx(data.torques(data.dac(20.0 * pose)), abs=1e-9)
    limits = (data.limits.q_min, data.limits.q_max, data.limits.v_max, data.tau_max)
    assert (np.array(limits) == found[-1].T).all()


def test_a_robot_file_of_ones_own_is_compiled_in_and_two_of_one_name_are_refused(tmp_path: Path) -> None:
    from qrobot.config import robot_path
    from qrobot.rci.c.robot_table import robot_table

    other = tmp_path / "other.toml"
    packaged = robot_path("puma560")
    other.write_text(re.sub(r'^name = "puma560"', 'name = "other"', packaged.read_text(), flags=re.MULTILINE))
    assert f'{{"other", {json.dumps(str(other))}, 6, ' in robot_table([packaged, other])
    with pytest.raises(ConfigError, match="two robots of the name puma560"):
        robot_table([packaged, packaged])


def test_one_arm_mirrors_another_in_c(make: Make, capfd: pytest.CaptureFixture[str]) -> None:
    with rci.use({name: partial(OfflineLink, robot=ROBOT) for name in ("left", "right")}):
        assert run_executable(example(make, "rci_mirror")) == 0
    behind = float(re.findall(r"at most (\S+) degrees", capfd.readouterr().out)[0])
    assert 0.1 < behind < 25.0 * np.pi / 8.4 * 0.084  # no more than three samples at the fastest of the swing


@pytest.mark.sampled(1)
@pytest.mark.parametrize(("arguments", "late"), [((), 1.5), (("4",), 1.0)], ids=["28 ms", "4 ms"])
def test_a_mirror_in_c_begins_wherever_the_arms_stand(
    arguments: tuple[str, ...], late: float, make: Make, capfd: pytest.CaptureFixture[str]
) -> None:
    start = np.radians([50.0, -70.0, 170.0, 20.0, 60.0, -40.0])
    rigs = {
        "left": LockstepRig(ROBOT, ServoSettings(rate_hz=1000.0), Emulator(ROBOT, start=start)),
        "right": LockstepRig(ROBOT, ServoSettings(rate_hz=1000.0)),
    }
    with rci.use({name: partial(link_factory, rig, 28_000) for name, rig in rigs.items()}):
        assert run_executable(example(make, "rci_mirror"), arguments) == 0
    assert float(re.findall(r"at most (\S+) degrees", capfd.readouterr().out)[0]) < late
    left, right = (rig.rows() for rig in rigs.values())
    assert not left["fault"].any()
    assert not right["fault"].any()
    assert right["q"][-1] == pytest.approx(np.array([-1, 1, 1, -1, 1, -1]) * left["q"][-1], abs=0.02)


def test_a_hybrid_controller_in_c_makes_a_spring_of_one_joint(make: Make) -> None:
    rig = LockstepRig(ROBOT, ServoSettings(rate_hz=1000.0))
    with rci.use(partial(link_factory, rig, 28_000)):
        assert run_executable(example(make, "rci_spring")) == 0
    rows = rig.rows()
    assert not rows["fault"].any()
    gone = rows["q"] - PARK
    assert 0.45 < gone[-1, 0] < 0.55
    assert np.abs(gone[:, 1:]).max() < 0.02
    assert rows[-1]["mode"] == Mode.HOLDING


@pytest.fixture(scope="module")
def turns(make: Make) -> Path:
    return make(TURN)


@pytest.mark.parametrize("stops", [False, True])
def test_a_stream_in_c_that_is_lost_before_it_moves_the_arm_begins_again(turns: Path, stops: bool) -> None:
    robot = FakeRobot(tuple(PARK))
    lose_streams(robot, MOST_STARTS - 1, stops)
    with rci.use(partial(VirtualLink, transfer=robot.transfer)):
        assert run_executable(turns) == 0
    assert len({command.stream for command in robot.commands if any(command.modes)}) == MOST_STARTS
    assert robot.q[0] > PARK[0] + 0.005


@pytest.mark.parametrize(("streams", "move"), [(MOST_STARTS, 0.0), (1, 1e-5)])
def test_it_ends_the_task_when_that_happens_too_often_or_has_moved_the_arm(
    turns: Path, capfd: pytest.CaptureFixture[str], streams: int, move: float
) -> None:
    robot = FakeRobot(tuple(PARK))
    lose_streams(robot, streams, move=move)
    with rci.use(partial(VirtualLink, transfer=robot.transfer)):
        assert run_executable(turns) == 7
    assert "does not follow the setpoints: STREAM_LOST" in capfd.readouterr().err


@pytest.mark.parametrize("before", [Mode.OFF, Mode.HOLDING])
def test_no_stream_in_c_begins_again_where_somebody_has_taken_power_away_meanwhile(
    turns: Path, capfd: pytest.CaptureFixture[str], before: Mode
) -> None:
    robot = FakeRobot(tuple(PARK))
    robot.mode = before
    robot.lose_stream_and(FakeRobot.lose_power_by_hand)
    with rci.use(partial(VirtualLink, transfer=robot.transfer)):
        assert run_executable(turns) == 7
    assert robot.mode is Mode.OFF
    assert len(robot.streams) == 1
    assert "let go of the arm before it followed: STREAM_LOST" in capfd.readouterr().err


def test_no_stream_in_c_begins_again_where_somebody_has_asked_for_a_stop_meanwhile(
    turns: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    robot = FakeRobot(tuple(PARK))
    robot.lose_stream_and(FakeRobot.stop_by_hand)
    with rci.use(partial(VirtualLink, transfer=robot.transfer)):
        assert run_executable(turns) == 7
    assert robot.mode is Mode.HOLDING
    assert len(robot.streams) == 1
    assert robot.q == tuple(PARK)
    assert "somebody has stopped the arm before it moved" in capfd.readouterr().err


@pytest.mark.parametrize("told", [False, True])
def test_a_task_in_c_heeds_a_stop_that_came_after_it_began_and_no_older_one(
    turns: Path, capfd: pytest.CaptureFixture[str], told: bool
) -> None:
    robot = FakeRobot(tuple(PARK))
    robot.mode = Mode.HOLDING
    robot.script((2 if told else 1, FakeRobot.tell_stop_before_stream))
    with rci.use(partial(VirtualLink, transfer=robot.transfer)):
        assert (run_executable(turns) == 0) is not told
    assert (robot.q == tuple(PARK)) is told
    assert ("somebody has stopped the arm before it moved" in capfd.readouterr().err) is told


def test_a_stop_by_hand_is_told_as_one_in_c_too(turns: Path, capfd: pytest.CaptureFixture[str]) -> None:
    robot = FakeRobot(tuple(PARK))

    def happens(_: int) -> None:
        if len(robot.path) > 6:
            robot.stop_by_hand()

    robot.before_period = happens
    with rci.use(partial(VirtualLink, transfer=robot.transfer)):
        assert run_executable(turns) == 8
    assert "the servo stopped the arm: no fault; somebody told it to, or took its power away" in capfd.readouterr().err


@pytest.mark.parametrize("how", ["fails", "released"])
def test_an_arm_that_its_task_in_c_has_left_holding_loses_power_when_that_is_asked_for(make: Make, how: str) -> None:
    program, robot = make(LEFT), FakeRobot(tuple(PARK))
    with rci.use(partial(VirtualLink, transfer=robot.transfer)):
        assert run_executable(program, [how, "and no more"]) == 0
        assert robot.mode is Mode.HOLDING
        robot.goodbyes = 0
        assert run_executable(program, [how]) == 0
    assert (robot.mode, robot.goodbyes) == (Mode.OFF, 2)  # and nobody greets an arm that is off


@pytest.mark.realtime
def test_a_task_in_c_that_is_released_during_its_function_stops_the_arm_with_the_first_command(make: Make) -> None:
    robot = FakeRobot(tuple(PARK), patience=1 << 30)
    with TcpRobot(robot, 0.005) as server:
        environment = os.environ | {"QROBOT_BRIDGE": "{}:{}".format(*server.address)}
        subprocess.run([make(RELEASED)], env=environment, timeout=PATIENCE_S, check=True)
    streamed = [any(command.modes) for command in robot.commands]
    last = len(streamed) - streamed[::-1].index(True)
    assert robot.commands[last].stop


@pytest.mark.realtime
def test_of_many_states_that_come_at_once_a_task_in_c_takes_the_newest(make: Make) -> None:
    robot = FakeRobot(tuple(PARK), patience=1 << 30)
    tell = robot.tell

    def tell_many() -> bytes:
        """A hundred states at once, as after a stall."""
        stalled = len(robot.path) > 9 and robot.seq < 100
        return b"".join(tell() for _ in range(100)) if stalled else tell()

    robot.tell = tell_many
    with TcpRobot(robot, 0.005) as server:
        environment = os.environ | {"QROBOT_BRIDGE": "{}:{}".format(*server.address)}
        said = subprocess.run(
            [make(HEARD)], env=environment, timeout=PATIENCE_S, check=True, capture_output=True, text=True
        ).stdout
    rows = np.array([line.split() for line in said.splitlines()], float)
    steps = np.diff(rows, axis=0)
    assert steps[steps[:, 0] > 0.0] == pytest.approx(np.array([[99.0, 100 * 0.028]]), abs=1e-6)


def test_what_the_servo_told_before_power_was_asked_for_is_no_answer_to_that(turns: Path) -> None:
    robot = FakeRobot(tuple(PARK))
    hear_power_late(robot)
    with rci.use(partial(VirtualLink, transfer=robot.transfer)):
        assert run_executable(turns) == 0
    assert robot.seq > LATE


@pytest.mark.parametrize("before", [FaultCode.NONE, FaultCode.STREAM_LOST])
def test_an_arm_that_brakes_and_loses_its_power_is_asked_for_it_in_c_too(turns: Path, before: FaultCode) -> None:
    robot = FakeRobot(tuple(PARK))
    robot.event = before
    lose_power(robot)
    with rci.use(partial(VirtualLink, transfer=robot.transfer)):
        assert run_executable(turns) == 0
    assert robot.seq > LATE


def test_a_signal_ends_a_program_that_waits_for_an_emulated_arm(make: Make, tmp_path: Path) -> None:
    noted = tmp_path / "process"
    note = 'FILE *file = fopen(words[1], "w");\n    if (n < 2 || fprintf(file, "%d", getpid()) < 0 || fclose(file))'
    text = TURN.replace("main(void)\n{", f"main(int n, char **words)\n{{\n    {note}\n        return 9;")
    program = make(f"#include <stdio.h>\n#include <unistd.h>\n{text}", flags=STRICT[1:])
    robot, seen = FakeRobot(tuple(PARK)), []

    def transfer(data: bytes) -> bytes:
        if robot.seq < 8 or seen:
            return robot.transfer(data)
        process = os.pidfd_open(int(noted.read_text()))
        signal.pidfd_send_signal(process, signal.SIGTERM)
        seen.append(select.select([process], [], [], PATIENCE_S)[0])  # it ends while it waits for this sample
        os.close(process)
        return robot.transfer(data)

    with rci.use(partial(VirtualLink, transfer=transfer)):
        assert run_executable(program, [str(noted)]) == 128 + signal.SIGTERM
    assert len(seen) == 1
    assert seen[0]


def test_power_that_somebody_stopped_is_not_asked_for_anew_in_c_either(
    turns: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    robot = FakeRobot(tuple(PARK))
    stop_power_up(robot)
    with rci.use(partial(VirtualLink, transfer=robot.transfer)):
        assert run_executable(turns) == 7
    assert "no arm power: POWER_STOPPED" in capfd.readouterr().err
    assert robot.mode is Mode.OFF


def test_power_that_is_refused_for_the_reason_of_last_time_ends_the_task(
    turns: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    robot = FakeRobot(tuple(PARK))
    robot.event, robot.refuse_power = FaultCode.POWER_NO_ACK, True
    with rci.use(partial(VirtualLink, transfer=robot.transfer)):
        assert run_executable(turns) == 7
    assert "no arm power: POWER_NO_ACK" in capfd.readouterr().err


def test_a_robot_on_virtual_time_without_a_relay_is_refused(make: Make) -> None:
    virtual = os.environ | {"QROBOT_RCI_TIME": "virtual"}
    done = subprocess.run([example(make, "rci_spring")], env=virtual, capture_output=True, text=True, check=False)
    assert (done.returncode, "`qrobot run --offline`" in done.stderr) == (1, True)


@pytest.mark.thorough
@pytest.mark.realtime
@needs_valgrind
def test_tasks_of_several_processors_in_real_time_leave_nothing_to_find(make: Make) -> None:
    flags = "-g", "-O1"
    assert_a_crowd_of_tasks_does_its_work(make(*LIVE, flags=(*flags, "-fsanitize=thread")))
    assert_a_crowd_of_tasks_does_its_work(*VALGRIND.split(), "--fair-sched=try", make(*LIVE, flags=flags))


@pytest.mark.realtime
def test_tasks_of_several_processors_share_clock_memory_messages_and_signals_in_real_time(make: Make) -> None:
    assert_a_crowd_of_tasks_does_its_work(make(*LIVE, flags=("-O2",)))


def assert_a_crowd_of_tasks_does_its_work(*program: object) -> None:
    watched = [*map(str, program), "crowd"]
    done = subprocess.run(watched, capture_output=True, text=True, timeout=FIRST_START_S, check=False)
    assert done.returncode == 0, (FOUND, done.stderr)
    assert done.stdout.splitlines() == [
        "task rogue: one of its functions takes longer than 0.05 s and was given up",
        "task device: its device was closed",
    ]


@pytest.mark.realtime
def test_a_program_in_c_ends_while_a_function_of_a_task_does_not_come_back(make: Make) -> None:
    status, said, _ = ran(make(BLOCKED, flags=STRICT[1:]))
    assert (status, said) == (0, "rci_close: -1\n")


@pytest.mark.realtime
def test_a_child_of_a_program_that_has_given_a_function_up_frees_what_it_closes(make: Make) -> None:
    """None of its parent's threads is there, before the parent closes its tasks and after."""
    status, _, _ = ran(make(FORKS, flags=STRICT[1:]))
    assert status == 0


@pytest.mark.realtime
def test_handlers_of_signals_may_ask_and_exit_whatever_call_they_interrupt(make: Make) -> None:
    assert ran(make(HANDLED, flags=STRICT[1:])) == (0, "", "")


@pytest.mark.realtime
def test_the_memory_of_a_program_with_tasks_is_locked_where_that_is_allowed(make: Make) -> None:
    status, said, _ = ran(make(LOCKED, flags=("-O2",)))
    assert status == 0
    kept = {name: int(re.search(rf"{name}:\s+(\d+) kB", said)[1]) for name in ("VmLck", "VmSize")}
    assert (kept["VmLck"] > kept["VmSize"] // 2) is may_lock_all()


@pytest.mark.realtime
def test_the_arm_stops_when_a_program_in_c_is_killed_hangs_or_loses_its_bridge(make: Make, arm: RunningArm) -> None:
    program = make(*LIVE, flags=("-O2",))
    bridge = os.environ | {"QROBOT_BRIDGE": f"127.0.0.1:{arm.arm.bridge.port}"}

    def start(mode: str) -> subprocess.Popen[str]:
        child = subprocess.Popen([program, mode], stdout=-1, stderr=-1, text=True, env=bridge)
        assert child.stdout is not None
        assert child.stdout.readline() == "swings\n"
        return child

    with start("swing") as swings:
        assert arm.mode is Mode.TRACKING
        second = subprocess.run([program, "swing"], capture_output=True, text=True, env=bridge, check=False)
        assert (second.returncode, "refused" in second.stderr) == (1, True)
        swings.kill()
    arm.wait_for(Mode.HOLDING)
    with start("rogue") as hangs:
        arm.wait_for(Mode.HOLDING)
        assert "takes longer than 0.5 s" in hangs.communicate()[1]
    assert hangs.returncode == 4
    with start("swing") as swings:
        arm.kill("bridge")
        assert "task puma560: " in swings.communicate()[1]
    assert swings.returncode == 4
    wait_until(lambda: arm.mode is not Mode.TRACKING, "the arm has stopped")
