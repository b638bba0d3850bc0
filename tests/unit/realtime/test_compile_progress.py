"""Who waits for a first start is told which kernel of how many, and a second process shares the work."""

from __future__ import annotations

import subprocess
from typing import Any

import pytest

from qrobot.cli.console import EveryTenth
from qrobot.realtime import compile_progress
from qrobot.realtime.compile_progress import SHORT, begin_entry, begin_kernel, end_part, tell_compiling
from qrobot.realtime.own_process import own_command
from qrobot.rig import compile_ahead
from qrobot.rig.compile_ahead import compiled_beside

Told = list[tuple[str, int, int]]


@pytest.fixture
def told(monkeypatch: pytest.MonkeyPatch) -> Told:
    monkeypatch.setattr(compile_progress, "_listeners", [])
    monkeypatch.setattr(compile_progress, "_Entry", type("_Entry", (), {"below": frozenset(), "waiting": set()}))
    heard: Told = []
    tell_compiling(lambda *words: heard.append(words))
    return heard


def names(number: int) -> set[str]:
    return {f"servo.stage_{each}" for each in range(number)}


def test_each_kernel_of_a_long_entry_is_told_with_its_number(told: Told) -> None:
    begin_entry(names(SHORT))
    for name in ("servo.stage_1", "servo.stage_0"):
        begin_kernel(name)
    assert told == [("servo.stage_1", 1, SHORT), ("servo.stage_0", 2, SHORT)]


def test_the_number_never_passes_how_many_there_are(told: Told) -> None:
    begin_entry(names(SHORT))
    for name in sorted(names(SHORT)) * 2:
        begin_kernel(name)
    begin_kernel("servo.of_other_types")
    assert [number for _, number, _ in told] == list(range(1, SHORT + 1))


def test_a_part_counts_within_the_program_whoever_compiled_it(told: Told) -> None:
    begin_entry(names(SHORT))
    begin_kernel("servo.stage_9")
    begin_entry(names(5))  # a part, compiled here
    begin_kernel("servo.stage_3")
    end_part(names(5))
    end_part(names(8))  # a part that another process compiled, which calls some of the same kernels
    assert [number for _, number, _ in told] == [1, 2, 6, 9]
    assert {of for *_, of in told} == {SHORT}


def test_of_a_short_entry_nothing_is_told(told: Told) -> None:
    begin_entry(names(SHORT - 1))
    begin_kernel("servo.stage_0")
    assert told == []


@pytest.mark.parametrize("of", [20, 57, 317])
def test_a_person_reads_about_ten_lines(of: int, capsys: pytest.CaptureFixture[str]) -> None:
    tell = EveryTenth()
    for number in range(1, of + 1):
        tell("servo.read", number, of)
    lines = capsys.readouterr().err.splitlines()
    assert 10 <= len(lines) <= 11
    assert lines[0] == f"compiling kernel 1 of {of}, once for this version on this machine: servo.read"


def test_a_tenth_that_another_process_did_is_told_too(capsys: pytest.CaptureFixture[str]) -> None:
    tell = EveryTenth()
    for number in (1, 2, 57, 58, 312, 1, 2):
        tell("servo.read", number, 312)
    said = [line.split(",")[0] for line in capsys.readouterr().err.splitlines()]
    assert said == [f"compiling kernel {number} of 312" for number in (1, 57, 312, 1)]


class Child:
    """A process that counts how often it is killed."""

    commands: list[list[str]]
    killed: int

    def __init__(self, command: list[str], **_: Any) -> None:
        Child.commands.append(command)

    def __enter__(self) -> Child:
        return self

    def __exit__(self, *_: object) -> None: ...

    def kill(self) -> None:
        Child.killed += 1


@pytest.fixture(autouse=True)
def children(monkeypatch: pytest.MonkeyPatch) -> type[Child]:
    Child.commands, Child.killed = [], 0
    monkeypatch.setattr(subprocess, "Popen", Child)
    return Child


def fail(children: type[Child]) -> None:
    with compiled_beside("puma560"):
        assert children.killed == 0
        raise ZeroDivisionError


def test_a_second_process_ends_with_the_block_even_when_that_fails(
    children: type[Child], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(compile_ahead, "is_compiled", lambda: False)
    with pytest.raises(ZeroDivisionError):
        fail(children)
    assert children.commands == [own_command("qrobot.rig.compile_ahead", "puma560")]
    assert children.killed == 1


def test_with_everything_compiled_no_process_is_started(children: type[Child], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(compile_ahead, "is_compiled", lambda: True)
    with compiled_beside("puma560"):
        pass
    assert children.commands == []
