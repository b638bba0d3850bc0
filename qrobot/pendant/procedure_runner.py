"""Calibration and identification of one arm at the pendant: the steps of `qrobot calibrate` and `qrobot identify`.

A recording and the model that was fitted to it stay in a folder of this run, until somebody confirms that the model is
to be kept.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable
from functools import partial
from pathlib import Path
from tempfile import mkdtemp
from typing import Any, Final

from qrobot.errors import MotionError
from qrobot.pendant.command_run import CommandRun
from qrobot.pendant.free_path import write_beside
from qrobot.pendant.procedure_messages import PageProcedureStart
from qrobot.pendant.runner import NICE, Runner

LIVE_STEPS: Final = ("calibrate", "record live")


class ProcedureRunner(Runner):
    """Belongs to one arm.

    Args:
        arm: instance name.
        deployment: file of the arm.
        robot: its robot file, or the name of a packaged one.
        models: folder for models that are kept.
        changed: called, from any thread, when `facts` are others.
    """

    def __init__(self, arm: str, deployment: str, robot: str, models: Path, changed: Callable[[], None]) -> None:
        super().__init__(changed)
        self._arm, self._robot, self._models = arm, robot, models
        self._place = [deployment, "--arm", arm]
        self._request: PageProcedureStart | None = None
        self._folder: Path | None = None
        self._kept = ""

    @property
    def live(self) -> bool:
        """A step runs that moves the arm."""
        return self.running is not None and self._request is not None and self._request.step in LIVE_STEPS

    @property
    def facts(self) -> dict[str, Any]:
        """The newest step, and what there is, for a page."""
        run, request = self._run, self._request
        return {
            "run": self._runs,
            "step": request.step if request else "",
            "state": run.state if run else "none",
            "told": run.told if run else "",
            "recorded": self._file("run.mcap").is_file(),
            "fitted": self._file("model.toml").is_file(),
            "kept": self._kept,
        }

    def start(self, request: PageProcedureStart) -> None:
        """Begin a step. Raises MotionError: another one runs, or the one before it was not done."""
        if self.running is not None:
            raise MotionError("a step runs: end it first")
        if request.step == "fit" and not self._file("run.mcap").is_file():
            raise MotionError("there is no recording yet: record first")
        if self._folder is None:
            self._folder = Path(mkdtemp(prefix="qrobot-pendant-"))
        command = self._command(request)
        self._request, self._kept = request, ""
        self._runs += 1
        self._run = CommandRun([command], self._changed, 0 if request.step in LIVE_STEPS else NICE)
        self._changed()

    def keep(self, confirmed: bool) -> str:
        """Write the model to its place, beside those that are there; its path.

        Raises:
            MotionError: it was not confirmed, there is none, or a step runs. ConfigError: it cannot be written.
        """
        if self.running is not None or not self._file("model.toml").is_file():
            raise MotionError("there is no model to keep: record and fit first")
        if not confirmed:
            raise MotionError("the model is not written: confirm it")
        model = self._file("model.toml")
        self._kept = str(write_beside(self._models, f"{self._arm}-model", ".toml", partial(shutil.copyfile, model)))
        return self._kept

    def close(self) -> None:
        """End what runs, and wait for it; what was not kept goes."""
        super().close()
        if self._folder is not None:
            shutil.rmtree(self._folder, ignore_errors=True)

    def _file(self, name: str) -> Path:
        return (self._folder or Path("/nonexistent")) / name

    def _command(self, request: PageProcedureStart) -> list[str]:
        """Arguments of `qrobot`; a step makes void what later ones have made of its result."""
        slow = ["--slow"] if request.slow else []
        log, model = self._file("run.mcap"), self._file("model.toml")
        match request.step:
            case "calibrate":
                return ["calibrate", *self._place, "--indexes", str(request.indexes)]
            case "plan":
                return ["identify", "plan", *self._place, *slow]
            case "fit":
                model.unlink(missing_ok=True)
                return ["identify", "fit", str(log), "--output", str(model), "--robot", self._robot]
            case _:
                log.unlink(missing_ok=True)
                model.unlink(missing_ok=True)
                where = "--lockstep" if request.step == "record lockstep" else "--go"
                return ["identify", "record", *self._place, where, *slow, "--output", str(log)]
