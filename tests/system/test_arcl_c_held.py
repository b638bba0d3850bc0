"""Programs in C whose stdout is held while they print: functions that are called at samples do not wait for it."""

from __future__ import annotations

import os
import subprocess
import termios
import threading
import tty
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tests.support.c_programs import compiled, needs_compiler
from tests.support.fake_robot import FakeRobot, TcpRobot
from tests.support.patience import PATIENCE_S, wait_until
from tests.support.puma import PARK

PRINTS = """\
#include <arcl.h>
#include <stdio.h>
static ROBOT *rp;
static int samples;
static int each(Feedback *told)
{
    if (++samples % 50 == 0)
        arcl_free(where(rp));
    return told->share > 2.;
}
int main(int argc, char **argv)
{
    rp = arcl_open(ARCL_ARGCV, argc, argv, 0);
    Motion *m = move(rp, joint_pos(rp, "P", 20., 90., -90., 0., 90., 0.), MOV_TIME, 1000, MOV_FEEDBACK, each, 0);
    for (int i = 0; i < 4000; i++)
        printf("line %d, which nobody takes until the arm has arrived\\n", i);
    arcl_wait(rp);
    printf("code %d, %d\\n", m->code, samples > 20);
    return 0;
}
"""
LINES = 4000

pytestmark = [pytest.mark.realtime, needs_compiler, pytest.mark.usefixtures("own_cache")]


@pytest.fixture(scope="module")
def prints(own_cache: None, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("held")
    (folder / "prints.c").write_text(PRINTS)
    return compiled(folder / "prints.c", folder)


def full_pipe() -> tuple[int, int, Callable[[], None]]:
    """A pipe that fills up: its ends, and what lets it go, for which it is enough that somebody reads."""
    near, far = os.pipe()
    return near, far, lambda: None


def held_terminal() -> tuple[int, int, Callable[[], None]]:
    """A terminal after Ctrl-S: its ends, and Ctrl-Q."""
    near, far = os.openpty()
    tty.setraw(far)
    termios.tcflow(far, termios.TCOOFF)
    kept = os.dup(far)

    def let_go() -> None:
        termios.tcflow(kept, termios.TCOON)
        os.close(kept)

    return near, far, let_go


def all_of(near: int, lines: bytearray) -> None:
    """Take what comes until the other end is closed, which a terminal tells as an error."""
    try:
        while data := os.read(near, 1 << 16):
            lines += data
    except OSError:
        pass
    os.close(near)


@pytest.mark.parametrize("switches", [[], ["+m", "+tr"]], ids=["no traces", "traces"])
@pytest.mark.parametrize("stdout", [full_pipe, held_terminal])
def test_functions_of_samples_do_not_wait_for_a_stdout_at_which_the_program_does(
    stdout: Callable[[], tuple[int, int, Callable[[], None]]], switches: list[str], prints: Path
) -> None:
    fake = FakeRobot(tuple(PARK), patience=1 << 30)
    near, far, let_go = stdout()
    said = bytearray()
    with TcpRobot(fake, 0.001) as server:
        environment = os.environ | {"QROBOT_BRIDGE": "{}:{}".format(*server.address)}
        process = subprocess.Popen([prints, *switches], env=environment, text=True, stdout=far, stderr=subprocess.PIPE)
        os.close(far)
        wait_until(
            lambda: process.poll() is not None or abs(fake.q[0] - np.radians(20.0)) < 1e-6,
            lambda: f"the arm arrives, which stands at {np.degrees(fake.q[0]):.3f}",
        )
        assert process.poll() is None, process.communicate()[1]
        reader = threading.Thread(target=all_of, args=(near, said))
        reader.start()
        let_go()
        told = process.communicate(timeout=PATIENCE_S)[1]
        reader.join(PATIENCE_S)
    assert process.returncode == 0, told
    lines = said.decode().splitlines()
    assert "code 4, 1" in lines
    if not switches:
        assert len(lines) == LINES + 1
