"""Calibration and identification at the pendant: what each step runs, and what is written when."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest

from qrobot.errors import MotionError
from qrobot.pendant import procedure_runner
from qrobot.pendant.output_tail import OutputTail
from qrobot.pendant.procedure_messages import PageProcedureStart
from qrobot.pendant.procedure_runner import NICE, ProcedureRunner

PLACE = ["arms.toml", "--arm", "puma"]


class FakeRun:
    """A run that never starts a process."""

    def __init__(self, commands: Sequence[list[str]], _changed: Callable[[], None], niceness: int) -> None:
        (self.command,), self.niceness = commands, niceness
        self.output, self.state, self.told, self.ended = OutputTail(), "running", "", False

    def end(self) -> None:
        self.ended = True

    def wait(self, _seconds: float) -> None:
        pass


@pytest.fixture
def runner(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> ProcedureRunner:
    monkeypatch.setattr(procedure_runner, "CommandRun", FakeRun)
    return ProcedureRunner("puma", "arms.toml", "bent.toml", tmp_path / "models", lambda: None)


def begun(runner: ProcedureRunner, step: str, **more: Any) -> Any:
    runner.start(PageProcedureStart(do="procedure start", arm=0, step=step, **more))  # type: ignore[arg-type]
    return runner._run


def test_each_step_runs_its_command_and_only_those_that_move_the_arm_are_ended_by_a_stop(
    runner: ProcedureRunner,
) -> None:
    run = begun(runner, "calibrate", indexes=7)
    assert run.command == ["calibrate", *PLACE, "--indexes", "7"]
    assert (run.niceness, runner.live) == (0, True)
    with pytest.raises(MotionError, match="end it first"):
        begun(runner, "plan")
    runner.stop()
    assert run.ended
    run.state = "ended"
    run = begun(runner, "plan", slow=True)
    assert run.command == ["identify", "plan", *PLACE, "--slow"]
    assert (run.niceness, runner.live) == (NICE, False)
    runner.stop()
    assert not run.ended
    run.state = "done"
    with pytest.raises(MotionError, match="record first"):
        begun(runner, "fit")
    run = begun(runner, "record live")
    assert run.command[:-1] == ["identify", "record", *PLACE, "--go", "--output"]
    assert runner.live
    runner.end()
    assert run.ended
    runner.close()


def test_a_model_is_written_only_when_that_is_confirmed_and_over_no_other(
    runner: ProcedureRunner, tmp_path: Path
) -> None:
    run = begun(runner, "record lockstep")
    log = Path(run.command[-1])
    log.write_text("log")
    run.state = "done"
    assert runner.facts["recorded"]
    run = begun(runner, "fit")
    model = Path(run.command[4])
    assert run.command == ["identify", "fit", str(log), "--output", str(model), "--robot", "bent.toml"]
    with pytest.raises(MotionError, match="no model to keep"):
        runner.keep(True)
    model.write_text("model")
    run.state = "done"
    with pytest.raises(MotionError, match="confirm it"):
        runner.keep(False)
    assert not (tmp_path / "models").exists()
    first, second = runner.keep(True), runner.keep(True)
    assert [Path(path).name for path in (first, second)] == ["puma-model.toml", "puma-model-1.toml"]
    assert Path(second).read_text() == "model"
    assert runner.facts["kept"] == second
    run = begun(runner, "record lockstep")  # what was fitted to the recording before is void
    assert not runner.facts["fitted"]
    assert not runner.facts["recorded"]
    runner.close()
    assert not model.parent.exists()
