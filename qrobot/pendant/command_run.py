"""Commands of `qrobot` that the pendant runs in processes of their own, one after the other while they succeed."""

from __future__ import annotations

import os
import select
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Final, Literal

from qrobot.pendant.output_tail import OutputTail
from qrobot.realtime.own_process import own_command
from qrobot.realtime.signals import signal_name

LAUNCH: Final = Path(__file__).with_name("launch.py")
INTERRUPTED_S: Final = 10.0  # for a program to bring its arm to rest and to write its trace; then it is killed
LOOK_S: Final = 0.1
CHUNK: Final = 1 << 16
MOST_CHUNKS: Final = 64  # that are still read of a process that has ended
CommandState = Literal["running", "done", "failed", "ended"]


class CommandRun:
    """Begins at once, in a thread of its own.

    Each process is a session of its own, and ends with the pendant, however that ends; what it has left running ends
    with it.

    Args:
        commands: arguments of `qrobot`.
        changed: called, from another thread, when `state` is another.
        niceness: of the processes.
        lines: what the last one reads first.
        variables: of their surroundings.
        program: runs the arguments.

    Attributes:
        output: what they print, errors too.
        state: "failed" with another status than 0, "ended" when it was asked for.
        told: how it ended, for people.
    """

    def __init__(
        self,
        commands: Sequence[Sequence[str]],
        changed: Callable[[], None],
        niceness: int = 0,
        lines: Sequence[str] = (),
        variables: Mapping[str, str] = {},
        program: Sequence[str] = tuple(own_command("qrobot")),
    ) -> None:
        self.output = OutputTail()
        self.state: CommandState = "running"
        self.told = ""
        self._commands, self._changed = commands, changed
        self._niceness, self._lines, self._program = niceness, lines, program
        self._surroundings = {**os.environ, "PYTHONUNBUFFERED": "1", "NO_COLOR": "1", **variables}
        self._process: subprocess.Popen[bytes] | None = None
        self._ending = self._killed = False
        self._lock = threading.Lock()
        self._thread = threading.Thread(target=self._run, name="pendant-command", daemon=True)
        self._thread.start()

    def say(self, line: str) -> None:
        """A line for the input of the process; lost when it does not read, or has gone."""
        with self._lock:
            if self._process is not None and self._process.stdin is not None:
                with suppress(BlockingIOError, BrokenPipeError, ValueError):
                    os.write(self._process.stdin.fileno(), line.encode() + b"\n")

    def interrupt(self) -> None:
        """SIGINT, as Ctrl-C at a terminal."""
        self._signal(signal.SIGINT)

    def end(self) -> None:
        """End it: SIGINT, and SIGKILL when that does not help. Returns at once."""
        if self._ending:
            return
        self._ending = True
        with self._lock:
            if self._process is not None and self._process.stdin is not None:
                self._process.stdin.close()
        self.interrupt()
        killer = threading.Timer(INTERRUPTED_S, self._kill)
        killer.daemon = True
        killer.start()

    def wait(self, seconds: float | None = None) -> None:
        """Wait until it has ended."""
        self._thread.join(seconds)

    def _kill(self) -> None:
        self._killed = self._signal(signal.SIGKILL)

    def _signal(self, number: signal.Signals) -> bool:
        """Send a signal to the process and to what it has started; False when it has gone."""
        with self._lock:
            if self._process is None:
                return False
            with suppress(ProcessLookupError):
                os.killpg(self._process.pid, number)
            return True

    # ------------------------------------------------------------------------------------------------- its own thread

    def _run(self) -> None:
        status = 0
        for number, command in enumerate(self._commands):
            if status == 0 and not self._ending:
                last = number == len(self._commands) - 1
                status = self._perform([*self._program, *command], self._lines if last else ())
        self.output.end()
        self.state = "ended" if self._ending else "failed" if status else "done"
        self.told = self._tell(status)
        self._changed()

    def _perform(self, command: Sequence[str], lines: Sequence[str]) -> int:
        head = [sys.executable, "-I", "-S", str(LAUNCH), str(os.getpid()), str(self._niceness)]
        pipe = subprocess.PIPE
        try:
            process = subprocess.Popen(
                [*head, *command], stdin=pipe, stdout=pipe, stderr=subprocess.STDOUT, start_new_session=True,
                env=self._surroundings,
            )  # fmt: skip
        except OSError as error:
            self.output.note(f"cannot be started: {error.strerror}")
            return 1
        assert process.stdin is not None
        os.set_blocking(process.stdin.fileno(), False)  # one that hangs must not keep the pendant waiting
        with self._lock:
            self._process = process
        for line in lines:
            self.say(line)
        if self._ending:  # asked for meanwhile
            self.interrupt()
        self._listen(process)
        return self._reap(process)

    def _listen(self, process: subprocess.Popen[bytes]) -> None:
        """Take what it prints until it has ended, whoever else still has its output open."""
        assert process.stdout is not None
        source, left = process.stdout.fileno(), MOST_CHUNKS
        os.set_blocking(source, False)
        while left:
            over = os.waitid(os.P_PID, process.pid, os.WEXITED | os.WNOHANG | os.WNOWAIT) is not None
            if not select.select([source], [], [], 0.0 if over else LOOK_S)[0]:
                if over:
                    return
                continue
            left -= over
            data = os.read(source, CHUNK)
            if data:
                self.output.take(data, time.monotonic())
            elif over:
                return
            else:  # it has closed its output and lives
                os.waitid(os.P_PID, process.pid, os.WEXITED | os.WNOWAIT)

    def _reap(self, process: subprocess.Popen[bytes]) -> int:
        """Its status; what it has left running is killed while its number is still its own."""
        with self._lock:
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            status = process.wait()
            self._process = None
            for pipe in (process.stdin, process.stdout):
                assert pipe is not None
                with suppress(OSError):
                    pipe.close()
        return status

    def _tell(self, status: int) -> str:
        if self._killed:
            return f"it did not end within {INTERRUPTED_S:g} s, and was killed"
        if self._ending:
            return "it was ended"
        if status < 0:
            return f"it was killed by {signal_name(-status)}"
        return f"it failed, status {status}: see the last lines" if status else "it has come to its end"
