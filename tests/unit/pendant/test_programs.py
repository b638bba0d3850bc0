"""Programs at the pendant: which there are, what is started for them, and what their errors are about."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest

from qrobot.errors import ConfigError, MotionError
from qrobot.pendant import program_runner
from qrobot.pendant.output_tail import OutputTail
from qrobot.pendant.program_folder import MOST_LETTERS, ProgramFolder, stamp_of
from qrobot.pendant.program_messages import PageProgramStart, RunManner
from qrobot.pendant.program_runner import NICE, ProgramRunner

VAL = ".PROGRAM main\n  READY\n.END\n.program Other.one()\n.END\n"
PLACE = ["--deployment", "arms.toml", "--arm", "puma"]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    programs = tmp_path / "programs"
    (programs / "sub" / "deep").mkdir(parents=True)
    (tmp_path / "secret.py").write_text("secret")
    for name in ("a.py", "sub/b.c", ".hidden.py", "notes.txt", "sub/deep/c.py"):
        (programs / name).write_text(f"# {name}")
    (programs / "v.v2").write_text(VAL)
    (programs / "out.py").symlink_to(tmp_path / "secret.py")
    return programs


class FakeRun:
    """A run that never starts a process."""

    def __init__(
        self, commands: Any, _changed: Callable[[], None], niceness: int, lines: Sequence[str], variables: Any
    ) -> None:
        self.commands, self.niceness, self.lines, self.variables = commands, niceness, lines, variables
        self.output, self.state, self.told = OutputTail(), "running", ""
        self.calls: list[str] = []

    def __getattr__(self, name: str) -> Any:
        return lambda *arguments: self.calls.append(" ".join([name, *map(str, arguments)]))


@pytest.fixture
def runner(folder: Path, monkeypatch: pytest.MonkeyPatch) -> ProgramRunner:
    monkeypatch.setattr(program_runner, "CommandRun", FakeRun)
    return ProgramRunner("puma", ProgramFolder(folder), "arms.toml")


def started(
    runner: ProgramRunner,
    name: str,
    manner: str = "offline",
    bridges: Sequence[str] = (),
    place: str = "",
    **more: Any,
) -> Any:
    """What is run for a page that shows the program as it is."""
    asked = {"name": name, "manner": manner, "stamp": stamp_of(runner.folder.path_of(name)), **more}
    runner.start(PageProgramStart(do="program start", arm=0, **asked), bridges, place)
    return runner._run


def test_programs_of_the_folder_are_listed_and_a_page_reaches_no_other_file(folder: Path) -> None:
    programs = ProgramFolder(folder)
    assert [(each["name"], each["language"], each["parts"]) for each in programs.listing()] == [
        ("a.py", "Python", []), ("sub/b.c", "C", []), ("v.v2", "VAL", ["main", "other.one"]),
    ]  # fmt: skip
    assert programs.source("sub/b.c") == "# sub/b.c"
    no_names = "é" * 200 + ".py", "a.py\0", "a\ud800.py"
    others = "../secret.py", "out.py", str(folder / "a.py"), "sub/../a.py", "notes.txt", ".hidden.py", "./a.py"
    for name in (*others, *no_names):
        with pytest.raises(ConfigError, match="there is no program"):
            programs.source(name)
    assert ProgramFolder(None).listing() == []
    (folder / "empty").mkdir()
    for path in (folder / "none", folder / "a.py", folder / "empty", Path("/")):
        with pytest.raises(ConfigError, match="--programs"):
            ProgramFolder(path)


def test_recordings_of_the_arm_are_listed_newest_first_and_are_replayed(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    logs = tmp_path / "logs"
    logs.mkdir()
    for age, name in enumerate(("puma-led-1.csv", "puma-led.csv", "puma-led-x.csv", "other-led.csv", "puma-led.mcap")):
        (logs / name).write_text("")
        os.utime(logs / name, (1000 - age, 1000 - age))
    programs = ProgramFolder(folder, logs, "puma-led")
    assert [(each["name"], each["language"]) for each in programs.listing()][:3] == [
        ("recorded/puma-led-1.csv", "recording"), ("recorded/puma-led.csv", "recording"), ("a.py", "Python"),
    ]  # fmt: skip
    assert ProgramFolder(None, tmp_path / "no such folder", "puma-led").listing() == []
    monkeypatch.setattr(program_runner, "CommandRun", FakeRun)
    runner = ProgramRunner("puma", programs, "arms.toml")
    played = ["replay", str(logs / "puma-led.csv"), *PLACE]
    for manner, moves in (("offline", []), ("lockstep", ["--lockstep", "--approach"]), ("live", ["--approach"])):
        run = started(runner, "recorded/puma-led.csv", manner)
        assert [command[: len(played)] for command in run.commands] == [played] * len(run.commands)
        assert run.commands[0][len(played)] == "--save-as"
        assert [command[len(played) :] for command in run.commands[1:]] == ([moves] if moves else [])
        assert runner.live == (manner == "live")
        run.state = "done"
    with pytest.raises(MotionError, match="only programs of VAL"):
        started(runner, "recorded/puma-led.csv", step=True)
    for name in ("recorded/other-led.csv", "recorded/../a.py", "recorded/sub/puma-led.csv", "recorded/puma-led-9.csv"):
        with pytest.raises(ConfigError, match="there is no program"):
            programs.source(name)
    runner.close()


def test_a_program_is_found_without_a_look_through_its_folder(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The pendant's loop, which takes stops, starts it: a folder of very many files must not hold that up."""
    programs = ProgramFolder(folder, folder, "puma-led")
    (folder / "puma-led.csv").write_text("")

    def walk(*_: object) -> None:
        raise AssertionError("the folder was walked through")

    for way in ("glob", "rglob", "iterdir"):
        monkeypatch.setattr(Path, way, walk)
    assert programs.path_of("sub/b.c") == folder / "sub/b.c"
    assert programs.path_of("recorded/puma-led.csv") == folder / "puma-led.csv"
    with pytest.raises(ConfigError, match="there is no program"):
        programs.path_of("nothing.py")


@pytest.mark.parametrize(
    "refused",
    [{"step": True}, {"name": "sub/b.c", "step": True}, {"manner": "live", "stamp": "another"}, {"name": "v.v2"}],
    ids=["stepped", "stepped in C", "not as shown", "no room"],
)
def test_the_newest_run_and_its_results_stay_when_the_next_one_is_refused(
    runner: ProgramRunner, monkeypatch: pytest.MonkeyPatch, refused: dict[str, Any]
) -> None:
    def full(prefix: str) -> str:
        raise OSError(28, "No space left on device", prefix)

    run = started(runner, "a.py")
    (Path(run.commands[0][run.commands[0].index("--output") + 1]) / "setpoints.csv").write_text("0,0\n")
    run.state = "done"
    facts, result = runner.facts, runner.result("setpoints")
    if refused == {"name": "v.v2"}:
        monkeypatch.setattr(program_runner, "mkdtemp", full)
    with pytest.raises((MotionError, OSError)):
        started(runner, **{"name": "a.py", **refused})
    assert runner.facts == facts
    assert facts["path"] == facts["run"]
    assert runner.result("setpoints") == result
    assert result is not None
    runner.close()


def test_each_language_is_run_by_its_command_and_what_moves_no_arm_gives_way(
    runner: ProgramRunner, folder: Path
) -> None:
    run = started(runner, "a.py")
    results = run.commands[0][run.commands[0].index("--output") + 1]
    assert run.commands == [["run", *PLACE, "--offline", "--output", results, str(folder / "a.py")]]
    assert run.niceness == NICE
    with pytest.raises(MotionError, match="end it first"):
        started(runner, "a.py")
    assert not runner.live
    runner.stop()
    assert run.calls == []
    run.state = "done"
    run = started(runner, "sub/b.c", "live")
    assert not Path(results).exists()
    results = run.commands[1][run.commands[1].index("--output") + 1]
    assert run.commands[0] == ["cc", str(folder / "sub/b.c"), "-o", f"{results}/b"]
    assert run.commands[1] == ["run", *PLACE, "--output", results, f"{results}/b"]
    assert run.niceness == 0
    assert runner.live
    assert run.variables == {}
    runner.stop()
    assert run.calls == ["end"]
    run.state = "ended"
    run = started(runner, "a.py", "live", bridges=[":5600", ":5602"])
    assert run.variables == {"QROBOT_BRIDGE": ":5600", "QROBOT_ONLY_BRIDGES": ":5600,:5602"}
    run.state = "ended"
    run = started(runner, "v.v2", "lockstep", execute="other.one", speed=20)
    assert run.commands[0][:7] == ["val", "run", str(folder / "v.v2"), "--execute", "other.one", "--speed", "20"]
    run.state = "ended"
    run = started(runner, "v.v2", step=True)
    assert run.commands == [["val", "--load", str(folder / "v.v2"), *PLACE, "--offline"]]
    assert run.lines == ["SPEED 50", "XSTEP main"]
    runner.say("NEXT")
    runner.interrupt()
    assert run.calls == ["say NEXT", "interrupt"]
    assert runner.output(0)["lines"] == ["> NEXT"]
    run.state = "failed"
    with pytest.raises(MotionError, match="only programs of VAL"):
        started(runner, "a.py", step=True)
    runner.close()


def test_the_path_ahead_is_what_the_newest_run_of_the_same_source_found_that_moved_no_arm(
    runner: ProgramRunner, folder: Path
) -> None:
    def path() -> tuple[int, str | None]:
        known = runner.path_ahead
        return runner.facts["path"], None if known is None else known.read_text()

    def finish(run: Any, state: str = "done", found: str = "") -> None:
        if found:
            Path(run.commands[-1][run.commands[-1].index("--output") + 1], "setpoints.csv").write_text(found)
        run.state = state

    run = started(runner, "a.py")
    finish(run, "running", "half of it")
    assert path() == (0, None)  # not whole yet
    finish(run, "done", "off line")
    assert path() == (1, "off line")
    run = started(runner, "a.py", "live")
    assert path() == (1, "off line")
    finish(run, "ended", "as it went")
    assert path() == (0, None)  # nothing is ahead
    run = started(runner, "a.py", "live")
    assert path() == (1, "off line")  # once more
    finish(run)
    (folder / "a.py").write_text("# changed")
    os.utime(folder / "a.py", ns=(1, 1))
    run = started(runner, "a.py", "live")
    assert path() == (0, None)
    finish(run)
    finish(started(runner, "v.v2", "lockstep", execute="main"), "done", "main")
    assert path() == (5, "main")
    run = started(runner, "v.v2", "live", execute="other.one")
    assert path() == (0, None)
    finish(run)
    run = started(runner, "v.v2", "live", execute="main")
    assert path() == (0, None)  # it was dropped by the run of another program
    finish(run)
    finish(started(runner, "a.py"), "failed", "up to the mistake")
    assert path() == (0, None)
    finish(started(runner, "a.py", "live"))
    assert path() == (0, None)
    runner.close()


def test_a_file_of_blank_lines_is_looked_through_in_no_time(runner: ProgramRunner, folder: Path) -> None:
    """The pendant does that, and a stop would wait: for minutes, where each line looks at all the rest."""
    (folder / "v.v2").write_text("\n" * (MOST_LETTERS - 100) + "  .program  last\n.END\n")
    assert runner.folder.listing()[-1]["parts"] == ["last"]


def test_a_program_that_is_not_as_the_page_shows_it_moves_no_arm(runner: ProgramRunner, folder: Path) -> None:
    def stamp() -> str:
        return str(next(each["stamp"] for each in runner.folder.listing() if each["name"] == "v.v2"))

    seen = stamp()
    started(runner, "v.v2", "live", stamp=seen).state = "done"
    assert runner.facts["stamp"] == seen
    (folder / "v.v2").write_text(f"{VAL}.PROGRAM third\n.END\n")
    os.utime(folder / "v.v2", ns=(1, 1))
    for shown in (seen, ""):  # as it was, and not yet
        with pytest.raises(MotionError, match="not as the page shows it"):
            started(runner, "v.v2", "live", stamp=shown)
    assert runner.facts["stamp"] == seen  # that of the run that was
    started(runner, "v.v2", "offline", stamp=seen).state = "done"  # nothing moves
    assert runner.facts["stamp"] == stamp() != seen
    assert runner.folder.listing()[-1]["parts"] == ["main", "other.one", "third"]
    started(runner, "v.v2", "live", stamp=stamp()).state = "done"
    (folder / "v.v2").unlink()
    assert "v.v2" not in [each["name"] for each in runner.folder.listing()]
    assert stamp_of(folder / "v.v2") == ""
    runner.close()


def test_what_moves_no_arm_begins_where_the_arm_stands(runner: ProgramRunner) -> None:
    def begun(manner: RunManner) -> Any:
        run = started(runner, "a.py", manner, place="1,-2,3")
        run.state = "done"
        return run.commands[0]

    assert "--start=1,-2,3" in begun("offline")
    assert "--start=1,-2,3" in begun("lockstep")
    assert not any(each.startswith("--start") for each in begun("live"))
    runner.close()


@pytest.mark.parametrize(
    ("name", "said", "line"),
    [
        ("a.py", ['  File "/x/a.py", line 7, in <module>', '  File "/x/a.py", line 3, in go', "ZeroDivisionError"], 3),
        ("a.py", ["qrobot: P is out of reach (/x/a.py, line 12)"], 12),
        ("a.py", ["qrobot: there is no arm; data.py, line 9"], None),
        ("sub/b.c", ["/x/sub/b.c:4:2: error: 'p' undeclared", "/x/sub/b.c:9:1: error: more"], 4),
        ("v.v2", ["v.v2, line 2, column 3: there is no step READDY"], 2),
    ],
)
def test_the_line_that_an_error_is_about_is_found(
    runner: ProgramRunner, name: str, said: list[str], line: int | None
) -> None:
    run = started(runner, name)
    assert "line" not in runner.facts or runner.facts["line"] is None
    for text in said:
        run.output.note(text)
    run.state = "failed"
    assert runner.facts["line"] == line
    runner.close()
