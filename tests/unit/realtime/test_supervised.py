"""Processes whose supervisor is killed: each ends, and in the order of their ranks."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

from qrobot.realtime.supervised import RANKS, Supervision
from tests.support.patience import PATIENCE_S

MEMBER = """
import os, signal, sys, time
from qrobot.realtime import supervised
supervised.PATIENCE_S = supervised.END_PATIENCE_S = float(os.environ["PATIENCE_S"])
name, seconds, log = sys.argv[1], float(sys.argv[2]), open(sys.argv[3], "a", buffering=1)
def end(number, frame):
    time.sleep(seconds)  # as long as a process takes to end in good order
    log.write(f"{name}\\n")
    sys.exit()
signal.signal(signal.SIGTERM, end)
supervised.end_with_supervisor()
print(os.environ.get("QROBOT_SUPERVISOR"), flush=True)
while True:
    time.sleep(60)
"""

SUPERVISOR = """
import os, subprocess, sys
from qrobot.realtime.supervised import SUPERVISOR_VARIABLE, Supervision
pipes, children = Supervision(), []
def environment(rank):
    return {**os.environ, SUPERVISOR_VARIABLE: ",".join(map(str, pipes.descriptors(rank)))}
for rank, seconds in ((0, 0.0), (4, 0.2), (2, 0.1), (2, 0.0)):
    child = subprocess.Popen(
        [sys.executable, "-c", os.environ["MEMBER"], str(rank), str(seconds), sys.argv[1]],
        pass_fds=pipes.descriptors(rank), env=environment(rank),
        stdout=subprocess.PIPE, start_new_session=True, text=True,
    )
    children.append(child)
told = [child.stdout.readline().strip() for child in children]
if sys.argv[2] == "restart":  # one of rank 4 was killed, and another one has taken its place
    children[1].kill()
    children[1].wait()
    child = subprocess.Popen(
        [sys.executable, "-c", os.environ["MEMBER"], "heir", "0.2", sys.argv[1]],
        pass_fds=pipes.descriptors(4), env=environment(4),
        stdout=subprocess.PIPE, start_new_session=True, text=True,
    )
    told.append(child.stdout.readline().strip())
print(*told, flush=True)
os.kill(os.getpid(), 9)
"""


def ends(log: Path, how: str = "") -> list[str]:
    """Names in the order in which the processes ended, once all have: their output, which they inherit, is closed."""
    environment = {**os.environ, "MEMBER": MEMBER, "PATIENCE_S": str(PATIENCE_S)}
    done = subprocess.run(
        [sys.executable, "-c", SUPERVISOR, str(log), how],
        env=environment, capture_output=True, text=True, timeout=PATIENCE_S, check=False,
    )  # fmt: skip
    assert done.returncode == -9, done.stderr
    assert set(done.stdout.split()) == {"None"}
    return log.read_text().split()


def test_processes_of_a_killed_supervisor_end_from_the_highest_rank_to_the_lowest(tmp_path: Path) -> None:
    order = ends(tmp_path / "log")
    assert order == sorted(order, reverse=True)
    assert sorted(order) == ["0", "2", "2", "4"]


def test_one_that_was_started_later_in_the_place_of_another_is_waited_for_as_well(tmp_path: Path) -> None:
    assert ends(tmp_path / "log", "restart") == ["heir", "2", "2", "0"]


def test_each_rank_waits_for_all_above_it_and_for_none_below() -> None:
    pipes = Supervision()
    try:
        every = [pipes.descriptors(rank) for rank in range(RANKS)]
        assert len({supervisor for supervisor, *_ in every}) == 1
        assert [len(higher) for _, _, *higher in every] == list(range(RANKS))[::-1]
    finally:
        pipes.close()
