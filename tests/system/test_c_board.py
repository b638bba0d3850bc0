"""A program in C against the emulated board: register reads and writes through the header of the examples."""

from __future__ import annotations

import re
import shutil
import signal
import subprocess
import time
import uuid
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from qrobot.config import load_robot
from qrobot.hwif import memory, registers
from qrobot.hwif.memory import LANES_START, Lane, read_trace
from qrobot.hwif.registers import DAC, DAC_ZERO, DISCRETE, DISCRETE_CALIBRATED, DISCRETE_POWER
from qrobot.realtime import segment
from qrobot.sim_board.emulator import Emulator
from qrobot.sim_board.server import BoardServer
from tests.support.patience import wait_until

SOURCES = Path(__file__).parents[2] / "examples" / "c"
INCLUDE = Path(__file__).parents[2] / "qrobot" / "wire" / "c"
COMPILER = shutil.which("cc") or ""
MOVED = 5  # joint 6

needs_compiler = pytest.mark.skipif(not COMPILER, reason="no C compiler: apt install gcc")
Program = subprocess.Popen[str]


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    target = tmp_path_factory.mktemp("c") / "move_one_joint"
    flags = ["-O2", "-Wall", "-Wextra", "-Werror", f"-I{INCLUDE}"]
    subprocess.run([COMPILER, *flags, "-o", target, SOURCES / "move_one_joint.c", "-lm"], check=True)
    return target


@pytest.fixture
def arm() -> str:
    return f"test{uuid.uuid4().hex[:12]}"


@pytest.fixture
def server(arm: str) -> Iterator[BoardServer]:
    with BoardServer(arm, Emulator(load_robot("puma560"))) as server:
        yield server


def start(program: Path, arm: str) -> Program:
    return subprocess.Popen([program, arm], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def moving(server: BoardServer) -> bool:
    return abs(float(server.emulator.v[MOVED])) > 0.05


def test_the_header_says_what_the_board_memory_is() -> None:
    text = (SOURCES / "trc004.h").read_text()
    defined = {name: int(value, 0) for name, value in re.findall(r"#define TRC004_(\w+) (0x[0-9A-F]+|\d+)\b", text)}
    del defined["TIMEOUT_NS"]
    elsewhere = {
        "MAGIC": segment.MAGIC_VALUE,
        "LANE": LANES_START + int(Lane.TOOL) * memory.LANE_WORDS,
        "LANE_FORGET": memory._LANE_FORGET,
        "LANE_TAIL": memory._LANE_TAIL,
        "LANE_RING": memory._LANE_RING,
    }
    for name, value in defined.items():
        expected = elsewhere.get(name, getattr(memory, name, getattr(registers, name, None)))
        assert value == expected, name
    assert len(defined) == text.count("#define TRC004_") - 2  # the guard of the header, and the time-out


@needs_compiler
@pytest.mark.realtime
def test_the_program_powers_the_arm_moves_one_joint_there_and_back_and_leaves_it_without_torque_and_power(
    program: Path, arm: str, server: BoardServer
) -> None:
    begin, far = np.int16(server.emulator.counters[MOVED]), 0
    with start(program, arm) as process:
        while process.poll() is None:
            far = max(far, int(np.int16(server.emulator.counters[MOVED])) - int(begin))
            time.sleep(0.01)
        printed, complaint = process.communicate()
    assert (process.returncode, complaint) == (0, "")
    assert f"{begin}" in printed
    assert far == pytest.approx(1500, abs=100)
    assert not server.emulator.powered
    trace = read_trace(server.segment.words)
    assert (trace[:8, 2:] == [(DAC + 2 * channel, DAC_ZERO) for channel in range(8)]).all()  # before any power
    assert trace[8, 2] == DISCRETE
    assert trace[8, 3] & DISCRETE_POWER
    assert (trace[-9:-1, 3] == DAC_ZERO).all()
    assert not trace[-1, 3] & DISCRETE_POWER
    assert trace[-1, 3] & DISCRETE_CALIBRATED


@needs_compiler
@pytest.mark.realtime
def test_ctrl_c_takes_torque_and_power_off(program: Path, arm: str, server: BoardServer) -> None:
    with start(program, arm) as process:
        wait_until(lambda: moving(server), "joint 6 moves")
        process.send_signal(signal.SIGINT)
        assert process.wait() == 1
    assert not server.emulator.powered
    assert (server.emulator.bundle.board.dac == DAC_ZERO).all()


@needs_compiler
@pytest.mark.realtime
def test_a_board_that_goes_away_ends_the_program_with_a_word(program: Path, arm: str) -> None:
    with BoardServer(arm, Emulator(load_robot("puma560"))) as server, start(program, arm) as process:
        wait_until(lambda: moving(server), "joint 6 moves")
        server.__exit__(None, None, None)
        assert process.wait() == 1
        assert process.communicate()[1] == f"the board of {arm} has gone\n"


@needs_compiler
def test_without_a_board_it_says_how_to_start_one(program: Path, arm: str) -> None:
    with start(program, arm) as process:
        assert process.communicate()[1] == f"no board of {arm}: start one with `qrobot board`\n"
    assert process.returncode == 1
