"""The emulated board as a process: on the wall clock, alone in serving its arm, gone cleanly."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
import uuid
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from qrobot.config import load_robot
from qrobot.errors import LinkBusy
from qrobot.hwif.board_memory import Lane, attach_board_memory, create_board_memory, fetch_image
from qrobot.hwif.image import IMAGE_COUNT, IMAGE_STATUS, IMAGE_T_NS, make_image
from qrobot.hwif.lanes import post_operations
from qrobot.hwif.operations import OP_WRITE
from qrobot.hwif.registers import DAC, DAC_ZERO, DISCRETE, DISCRETE_POWER, STATUS_POWER
from qrobot.hwif.trace import read_trace
from qrobot.realtime.shared_memory import segment_path
from qrobot.sim_board.emulator import Emulator
from qrobot.sim_board.server import EmulatedBoardServer
from tests.support.patience import PATIENCE_S, wait_until

pytestmark = pytest.mark.realtime

HALF_A_SECOND_NS = 500_000_000

SERVE = """
import sys
from qrobot.config import load_robot
from qrobot.sim_board.emulator import Emulator
from qrobot.sim_board.server import serve
serve(sys.argv[1], Emulator(load_robot("puma560")), lambda: print("ready", flush=True))
"""


@pytest.fixture
def arm() -> Iterator[str]:
    name = f"test{uuid.uuid4().hex[:12]}"
    yield name
    for board in name, f"{name}b":
        segment_path(f"{board}-board").unlink(missing_ok=True)


def start_board(arm: str) -> subprocess.Popen[str]:
    board = subprocess.Popen([sys.executable, "-c", SERVE, arm], stdout=subprocess.PIPE, text=True)
    assert board.stdout is not None
    assert board.stdout.readline() == "ready\n"
    return board


def image_of(memory: Any) -> Any:
    image = make_image()
    assert fetch_image(memory, image)
    return image


def image_and_skipped(memory: Any) -> tuple[Any, int]:
    """An image, and how many steps were left out before it."""
    skipped, count = int(memory.facts.skipped), image_of(memory)[IMAGE_COUNT]
    wait_until(lambda: image_of(memory)[IMAGE_COUNT] > count, "an image that comes after those steps")
    image = image_of(memory)
    return (image, skipped) if int(memory.facts.skipped) == skipped else image_and_skipped(memory)


def status_of(memory: Any) -> int:
    return int(image_of(memory)[IMAGE_STATUS])


def write(memory: Any, offset: int, value: int) -> None:
    """From now on, as the servo writes: a board that comes late takes it in none of the steps of the past."""
    assert post_operations(memory, Lane.TOOL, np.array([(OP_WRITE, offset, value)]), 1, time.monotonic_ns())


def test_physics_follows_the_wall_clock_and_stamps_images_with_it(arm: str) -> None:
    with EmulatedBoardServer(arm, Emulator(load_robot("puma560"))) as server:
        memory = server.segment.memory
        wait_until(lambda: image_of(memory)[IMAGE_COUNT] > 2)  # the image of power-up is not on the loop's grid
        (first, skipped_before), after_ns = image_and_skipped(memory), time.monotonic_ns()
        wait_until(lambda: image_of(memory)[IMAGE_T_NS] > first[IMAGE_T_NS] + HALF_A_SECOND_NS, "half a second goes by")
        (last, skipped), reached_ns = image_and_skipped(memory), time.monotonic_ns()
    period_ns = int(memory.facts.period_ns)
    steps = int(last[IMAGE_COUNT] - first[IMAGE_COUNT])
    assert last[IMAGE_T_NS] - first[IMAGE_T_NS] == (steps + skipped - skipped_before) * period_ns
    assert first[IMAGE_T_NS] <= after_ns
    assert last[IMAGE_T_NS] <= reached_ns
    assert (memory.facts.joints, chr(int(memory.facts.revision))) == (6, "F")


def test_a_board_takes_the_time_of_one_that_has_let_pass_more_and_never_turns_its_own_back(arm: str) -> None:
    with create_board_memory(f"{arm}b") as beside:
        beside.memory.facts.slipped_ns = 200_000_000
        with EmulatedBoardServer(arm, Emulator(load_robot("puma560")), True, [f"{arm}b"]) as server:
            assert server.slipped_ns >= 200_000_000  # from its start
            beside.memory.facts.slipped_ns = server.slipped_ns + 100_000_000
            server.look_beside()
            sampled = [int(server.segment.memory.facts.now_ns)]
            while server.slipped_ns < beside.memory.facts.slipped_ns:
                wait_until(lambda: server.segment.memory.facts.now_ns != sampled[-1], "it goes on meanwhile")
                sampled.append(int(server.segment.memory.facts.now_ns))
    assert sampled == sorted(sampled)


def test_a_board_that_lets_nothing_pass_follows_nobody(arm: str) -> None:
    with create_board_memory(f"{arm}b") as beside:
        beside.memory.facts.slipped_ns = 200_000_000
        with EmulatedBoardServer(arm, Emulator(load_robot("puma560")), False, [f"{arm}b"]) as server:
            wait_until(lambda: image_of(server.segment.memory)[IMAGE_COUNT] > 2, "it runs")
            assert server.slipped_ns == 0


def test_a_second_board_for_the_same_arm_is_refused(arm: str) -> None:
    emulator = Emulator(load_robot("puma560"))
    with EmulatedBoardServer(arm, emulator), pytest.raises(LinkBusy, match=arm):
        EmulatedBoardServer(arm, emulator)


@pytest.mark.sampled(1)
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_ends_the_process_and_removes_its_memory(arm: str, number: signal.Signals) -> None:
    board = start_board(arm)
    assert segment_path(f"{arm}-board").exists()
    board.send_signal(number)
    board.communicate(timeout=PATIENCE_S)
    assert board.returncode == 0
    assert not segment_path(f"{arm}-board").exists()


def test_writes_from_another_process_act_and_are_stamped_with_the_boards_clock(arm: str) -> None:
    board = start_board(arm)
    try:
        with attach_board_memory(arm) as segment:
            memory = segment.memory
            before = time.monotonic_ns()
            write(memory, DAC, DAC_ZERO + 1)
            write(memory, DISCRETE, DISCRETE_POWER)
            wait_until(lambda: status_of(memory) & STATUS_POWER)
            after = time.monotonic_ns()
            rows = read_trace(memory)
            assert rows[:, 2:].tolist() == [[DAC, DAC_ZERO + 1], [DISCRETE, DISCRETE_POWER]]
            assert (rows[:, 1] == Lane.TOOL).all()
            assert before <= rows[0, 0] <= rows[1, 0] <= after
            memory.panel.estop = 1
            wait_until(lambda: not status_of(memory) & STATUS_POWER)
    finally:
        board.send_signal(signal.SIGTERM)
        board.communicate(timeout=PATIENCE_S)


def test_a_killed_board_is_replaced_and_peers_see_the_new_one_in_the_memory_they_have(arm: str) -> None:
    board = start_board(arm)
    with attach_board_memory(arm) as segment:
        board.kill()
        board.communicate()
        assert not segment.owner_alive
        stopped = int(image_of(segment.memory)[IMAGE_COUNT])
        second = start_board(arm)
        try:
            assert segment.is_current
            assert segment.owner_alive
            wait_until(lambda: image_of(segment.memory)[IMAGE_COUNT] not in (0, stopped))
            write(segment.memory, DISCRETE, DISCRETE_POWER)
            wait_until(lambda: status_of(segment.memory) & STATUS_POWER)
        finally:
            second.send_signal(signal.SIGTERM)
            second.communicate(timeout=PATIENCE_S)
