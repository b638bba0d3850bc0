"""The pendant's end of a process that moves an arm (`jog_process`): started when needed, and anew when it has died."""

from __future__ import annotations

import json
import os
import subprocess
import threading
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

from qrobot.config.deployment import BoardChoice, DeployedArm, ServoChoice
from qrobot.realtime.own_process import own_command

WRITING_S: Final = 120.0  # [A] twice what the longest recordings take


def told_arm(arm: DeployedArm) -> str:
    """Robot, bridge and fences of an arm as JSON, for the process that moves it."""
    board, servo = BoardChoice(scene=arm.board.scene), ServoChoice(tool_mm=arm.servo.tool_mm)
    known = DeployedArm(name=arm.name, robot=arm.robot, bridge=arm.bridge, fences=arm.fences, board=board, servo=servo)
    return known.model_dump_json(by_alias=True, exclude_unset=True)


class JogWorker:
    """Belongs to one arm.

    Args:
        arm: of the deployment.
        taught: file of places by name.
        tell: takes a line for people, "" when only `session` has changed; from another thread.

    Attributes:
        session: "no", "opening" or "ready".
        guide: the arm is, or was last, taken to be led by hand.
        led: lengths of what was recorded of that, s.
        writes: a recording is being written.
    """

    def __init__(self, arm: DeployedArm, taught: Path, tell: Callable[[str], None]) -> None:
        self.session, self.guide, self.writes = "no", False, False
        self.led: list[float] = []
        self._arm, self._taught, self._tell = arm, taught, tell
        self._process: subprocess.Popen[bytes] | None = None

    def start(self) -> None:
        """Start the process, unless it runs."""
        if self._process is not None and self._process.poll() is None:
            return
        command = own_command("qrobot.pendant.jog_process", told_arm(self._arm), str(self._taught))
        process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        assert process.stdin is not None
        os.set_blocking(process.stdin.fileno(), False)  # one that hangs must not keep the pendant waiting
        self._process = process
        threading.Thread(target=self._listen, args=(process,), name="pendant-jog", daemon=True).start()

    def say(self, **message: Any) -> None:
        """Send a message, see `jog_process`; lost when the process does not read, or has gone."""
        if self._process is None or self._process.stdin is None:
            return
        with suppress(BlockingIOError, BrokenPipeError, ValueError):
            os.write(self._process.stdin.fileno(), json.dumps(message).encode() + b"\n")

    def close(self) -> None:
        """End the input: the arm is brought to rest, and the process ends. Returns at once."""
        if self._process is not None and self._process.stdin is not None:
            with suppress(OSError):
                self._process.stdin.close()

    def wait(self, seconds: float) -> None:
        """Wait for the end of the process, for at most so long; one that has not ended is killed.

        One that writes a recording moves nothing, and is waited for much longer.
        """
        if self._process is None or self._ends_within(seconds) or (self.writes and self._ends_within(WRITING_S)):
            return
        self._process.kill()
        self._process.wait()

    def _ends_within(self, seconds: float) -> bool:
        assert self._process is not None
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(seconds)
        return self._process.returncode is not None

    def _listen(self, process: subprocess.Popen[bytes]) -> None:
        assert process.stdout is not None
        with process.stdout as answers:
            for line in answers:
                said = json.loads(line)
                self.session, self.guide, self.led = said["session"], said["guide"], said["led"]
                self.writes = said["writes"]
                self._tell(said["text"])
        self.session, self.led, self.writes = "no", [], False
        self._tell("" if process.wait() == 0 else "the process that moves the arm has ended: take the arm again")
