"""The process that moves an arm for the pendant: when it takes the arm, and when it does not."""

from __future__ import annotations

import io
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from qrobot.errors import LinkLost
from qrobot.pendant import jog_session
from qrobot.pendant.jog_process import JogProcess
from tests.support.patience import PATIENCE_S, give_time

ON = '{"do": "on"}'


@pytest.mark.realtime
def test_a_second_on_does_not_take_the_arm_again_after_its_session_has_ended(monkeypatch: pytest.MonkeyPatch) -> None:
    began, told_twice, answers = threading.Event(), threading.Event(), io.StringIO()
    taken: list[str] = []

    def take(_link: object, robot: str, _period_ms: float) -> None:
        taken.append(robot)
        began.set()
        assert told_twice.wait(PATIENCE_S)
        raise LinkLost("power was taken away")

    def lines() -> Iterator[str]:
        yield ON
        assert began.wait(PATIENCE_S)
        yield ON  # a double click
        told_twice.set()
        give_time()
        yield '{"do": "release"}'

    monkeypatch.setattr(jog_session, "open_channel", take)
    process = JogProcess("puma560", pytest.fail, Path("unused"), answers)
    reader = threading.Thread(target=process.read, args=(lines(),))
    reader.start()
    process.run()
    reader.join()
    assert "power was taken away" in answers.getvalue()
    assert taken == ["puma560"]


@pytest.mark.realtime
def test_a_line_that_cannot_be_obeyed_is_the_end_of_the_process() -> None:
    answers = io.StringIO()
    process = JogProcess("puma560", pytest.fail, Path("unused"), answers)
    with pytest.raises(ValueError, match="Expecting value"):
        process.read([ON, "no JSON"])
    process.run()  # does not take the arm, and ends
    assert answers.getvalue().count("opening") == 0
