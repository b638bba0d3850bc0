"""The command line: what it prints, where, and with which exit status."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import pytest
from cyclopts import App

from qrobot.cli.console import run_app, write_json
from qrobot.cli.main import COMMANDS, make_app
from qrobot.errors import ConfigError
from tests.support.patience import PATIENCE_S

COLUMNS = 80
HEAVY = ("numpy", "numba", "mujoco", "matplotlib", "pydantic", "foxglove", "pyarrow")


def python(code: str, **environment: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", code]
    return subprocess.run(
        command, capture_output=True, text=True, check=False, timeout=PATIENCE_S, env={**os.environ, **environment}
    )


def test_help_names_every_command_and_imports_nothing_heavy() -> None:
    found = python(
        "import sys; from qrobot.cli.main import make_app; from qrobot.cli.console import run_app\n"
        "status = run_app(make_app(), ['--help'])\n"
        f"print([name for name in {HEAVY} if name in sys.modules], file=sys.stderr); sys.exit(status)"
    )
    assert found.returncode == 0
    assert found.stderr.strip() == "[]"
    for command in COMMANDS:
        assert f"{command.name} " in found.stdout
        assert command.help in found.stdout


@pytest.mark.parametrize(
    ("tokens", "words"),
    [(["bord"], "no command 'bord'; did you mean 'board'?"), (["xyzzy"], "no command 'xyzzy'; there are: demo, up")],
)
def test_an_unknown_command_is_one_line_with_a_proposal_and_status_2(
    tokens: list[str], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_app(make_app(), tokens) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.startswith(f"qrobot: {words}")
    assert captured.err.count("\n") == 1


@pytest.mark.parametrize("command", [command.name for command in COMMANDS])
def test_the_command_asked_for_shows_its_own_longer_help_in_whole_lines(
    command: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", str(COLUMNS))
    assert run_app(make_app(command), [command, "--help"]) == 0
    long = capsys.readouterr().out
    assert run_app(make_app(), [command, "--help"]) == 0
    assert len(long) >= len(capsys.readouterr().out)
    assert broken_lines(long.partition("╭")[0].splitlines()) == []


def broken_lines(lines: list[str]) -> list[str]:
    """Lines that end before the terminal does though the sentence goes on, and indented ones that it breaks."""
    indented = [
        line for line, after in pairwise(lines) if line.startswith("  ") and after.strip() and not after.startswith(" ")
    ]
    early = [
        line
        for line, after in pairwise(lines)
        if line.strip() and after.strip() and not (line + after).startswith("  ")
        if len(line.rstrip()) + 1 + len(after.split()[0]) <= COLUMNS
    ]
    return indented + early


def test_help_names_no_option_that_asks_for_what_is_so_anyway(capsys: pytest.CaptureFixture[str]) -> None:
    assert run_app(make_app("run"), ["run", "--help"]) == 0
    told = capsys.readouterr().out
    assert "--lockstep" in told
    assert [
        noise for noise in ("--no-", "--empty-", "default: False", "default: None", "default: ()") if noise in told
    ] == []


def test_a_command_is_imported_without_a_look_for_garbage_and_then_garbage_is_looked_for_again() -> None:
    found = python(
        "import gc, sys; from qrobot.cli.main import import_command\n"
        "looks = lambda: sum(generation['collections'] for generation in gc.get_stats())\n"
        "before = looks(); import_command('servo'); looked = looks() - before\n"
        "print('numba' in sys.modules, looked, gc.isenabled(), gc.get_freeze_count() > len(sys.modules))"
    )
    assert found.stdout.split() == ["True", "0", "True", "True"], found.stderr


def test_an_operators_command_waits_for_no_compiler() -> None:
    commands = (
        "ctl",
        "run",
        "jog",
        "teach",
        "guide",
        "up",
        "log",
        "calibrate",
        "inject",
        "pendant",
        "cc",
        "val",
        "replay",
    )
    found = python(
        "import sys; from qrobot.cli.main import import_command\n"
        f"for name in {commands}: import_command(name)\n"
        f"print([name for name in {HEAVY} if name in sys.modules])"
    )
    assert found.stdout.strip() == "['numpy', 'pydantic']", found.stderr


def test_a_program_that_draws_nothing_waits_for_no_library_that_draws() -> None:
    found = python(
        "import sys; from qrobot.cli.main import import_command; import_command('run')\n"
        "import qrobot.cli.run_film, qrobot.cli.run_lockstep, qrobot.cli.traced; print('matplotlib' in sys.modules)"
    )
    assert found.stdout.split() == ["False"], found.stderr


INTERRUPTED_IN_A_TEXT = """
import sys
from cyclopts import App
from qrobot.cli.console import run_app

def command():
    exec("raise KeyboardInterrupt")  # as it may come while a dataclass is made

app = App(name="interrupted")
app.default(command)
sys.exit(run_app(app, []))
"""


def test_an_interrupt_ends_a_command_by_its_status_wherever_it_comes(tmp_path: Path) -> None:
    (tmp_path / "interrupted.py").write_text(INTERRUPTED_IN_A_TEXT)
    done = subprocess.run([sys.executable, "-m", "interrupted"], cwd=tmp_path, check=False, timeout=PATIENCE_S)
    assert done.returncode == 130


def test_servo_ctl_is_another_name_of_ctl(capsys: pytest.CaptureFixture[str]) -> None:
    assert run_app(make_app("servo"), ["servo", "ctl", "--help"]) == 0
    assert "calibrate" in capsys.readouterr().out
    assert run_app(make_app("servo"), ["servo", "ctl", "status", "--deployment", "nowhere"]) == 1
    assert capsys.readouterr().err.startswith("qrobot: no configuration named 'nowhere'")
    assert run_app(make_app("servo"), ["servo", "ctl", "dance"]) == 2


@pytest.fixture
def app() -> App:
    app = App(name="qrobot", version="1")

    @app.command
    def fail(message: str) -> None:
        raise ConfigError(message)

    @app.command
    def end(status: int) -> int:
        return status

    @app.command
    def interrupt() -> None:
        raise KeyboardInterrupt

    @app.command
    def interrupt_of_a_library() -> None:  # as pybind11 tells it, of a module that loads another one
        inner = ImportError("initialization failed")
        inner.__cause__ = KeyboardInterrupt()
        raise ImportError("initialization failed") from inner

    @app.command
    def load() -> None:
        raise ImportError("undefined symbol")

    @app.command
    def slip() -> None:
        raise ZeroDivisionError

    return app


def test_an_error_of_ours_is_one_line_on_stderr_and_status_1(app: App, capsys: pytest.CaptureFixture[str]) -> None:
    assert run_app(app, ["fail", "no arm [red]x[/red]:\n  'elbow'"]) == 1
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err == "qrobot: no arm [red]x[/red]: 'elbow'\n"


@pytest.mark.parametrize("status", [0, 1, 7])
def test_the_status_is_what_the_command_returns(app: App, status: int) -> None:
    assert run_app(app, ["end", str(status)]) == status


@pytest.mark.parametrize("tokens", [["end"], ["end", "soon"], ["end", "1", "2"], ["end", "--loud", "1"]])
def test_wrong_usage_is_one_line_and_status_2(app: App, tokens: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert run_app(app, tokens) == 2
    error = capsys.readouterr().err
    assert error.startswith("qrobot: ")
    assert error.count("\n") == 1


@pytest.mark.parametrize("command", ["interrupt", "interrupt-of-a-library"])
def test_ctrl_c_ends_with_130_and_no_traceback(app: App, command: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run_app(app, [command]) == 130
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize(("command", "mistake"), [("slip", ZeroDivisionError), ("load", ImportError)])
def test_a_mistake_of_the_program_keeps_its_traceback(app: App, command: str, mistake: type[Exception]) -> None:
    with pytest.raises(mistake):
        run_app(app, [command])


@pytest.mark.parametrize("say", ["print", "out.print"])
def test_a_reader_that_has_had_enough_is_no_error(say: str) -> None:
    code = (
        "import sys; from qrobot.cli.main import *; from qrobot.cli.console import out, run_app\n"
        "from cyclopts import App\napp = App()\n"
        f"@app.default\ndef talk() -> None:\n    for i in range(100000): {say}(i)\n"
        "sys.exit(run_app(app, []))"
    )
    piped = f"{sys.executable} -c '{code}' | head -1; exit ${{PIPESTATUS[0]}}"
    found = subprocess.run(["bash", "-c", piped], capture_output=True, text=True, check=False, timeout=PATIENCE_S)
    assert (found.returncode, found.stdout, found.stderr) == (0, "0\n", "")


def test_a_disk_that_takes_no_more_of_the_output_is_one_line() -> None:
    command = [sys.executable, "-m", "qrobot", "robot", "list"]
    with Path("/dev/full").open("w") as full:
        found = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert (found.returncode, found.stderr) == (1, "qrobot: what it writes is not taken: No space left on device\n")


@pytest.mark.parametrize(("words", "status"), [(["board", "--nope"], 2), (["robot", "show", "nosuch"], 1)])
def test_one_that_takes_no_more_messages_changes_no_exit_status(words: list[str], status: int) -> None:
    with Path("/dev/full").open("w") as full:
        assert subprocess.run([sys.executable, "-m", "qrobot", *words], stderr=full, check=False).returncode == status


def test_nor_does_it_end_what_goes_on() -> None:
    code = (
        "import sys; from qrobot.cli.console import note, run_app, write_json\n"
        "from cyclopts import App\napp = App()\n"
        "@app.default\ndef talk() -> None:\n    for i in range(3): note(str(i))\n    write_json([1])\n"
        "sys.exit(run_app(app, []))"
    )
    with Path("/dev/full").open("w") as full:
        found = subprocess.run([sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=full, check=False)
    assert (found.returncode, found.stdout.split()) == (0, [b"[", b"1", b"]"])


def test_nor_does_one_of_messages_take_results_along() -> None:
    code = (
        "import sys; from qrobot.cli.console import note, run_app, write_json\n"
        "from cyclopts import App\napp = App()\n"
        "@app.default\ndef talk() -> None:\n    for i in range(20000): note(str(i))\n    write_json([1])\n"
        "sys.exit(run_app(app, []))"
    )
    piped = f"{{ {sys.executable} -c '{code}' 2>&1 >&3 | head -1; exit ${{PIPESTATUS[0]}}; }} 3>&1"
    found = subprocess.run(["bash", "-c", piped], capture_output=True, text=True, check=False, timeout=PATIENCE_S)
    assert (found.returncode, found.stderr) == (0, "")
    assert found.stdout.split() == ["0", "[", "1", "]"]


def test_json_goes_to_stdout_or_to_a_file_whose_directory_is_made(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    value = {"rate_hz": 1000.0, "names": ["[a]", "b" * 300, "laws.py:on:x", ":a: a:b:c"]}
    write_json(value)
    assert json.loads(capsys.readouterr().out) == value
    write_json(value, tmp_path / "deep" / "x.json")
    assert json.loads((tmp_path / "deep" / "x.json").read_text()) == value
