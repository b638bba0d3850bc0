"""Order of the requests of a page, and what need not wait for it."""

from __future__ import annotations

import threading
from typing import Any, Self

from qrobot.errors import LinkLost
from qrobot.pendant.servo_requests import ServoRequests
from tests.support.patience import PATIENCE_S


class SlowServo:
    """A control interface whose first request is answered only when `go_on` is set; later ones at once."""

    def __init__(self) -> None:
        self.done: list[Any] = []
        self.heard, self.go_on, self.last = threading.Event(), threading.Event(), threading.Event()

    def __call__(self, _arm: str, _patience_s: float) -> SlowServo:
        return self

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def change_override(self, factor: float) -> None:
        self.done.append(factor)
        self.heard.set()
        assert self.go_on.wait(PATIENCE_S)
        if factor == 0.5:
            raise LinkLost("the servo went")
        if factor == 0.3:
            self.last.set()

    def resume(self) -> None:
        self.done.append("resume")
        self.heard.set()
        assert self.go_on.wait(PATIENCE_S)

    def pause(self) -> None:
        self.done.append("pause")
        self.last.set()

    def stop(self) -> Any:
        self.done.append("stop")
        self.last.set()
        raise LinkLost("away")


def test_of_several_overrides_the_newest_is_in_force_at_the_end_also_after_one_that_failed() -> None:
    servo, told = SlowServo(), []
    requests = ServoRequests("arm", told.append, servo)  # type: ignore[arg-type]
    requests.override(0.5)
    assert servo.heard.wait(PATIENCE_S)
    for factor in (0.9, 0.7, 0.3):
        requests.override(factor)
    servo.go_on.set()
    assert servo.last.wait(PATIENCE_S)
    assert servo.done == [0.5, 0.3]
    assert told == ["override: the servo went"]


def test_a_stop_waits_for_no_request_and_those_that_wait_are_forgotten() -> None:
    servo = SlowServo()
    requests = ServoRequests("arm", lambda _: None, servo)  # type: ignore[arg-type]
    requests.act("resume")
    assert servo.heard.wait(PATIENCE_S)
    requests.act("resume")
    requests.stop(by_bridge=False)
    assert servo.last.wait(PATIENCE_S)
    assert servo.done == ["resume", "stop"]
    servo.last.clear()
    requests.act("pause")  # of one kind with what hangs
    servo.go_on.set()
    assert servo.last.wait(PATIENCE_S)
    assert servo.done == ["resume", "stop", "pause"]
