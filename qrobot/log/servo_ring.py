"""The telemetry ring of an arm, whichever servo writes it."""

from __future__ import annotations

from qrobot.errors import LinkError
from qrobot.log.ring_history import RingHistory
from qrobot.realtime.shared_memory import SharedMemory
from qrobot.servo.memory.servo_memory import ServoInfo, attach_servo_memory, servo_info
from qrobot.servo.memory.telemetry import TelemetryReader


class ServoRing:
    """The ring of one arm, whichever servo serves it now; of one that has ended, what it left.

    Args:
        arm: instance name.

    Attributes:
        info: facts of the servo.
    """

    def __init__(self, arm: str) -> None:
        self._arm = arm
        self._segment: SharedMemory | None = None
        self._history: RingHistory | None = None
        self.info: ServoInfo | None = None

    def history(self) -> RingHistory:
        """Cycles that its ring has up to now. Raises LinkError: no servo serves the arm, or none yet."""
        if self._history is None or not self._is_same():
            self._attach()
        assert self._history is not None
        if self._is_same():  # else the ring is another servo's since
            self._history.take()
        return self._history

    def _is_same(self) -> bool:
        segment, info = self._segment, self.info
        return (
            segment is not None
            and info is not None
            and segment.is_current
            and int(segment.header.generation) == info.generation
        )

    def _attach(self) -> None:
        """Find the servo; one that has ended is kept until there is another one."""
        try:
            segment = attach_servo_memory(self._arm)
            info = servo_info(segment.words)
            if not info.ready:
                segment.close()
                raise LinkError(f"the servo of {self._arm} is starting: wait a moment")
        except LinkError:
            if self._history is None:
                raise
            return
        if self._segment is not None:
            self._segment.close()
        reader = TelemetryReader(segment.words, info.telemetry_base, info.telemetry_capacity, info.n)
        self._segment, self.info, self._history = segment, info, RingHistory(reader)
