"""`qrobot val run`, without the arms behind it."""

from __future__ import annotations

import io
import signal
from pathlib import Path

import pytest

from qrobot.cli.console import run_app
from qrobot.cli.main import make_app
from qrobot.cli.val import _execute
from qrobot.rccl.offline import OfflineLink
from qrobot.rci import Link
from qrobot.realtime.signals import handled
from qrobot.wire import Hello
from tests.support.signals import default_signals
from tests.support.val_runs import PLACES, interpreter, main_program


def test_ctrl_c_brings_the_arm_to_rest_and_tells_the_line(capsys: pytest.CaptureFixture[str]) -> None:
    with interpreter(main_program("x = 1", "MOVE a", "MOVE b", rest=PLACES)) as (run, _):
        arm, sample, samples = run.machine.arm, run.machine.arm.sample, iter(range(1, 10_000))

        def press() -> None:
            sample()
            if next(samples) == 10:
                raise KeyboardInterrupt

        arm.sample = press  # type: ignore[method-assign]
        with pytest.raises(KeyboardInterrupt):
            _execute(run, "main", 1, 100.0)
        assert arm.idle
        assert 0.451 < run.machine.frame("here")[0, 3] < 0.625  # on its way to a
    assert "interrupted in program main, line " in capsys.readouterr().err


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
@pytest.mark.parametrize("library", ["rccl", "arcl"])
@pytest.mark.parametrize("kind", ["--offline", "--lockstep"])
def test_sigterm_and_a_closed_terminal_bring_the_arm_to_rest_and_are_told_in_one_sentence(
    kind: str, library: str, number: signal.Signals,
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    file = tmp_path / "to_and_fro.v2"
    file.write_text(main_program("MOVE a", 'TYPE "on the way"', "MOVE b", rest=PLACES))
    monkeypatch.setattr("qrobot.cli.val._say", lambda _: signal.raise_signal(number))
    monkeypatch.chdir(tmp_path)
    with default_signals(number):
        assert run_app(make_app("val"), ["val", "run", kind, "--library", library, str(file)]) == 128 + number
        assert signal.getsignal(number) is signal.SIG_DFL
    assert capsys.readouterr().err.splitlines()[-1] == "qrobot: interrupted in program main, line 3: the arm stands"


@pytest.mark.parametrize(
    "text",
    [
        main_program("WHILE TRUE DO", 'TYPE "on the way"', "END"),
        main_program("MOVE a", 'TYPE "on the way"', "MOVE b", rest=PLACES),
    ],
)
def test_sigterm_ends_a_program_that_a_script_runs_in_the_background_where_ctrl_c_is_ignored(
    text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "behind.v2"
    file.write_text(text)
    monkeypatch.setattr("qrobot.cli.val._say", lambda _: signal.raise_signal(signal.SIGTERM))
    with default_signals(signal.SIGTERM), handled({signal.SIGINT: signal.SIG_IGN}):
        assert run_app(make_app("val"), ["val", "run", "--offline", str(file)]) == 143


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_they_end_the_monitor_which_ctrl_c_does_not(
    number: signal.Signals, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "to_and_fro.v2"
    file.write_text(main_program("MOVE a", 'TYPE "on the way"', "MOVE b", rest=PLACES))
    sent = [signal.SIGINT, number]

    def say(line: str) -> None:
        if line == "on the way":
            signal.raise_signal(sent.pop(0))

    monkeypatch.setattr("qrobot.cli.val._say", say)
    monkeypatch.setattr("sys.stdin", io.StringIO("EXECUTE main\nABORT\nEXECUTE main\nEXECUTE main\n"))
    with default_signals(number):
        assert run_app(make_app("val"), ["val", "--offline", "--load", str(file)]) == 128 + number
    assert capsys.readouterr().err == ""
    assert not sent


def test_a_program_greets_its_arm_by_the_name_of_its_file_and_the_monitor_as_such(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "stack.v2"
    file.write_text(main_program("x = 1"))
    greeted: list[str] = []

    def link(_arm: object, hello: Hello) -> Link:
        greeted.append(hello.program)
        return OfflineLink(hello)

    monkeypatch.setattr("qrobot.cli.run_lockstep.LockstepArm.link", link)
    monkeypatch.setattr("sys.stdin", io.StringIO("QUIT\n"))
    monkeypatch.setattr("sys.argv", ["qrobot"])
    assert run_app(make_app("val"), ["val", "run", "--lockstep", str(file)]) == 0
    assert run_app(make_app("val"), ["val", "--lockstep", "--load", str(file)]) == 0
    assert greeted == ["val: stack.v2", "val: monitor"]


@pytest.mark.parametrize(("kind", "outputs"), [("--lockstep", "none"), ("--offline", "3")])
def test_an_output_without_a_line_is_refused_at_the_monitor_where_there_is_a_board(
    kind: str, outputs: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO("DO SIGNAL 3\nIO\nDO RESET\n"))
    assert run_app(make_app("val"), ["val", kind]) == 0
    told = capsys.readouterr().out
    assert ("output 3 is not configured; the deployment file has none" in told) == (kind == "--lockstep")
    assert f"outputs  {outputs}\n" in told
    assert told.count("error") == (kind == "--lockstep")
