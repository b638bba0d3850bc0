"""A process whose parent is a fork server, as the process sees it that has asked for it."""

from __future__ import annotations

import os
import select
import signal
import subprocess
from contextlib import suppress
from typing import Final

from qrobot.realtime.fork_order import STATUS

UNKNOWN_STATUS: Final = 255  # [A] of a process whose fork server does not tell
TELL_S: Final = 1.0  # [A] until it tells, once the process has ended


class ForkedProcess:
    """A forked process; its methods do what those of their names do of `subprocess.Popen`. It owns its descriptors.

    Args:
        pid: process id.
        process: descriptor of the process (pidfd_open(2)): a signal to it meets no other one.
        status: pipe into which the fork server writes how it has ended.

    Attributes:
        pid: process id.
        returncode: exit status, or minus the number of the signal that has ended it; None until `poll` or `wait` has
            seen that.
    """

    def __init__(self, pid: int, process: int, status: int) -> None:
        self.pid = pid
        self.returncode: int | None = None
        self._process, self._status = process, status

    def poll(self) -> int | None:
        """Its status, once it has ended."""
        return self._look(0.0)

    def wait(self, timeout: float | None = None) -> int:
        """Its status. Raises subprocess.TimeoutExpired when it has not ended within so many seconds."""
        status = self._look(timeout)
        if status is None:
            raise subprocess.TimeoutExpired(f"process {self.pid}", timeout or 0.0)
        return status

    def send_signal(self, number: int) -> None:
        """Send a signal, unless it has ended."""
        if self.returncode is None:
            with suppress(ProcessLookupError):
                signal.pidfd_send_signal(self._process, number)

    def kill(self) -> None:
        """Send SIGKILL."""
        self.send_signal(signal.SIGKILL)

    def _look(self, timeout: float | None) -> int | None:
        if self.returncode is None and is_readable(self._process, timeout):  # it has ended
            told = os.read(self._status, STATUS.size) if is_readable(self._status, TELL_S) else b""
            self.returncode = STATUS.unpack(told)[0] if told else UNKNOWN_STATUS
            self._close()
        return self.returncode

    def _close(self) -> None:
        os.close(self._process)
        os.close(self._status)

    def __del__(self) -> None:
        if self.returncode is None:
            self._close()


def is_readable(descriptor: int, timeout_s: float | None) -> bool:
    """Whether there is something to read, or an end, within so many seconds; None waits for it."""
    poll = select.poll()
    poll.register(descriptor, select.POLLIN)
    return bool(poll.poll(None if timeout_s is None else max(0.0, timeout_s) * 1e3))
