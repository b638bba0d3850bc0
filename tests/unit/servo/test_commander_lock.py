"""One commander an arm: taken, refused, given back, and never stuck with the dead."""

from __future__ import annotations

import subprocess
import sys
import uuid
from typing import Any

import pytest

from qrobot.errors import LinkBusy
from qrobot.rccl_bridge.lease import Lease
from qrobot.realtime import shared_memory
from qrobot.realtime.shared_memory import SharedMemory, segment_path
from qrobot.servo.memory.commander_lock import LABEL_BYTES, Authority

HOLD = """
import sys
from qrobot.servo.memory.commander_lock import Authority
authority = Authority(sys.argv[1])
authority.take("another program")
print("held", flush=True)
sys.stdin.read()
"""


@pytest.fixture
def arm() -> str:
    return f"t{uuid.uuid4().hex[:10]}"


def test_one_holder_at_a_time_named_to_whoever_is_refused(arm: str) -> None:
    first, second = Authority(arm), Authority(arm)
    first.take("the bridge for welding.py")
    with pytest.raises(LinkBusy, match=r"is commanded by the bridge for welding.py \(process \d+\)"):
        second.take("me")
    assert (first.held, second.held) == (True, False)
    first.release()
    assert second.maybe_holder() is None
    second.take("me")
    assert first.maybe_holder() == second.maybe_holder()
    second.release()


def test_whoever_is_refused_is_so_at_once(arm: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """The thread that refuses is the one that reads stops."""
    first, second = Authority(arm), Authority(arm)
    first.take("a program")
    monkeypatch.setattr(shared_memory, "sleep_between_looks", lambda _: pytest.fail("it waited"))
    with pytest.raises(LinkBusy, match="is commanded by a program"):
        second.take("me")
    first.release()


def test_taking_it_again_changes_the_name_and_releasing_twice_nothing(arm: str) -> None:
    authority = Authority(arm)
    authority.take("a")
    authority.take("b" * 500)
    holder = authority.maybe_holder()
    assert holder is not None
    assert holder.startswith("b" * LABEL_BYTES + " (")
    authority.release()
    authority.release()
    assert authority.maybe_holder() is None


def test_a_holder_that_is_killed_holds_nothing(arm: str) -> None:
    with subprocess.Popen(
        [sys.executable, "-c", HOLD, arm], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == "held\n"
        authority = Authority(arm)
        with pytest.raises(LinkBusy, match=f"another program \\(process {other.pid}\\)"):
            authority.take("me")
        other.kill()
        other.wait()
    assert authority.maybe_holder() is None
    authority.take("me")
    authority.release()


def test_what_a_killed_holder_left_is_cleared_away_and_a_living_holder_is_not_disturbed(arm: str) -> None:
    left = segment_path(f"{arm}-commander")
    with subprocess.Popen(
        [sys.executable, "-c", HOLD, arm], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == "held\n"
        Authority(arm).clear()
        assert Authority(arm).maybe_holder() is not None
        assert not Authority(arm).holder_was_killed
        other.kill()
        other.wait()
    assert left.exists()
    assert Authority(arm).holder_was_killed
    Authority(arm).clear()
    assert not left.exists()
    Authority(arm).clear()
    assert not Authority(arm).holder_was_killed


def test_a_holder_who_gives_it_back_while_somebody_looks_was_not_killed(
    arm: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    authority = Authority(arm)
    authority.take("me")
    attach = SharedMemory.attach

    def gone_meanwhile(*arguments: Any, **named: Any) -> SharedMemory:
        segment = attach(*arguments, **named)
        authority.release()
        return segment

    monkeypatch.setattr(SharedMemory, "attach", gone_meanwhile)
    assert not Authority(arm).holder_was_killed


def test_a_bridge_that_may_not_command_tells_its_client_who_does(arm: str) -> None:
    outside = Authority(arm)
    outside.take("qrobot ctl")
    lease, client = Lease(Authority(arm)), object()
    assert not lease.take(client, "a program")
    assert "commanded by qrobot ctl" in lease.refusal
    assert not lease.taken
    outside.release()
    assert lease.take(client, "a program")
    assert not lease.take(object(), "another program")
    assert lease.refusal == "is commanded by a program"
    with pytest.raises(LinkBusy, match="a program"):
        outside.take("qrobot ctl")
    assert lease.release(client)
    outside.take("qrobot ctl")
    outside.release()
