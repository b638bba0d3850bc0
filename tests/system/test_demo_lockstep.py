"""`qrobot demo --lockstep` from outside: what it writes, and that Ctrl-C ends it."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
from pathlib import Path

import numpy as np
import pytest

from qrobot.log.read import read_log
from qrobot.realtime.jit import jit_disabled
from qrobot.rig.experiment import ExperimentRun, run_lockstep
from tests.support.patience import PATIENCE_S, wait_until
from tests.support.processes import FIRST_START_S, qrobot
from tests.support.thorough import wide

TELLING = """
from qrobot.servo.laws.law import KP, KV, SIGNALS_AT, law

@law(signals=("push",))
def telling(q_ref, v_ref, q, v, gains, gravity, friction, memory, tau):
    for j in range(tau.size):
        tau[j] = gains[KP, j] * (q_ref[j] - q[j]) + gains[KV, j] * (v_ref[j] - v[j]) + gravity[j] + friction[j]
    memory[SIGNALS_AT] = tau[1]
"""

# After some seconds of a run, whose law its trial has found harmless.
HANGING = """
from qrobot.servo.laws.law import KP, KV, law

@law
def hanging(q_ref, v_ref, q, v, gains, gravity, friction, memory, tau):
    for j in range(tau.size):
        tau[j] = gains[KP, j] * (q_ref[j] - q[j]) + gains[KV, j] * (v_ref[j] - v[j]) + gravity[j] + friction[j]
    memory[0] += 1.0
    while memory[0] > 3000.0:
        tau[0] += 1e-9
"""
HANGS_S = 3.0  # of computing, in which a run ends
FEW_FAULTS = 10  # whoever compiles or plots needs more memory

RUN_KEYS = {
    "rate_hz": int,
    "clock": str,
    "plant": str,
    "law": str,
    "max_abs_error_rad": list,
    "rms_error_rad": list,
    "cycles": int,
    "late_cycles": int,
    "wakeup_us": dict,
    "realtime_factor": float,
    "fault": type(None),
}


def demo(directory: Path, *options: str) -> subprocess.Popen[str]:
    return qrobot("demo", *options, "--out-dir", directory / "demo")


def test_a_demo_in_lockstep_writes_its_summary_log_and_figures(tmp_path: Path) -> None:
    summary = tmp_path / "summary.json"
    with demo(tmp_path, "--lockstep", "--rate", "1000", "--json", str(summary)) as process:
        told, said = process.communicate(timeout=FIRST_START_S)
    assert process.returncode == 0, said
    (replay,) = [line.split() for line in told.splitlines() if line.startswith("replay ")]
    assert shutil.which(replay[1]) is not None  # the line can be copied as it is
    (run,) = json.loads(summary.read_text())["runs"]
    assert {key: type(run[key]) for key in RUN_KEYS} == RUN_KEYS
    assert (run["rate_hz"], run["clock"], run["plant"], run["law"]) == (1000, "lockstep", "nominal", "qrobot")
    assert len(run["max_abs_error_rad"]) == len(run["rms_error_rad"]) == 6
    pairs = zip(run["rms_error_rad"], run["max_abs_error_rad"], strict=True)
    assert all(0.0 < rms < largest < 0.005 for rms, largest in pairs)
    assert set(run["wakeup_us"]) == {"p50", "p99", "max"}
    assert run["cycles"] > 6000
    assert read_log(run["log"]).rows.size == run["cycles"]
    assert {path.name for path in (tmp_path / "demo").glob("*.png")} == {"positions.png", "errors.png"}


@pytest.mark.thorough
def test_the_log_of_a_law_of_ones_own_has_its_name_without_the_folder_and_the_names_of_its_signals(
    tmp_path: Path,
) -> None:
    (tmp_path / "my_laws.py").write_text(TELLING)
    log = run_lockstep(ExperimentRun(1000, law=f"{tmp_path}/my_laws.py:telling"), tmp_path).log
    assert log.path.name == "lockstep-1000-nominal-my_laws.py-telling.mcap"
    assert (log.law_names, log.signal_names) == (("my_laws.py:telling",), ("push",))
    assert np.abs(log.rows["signals"][:, 0]).max() > 1.0


@pytest.mark.parametrize("run", [1, *wide(2)])
def test_ctrl_c_ends_a_demo_in_lockstep(tmp_path: Path, run: int) -> None:
    """In its first run, when there is nothing to show, and in a later one."""
    with demo(tmp_path, "--lockstep") as process:
        assert process.stderr is not None
        while f"run {run} of" not in (line := process.stderr.readline()):
            assert line, "it has ended"
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 130
    assert "Traceback" not in said


@pytest.mark.thorough
@pytest.mark.skipif(jit_disabled(), reason="plain Python hears Ctrl-C in any loop")
def test_ctrl_c_ends_a_demo_whose_law_never_comes_back(tmp_path: Path) -> None:
    (tmp_path / "my_laws.py").write_text(HANGING)
    with demo(tmp_path, "--lockstep", "--rate", "1000", "--law", f"{tmp_path}/my_laws.py:hanging") as process:
        assert process.stderr is not None
        while "run 1 of" not in (line := process.stderr.readline()):
            assert line, "it has ended"
        hang = Hang(process.pid)
        wait_until(lambda: process.poll() is not None or hang.lasts(), "the law hangs")
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 130
    assert "Traceback" not in said


class Hang:
    """A process that computes and computes, and asks for no memory meanwhile."""

    def __init__(self, process: int) -> None:
        self._stat = Path(f"/proc/{process}/stat")
        self._faults, self._since_s = self._look()

    def lasts(self) -> bool:
        """It has done nothing else for a while."""
        faults, computed_s = self._look()
        if faults > self._faults + FEW_FAULTS:
            self._faults, self._since_s = faults, computed_s
        return computed_s > self._since_s + HANGS_S

    def _look(self) -> tuple[int, float]:
        """Pages asked for and seconds computed so far (proc(5): minflt, utime, stime)."""
        fields = self._stat.read_text().rpartition(")")[2].split()
        return int(fields[7]), (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
