"""Programs of one arm at the pendant: off line, in lock-step or live, one at a time."""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import mkdtemp
from typing import Any, Final, TypeAlias

from qrobot.errors import MotionError
from qrobot.pendant.command_run import CommandRun
from qrobot.pendant.program_folder import RECORDING, ProgramFolder, language_of, stamp_of
from qrobot.pendant.program_messages import PageProgramStart
from qrobot.pendant.runner import NICE, Runner
from qrobot.rci.tcp import BRIDGE_VARIABLE, ONLY_VARIABLE

RESULTS: Final = {"requests": "requests.txt", "setpoints": "setpoints.csv"}

Source: TypeAlias = tuple[str, str, str]  # name, program of a VAL file, stamp


@dataclass(frozen=True)
class FoundPath:
    """Setpoints of a run that moved no arm, in its folder."""

    run: int
    folder: Path
    source: Source


class ProgramRunner(Runner):
    """Belongs to one arm.

    Args:
        arm: instance name.
        folder: of the programs.
        deployment: file of the arm.
        changed: called, from any thread, when `facts` are others.

    Attributes:
        folder: of the programs.
        deployment: file of the arm.
    """

    def __init__(
        self,
        arm: str,
        folder: ProgramFolder | None = None,
        deployment: str = "",
        changed: Callable[[], None] = lambda: None,
    ) -> None:
        super().__init__(changed)
        self.folder = folder or ProgramFolder(None)
        self.deployment = deployment
        self._place = ["--deployment", deployment, "--arm", arm]
        self._request: PageProgramStart | None = None
        self._stamp = ""  # of its source
        self._results: Path | None = None
        self._found: FoundPath | None = None
        self._complained: tuple[int, int | None] = 0, None  # run, and the line of its source that an error is about

    @property
    def live(self) -> bool:
        """A program runs that commands the arm."""
        return self.running is not None and self._request is not None and self._request.manner == "live"

    @property
    def facts(self) -> dict[str, Any]:
        """The newest run, for a page."""
        run, request = self._run, self._request
        if run is None or request is None:
            return {"run": 0, "state": "none"}
        return {
            "run": self._runs,
            "state": run.state,
            "name": request.name,
            "stamp": self._stamp,
            "manner": request.manner,
            "stepping": request.step,
            "told": run.told,
            "line": self._error_line(run, request) if run.state == "failed" else None,
            "path": 0 if self.path_ahead is None or self._found is None else self._found.run,
        }

    def start(self, request: PageProgramStart, bridges: Sequence[str] = (), place: str = "") -> None:
        """Start a program, which reaches no arms but those of `bridges`, its own first.

        An arm that is not there begins at `place`, as `--start` has it; empty for the pose of the deployment file.

        Raises:
            MotionError: another one runs, what would move the arm is not what the page shows, or what is no program of
                VAL is to be stepped.
            ConfigError: there is none of that name.
        """
        if self.running is not None:
            raise MotionError("a program runs: end it first")
        path = self.folder.path_of(request.name)
        stamp = stamp_of(path)
        if request.manner == "live" and request.stamp != stamp:
            raise MotionError(f"{request.name} is not as the page shows it: look at it, and start it again")
        if request.step and language_of(path) != "VAL":
            raise MotionError("only programs of VAL can be stepped")
        results = Path(mkdtemp(prefix="qrobot-pendant-"))  # before anything of the newest run is given up: it may fail
        source = request.name, request.execute, stamp
        self._discard(but_path_of=source if request.manner == "live" else None)
        self._results, self._request, self._stamp = results, request, stamp
        self._runs += 1
        if request.manner != "live":
            self._found = FoundPath(self._runs, results, source)
        self._run = CommandRun(
            self._commands(request, path, results, place),
            self._changed,
            0 if request.manner == "live" else NICE,
            [f"SPEED {request.speed:g}", f"XSTEP {request.execute}"] if request.step else [],
            {BRIDGE_VARIABLE: bridges[0], ONLY_VARIABLE: ",".join(bridges)} if bridges else {},
        )
        self._changed()

    def say(self, line: str) -> None:
        """A line for its input."""
        if (run := self.running) is not None:
            run.output.note(f"> {line}")
            run.say(line)

    def interrupt(self) -> None:
        """Interrupt a program that is stepped."""
        if (run := self.running) is not None and self._request is not None and self._request.step:
            run.interrupt()

    def output(self, after: int) -> dict[str, Any]:
        """Lines that the newest run has printed, from number `after` on, and which `RESULTS` it has written."""
        return super().output(after) | {"results": [name for name in RESULTS if self.result(name)]}

    def result(self, name: str) -> Path | None:
        """A file that the newest run has written, one of `RESULTS`; None: there is none."""
        path = None if self._results is None or name not in RESULTS else self._results / RESULTS[name]
        return path if path is not None and path.is_file() else None

    @property
    def path_ahead(self) -> Path | None:
        """Setpoints that the newest run goes through, or would, as a run that moved no arm has found; None: unknown.

        A program that has moved the arm has nothing ahead.
        """
        run, found = self._run, self._found
        if run is None or found is None or run.state != ("running" if found.run != self._runs else "done"):
            return None
        path = found.folder / RESULTS["setpoints"]
        return path if path.is_file() else None

    def close(self) -> None:
        """End what runs, and wait for it."""
        super().close()
        self._discard()

    def _discard(self, but_path_of: Source | None = None) -> None:
        """Delete results of the runs before, but the path that was found for a source."""
        known = self.path_ahead is not None or (self._found is not None and self._found.run != self._runs)
        if self._found is not None and not (known and self._found.source == but_path_of):
            shutil.rmtree(self._found.folder, ignore_errors=True)
            self._found = None
        if self._results is not None and (self._found is None or self._found.folder != self._results):
            shutil.rmtree(self._results, ignore_errors=True)
        self._results = None

    def _commands(self, request: PageProgramStart, path: Path, results: Path, start: str) -> list[Sequence[str]]:
        """Arguments of `qrobot`, command by command."""
        manner = [] if request.manner == "live" else [f"--{request.manner}", *([f"--start={start}"] if start else [])]
        if request.step:
            return [["val", "--load", str(path), *self._place, *manner]]
        place = [*self._place, *manner, "--output", str(results)]
        match language_of(path):
            case kind if kind == RECORDING:
                return self._replays(request, path, results)
            case "VAL":
                how = ["--execute", request.execute, "--speed", f"{request.speed:g}"]
                return [["val", "run", str(path), *how, *place]]
            case "C":
                made = str(results / path.stem)
                return [["cc", str(path), "-o", made], ["run", *place, made]]
            case _:
                return [["run", *place, str(path)]]

    def _replays(self, request: PageProgramStart, path: Path, results: Path) -> list[Sequence[str]]:
        """The same for a recording: its setpoints for the ghost, and unless that is all, an arm that follows them."""
        replay = ["replay", str(path), *self._place]
        judged = [*replay, "--save-as", str(results / RESULTS["setpoints"])]
        match request.manner:
            case "offline":
                return [judged]
            case "lockstep":
                return [judged, [*replay, "--lockstep", "--approach"]]
            case "live":
                return [judged, [*replay, "--approach"]]

    def _error_line(self, run: CommandRun, request: PageProgramStart) -> int | None:
        """Line of the source that the output complains of: the last one, of a compiler the first one."""
        if self._complained[0] != self._runs:
            name = Path(request.name).name
            pattern = re.compile(rf"(?<![\w.]){re.escape(name)}\"?(?:, line |:)(\d+)")
            found = [match[1] for line in run.output.since(0).lines for match in pattern.finditer(line)]
            self._complained = self._runs, int(found[0 if name.endswith(".c") else -1]) if found else None
        return self._complained[1]
