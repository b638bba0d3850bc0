"""Every option of every command, with values that cannot be: refused in one line, before anything has begun."""

from __future__ import annotations

import math
import re
import sys
import tempfile
import types
import typing
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal

import pytest
from cyclopts import App
from cyclopts.argument import Argument

from qrobot.cli.console import run_app
from qrobot.cli.main import make_app
from qrobot.cli.option_types import Range, require_new_log, require_writable_log
from qrobot.config import load_robot
from qrobot.log.header import LOCKSTEP, REALTIME, header_for
from qrobot.log.record import write_log
from qrobot.servo.memory.telemetry import TelemetryLayout
from tests.support.log_samples import make_rows

APP: Final = make_app()
READ: Final = {
    "--program",
    "--file",
    "--script",
    "--robot",
    "--a",
    "--b",
    "LOGS",
    "FILES",
    "--loaded",
    "--dynamic",
    "pendant --log",
    "--programs",
    "--then",
} | {
    "--previous",
    "--model",
    "--results",
    "--faults",
    "--load",
    "--with",
}
"""Paths that a command reads; by command and name where another command writes one of that name."""
GROWING: Final = {"board --record", "log record --output", "identify record --output"} | {
    f"{command} {option}"
    for command, option in (
        ("run", "--log"), ("val run", "--log"), ("study identify", "--output"), ("study gains", "--output")
    )
}  # fmt: skip
"""What is written piece by piece, into a file that may be there; others put a new one in its place."""
WORDS: Final[dict[str, tuple[str, ...]]] = {
    "--deployment": ("nowhere", "/", "/dev/null", "missing.toml", ""),
    "--arm": ("nobody", "", "../x"),
    "--law": ("nolaw", "", "missing.py", "missing.py:law", ":"),
    "--name": ("nolaw", "", "missing.py:law"),
    "--model": ("missing.toml", "/", "/dev/null"),
    "--robot": ("norobot", "/", "/dev/null", ""),
    "--set": ("x", "x=", "=1", "x=nan", "x=inf", "x=-inf", "x=one"),
    "--serve": ("x", "can=", "modbus=", "modbus=nohost", "modbus=127.0.0.1:70000", "modbus=127.0.0.1:0@nan", "usb=1"),
    "--fault": ("x", "encoder:9 stuck", "dac:1 gain nan", "encoder:1 stuck @-1s", "encoder:1 stuck @nans", ""),
    "LINES": ("x", "estop maybe", "input:9 on", "analog:1 nan", ""),
    "FAULTS": ("x", "encoder:9 stuck", "dac:1 gain nan", "encoder:1 stuck @-1s", ""),
    "--listen": ("x", "127.0.0.1", "127.0.0.1:70000", ":", "127.0.0.1:-1", ""),
    "--scheduler": ("x", "tcp://", "tcp://nohost.invalid:1"),
    "--velocity": ("novelocity", ""),
    "--center": ("x", "", "1,2", "1,2,nan", "1,2,3,4", "inf,0,0"),
    "--inertia": ("x", "", "1,2,3", "0,0,0,0,0,nan", "1,1,1,0,0,0,0"),
    "--date": ("nonsense", "2026-13-01", ""),
    "--plant": ("noplant", ""),
    "--execute": ("nobody", "", "/"),
    "--tip": ("nobody", ""),
    "--start": ("nowhere", "", "0,0,0", "0,0,0,0,0,nan", "999,0,0,0,0,0", "park"),  # the last one: no kind of run
    "--like": ("norobot", "/", "/dev/null", ""),
    "--frame": ("nobody", "", ":", "missing.db:TABLE", "/:TABLE"),
    "--stick": ("nowhere", "/", "/dev/null", ""),
}
"""What a word may not be, by option; `--plant` of `log record` is free text."""
FREE: Final = {("log", "record", "--plant"), ("cc", "ARGUMENTS"), ("run", "ARGUMENTS"), ("servo", "ctl", "WORDS")}
NUMBERS: Final = ("nan", "-1", "-inf", "1e400", "9" * 400, "x", "")
ENDLESS: Final = ("1e400", "9" * 400)
"""Allowed where a number has no upper bound."""
REQUIRED: Final = {
    "--mass": "1",
    "--state": "on",
    "--name": "pd",
    "--program": "p.py",
}


@dataclass(frozen=True)
class Option:
    """One option or argument of one command."""

    command: tuple[str, ...]
    argument: Argument
    others: tuple[Argument, ...]

    @property
    def name(self) -> str:
        return self.argument.name

    @property
    def kinds(self) -> set[Any]:
        return set(kinds_of(self.argument.hint))

    @property
    def ranges(self) -> list[Range]:
        return [each for each in as_tuple(self.argument.parameter.validator) if isinstance(each, Range)]

    @property
    def suffixes(self) -> list[str]:
        """Which a file must have, as help tells them."""
        return suffixes_of(self.argument)

    def tokens(self, value: str) -> list[str]:
        """The command with `value` for this option, and something for those that it needs besides."""
        needed = [each for each in self.others if each.required and each.name != self.name]
        words = [f"{each.name}={needed_value(each)}" for each in needed]
        own = [f"{self.name}={value}"] if self.name.startswith("--") else ["--", value]
        return [*self.command, *words, *own]

    def __str__(self) -> str:
        return " ".join((*self.command, self.name))


def suffixes_of(argument: Argument) -> list[str]:
    return re.findall(r"(?<!\w)\.[a-z]\w+", argument.parameter.help or "")


def needed_value(argument: Argument) -> str:
    if argument.name in REQUIRED:
        return REQUIRED[argument.name]
    return f"out{suffixes_of(argument)[0]}" if argument.name in ("--output", "--target") else "missing"


def as_tuple(value: Any) -> tuple[Any, ...]:
    return tuple(value) if isinstance(value, tuple | list) else (value,)


def kinds_of(hint: Any) -> Iterator[Any]:
    """The plain types in an annotation; of a Literal itself."""
    origin = typing.get_origin(hint)
    if origin in (typing.Union, types.UnionType, tuple, list):
        for part in typing.get_args(hint):
            yield from kinds_of(part)
    else:
        yield Literal if origin is Literal else hint


def all_options(app: App = APP, path: tuple[str, ...] = ()) -> Iterator[Option]:
    for name in (name for name in app if not name.startswith("-")):
        yield from all_options(app[name], (*path, name))
    if path and app.default_command is not None:
        arguments = [each for each in app.assemble_argument_collection(parse_docstring=True) if each.name != "*"]
        for argument in arguments:
            yield Option(path, argument, tuple(arguments))


def is_read(option: Option) -> bool:
    return option.name in READ or str(option) in READ


OPTIONS: Final = tuple(all_options())
NUMERIC: Final = tuple(option for option in OPTIONS if {int, float} & option.kinds)
PATHS: Final = tuple(option for option in OPTIONS if Path in option.kinds)
WRITTEN: Final = tuple(option for option in PATHS if not is_read(option))
OF_A_KIND: Final = tuple(option for option in WRITTEN if option.suffixes)
WHOLE: Final = tuple(option for option in WRITTEN if str(option) not in GROWING)
READ_PATHS: Final = tuple(option for option in PATHS if is_read(option))
WORDED: Final = tuple(
    option for option in OPTIONS if str in option.kinds and (*option.command, option.name) not in FREE
)


@pytest.fixture(autouse=True)
def empty_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Commands run in a folder of their own; nothing may be in it afterwards that was not before."""
    folder = tmp_path / "here"
    folder.mkdir()
    monkeypatch.chdir(folder)
    monkeypatch.setattr("qrobot.study.engine.PATIENCE_S", 0.1)
    monkeypatch.setattr("qrobot.rci.tcp.ANSWER_TIMEOUT_S", 0.1)
    yield folder
    assert list(folder.iterdir()) == []


def refused(capsys: pytest.CaptureFixture[str], tokens: list[str], *statuses: int) -> str:
    """What a command says that cannot be done: one line, with the status that belongs to it."""
    status = run_app(make_app(tokens[0]), tokens)
    captured = capsys.readouterr()
    complaint = captured.err.splitlines()[-1] if captured.err else ""
    assert status in statuses, (tokens, complaint)
    assert captured.out == ""
    assert re.match(r"(qrobot|SyntaxError): \S", complaint), tokens
    return complaint


def test_there_are_options_of_every_kind() -> None:
    assert len(OPTIONS) > 100
    assert min(len(NUMERIC), len(WRITTEN), len(OF_A_KIND), len(READ_PATHS), len(WORDED)) > 10


@pytest.mark.parametrize("option", NUMERIC, ids=str)
def test_every_number_has_a_range(option: Option) -> None:
    assert option.ranges


@pytest.mark.sampled(24)
@pytest.mark.parametrize("option", NUMERIC, ids=str)
def test_a_number_that_cannot_be_is_refused_with_what_is_allowed(
    capsys: pytest.CaptureFixture[str], option: Option
) -> None:
    (allowed,) = option.ranges
    for value in set(NUMBERS) - set(ENDLESS if allowed.most == math.inf else ()):
        complaint = refused(capsys, option.tokens(value), 2)
        assert str(allowed) in complaint or "unable to convert" in complaint
        assert complaint.endswith(f"(see `qrobot {' '.join(option.command)} --help`)")


@pytest.mark.parametrize("option", WRITTEN, ids=str)
def test_every_path_that_is_written_is_checked(option: Option) -> None:
    assert [each for each in as_tuple(option.argument.parameter.validator) if each is not None]


@pytest.mark.sampled(17)
@pytest.mark.parametrize("option", WRITTEN, ids=str)
def test_what_cannot_be_written_is_refused(capsys: pytest.CaptureFixture[str], tmp_path: Path, option: Option) -> None:
    (tmp_path / "file").touch()
    suffix = next(iter(option.suffixes), ".mcap")
    for place in (tmp_path / "file" / f"x{suffix}", Path(f"/proc/nowhere/x{suffix}"), tmp_path / ("n" * 300 + suffix)):
        assert f"cannot write {place}: " in refused(capsys, option.tokens(str(place)), 2)


def refuse_folder(**_: object) -> None:
    raise PermissionError(13, "Permission denied")


@pytest.mark.parametrize("option", WHOLE, ids=str)
def test_a_file_is_refused_in_whose_folder_there_can_be_no_other_to_take_its_place(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, option: Option
) -> None:
    place, probe = tmp_path / f"x{next(iter(option.suffixes), '')}", tempfile.TemporaryFile
    place.touch()
    monkeypatch.setattr("tempfile.TemporaryFile", lambda dir: refuse_folder() if dir == tmp_path else probe(dir=dir))
    assert f"cannot write {place}: " in refused(capsys, option.tokens(str(place)), 2)
    assert place.read_bytes() == b""


@pytest.mark.sampled(11)
@pytest.mark.parametrize("option", OF_A_KIND, ids=str)
def test_a_file_of_another_kind_is_not_written_over(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, option: Option
) -> None:
    for name in ("parts.db", "run.mcap", "cell.toml", "README", "lesson.csv"):
        (tmp_path / name).write_text("somebody's work")
        if Path(name).suffix not in option.suffixes:
            assert f"cannot write {tmp_path / name}: " in refused(capsys, option.tokens(str(tmp_path / name)), 2)
            assert (tmp_path / name).read_text() == "somebody's work"


SHARED = {".toml", ".txt", ".xml"}  # suffixes of several kinds of file


@pytest.mark.parametrize("option", [each for each in OF_A_KIND if SHARED & set(each.suffixes)], ids=str)
@pytest.mark.parametrize("text", ["somebody's work", "[[arm]]\nname = 'left'\n", "[tool.ruff]\n", "<launch/>", "\0\1"])
def test_a_file_of_another_kind_and_the_same_suffix_is_not_written_over(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, option: Option, text: str
) -> None:
    path = tmp_path / f"cell{next(iter(option.suffixes))}"
    path.write_text(text)
    complaint = " ".join(refused(capsys, option.tokens(str(path)), 2).split())
    assert f"cannot write {path}: it is" in complaint
    assert "name another file" in complaint
    assert path.read_text() == text


@pytest.mark.parametrize(
    "words", [["run", "--lockstep", "p.py", "--log"], ["identify", "record", "--lockstep", "--output"]]
)
def test_the_recording_of_a_running_arm_is_not_written_over(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, words: list[str]
) -> None:
    robot = load_robot("puma560")
    rows = TelemetryLayout(robot.n).empty(3)
    for clock in (REALTIME, LOCKSTEP):
        path = write_log(tmp_path / f"{clock}.mcap", rows, header_for(robot, 1_000_000, "qrobot", clock))[0]
        before = path.read_bytes()
        if clock == REALTIME:
            told = " ".join(refused(capsys, [*words, str(path)], 2).split())
            assert "it is the recording of a running arm, name another file" in told
        else:
            require_writable_log(path)  # it can be made again
        assert path.read_bytes() == before
    header = header_for(robot, 1_000_000, "qrobot", REALTIME)
    parts = write_log(tmp_path / "parted.mcap", make_rows(20_000), header, max_bytes=300_000)
    for gone in parts[:-1]:  # removed, one after the other
        gone.unlink()
        with pytest.raises(ValueError, match="the recording of a running arm"):
            require_writable_log(parts[0])
        with pytest.raises(ValueError, match="it is a recording already"):
            require_new_log(parts[0])
    parts[-1].unlink()
    write_log(tmp_path / "parted.2026.mcap", rows, header)  # another log, of that year
    require_new_log(parts[0])
    (tmp_path / "damaged.mcap").write_bytes(before[:200])
    with pytest.raises(ValueError, match="name another file"):
        require_writable_log(tmp_path / "damaged.mcap")


@pytest.mark.parametrize("option", [each for each in OF_A_KIND if ".parquet" in each.suffixes], ids=str)
def test_a_table_for_which_a_library_is_missing_is_refused(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, option: Option
) -> None:
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    assert "pip install 'qrobot[logs]'" in refused(capsys, option.tokens(str(tmp_path / "t.parquet")), 2)


@pytest.mark.parametrize(
    "words",
    [
        ["run", "--offline", "{folder}/p.py"],
        ["log", "record"],
        ["up"],
        ["demo", "--lockstep"],
        ["log", "plot", "x.mcap"],
    ],
    ids=lambda words: " ".join(words[:2]),
)
def test_a_folder_that_nobody_named_is_checked_too(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: list[str]
) -> None:
    (tmp_path / "p.py").write_text("raise SystemExit('it began')\n")
    monkeypatch.setattr("tempfile.TemporaryFile", refuse_folder)
    monkeypatch.setattr("qrobot.rig.deployed.bridge_ready", lambda *_: False)
    complaint = refused(capsys, [word.format(folder=tmp_path) for word in words], 1, 2)
    assert "cannot write" in complaint
    assert "Permission denied" in complaint


@pytest.mark.sampled(18)
@pytest.mark.parametrize("option", READ_PATHS, ids=str)
def test_a_path_that_leads_nowhere_is_refused(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, option: Option
) -> None:
    rubbish = tmp_path / "rubbish.mcap"
    rubbish.write_bytes(bytes(range(256)) * 8)
    empty = ["/dev/null"] if option.name != "--script" else []  # a script without a command is one
    for value in ("missing", "/", *empty, str(rubbish), str(rubbish / "x"), "n" * 300, ""):
        refused(capsys, option.tokens(value), 1, 2)


@pytest.mark.parametrize("option", WORDED, ids=str)
def test_every_word_has_something_that_it_may_not_be(option: Option) -> None:
    assert option.name in WORDS


@pytest.mark.sampled(45)
@pytest.mark.parametrize("option", WORDED, ids=str)
def test_a_word_that_cannot_be_is_refused(capsys: pytest.CaptureFixture[str], option: Option) -> None:
    for value in WORDS[option.name]:
        refused(capsys, option.tokens(value), 1, 2)


@pytest.mark.parametrize("words", [["--center", "-0.02,0,0.05"], ["--inertia", "0.1,0.1,0.1,-0.01,0,0"]])
def test_a_list_may_begin_with_a_negative_number(capsys: pytest.CaptureFixture[str], words: list[str]) -> None:
    assert run_app(make_app(), ["ctl", "payload", "--mass", "1", *words]) == 1
    assert "no servo of" in capsys.readouterr().err
