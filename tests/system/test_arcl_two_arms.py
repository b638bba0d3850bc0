"""Programs of ARCL on two arms in real time, whose functions, called at the samples of one arm, tell the other one
something: neither waits for the other for ever."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from tests.support.c_programs import compiled, needs_compiler
from tests.support.fake_robot import FakeRobot, TcpRobot
from tests.support.patience import PATIENCE_S
from tests.support.puma import PARK

pytestmark = [pytest.mark.realtime, pytest.mark.usefixtures("own_cache")]
PERIOD_S = 0.002
IN_C = """
#include <arcl.h>
#include <stdio.h>
static ROBOT *arms[2];
static long told[2];
static void first(Feedback *feedback) { (void) feedback; told[0]++; arcl_override(arms[1], 50.); }
static void second(Feedback *feedback) { (void) feedback; told[1]++; arcl_override(arms[0], 50.); }
int main(int argc, char **argv)
{
    int i;
    for (i = 0; i < 2; i++)
        arms[i] = arcl_open(ARCL_BRIDGE, argv[1 + i], ARCL_PERIOD, 20., 0);
    for (i = 0; i < 2; i++)
        move(arms[i], joint_pos(arms[i], "P", 20., 90., -90., 0., 90., 0.), MOV_TIME, 4000, MOV_FEEDBACK,
             i ? second : first, 0);
    for (i = 0; i < 2; i++)
        arcl_wait(arms[i]);
    for (i = 0; i < 2; i++)
        arcl_close(arms[i]);
    printf("%s\\n", argc && told[0] > 150 && told[1] > 150 ? "both moved" : "too few samples");
    return 0;
}
"""
SERVE = """
import sys
from pathlib import Path
from qrobot.arcl.c.__main__ import no_rccl
from qrobot.arcl.c.dispatcher import ArclDispatcher
from qrobot.c_transport.program import run_served
sys.exit(run_served(Path(sys.argv[1]), sys.argv[2:], [no_rccl, ArclDispatcher]))
"""
IN_PYTHON = """
import sys
from qrobot.arcl import *
from qrobot.errors import MotionError
told, refusals = [0, 0], set()
def teller(i):
    def tell(feedback):
        told[i] += 1
        try:
            {told}
        except MotionError as refusal:
            refusals.add(str(refusal))
    return tell
arms = [arcl_open(ARCL_BRIDGE, place, ARCL_PERIOD, 20.0, 0) for place in sys.argv[1:]]
for i, arm in enumerate(arms):
    move(arm, joint_pos(arm, "P", (20.0, 90.0, -90.0, 0.0, 90.0, 0.0)), MOV_TIME, 4000, MOV_FEEDBACK, teller(i), 0)
for arm in arms:
    arcl_wait(arm)
for arm in arms:
    arcl_close(arm)
print("both moved" if min(told) > 150 else "too few samples", *refusals)
"""


def said_on_two_arms(*words: str) -> str:
    """What a program says that is given the places of two bridges."""
    fakes = [FakeRobot(tuple(PARK), patience=1 << 30) for _ in range(2)]
    with TcpRobot(fakes[0], PERIOD_S) as one, TcpRobot(fakes[1], PERIOD_S) as other:
        places = [f"{host}:{port}" for host, port in (one.address, other.address)]
        done = subprocess.run(
            [sys.executable, *words, *places],
            capture_output=True, text=True, timeout=PATIENCE_S, check=False, env=os.environ,
        )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert [fake.q[0] for fake in fakes] == pytest.approx([np.radians(20.0)] * 2)
    return done.stdout


def test_functions_of_two_arms_in_python_tell_each_other_something() -> None:
    assert said_on_two_arms("-c", IN_PYTHON.format(told="arms[1 - i].override(50.0)")) == "both moved\n"


@pytest.mark.sampled(1)
@pytest.mark.parametrize("call", ["arcl_wait", "arcl_close"])
def test_a_function_of_one_arm_cannot_wait_for_another_one(call: str) -> None:
    """The samples of its own arm would wait with it."""
    said = said_on_two_arms("-c", IN_PYTHON.format(told=f"{call}(arms[1 - i])"))
    assert said.startswith("both moved a function that is called at each sample must not wait")


@pytest.mark.thorough
@needs_compiler
def test_functions_of_two_arms_in_c_tell_each_other_something(tmp_path: Path) -> None:
    (tmp_path / "two_arms.c").write_text(IN_C)
    program = compiled(tmp_path / "two_arms.c", tmp_path)
    assert said_on_two_arms("-c", SERVE, str(program)) == "both moved\n"
