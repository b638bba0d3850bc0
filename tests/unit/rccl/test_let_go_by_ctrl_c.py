"""Ctrl-C twice at one sample on virtual time, which lets go of the arm: it is told once."""

from __future__ import annotations

import signal

import pytest

from qrobot.errors import LinkError
from qrobot.rccl.connect import open_channel
from qrobot.rccl.offline import OfflineLink
from qrobot.wire import Command, State

LET_GO = "an interrupt in the midst of a sample has let go of the arm"


class HitLink(OfflineLink):
    """An ideal arm at one of whose samples somebody hits Ctrl-C twice."""

    hit = False

    def exchange(self, command: Command | None) -> State:
        if self.hit:
            type(self).hit = False
            signal.raise_signal(signal.SIGINT)
            signal.raise_signal(signal.SIGINT)
        return super().exchange(command)


@pytest.fixture(autouse=True)
def _hit_by_the_test(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(HitLink, "hit", False)


@pytest.mark.parametrize("ask", ["stop", "waitas"])
def test_who_stops_the_arm_or_waits_for_it_then_is_told_why_it_cannot(ask: str) -> None:
    with open_channel(HitLink, "puma560", 28.0) as arm:
        HitLink.hit = True
        with pytest.raises(KeyboardInterrupt):
            arm.waitas(lambda: False)
        for _ in range(2):
            with pytest.raises(LinkError, match=LET_GO):
                arm.stop() if ask == "stop" else arm.waitas(lambda: False)


def test_a_program_that_waits_for_its_other_arm_is_not_told_again_when_it_ends() -> None:
    with open_channel(OfflineLink, "puma560", 28.0) as left:
        with open_channel(HitLink, "puma560", 28.0) as right:
            HitLink.hit = True
            with pytest.raises(KeyboardInterrupt):
                left.waitas(lambda: False)
            with pytest.raises(LinkError, match=LET_GO):
                right.waitas(lambda: False)
        left.stop()
        left.waitfor(left.completed)
