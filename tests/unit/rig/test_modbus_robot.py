"""A running robot over Modbus: what its servo and board show, read only, and honest when one of them is away."""

from __future__ import annotations

import uuid
from collections.abc import Iterator
from contextlib import ExitStack, suppress

import numpy as np
import pytest

from qrobot.errors import LinkBusy, LinkError
from qrobot.hwif.board_memory import create_board_memory
from qrobot.hwif.modbus.map import MAX_JOINTS, ROBOT, VECTORS, encode_robot
from qrobot.realtime.shared_memory import segment_path
from qrobot.rig.modbus_robot import RunningRobot
from qrobot.servo.memory.servo_memory import create_servo_memory

WORDS = (5, 21, 22, 3, 31, 1, 2, 6)


@pytest.fixture
def arm() -> Iterator[str]:
    name = f"test{uuid.uuid4().hex[:12]}"
    yield name
    for part in ("board", "servo"):
        segment_path(f"{name}-{part}").unlink(missing_ok=True)


def singles(registers: list[int], vector: int, n: int) -> list[float]:
    """Floats of a vector, the more significant word first."""
    at = VECTORS - ROBOT + 2 * MAX_JOINTS * vector
    high, low = np.array(registers[at : at + 2 * n : 2]), np.array(registers[at + 1 : at + 2 * n : 2])
    return (high << 16 | low).astype(np.uint32).view(np.float32).tolist()  # type: ignore[no-any-return]


def test_every_number_of_a_robot_stands_where_the_map_says() -> None:
    vectors = [np.array([0.5, -1.25, 3.0]) * (k + 1) for k in range(4)]
    registers = encode_robot(WORDS, 0x0001_0002_0003_0004, 9, 0x8005, vectors)
    assert registers[:8] == list(WORDS)
    assert registers[8:17] == [1, 2, 3, 4, 0, 0, 0, 9, 0x8005]
    assert [singles(registers, k, 3) for k in range(4)] == [vector.tolist() for vector in vectors]
    assert len(registers) == VECTORS - ROBOT + 4 * 2 * MAX_JOINTS


def test_a_robot_is_shown_while_its_servo_lives_and_found_again(arm: str) -> None:
    robot = RunningRobot(arm)
    with pytest.raises(LinkError, match="no shared memory"):
        robot.registers()
    for n in (6, 3):
        with ExitStack() as stack:
            stack.enter_context(create_servo_memory(arm, "puma560", "qrobot", n, 1_000_000, 16))
            assert robot.registers()[7] == n
        with pytest.raises(LinkError):
            robot.registers()
    robot.close()


def test_the_board_of_a_running_robot_takes_nothing_from_here(arm: str) -> None:
    robot = RunningRobot(arm)
    with suppress(LinkError):
        robot.facts()
    with create_board_memory(arm) as board:
        board.memory.facts.revision, board.memory.facts.joints = ord("F"), 6
        assert robot.facts().joints == 6
        with pytest.raises(LinkBusy, match="the servo of"):
            robot.apply(np.zeros((1, 3), np.int64))
    robot.close()
