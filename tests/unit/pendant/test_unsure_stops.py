"""No line for people takes away one that says to press the emergency stop."""

from __future__ import annotations

import json
import queue
import threading
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Self

import pytest

from qrobot.errors import LinkLost
from qrobot.pendant.floor import PageView
from qrobot.pendant.jog_process import PRESSED
from qrobot.pendant.servo_requests import ServoRequests
from tests.support.patience import PATIENCE_S
from tests.unit.pendant.test_floor import Floor

LOST = "STOP HAS NOT REACHED THE ARM: press the emergency stop"


class Servo:
    """A control interface that is away, or holds the arm."""

    away = False

    def __call__(self, _arm: str, _patience_s: float) -> Servo:
        if self.away:
            raise LinkLost("no servo")
        return self

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def stop(self) -> Any:
        return SimpleNamespace(mode="HOLDING")

    power_off = stop


class StoppedFloor(Floor):
    """Two arms whose servos are asked."""

    def __init__(self, folder: Path) -> None:
        super().__init__(folder, arms=2)
        self.servos, self.told = [Servo(), Servo()], threading.Semaphore(0)
        for arm, servo in zip(self.arms, self.servos, strict=True):
            arm.requests = ServoRequests(arm.arm.name, self.hear(arm.tell), servo)  # type: ignore[arg-type]

    def hear(self, tell: Any) -> Any:
        """Have each line counted that is told."""

        def told(text: str) -> None:
            tell(text)
            self.told.release()

        return told

    def stop(self) -> None:
        """STOP of some page, and both arms have told what became of it."""
        self.says(1, do="stop")
        for _ in self.arms:
            assert self.told.acquire(timeout=PATIENCE_S)

    def unsure(self, page: PageView) -> list[str]:
        """What a page is told of each arm's stop."""
        return [arm["unsure"] for arm in json.loads(self.status(page))["arms"]]


@pytest.mark.parametrize("lost", [0, 1])
def test_a_stop_that_has_not_reached_an_arm_is_told_until_one_of_that_arm_is_answered(
    lost: int, tmp_path: Path
) -> None:
    floor = StoppedFloor(tmp_path)
    floor.servos[lost].away = True
    floor.stop()
    for arm in floor.arms:  # whatever is told later, of whichever arm
        arm.tell(PRESSED.format("STOP"))
        arm.tell("wrote led.csv")
    for page in floor.pages:
        page.complain("only the page that drives this arm can do that")
        told = floor.unsure(page)
        assert told[lost].startswith(LOST)
        assert told[1 - lost] == ""
    floor.says(0, do="act", arm=1 - lost, name="power off")  # the other one
    assert floor.told.acquire(timeout=PATIENCE_S)
    assert floor.unsure(floor.pages[0])[lost].startswith(LOST)
    floor.servos[lost].away = False
    floor.says(0, do="act", arm=lost, name="power off")
    assert floor.told.acquire(timeout=PATIENCE_S)
    assert floor.unsure(floor.pages[0]) == ["", ""]


def test_each_stop_that_is_not_answered_is_told_anew(tmp_path: Path) -> None:
    """A page on which somebody has taken the line away shows it again."""
    floor = StoppedFloor(tmp_path)
    floor.servos[0].away = True
    for count in (1, 2):
        floor.stop()
        assert [arm["unsures"] for arm in json.loads(floor.status(floor.pages[0]))["arms"]] == [count, 0]


class MistakenServo(Servo):
    """One whose client makes a mistake of its own."""

    def stop(self) -> Any:
        raise ValueError("an answer that nobody has thought of")

    power_off = stop


@pytest.mark.parametrize("halt", [ServoRequests.stop, ServoRequests.power_off])
def test_a_stop_that_fails_by_a_mistake_of_ours_is_not_certain_either(
    halt: Callable[[ServoRequests, bool], None],
) -> None:
    told: queue.SimpleQueue[str] = queue.SimpleQueue()
    requests = ServoRequests("arm", told.put, MistakenServo())  # type: ignore[arg-type]
    halt(requests, False)
    line = told.get(timeout=PATIENCE_S)
    assert "HAS NOT REACHED THE ARM: press the emergency stop (ValueError: an answer that nobody" in line
    assert requests.unsure == line


class SlowServo(Servo):
    """One whose answers, and whose silence, come when they are let go, by the number of the request."""

    def __init__(self, answers: list[bool]) -> None:
        self.answers = answers
        self.begun = 0
        self.came = threading.Semaphore(0)
        self.go_on = [threading.Event() for _ in answers]

    def stop(self) -> Any:
        number, self.begun = self.begun, self.begun + 1
        self.came.release()
        assert self.go_on[number].wait(PATIENCE_S)
        if not self.answers[number]:
            raise LinkLost("no answer")
        return super().stop()


@pytest.mark.parametrize(
    ("answers", "order", "unsure"),
    [
        ([False, True], [1, 0], False),  # the arm has stopped since
        ([False, True], [0, 1], False),
        ([True, False], [0, 1], True),
        ([True, False], [1, 0], True),  # it went on, perhaps, before somebody pressed again
    ],
)
def test_of_stops_under_way_at_once_the_newest_counts(answers: list[bool], order: list[int], unsure: bool) -> None:
    servo, told = SlowServo(answers), threading.Semaphore(0)
    requests = ServoRequests("arm", lambda _: told.release(), servo)  # type: ignore[arg-type]
    for _ in answers:
        requests.stop(by_bridge=False)
        assert servo.came.acquire(timeout=PATIENCE_S)
    for number in order:
        servo.go_on[number].set()
        assert told.acquire(timeout=PATIENCE_S)
    assert bool(requests.unsure) == unsure
