"""The files of a running servo are removed, as when its account logs out: whoever follows the servo has it still."""

from __future__ import annotations

import os
import shutil
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from qrobot.errors import LinkError
from qrobot.hwif.board_memory import attach_board_memory, create_board_memory
from qrobot.log.follow import LOOK_NS, ServoFollower
from qrobot.log.servo_ring import ServoRing
from qrobot.log.writer import LogWriter
from qrobot.rccl_bridge.servo_port import ServoPort
from qrobot.realtime.structure import local_record
from qrobot.rig.modbus_robot import RunningRobot
from qrobot.servo.memory.published_state import publish_state, state_dtype
from qrobot.servo.memory.servo_memory import ServoSegment, attach_servo_memory, create_servo_memory, servo_record
from qrobot.servo.process.guardian import _follow
from qrobot.servo.process.neighbour_look import RETRY_S, OtherServo
from qrobot.units import NS_PER_S
from tests.support.log_samples import make_header

ARM, ROBOT, N, PERIOD_NS = "vanished", "puma560", 6, 1_000_000


def make_servo() -> ServoSegment:
    servo = create_servo_memory(ARM, ROBOT, "pd", N, PERIOD_NS, 16)
    servo.front.info.ready = 1
    return servo


@dataclass
class Scene:
    """A servo in a folder that goes away."""

    servo: ServoSegment
    remove: Callable[[], None]


@pytest.fixture(params=["removed", "made anew", "with another servo in it"])
def scene(runtime_folder: Path, request: pytest.FixtureRequest) -> Iterator[Scene]:
    """What is left of the folder when it has been removed: nothing, an empty one, or one with another servo in it."""
    others: list[ServoSegment] = []

    def remove() -> None:
        shutil.rmtree(runtime_folder)
        if request.param != "removed":
            runtime_folder.mkdir(0o700)
        if request.param == "with another servo in it":
            others.append(make_servo())

    servo = make_servo()
    yield Scene(servo, remove)
    for each in (servo, *others):
        each.close()
    runtime_folder.mkdir(0o700, exist_ok=True)


def test_a_stop_and_a_power_off_of_a_bridge_reach_the_servo(scene: Scene) -> None:
    port = ServoPort(ARM, ROBOT, N)
    port.request_stop()
    scene.remove()
    port.request_stop()
    port.request_power_off()
    command = scene.servo.front.command
    assert (command.stops, command.power_offs, port.servo) == (2, 1, 1)


def test_its_log_goes_on_until_the_servo_ends(scene: Scene, tmp_path: Path) -> None:
    logs: list[LogWriter] = []

    def open_log(_info: object, _pid: int) -> LogWriter:
        logs.append(LogWriter(tmp_path / f"{len(logs)}.mcap", make_header(N, PERIOD_NS)))
        return logs[-1]

    follower = ServoFollower(ARM, open_log, lambda _line: None)
    follower.step(LOOK_NS)
    scene.remove()
    for look in range(2, 5):
        follower.step(look * LOOK_NS)
        assert (follower.recording, len(logs)) == (True, 1)
    scene.servo.close(unlink=True)
    follower.step(5 * LOOK_NS)
    assert not follower.recording
    follower.close()


def test_its_curves_and_its_registers_go_on(scene: Scene) -> None:
    ring, robot = ServoRing(ARM), RunningRobot(ARM)
    history, before = ring.history(), robot.registers()
    scene.remove()
    assert ring.history() is history
    assert robot.registers() == before
    robot.close()


def test_a_neighbour_is_heard_of(scene: Scene) -> None:
    clock, ticks = [0.0], []
    other, state = OtherServo(ARM, ROBOT, N, lambda: clock[0]), local_record(state_dtype(N))
    for tick in (1, 2):
        state.tick = tick
        publish_state(servo_record(scene.servo.words, N), state)
        seen = other.snapshot()
        ticks.append(None if seen is None else seen.tick)
        if tick == 1:
            scene.remove()
        clock[0] += 2 * RETRY_S
    assert ticks == [1, 2]
    other.close()


def test_a_guardian_keeps_its_servo_and_its_board(scene: Scene) -> None:
    with create_board_memory(ARM), attach_servo_memory(ARM) as servo, attach_board_memory(ARM) as board:
        scene.remove()
        assert _follow(servo, attach_servo_memory, ARM) is servo
        assert _follow(board, attach_board_memory, ARM) is board
        assert servo.owner_alive
        assert board.owner_alive


def test_once_the_servo_has_ended_its_successor_is_followed(
    scene: Scene, runtime_folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(time, "monotonic_ns", lambda: NS_PER_S)
    port = ServoPort(ARM, ROBOT, N)
    port.request_stop()
    scene.remove()
    scene.servo.close(unlink=True)
    shutil.rmtree(runtime_folder, ignore_errors=True)
    with pytest.raises(LinkError, match="start the arm"):
        port.request_stop()
    runtime_folder.mkdir(0o700)
    with make_servo() as successor:
        port.request_stop()
        assert (successor.front.command.stops, port.servo) == (1, 2)


def test_a_file_of_the_same_number_in_another_file_system_is_another_file(
    runtime_folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    servo = make_servo()
    peer = attach_servo_memory(ARM)
    servo.close()
    stat, number = os.stat, os.stat(peer.path).st_ino

    def elsewhere(path: object, **how: object) -> os.stat_result:
        found = list(stat(path, **how))  # type: ignore[call-overload]
        found[1], found[2] = number, found[2] + 1
        return os.stat_result(found)

    monkeypatch.setattr(os, "stat", elsewhere)
    assert not peer.is_current
    peer.close()
