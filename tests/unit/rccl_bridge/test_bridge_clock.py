"""A bridge reads the arm's time in two steps, and its process may be stopped between them."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from qrobot.rccl_bridge import BridgeServer, BridgeSettings, arm_time
from tests.support.fake_port import FakePort

NOW_NS, STALL_NS = 5_000_000_000, 450_000_000


@pytest.mark.parametrize("stopped_at", range(3))
def test_a_bridge_that_is_stopped_as_it_reads_the_arms_time_stamps_no_frame_with_a_time_long_past(
    stopped_at: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A frame whose stamp is as old as the stall was long would be the last of its stream."""
    port, readings = FakePort(), 0
    clock = SimpleNamespace(now_ns=NOW_NS)

    def read(value: int) -> int:
        """Read one of the two; a stall follows, of which the arm tells before the bridge goes on."""
        nonlocal readings
        if readings == stopped_at:
            clock.now_ns += STALL_NS
            port.slipped += STALL_NS
        readings += 1
        return value

    monkeypatch.setattr(port, "slipped_ns", lambda: read(port.slipped))
    monkeypatch.setattr(arm_time, "time", SimpleNamespace(monotonic_ns=lambda: read(clock.now_ns)))
    assert BridgeServer(port, BridgeSettings()).now_ns() == NOW_NS
    assert readings > stopped_at  # the stall has come
