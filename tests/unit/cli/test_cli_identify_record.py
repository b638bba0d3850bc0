"""`qrobot identify record` on a running arm: what it says when the moves do not come to their end."""

from __future__ import annotations

import contextlib
import errno
import os
import threading
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from qrobot.cli.arms import choose_arm
from qrobot.cli.identify_fit import IdentificationTask
from qrobot.cli.identify_options import FitOptions
from qrobot.cli.identify_record import (
    _recording,
    read_rows,
    record_emulated,
    record_running,
    says_where_it_broke_off,
)
from qrobot.config import load_robot
from qrobot.errors import (
    ConfigError,
    FenceCrossed,
    IdentificationError,
    LinkBusy,
    LogError,
    MotionError,
    QRobotError,
    ServoFault,
)
from qrobot.faultcodes import FaultCode
from qrobot.ident.perform import MoveProgress
from qrobot.ident.plan import ExcitationPlan, Swing
from qrobot.log.follow import LOOK_NS, ServoFollower
from qrobot.log.header import LOCKSTEP, LogHeader, header_for
from qrobot.log.read import read_log
from qrobot.log.record import write_log
from qrobot.servo.memory.mailbox import ServoMailbox
from qrobot.servo.memory.servo_memory import ServoMemory, create_servo_memory, servo_info
from qrobot.servo.memory.telemetry import Rows, TelemetryLayout, append_row
from qrobot.wire import RobotFlag
from tests.support.patience import PATIENCE_S, wait_until
from tests.support.processes import write_deployment

PUMA = load_robot("puma560")
HEADER = header_for(PUMA, 1_000_000, "qrobot", arm="left")

POSE = Swing("pose 9", np.zeros(6), np.ones(6), 1.5, 0.25)
PLAN = ExcitationPlan(PUMA.name, (POSE,), 1.0, 1.5)


def break_off(error: BaseException, told: list[int]) -> None:
    """A recording that ends in an error during the ninth move."""
    with says_where_it_broke_off(lambda number, _move: told.append(number)) as tell:
        tell(7, POSE)
        tell(8, POSE)
        raise error


@pytest.mark.parametrize("error", [ServoFault(FaultCode.FOLLOWING, "joint 4"), KeyboardInterrupt()])
def test_how_to_go_on_is_said(error: BaseException, capsys: pytest.CaptureFixture[str]) -> None:
    told: list[int] = []
    with pytest.raises(type(error)):
        break_off(error, told)
    assert told == [7, 8]
    said = " ".join(capsys.readouterr().err.split())
    assert "it broke off in pose 9" in said
    assert "--first 9 " in said


@pytest.mark.parametrize(
    "error",
    [FenceCrossed("move to pose 9: too near", "bench", "wrist", 0.01, 0.4), ServoFault(FaultCode.FENCE, "bench")],
)
def test_a_move_that_a_fence_forbids_is_to_be_left_out(error: Exception, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(type(error)):
        break_off(error, [])
    said = " ".join(capsys.readouterr().err.split())
    assert "it broke off in pose 9: the same with --first 10 and another --output leaves it out" in said
    assert "--first 9 " not in said


def test_nothing_is_said_of_moves_that_were_made(capsys: pytest.CaptureFixture[str]) -> None:
    with says_where_it_broke_off(lambda _number, _move: None) as tell:
        tell(0, POSE)
    assert capsys.readouterr().err == ""


def test_nothing_is_said_where_no_move_had_begun(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(ServoFault), says_where_it_broke_off(lambda _number, _move: None):
        raise ServoFault(FaultCode.FOLLOWING, "before the first")
    assert capsys.readouterr().err == ""


def test_a_full_disk_behind_the_lines_of_the_recorder_ends_no_recording(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    name, written = f"recorded{os.getpid()}", threading.Event()
    deployment = write_deployment(tmp_path, name=name)
    layout = TelemetryLayout(PUMA.n)

    def note(_line: str) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    def pretend(follower: ServoFollower, stop: threading.Event) -> None:
        """The recorder beside a servo, on a clock moved by hand."""
        try:
            follower.step(LOOK_NS)
            follower.step(2 * LOOK_NS)
            written.set()
            assert stop.wait(PATIENCE_S)
        finally:
            written.set()
            follower.close()

    monkeypatch.setattr("qrobot.cli.identify_record.note", note)
    monkeypatch.setattr("qrobot.cli.log.recorded_header", lambda *_: HEADER)
    monkeypatch.setattr("qrobot.log.follow.follow", pretend)
    with ready_servo(name) as memory:
        base = servo_info(memory.words).telemetry_base
        with _recording(choose_arm(str(deployment), None), PUMA, tmp_path / "run.mcap") as recorder:
            recorder.begin()
            for row in layout.empty(100).view(np.int64).reshape(100, layout.row_words):
                append_row(memory.words, base, 256, layout.row_words, row)
            assert written.wait(PATIENCE_S)
    assert read_log(tmp_path / "run.mcap").rows.size == 100


REAL = replace(HEADER, wall_offset_ns=1_700_000_000_000_000_000)


def cycles(first: int, last: int, carried: float = 0.0) -> Rows:
    """Rows of a running servo."""
    rows = TelemetryLayout(PUMA.n).empty(last - first)
    rows["tick"] = np.arange(first, last)
    rows["t_ns"] = 5_000_000_123 + rows["tick"] * REAL.period_ns
    rows["q"][:, 0] = carried
    return rows


def test_cycles_that_several_logs_have_count_once_and_with_the_first_that_has_them(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    first = write_log(tmp_path / "first.mcap", cycles(0, 300), REAL)[0]
    second = write_log(tmp_path / "second.mcap", cycles(200, 500), REAL)[0]
    rows, _ = read_rows([first, second])
    assert rows["tick"].tolist() == list(range(500))
    assert "second.mcap: 100 of its cycles are in another log" in " ".join(capsys.readouterr().err.split())
    carried, _ = read_rows([second], REAL, beside=cycles(0, 300))
    assert carried["tick"].tolist() == list(range(300, 500))
    assert read_rows([first, first])[0].size == 300


def test_of_a_recording_that_was_not_ended_it_is_told_that_passes_may_be_missing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    whole = write_log(tmp_path / "whole.mcap", cycles(0, 3000), REAL)[0]
    assert read_rows([whole])[0].size == 3000
    assert not capsys.readouterr().err
    (tmp_path / "cut.mcap").write_bytes(whole.read_bytes()[: whole.stat().st_size // 2])
    assert 0 < read_rows([tmp_path / "cut.mcap"])[0].size < 3000
    assert "cut.mcap was not ended" in " ".join(capsys.readouterr().err.split())


def test_runs_on_virtual_time_are_taken_whole_and_so_are_those_of_another_servo(tmp_path: Path) -> None:
    later, other = cycles(0, 300), cycles(0, 300, carried=0.5)
    later["t_ns"] += 1
    for header, rows in ((HEADER, other), (replace(HEADER, clock=LOCKSTEP), other), (REAL, later)):
        logs = [write_log(tmp_path / f"{n}.mcap", made, header)[0] for n, made in ((1, cycles(0, 300)), (2, rows))]
        assert read_rows(logs)[0].size == 600


def test_a_run_on_virtual_time_that_is_given_twice_counts_once(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Twice the rows would tell intervals that are too narrow by a third, and passes held back would be in the fit."""
    first, second, other = (
        write_log(tmp_path / f"{name}.mcap", cycles(0, 300, carried), replace(HEADER, clock=LOCKSTEP))[0]
        for name, carried in (("first", 0.0), ("second", 0.0), ("other", 0.5))
    )
    rows, _ = read_rows([first, other, second])
    assert rows.size == 600
    assert "second.mcap: all of its cycles are in another log as well" in " ".join(capsys.readouterr().err.split())
    assert read_rows([second], HEADER, beside=rows)[0].size == 0


@contextlib.contextmanager
def ready_servo(name: str, override: float = 1.0, speed_limit: float = 1.0, flags: int = 0) -> Iterator[ServoMemory]:
    """Memory of a servo that is ready, and tells so of the operator and of its speed."""
    with create_servo_memory(name, PUMA.name, "qrobot", PUMA.n, HEADER.period_ns, 256) as memory:
        memory.front.info.ready = 1
        state = ServoMailbox(memory.words).memory.published.state
        state.override, state.speed_limit, state.flag_bits = override, speed_limit, flags
        yield memory


class OneMove:
    """What `record_running` needs of an arm and a plan whose moves are told to `moved`."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, between: Callable[[], None] = lambda: None) -> None:
        self.moved: list[int] = []

        def perform(_arm: object, _robot: object, _plan: object, told: MoveProgress, first: int) -> None:
            for number in range(first, first + 3):
                told(number, POSE)
                self.moved.append(number)
                between()

        monkeypatch.setattr("qrobot.cli.identify_record.perform", perform)
        for name in ("use", "control"):
            monkeypatch.setattr(f"qrobot.rccl.{name}", lambda *_: contextlib.nullcontext())
        monkeypatch.setattr("qrobot.cli.identify_record.link_of", lambda _arm: None)


@pytest.mark.parametrize(
    ("robot", "ready", "complaint"), [("stanford", 1, "the servo runs 'stanford'"), ("puma560", 0, "is not ready")]
)
def test_an_arm_that_would_not_be_recorded_makes_no_move(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, robot: str, ready: int, complaint: str
) -> None:
    name, arm = f"unready{os.getpid()}", OneMove(monkeypatch)
    deployment = choose_arm(str(write_deployment(tmp_path, name=name)), None)
    with create_servo_memory(name, robot, "qrobot", PUMA.n, HEADER.period_ns, 256) as memory:
        memory.front.info.ready = ready
        with pytest.raises(QRobotError, match=complaint):
            record_running(deployment, PUMA, PLAN, tmp_path / "run.mcap", 0)
    assert arm.moved == []


@pytest.mark.parametrize(
    ("told", "remedy"),
    [
        ({"override": 0.1}, "qrobot ctl override 100"),
        ({"flags": int(RobotFlag.PAUSED)}, "qrobot ctl resume"),
        ({"speed_limit": 0.06}, "without reduced speed"),
    ],
)
def test_an_arm_that_would_move_too_slowly_to_tell_anything_makes_no_move(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, told: dict[str, Any], remedy: str
) -> None:
    arm, name = OneMove(monkeypatch), f"slow{os.getpid()}"
    monkeypatch.setattr("qrobot.cli.log.recorded_header", lambda *_: REAL)
    deployment = choose_arm(str(write_deployment(tmp_path, name=name)), None)
    with ready_servo(name, **told), pytest.raises(MotionError, match=remedy):
        record_running(deployment, PUMA, PLAN, tmp_path / "run.mcap", 0)
    assert arm.moved == []
    assert not (tmp_path / "run.mcap").exists()


def test_a_recorder_that_has_ended_ends_the_moves_and_says_with_which_to_go_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    name, has_ended = f"ended{os.getpid()}", lambda: "recorder" not in [each.name for each in threading.enumerate()]
    arm = OneMove(monkeypatch, between=lambda: wait_until(has_ended, "the recorder has ended"))

    def die(follower: ServoFollower, _stop: threading.Event) -> None:
        follower.close()
        raise LogError("an old part cannot be removed")

    monkeypatch.setattr("qrobot.log.follow.follow", die)
    monkeypatch.setattr("qrobot.cli.log.recorded_header", lambda *_: REAL)
    deployment = choose_arm(str(write_deployment(tmp_path, name=name)), None)
    with (
        ready_servo(name),
        pytest.raises(LogError, match="nothing is recorded any more: an old part cannot be removed"),
    ):
        record_running(deployment, PUMA, PLAN, tmp_path / "run.mcap", 4)
    assert arm.moved in ([], [4])


def test_a_recording_begins_where_the_command_did(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def wait_and_close(follower: ServoFollower, stop: threading.Event) -> None:
        assert stop.wait(PATIENCE_S)
        follower.close()

    monkeypatch.setattr("qrobot.log.follow.follow", wait_and_close)
    monkeypatch.setattr("qrobot.cli.log.recorded_header", lambda *_: REAL)
    name, layout = f"begun{os.getpid()}", TelemetryLayout(PUMA.n)
    deployment = choose_arm(str(write_deployment(tmp_path, name=name)), None)
    with ready_servo(name) as memory:
        base = servo_info(memory.words).telemetry_base

        def run(first: int, last: int) -> None:
            for row in cycles(first, last).view(np.int64).reshape(-1, layout.row_words):
                append_row(memory.words, base, 256, layout.row_words, row)

        run(0, 100)
        with _recording(deployment, PUMA, tmp_path / "run.mcap") as recorder:
            recorder.begin()
            run(100, 150)
        with (
            pytest.raises(LogError, match="wrote no cycle"),
            _recording(deployment, PUMA, tmp_path / "none.mcap") as recorder,
        ):
            recorder.begin()
    assert read_log(tmp_path / "run.mcap").rows["tick"].tolist() == list(range(100, 150))


def test_a_recording_is_not_written_over(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    arm, earlier = OneMove(monkeypatch), write_log(tmp_path / "run.mcap", cycles(0, 300), REAL)[0]
    name, before = f"kept{os.getpid()}", earlier.read_bytes()
    deployment = choose_arm(str(write_deployment(tmp_path, name=name)), None)
    with ready_servo(name), pytest.raises(ConfigError, match=r"run\.mcap: it is a recording already"):
        record_running(deployment, PUMA, PLAN, earlier, 0)
    assert arm.moved == []
    assert earlier.read_bytes() == before


def test_an_arm_that_somebody_else_commands_leaves_no_log(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(_arm: object) -> None:
        raise LinkBusy("commanded by program 3")

    OneMove(monkeypatch)
    monkeypatch.setattr("qrobot.rccl.control", refuse)
    monkeypatch.setattr("qrobot.cli.log.recorded_header", lambda *_: REAL)
    name = f"busy{os.getpid()}"
    deployment = choose_arm(str(write_deployment(tmp_path, name=name)), None)
    with ready_servo(name), pytest.raises(LinkBusy):
        record_running(deployment, PUMA, PLAN, tmp_path / "run.mcap", 0)
    assert not (tmp_path / "run.mcap").exists()


@pytest.mark.parametrize("told", [[0.0, 0.0, 0.0], [0.0, 2.0, 1.0], [np.nan, 0.5, np.nan]])
def test_a_load_that_was_told_while_an_arm_was_recorded_is_known(tmp_path: Path, told: list[float]) -> None:
    rows = TelemetryLayout(PUMA.n).empty(3)
    rows["payload"][:, 0] = told
    log = write_log(tmp_path / "run.mcap", rows, HEADER)[0]
    assert IdentificationTask((log,), FitOptions()).told_kg == np.nanmax(told)


SHORTER = replace(HEADER, robot_digest="0123456789abcdef")


@pytest.mark.parametrize(
    ("other", "complaint"),
    [
        (replace(HEADER, robot="stanford"), "is of robot 'stanford', not 'puma560'"),
        (replace(HEADER, joint_names=HEADER.joint_names[::-1]), "is of joints flange, wrist_bend"),
        (SHORTER, "whose robot file has another geometry or transmission"),
        (replace(HEADER, period_ns=2_000_000), "is of rate 500 Hz, not 1000"),
        (replace(HEADER, arm="right"), "is of arm 'right', not 'left' as"),
        (replace(HEADER, plant="mismatched"), r"is of an emulated arm \(plant 'mismatched'\), not a real arm as"),
    ],
)
def test_logs_that_do_not_belong_together_are_told_apart(other: LogHeader, complaint: str, tmp_path: Path) -> None:
    """Of one fit, and as its fast runs or its runs with a load."""
    rows = TelemetryLayout(PUMA.n).empty(3)
    first = write_log(tmp_path / "slow.mcap", rows, HEADER)[0]
    second = write_log(tmp_path / "fast.mcap", rows, other)[0]
    for logs, like in (([first, second], None), ([second], HEADER)):
        with pytest.raises(LogError, match=complaint):
            read_rows(logs, like)


def test_a_log_of_before_there_were_digests_is_read_and_one_of_another_geometry_is_not_fitted(tmp_path: Path) -> None:
    rows = TelemetryLayout(PUMA.n).empty(3)
    old = write_log(tmp_path / "old.mcap", rows, replace(HEADER, robot_digest=""))[0]
    other = write_log(tmp_path / "other.mcap", rows, SHORTER)[0]
    with pytest.raises(IdentificationError, match="nothing recorded moves steadily"):
        IdentificationTask((old,), FitOptions()).identified()
    with pytest.raises(ConfigError, match="are not those that the logs were recorded with"):
        IdentificationTask((other,), FitOptions()).identified()


def test_a_recording_names_the_law_of_a_file_without_its_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "soft.py").write_text("")
    arm = choose_arm("emulator", None)
    arm = arm.model_copy(update={"servo": arm.servo.model_copy(update={"law": f"{tmp_path}/soft.py:spring"})})
    monkeypatch.setattr("qrobot.rig.identify.record_lockstep", lambda *_: TelemetryLayout(6).empty(3))
    record_emulated(arm, PUMA, PLAN, tmp_path / "run.mcap", "nominal", 0, 0.0)
    assert read_log(tmp_path / "run.mcap").header.law == "soft.py:spring"
