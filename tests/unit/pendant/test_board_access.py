"""The board at the pendant: looked at as long as a page asks, worked only where it is emulated."""

from __future__ import annotations

import io
import json
import threading
from collections.abc import Sequence
from typing import Any

import pytest

from qrobot.config.can import CanTransport
from qrobot.config.deployment import BoardChoice, load_deployment
from qrobot.errors import MotionError
from qrobot.pendant import board_access
from qrobot.pendant.board_access import AGAIN_S, UNASKED_S, BoardAccess
from qrobot.pendant.output_tail import OutputTail
from tests.support.patience import MOMENT_S, PATIENCE_S, wait_until

ARM = load_deployment("emulator").arm[0]


class FakeProcess:
    """`qrobot board show` that prints these lines."""

    started: list[Sequence[str]]

    def __init__(self, command: Sequence[str], **_: Any) -> None:
        self.started.append(command)
        self.stdout = io.BytesIO("".join(f"{line}\n" for line in self.lines).encode())

    lines: Sequence[str] = ()

    def wait(self) -> int:
        return 0

    def terminate(self) -> None:
        self.started.append("terminated")


@pytest.fixture
def process(monkeypatch: pytest.MonkeyPatch) -> type[FakeProcess]:
    FakeProcess.started = []
    monkeypatch.setattr(board_access.subprocess, "Popen", FakeProcess)
    return FakeProcess


class Access(BoardAccess):
    def __init__(self, kind: str = "emulator") -> None:
        self.now_s, self.told = 100.0, list[str]()
        board = BoardChoice() if kind == "emulator" else BoardChoice(kind="can", can=CanTransport())
        super().__init__(ARM.model_copy(update={"board": board}), "arms.toml", self.told.append, lambda: self.now_s)

    def over(self) -> bool:
        return self._process is None


def test_pages_that_ask_at_once_begin_one_look(process: type[FakeProcess], monkeypatch: pytest.MonkeyPatch) -> None:
    access, began = Access(), threading.Barrier(2)
    begin = access._begin

    def slowly() -> None:
        second.start()
        began.wait()  # the other page asks meanwhile
        begin()

    def ask() -> None:
        began.wait()
        access.look(kinds=False)

    second = threading.Thread(target=ask)
    monkeypatch.setattr(access, "_begin", slowly)
    access.look(kinds=False)
    second.join()
    assert len([command for command in process.started if "show" in command]) == 1


def test_a_board_is_looked_at_when_a_page_asks_and_its_complaint_is_told(process: type[FakeProcess]) -> None:
    process.lines = [json.dumps({"kinds": [1]}), json.dumps({"count": 5}), "qrobot: the board of puma560 has gone"]
    access = Access()
    assert access.look(kinds=False)["emulated"]
    wait_until(access.over, "its lines are read")
    assert process.started[0][4:6] == ["board", "show"]
    seen = access.look(kinds=True)
    assert (seen["problem"], seen["board"], seen["kinds"]) == ("the board of puma560 has gone", None, [1])
    assert len(process.started) == 1
    access.now_s += AGAIN_S
    access.look(kinds=False)
    wait_until(access.over, "its lines are read")
    assert len(process.started) == 2


def test_the_process_ends_when_no_page_asks(process: type[FakeProcess], monkeypatch: pytest.MonkeyPatch) -> None:
    process.lines = [json.dumps({"count": 5})]
    access = Access()
    monkeypatch.setattr(access, "_take", lambda _: setattr(access, "now_s", access.now_s + UNASKED_S + 1.0))
    access.look(kinds=False)
    wait_until(access.over, "its lines are read")
    assert process.started[1:] == ["terminated"]


def test_an_emulated_board_is_worked_by_commands_and_a_real_one_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    ran: list[Sequence[str]] = []

    class FakeRun:
        def __init__(self, commands: Sequence[Sequence[str]], _changed: Any, _niceness: int) -> None:
            ran.extend(commands)
            self.output, self.told = OutputTail(), "failed"
            self.state = "failed" if "encoder:9 stuck" in commands[0] else "done"
            if self.state == "failed":
                self.output.note("qrobot: which joint?")

        def wait(self) -> None:
            pass

    monkeypatch.setattr(board_access, "CommandRun", FakeRun)
    access, place = Access(), ["--deployment", "arms.toml", "--arm", ARM.name]
    access.force("estop on")
    wait_until(lambda: access.told == ["estop on"], "told")
    access.inject("encoder:9 stuck")
    wait_until(lambda: access.told[1:] == ["not done: which joint?"], "told")
    access.repair()
    wait_until(lambda: access.told[2:] == ["everything is repaired"], "told")
    assert ran == [
        ["board", "force", "estop on", *place], ["inject", "encoder:9 stuck", *place], ["inject", "--clear", *place],
    ]  # fmt: skip
    real = Access("can")
    for act in (lambda: real.force("estop on"), lambda: real.inject("encoder:1 stuck"), real.repair):
        with pytest.raises(MotionError, match="a real one"):
            act()
    assert len(ran) == 3


class Works:
    """A command that works as soon as it is waited for; the first one only when another has overtaken it, or late."""

    late_s: float
    worked: list[str]
    ended: set[str]
    overtaken: threading.Event

    def __init__(self, commands: Sequence[Sequence[str]], _changed: Any, _niceness: int) -> None:
        self.line, self.output, self.state, self.told = commands[0][2], OutputTail(), "running", "it was ended"

    def wait(self) -> None:
        if self.line == "push:1 40":
            self.overtaken.wait(self.late_s)
        self.worked.append(self.line)
        self.overtaken.set()
        self.state = "done"

    def end(self) -> None:
        self.ended.add(self.line)
        self.overtaken.set()


@pytest.fixture
def works(monkeypatch: pytest.MonkeyPatch) -> type[Works]:
    Works.late_s, Works.worked, Works.ended, Works.overtaken = MOMENT_S, [], set(), threading.Event()
    monkeypatch.setattr(board_access, "CommandRun", Works)
    return Works


def test_the_panel_is_worked_in_the_order_of_its_buttons(works: type[Works]) -> None:
    access, lines = Access(), ["push:1 40", "push:1 0", "input:3 on", "input:3 off"]
    for line in lines:
        access.force(line)
    wait_until(lambda: len(access.told) == len(lines), "all are told")
    assert works.worked == access.told == lines


def test_a_panel_that_is_closed_ends_what_runs_and_begins_nothing(works: type[Works]) -> None:
    works.late_s = PATIENCE_S
    access = Access()
    access.force("push:1 40")
    access.force("push:1 0")
    wait_until(lambda: access._command, "the first one runs")
    access.close()
    wait_until(lambda: access.told, "it has ended")
    assert works.ended == {"push:1 40"}
    access._commands.shutdown()
    assert works.worked == ["push:1 40"]
