"""A program in C with an arm of RCCL and one that a task of RCI moves: at a bad end both stop, neither waits."""

from __future__ import annotations

import os
import signal
import subprocess
from pathlib import Path

import pytest

from qrobot.wire import Mode
from tests.support.c_programs import compiled_text, needs_compiler
from tests.support.fake_robot import FakeRobot, TcpRobot
from tests.support.patience import PATIENCE_S
from tests.support.puma import PARK

pytestmark = [needs_compiler, pytest.mark.realtime, pytest.mark.usefixtures("own_cache")]

PERIOD_S = 0.02
PROGRAM = """
#include "rci.h"
#include <signal.h>
#include <stdlib.h>
#include <unistd.h>
static RCI_TASK *td;
static void turn(RCI_TASK *td)
{
    double q[6];
    int j;
    for (j = 0; j < 6; j++) q[j] = td->how.q_setpoint[j] + (j == 0 ? 0.0001 : 0.0);
    rci_goto(td, q);
}
int main(int n, char **words)
{
    POS_PTR p;
    control();
    if (n < 2 || rci_robot("swing", "puma560", words[1]) || (td = rci_create("swing", "")) == 0 ||
        rci_control(td, turn, 0, 0) || rci_start(td->bit))
        return 9;
    p = jposition("P", 40., -90., 180., 0., 0., 0.);
    setime(100., 60000.);
    move(p);
    waitas(p->scal > 0. && rci_runs(td) > 9)
    END
    for (;;)
        pause();
}
"""


def rest_only_when_both_stop(robot: FakeRobot, other: FakeRobot) -> None:
    """It comes to rest when the other one is asked to stop as well."""

    def look(_seq: int) -> None:
        if any(command.stop for command in robot.commands):
            robot.mode = Mode.HOLDING if any(command.stop for command in other.commands) else Mode.STOPPING

    robot.before_period = look


@pytest.mark.parametrize(
    ("end", "status"),
    [
        ("exit(3);", 3),
        ("move(0);", 1),
        ("kill(getpid(), SIGINT);", 128 + signal.SIGINT),
        ("kill(getpid(), SIGTERM);", 128 + signal.SIGTERM),
    ],
)
def test_both_arms_are_told_to_stop_before_one_of_them_rests(end: str, status: int, tmp_path: Path) -> None:
    arms = moved, swung = [FakeRobot(tuple(PARK), patience=1 << 30) for _ in range(2)]
    rest_only_when_both_stop(moved, swung)
    rest_only_when_both_stop(swung, moved)
    program = compiled_text(PROGRAM.replace("END", end), tmp_path)
    with TcpRobot(moved, PERIOD_S) as first, TcpRobot(swung, PERIOD_S) as second:
        bridges = ["{}:{}".format(*server.address) for server in (first, second)]
        environment = os.environ | {"QROBOT_BRIDGE": bridges[0]}
        done = subprocess.run([program, bridges[1]], env=environment, timeout=PATIENCE_S, check=False)
    assert done.returncode == status
    assert all(any(command.stop for command in arm.commands) for arm in arms)
    assert [arm.mode for arm in arms] == [Mode.HOLDING, Mode.HOLDING]
