"""Frames for the servo, out of a client's COMMANDs: streams get lasting numbers, requests become edges."""

from __future__ import annotations

from dataclasses import replace

from qrobot.rccl_bridge.lease import Lease
from qrobot.rccl_bridge.servo_interface import SetpointFrame
from qrobot.wire import Command


class FrameMaker:
    """Remembers what one commander said last.

    To another servo than before, unless it has power already, nothing is forwarded until the power request was dropped
    once, and the commander's next frame begins a new stream: nothing moves because somebody restarted something.
    """

    def __init__(self, lease: Lease, period_ns: int) -> None:
        self._lease = lease
        self._period_ns = period_ns
        self._last: Command | None = None
        self._acknowledged = 0
        self._client_stream: int | None = None
        self._stream = 0
        self._power_locked = False

    @property
    def acknowledged(self) -> int:
        """Seq of the newest COMMAND whose setpoints were possible, 0 before the first."""
        return self._acknowledged

    def meet(self, powered: bool) -> None:
        """Another servo has come: a power request that stands was made to the one before, unless this one has power."""
        self._power_locked = not powered
        self._client_stream = None

    def make(self, command: Command, seq: int, now_ns: int) -> SetpointFrame | None:
        """The frame of `command`, whose unwrapped sequence number is `seq`; None while the power request is locked."""
        self._acknowledged = command.seq
        return self._make(command, seq, now_ns)

    def make_request(self, command: Command, now_ns: int) -> SetpointFrame | None:
        """The frame of what `command` requests while its setpoints are impossible: it holds every joint."""
        nothing = (0,) * len(command.modes)
        return self._make(replace(command, modes=nothing, setpoints=nothing), 0, now_ns)

    def _make(self, command: Command, seq: int, now_ns: int) -> SetpointFrame | None:
        last, self._last = self._last, command
        self._power_locked = self._power_locked and command.power
        if self._power_locked:
            return None
        if command.stream != self._client_stream:
            self._client_stream, self._stream = command.stream, self._lease.new_stream(now_ns)
        return SetpointFrame(
            stream=self._stream,
            seq=seq,
            t_ns=now_ns,
            period_ns=self._period_ns,
            modes=command.modes,
            setpoints=command.setpoints,
            power=command.power,
            clear_fault=command.clear_fault and not (last is not None and last.clear_fault),
            stop=command.stop and not (last is not None and last.stop),
            hand=command.hand,
            outputs=command.outputs,
            hold_to_run=command.hold_to_run,
            key_held=command.key_held,
            signals=command.signals,
            path_waits=command.path_waits,
        )
