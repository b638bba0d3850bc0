"""The board of an arm at the pendant: seen through a process of the command line, worked only where it is emulated."""

from __future__ import annotations

import json
import subprocess
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from typing import Any, Final

from qrobot.config.deployment import DeployedArm
from qrobot.errors import MotionError
from qrobot.pendant.command_run import CommandRun
from qrobot.pendant.runner import NICE
from qrobot.realtime.own_process import own_command

UNASKED_S: Final = 5.0  # then no page looks any longer, and the process ends
AGAIN_S: Final = 2.0  # between two tries to look at a board that is not there


class BoardAccess:
    """Belongs to one arm. Instants are seconds of one clock.

    The pendant knows neither registers nor faults: `qrobot board show`, `force` and `inject` do.

    Args:
        arm: of the deployment.
        deployment: file of the arm.
        tell: takes a line for people, from any thread.
        clock: seconds.
    """

    def __init__(
        self, arm: DeployedArm, deployment: str, tell: Callable[[str], None], clock: Callable[[], float]
    ) -> None:
        self.emulated = arm.board.emulated
        self._name, self._place = arm.name, ["--deployment", deployment, "--arm", arm.name]
        self._tell, self._clock = tell, clock
        self._process: subprocess.Popen[bytes] | None = None
        self._asked_s = self._began_s = -AGAIN_S
        self._beginning = threading.Lock()
        self._seen: dict[str, Any] = {}
        self._kinds: list[Any] = []
        self._problem = "looking at the board"
        self._commands = ThreadPoolExecutor(1, thread_name_prefix="pendant-board-command")  # one after the other
        self._command: CommandRun | None = None
        self._closed = False

    def look(self, kinds: bool) -> dict[str, Any]:
        """Newest look at the board; the first look begins to look, and finds nothing yet.

        Args:
            kinds: with what can be broken in it, which does not change.
        """
        self._asked_s = self._clock()
        with self._beginning:  # two pages may look at once
            if self._process is None and self._asked_s - self._began_s >= AGAIN_S:
                self._begin()
        seen = {"emulated": self.emulated, "problem": self._problem, "board": self._seen or None}
        return seen | ({"kinds": self._kinds if self.emulated else []} if kinds else {})

    def force(self, line: str) -> None:
        """Work the panel. Raises MotionError: the board is a real one."""
        self._require_emulated()
        self._run(["board", "force", line], line)

    def inject(self, line: str) -> None:
        """Let something break. Raises MotionError: the board is a real one."""
        self._require_emulated()
        self._run(["inject", line], f"broken: {line}")

    def repair(self) -> None:
        """Repair everything that was broken. Raises MotionError: the board is a real one."""
        self._require_emulated()
        self._run(["inject", "--clear"], "everything is repaired")

    def close(self) -> None:
        """Look no longer, and end the command that runs; nothing may be asked for afterwards."""
        self._closed = True
        self._commands.shutdown(wait=False, cancel_futures=True)
        if (command := self._command) is not None and command.state == "running":
            command.end()
        if (process := self._process) is not None:
            process.terminate()

    def _require_emulated(self) -> None:
        if not self.emulated:
            raise MotionError(f"the board of {self._name} is a real one: nothing is forced or broken in it from here")

    def _run(self, command: Sequence[str], done: str) -> None:
        """Run a command when those before it have ended, and tell how it ended; returns at once."""
        self._commands.submit(self._run_now, command, done)

    def _run_now(self, command: Sequence[str], done: str) -> None:
        self._command = made = CommandRun([[*command, *self._place]], lambda: None, NICE)
        if self._closed:
            made.end()
        made.wait()
        lines = made.output.since(0).lines
        complaint = lines[-1].removeprefix("qrobot: ") if lines else made.told
        self._tell(done if made.state == "done" else f"not done: {complaint}")

    # ------------------------------------------------------------------------------------------ the process that looks

    def _begin(self) -> None:
        self._began_s = self._asked_s
        command = own_command("qrobot", "board", "show", "--follow", *self._place)
        process = subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, start_new_session=True
        )
        self._process = process
        threading.Thread(target=self._listen, args=(process,), name="pendant-board", daemon=True).start()

    def _listen(self, process: subprocess.Popen[bytes]) -> None:
        assert process.stdout is not None
        with process.stdout as lines:
            for line in lines:
                self._take(line.decode(errors="replace").strip())
                if self._clock() - self._asked_s > UNASKED_S:
                    process.terminate()
        process.wait()
        self._seen = {}
        if not self._problem:
            self._problem = "looking at the board"
        self._process = None

    def _take(self, line: str) -> None:
        """A line of JSON, or the complaint with which it ends."""
        with suppress(ValueError):
            said = json.loads(line)
            if "kinds" in said:
                self._kinds = said["kinds"]
            else:
                self._seen, self._problem = said, ""
            return
        self._problem = line.removeprefix("qrobot: ")
