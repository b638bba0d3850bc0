"""The pendant's end of a process that answers questions (`answering`): begun when needed, and anew when it died."""

from __future__ import annotations

import json
import select
import subprocess
import threading
import time
from typing import Any, Final

from qrobot.errors import LogError
from qrobot.pendant.answering import ANSWER_HEAD, ProcessAnswer
from qrobot.realtime.own_process import own_command

PATIENCE_S: Final = 30.0


LOGS: Final = (
    "qrobot.pendant.log_process",
    "the log could not be read: was the file cut off while it was open? Open it again",
)
SCOPE: Final = "qrobot.pendant.scope_process", "the cycles of the servo could not be read: look again"


class AnsweringProcess:
    """Asks one question at a time; others wait. Not for the thread of the server's loop.

    Args:
        module: that the process runs.
        sorry: why there is no answer when the process has died or is silent.
    """

    def __init__(self, module: str, sorry: str) -> None:
        self._module, self._sorry = module, sorry
        self._lock = threading.Lock()
        self._process: subprocess.Popen[bytes] | None = None

    def ask(self, **request: Any) -> ProcessAnswer:
        """Answer of the process. Raises LogError: it has none, or it ended or was silent at this question."""
        with self._lock:
            try:
                told, data = self._exchange(json.dumps(request).encode() + b"\n")
            except (OSError, EOFError):
                self._end()
                raise LogError(self._sorry) from None
        if "error" in told:
            raise LogError(told["error"])
        return told, data

    def start(self) -> None:
        """Begin the process now: it takes a second or more."""
        with self._lock:
            self._running()

    def close(self) -> None:
        """End the process."""
        with self._lock:
            self._end()

    def _exchange(self, request: bytes) -> ProcessAnswer:
        process = self._running()
        assert process.stdin is not None
        process.stdin.write(request)
        process.stdin.flush()
        by = time.monotonic() + PATIENCE_S
        told_bytes, data_bytes = ANSWER_HEAD.unpack(self._take(process, ANSWER_HEAD.size, by))
        return json.loads(self._take(process, told_bytes, by)), self._take(process, data_bytes, by)

    def _take(self, process: subprocess.Popen[bytes], length: int, by: float) -> bytes:
        assert process.stdout is not None
        taken = b""
        while len(taken) < length:
            if not select.select([process.stdout], [], [], max(0.0, by - time.monotonic()))[0]:
                raise EOFError
            piece = process.stdout.read(length - len(taken))
            if not piece:
                raise EOFError
            taken += piece
        return taken

    def _running(self) -> subprocess.Popen[bytes]:
        if self._process is None or self._process.poll() is not None:
            command = own_command(self._module)
            self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, bufsize=0)
        return self._process

    def _end(self) -> None:
        if self._process is not None:
            for pipe in (self._process.stdin, self._process.stdout):
                if pipe is not None:
                    pipe.close()
            self._process.kill()
            self._process.wait()
            self._process = None
