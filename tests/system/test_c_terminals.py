"""C programs at terminals that hold up what they print, and at prompts that signals interrupt."""

from __future__ import annotations

import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from qrobot.rccl.c.program import run_executable
from tests.support.c_programs import compiled_text, needs_compiler
from tests.support.fake_robot import FakeRobot
from tests.support.faked_c_programs import MOVING, at_rest, part_of_the_way, robot
from tests.support.patience import wait_until

__all__ = ["robot"]  # the fixture

pytestmark = [needs_compiler, pytest.mark.usefixtures("own_cache")]

HELD = """
import os, pty, select, sys, time
kind, let_go, program = sys.argv[1:]

def is_ready():
    return select.select([], [1], [], 0)[1]

if kind == "terminal":
    pid, screen = pty.fork()
    if pid == 0:
        while is_ready():
            time.sleep(0.001)
        os.execv(program, [program])
    os.write(screen, b"\\x13")
else:
    screen, writing = os.pipe()
    pid = os.fork()
    if pid == 0:
        os.dup2(writing, 1)
        while is_ready():
            os.write(1, b" " * 4096)
        os.dup2(1, 2)
        os.execv(program, [program])
    os.close(writing)
while not os.path.exists(let_go) and os.getppid() != 1:
    time.sleep(0.001)
if kind == "terminal":
    os.write(screen, b"\\x11")
try:
    while heard := os.read(screen, 4096):
        os.write(1, heard.lstrip())
except OSError:  # of a terminal that is closed
    pass
sys.exit(os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]))
"""
PRINTING = """
    #include <pthread.h>
    #include <unistd.h>
    volatile int printing;
    void *kills(void *unused) { while (!printing) usleep(500); kill(getpid(), SIGTERM); return unused; }
"""


@pytest.mark.sampled(4)
@pytest.mark.parametrize("kind", ["terminal", "pipe"])
@pytest.mark.parametrize(
    ("before", "last", "status", "said"),
    [
        ("", "kill(getpid(), SIGINT); for (;;);", 130, "interrupted; the arm is brought to rest\ntaken apart\n"),
        ("", "setvel(-1., 0.);", 1, "the speed of the tool must be positive"),
        ("int moving; each() { if (moving) exit(3); }", "moving = 1; waitfor(completed)", 3, "taken apart\n"),
        (PRINTING, 'printing = 1; for (;;) printf("on its way\\n");', 143, "interrupted"),
    ],
    ids=["interrupted", "refused", "ends in a function", "interrupted while it prints"],
)
def test_what_is_said_at_a_held_terminal_holds_up_no_stop(
    before, last, status, said, kind, robot: FakeRobot, tmp_path: Path, capfd
) -> None:
    """It is said when the terminal is let go, which here the arm must rest for."""
    let_go, window = tmp_path / "let_go", tmp_path / "window"
    threads = "pthread_t thread; pthread_create(&thread, 0, kills, 0);" if "kills" in before else ""
    function = "control(each);" if "each" in before else ""
    text = f"""
    #include <signal.h>
    #include <stdlib.h>
    #include <unistd.h>
    {before}
    main() {{ {threads} mess = "taken apart"; {function} {MOVING} {last} }}
    """
    (tmp_path / "held.py").write_text(HELD)
    program = compiled_text(text, tmp_path, "-pthread")
    window.write_text(f"#!/bin/sh\nexec {sys.executable} {tmp_path}/held.py {kind} {let_go} {program}\n")
    window.chmod(0o755)

    def let_go_at_rest() -> None:
        try:
            wait_until(lambda: robot.goodbyes, "the end of the stream")
        finally:
            let_go.touch()

    with ThreadPoolExecutor(1) as pool:
        rests = pool.submit(let_go_at_rest)
        assert run_executable(window) == status
    rests.result()
    assert part_of_the_way(robot)
    assert at_rest(robot) or function  # without which no sample can be finished: its bridge brings the arm to rest
    assert said in capfd.readouterr().out.replace("\r\n", "\n")


PROMPT = """
import os, signal, subprocess, sys, time
program = subprocess.Popen(sys.argv[1], stdin=subprocess.PIPE, stdout=subprocess.PIPE, close_fds=False)
seen = b""

def hear(text):
    global seen
    while text not in seen:
        heard = os.read(program.stdout.fileno(), 100)
        if not heard:
            sys.exit(99)
        seen += heard
    seen = seen.partition(text)[2]

hear(b"? ")
program.send_signal(signal.SIGUSR1)
hear(b"heard")
if sys.argv[2] == "goes on":
    os.write(program.stdin.fileno(), b"where\\n")
    hear(b"? ")
    os.write(program.stdin.fileno(), b"q\\n")
while sys.argv[2] == "ends" and program.poll() is None:  # the first may have come before it read
    program.send_signal(signal.SIGUSR1)
    time.sleep(0.01)
sys.exit(program.wait())
"""


@pytest.mark.parametrize(("then", "handler", "status"), [("goes on", "", 0), ("ends", "terminate = 1;", 1)])
def test_a_signal_at_a_prompt_is_no_end_of_the_input(then, handler, status, robot, tmp_path: Path, capfd) -> None:
    """A program that is to be terminated is asked nothing more."""
    text = f"""
    #include <signal.h>
    #include <unistd.h>
    void heard(int signal) {{ (void) signal; {handler} write(1, "heard", 5); }}
    main() {{
        struct sigaction action = {{.sa_handler = heard}};
        sigaction(SIGUSR1, &action, 0);
        stepmode();
        move(park);
        return 0;
    }}
    """
    (tmp_path / "prompt.py").write_text(PROMPT)
    window = tmp_path / "window"
    window.write_text(
        f"#!/bin/sh\nexec {sys.executable} {tmp_path}/prompt.py {compiled_text(text, tmp_path)} '{then}'\n"
    )
    window.chmod(0o755)
    assert run_executable(window) == status
    assert ("terminate" in capfd.readouterr().err) == (then == "ends")
