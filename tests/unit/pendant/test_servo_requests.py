"""Order of the requests of a page, and what need not wait for it."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from functools import partial
from types import SimpleNamespace
from typing import Any, Self

import pytest

from qrobot.errors import ConfigError, LinkLost
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

    def change_payload(self, mass: float, centre: Sequence[float]) -> Any:
        self.last.set()
        if mass > 4.0:
            raise ConfigError(f"{mass:g} kg: the shoulder cannot hold it")
        self.done.append((mass, tuple(centre)))
        return SimpleNamespace(payload_mass=mass)

    def change_collision(self, thresholds: Sequence[float], reaction: str) -> None:
        self.done.append((tuple(thresholds), reaction))

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


def test_a_load_and_what_follows_a_collision_are_told_when_the_servo_has_taken_them_and_why_it_has_not() -> None:
    servo, told = SlowServo(), []
    arrived = threading.Event()

    def tell(text: str) -> None:
        told.append(text)
        arrived.set()

    requests = ServoRequests("arm", tell, servo)  # type: ignore[arg-type]
    for mass, answer in ((1.5, "the servo reckons with 1.5 kg"), (9.0, "load: 9 kg: the shoulder cannot hold it")):
        requests.load(mass, (0.0, 0.01, 0.05))
        assert arrived.wait(PATIENCE_S)
        assert answer in told[-1]
        arrived.clear()
    requests.collision((10.0, 20.0), "comply")
    assert arrived.wait(PATIENCE_S)
    assert "soft for two seconds" in told[-1]
    assert servo.done == [(1.5, (0.0, 0.01, 0.05)), ((10.0, 20.0), "comply")]


def test_threads_that_cannot_be_started_leave_room_for_later_stops_and_requests(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def none_left(_thread: threading.Thread) -> None:
        raise RuntimeError("can't start new thread")

    servo, told = SlowServo(), list[str]()
    requests = ServoRequests("arm", told.append, servo)  # type: ignore[arg-type]
    with monkeypatch.context() as patched:
        patched.setattr(threading.Thread, "start", none_left)
        for _ in range(9):
            requests.stop(by_bridge=True)
            with pytest.raises(RuntimeError):
                requests.act("pause")
    assert told == ["STOP was pressed: no thread is left to ask the servo by itself; press again"] * 9
    for request in (partial(requests.stop, by_bridge=True), partial(requests.act, "pause")):
        servo.last.clear()
        request()
        assert servo.last.wait(PATIENCE_S)
    assert servo.done == ["stop", "pause"]
