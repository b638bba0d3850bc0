"""Recordings: every access once and in order, readable after any end, and a check of whoever repeats it."""

from __future__ import annotations

import contextlib
import dataclasses
import fcntl
import os
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from qrobot.arrays import Words
from qrobot.errors import LinkLost, LocalProtocolError, LogError, QRobotError
from qrobot.hwif.bus import BoardFacts, Operations, for_the_transport
from qrobot.hwif.image import IMAGE_COUNT, IMAGE_INPUTS, make_image
from qrobot.hwif.operations import OP_FIELDS, OP_OUTPUTS, OP_READ, OP_REFERENCE, OP_WRITE
from qrobot.hwif.recorder import MAGIC, BusRecorder
from qrobot.hwif.registers import ADC_MUX, ADC_START, DAC, DISCRETE, ENC_COUNT, ENC_LOAD
from qrobot.hwif.replay import Exchange, Replay, load_recording, replay_onto
from tests.support.bench import Bench
from tests.support.bus import BenchEndpoint, DirectBus
from tests.support.thorough import examples

Access = tuple[int, int, int]

# What a driver does: load counters, arm the indexes, convert, move.
SESSION: list[list[Access]] = [
    [],
    [(OP_WRITE, ENC_LOAD + 2 * joint, 1000 * joint) for joint in range(6)],
    [(OP_WRITE, DISCRETE, 0), (OP_WRITE, DISCRETE, 0x3F00)],
    [(OP_WRITE, ADC_MUX, 3), (OP_READ, ADC_START, 0)],
    [],
    [(OP_WRITE, DAC, 0x7FF)],
]


def rows(accesses: list[Access]) -> np.ndarray[tuple[int, int], np.dtype[np.int64]]:
    return np.array(accesses, np.int64).reshape(-1, OP_FIELDS)


def record(path: Path, cut_after: int | None = None) -> list[np.ndarray[tuple[int], np.dtype[np.int64]]]:
    """Record SESSION on a bench whose first shaft turns; returns the images."""
    bus, images = DirectBus(BenchEndpoint(Bench(revision_f=False))), []
    with BusRecorder(bus, path) as recorder:
        recorder.connect()
        for number, accesses in enumerate(SESSION):
            bus.cut = number == cut_after
            bus.endpoint.bench.shaft[0] += 7.0  # type: ignore[attr-defined]
            image = make_image()
            try:
                recorder.exchange(rows(accesses), image)
            except LinkLost:
                recorder.close()
                bus.cut = False
                recorder.connect()
            images.append(image)
    return images


def test_a_recording_gives_back_every_access_and_every_image(tmp_path: Path) -> None:
    images = record(tmp_path / "session.txt")
    recording = load_recording(tmp_path / "session.txt")
    assert not recording.torn
    assert [[tuple(map(int, row)) for row in each.operations] for each in recording.exchanges] == SESSION
    for each, image in zip(recording.exchanges, images, strict=True):
        assert each.image is not None
        np.testing.assert_array_equal(each.image, image)
    assert recording.accesses()["ENC_LOAD 3"] == 1
    assert recording.accesses()["DISCRETE"] == 2
    assert recording.duration_s == pytest.approx(5 * 250e-6)


def test_a_recording_stands_in_for_the_board(tmp_path: Path) -> None:
    images = record(tmp_path / "session.txt", cut_after=3)
    replay = Replay(load_recording(tmp_path / "session.txt"))
    assert replay.connect() == BoardFacts("E", 6)
    for number, accesses in enumerate(SESSION):
        image = make_image()
        if number == 3:
            with pytest.raises(LinkLost, match="the wire is cut"):
                replay.exchange(rows(accesses), image)
            replay.close()
            replay.connect()
        else:
            replay.exchange(rows(accesses), image)
        np.testing.assert_array_equal(image, images[number])
    assert replay.finished
    with pytest.raises(LocalProtocolError, match="ends here"):
        replay.exchange(rows([]), image)


@pytest.mark.parametrize(
    ("instead", "message"),
    [
        ([(OP_WRITE, DISCRETE, 0)], "line 5: access 2 was w2e=3f00, now it is nothing"),
        ([(OP_WRITE, DISCRETE, 0), (OP_WRITE, DISCRETE, 0x3E00)], "line 5: access 2 was w2e=3f00, now it is w2e=3e00"),
        ([(OP_WRITE, DISCRETE, 0x3F00), (OP_WRITE, DISCRETE, 0)], "line 5: access 1 was w2e=0, now it is w2e=3f00"),
        ([*SESSION[2], (OP_READ, ADC_START, 0)], "line 5: access 3 was nothing, now it is r1e"),
    ],
)
def test_the_first_access_that_differs_is_named(tmp_path: Path, instead: list[Access], message: str) -> None:
    record(tmp_path / "session.txt")
    replay, image = Replay(load_recording(tmp_path / "session.txt")), make_image()
    replay.connect()
    for accesses in SESSION[:2]:
        replay.exchange(rows(accesses), image)
    with pytest.raises(LocalProtocolError, match=message):
        replay.exchange(rows(instead), image)


def test_an_equal_board_answers_a_recording_equally_and_another_one_is_found_out(tmp_path: Path) -> None:
    class Turning(BenchEndpoint):
        def apply(self, operations: np.ndarray[tuple[int, int], np.dtype[np.int64]]) -> None:
            self.bench.shaft[0] += 7.0
            super().apply(operations)

    record(tmp_path / "session.txt")
    recording = load_recording(tmp_path / "session.txt")
    assert replay_onto(recording, DirectBus(Turning(Bench(revision_f=False)))) == ""
    assert "line 3: was 10=7, now it is 10=0" in replay_onto(recording, DirectBus(BenchEndpoint(Bench())))


def test_a_recording_cut_off_anywhere_is_complete_up_to_its_last_whole_line(tmp_path: Path) -> None:
    record(tmp_path / "session.txt")
    text = (tmp_path / "session.txt").read_text()
    whole = load_recording(tmp_path / "session.txt").exchanges
    for length in range(len(MAGIC) + 1, len(text)):
        torn = tmp_path / "torn.txt"
        torn.write_text(text[:length])
        recording = load_recording(torn)
        assert recording.torn == (text[length - 1] != "\n")
        for was, now in zip(whole, recording.exchanges, strict=False):
            np.testing.assert_array_equal(was.image, now.image)


@given(st.text(st.characters(max_codepoint=126), max_size=40), st.integers(0, 8))
@settings(max_examples=examples(200))
def test_a_line_that_means_nothing_is_named_and_nothing_else_is_raised(
    tmp_path_factory: pytest.TempPathFactory, garbage: str, place: int
) -> None:
    path = tmp_path_factory.getbasetemp() / "garbage.txt"
    lines = [MAGIC, "board F 6 0", "250000 1 w30=800 : 0c=1", "lost LinkLost: away", "close"]
    lines.insert(1 + place % len(lines), garbage)
    path.write_text("\n".join(lines) + "\n")
    with contextlib.suppress(LogError):
        events = load_recording(path).events
        assert all(isinstance(each, Exchange) or each.facts.revision in "EF" for each in events)


@pytest.mark.parametrize(
    "line",
    ["board G 6 0", "board F", "5 1", "5 1 w30 :", "5 1 x30=1 :", "5 1 : 20=1", "5 1 : 1=1", f"{9**30} 1 :", ""],
)
def test_the_line_that_is_wrong_is_named(tmp_path: Path, line: str) -> None:
    path = tmp_path / "wrong.txt"
    path.write_text(f"{MAGIC}\nboard F 6 0\n{line}\n")
    with pytest.raises(LogError, match=r"wrong\.txt, line 3: "):
        load_recording(path)


def test_what_is_no_recording_is_refused(tmp_path: Path) -> None:
    (tmp_path / "other.txt").write_bytes(b"\xff\xfe other\n")
    for name in ("other.txt", "missing.txt"):
        with pytest.raises(LogError):
            load_recording(tmp_path / name)
    (tmp_path / "old.txt").write_text("qrobot-registers 0\n")
    with pytest.raises(LogError, match="another version"):
        load_recording(tmp_path / "old.txt")
    with pytest.raises(LogError, match="cannot record"):
        BusRecorder(DirectBus(BenchEndpoint()), tmp_path / "no folder" / "session.txt")


def test_a_disk_that_takes_no_more_ends_the_recording_and_not_the_bus() -> None:
    bus = DirectBus(BenchEndpoint())
    recorder = BusRecorder(bus, Path("/dev/full"))
    image = make_image()
    recorder.connect()
    for _ in range(3):
        recorder.exchange(rows([]), image)
    recorder.finish()
    assert "No space left" in recorder.problem
    assert image[IMAGE_COUNT] > 0


def test_no_exchange_waits_for_a_disk_that_stands_still(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("qrobot.hwif.recorder.KEPT_LINES", 3)
    pipe, image = tmp_path / "disk", make_image()
    os.mkfifo(pipe)
    disk = os.open(pipe, os.O_RDWR)
    room = fcntl.fcntl(disk, fcntl.F_GETPIPE_SZ)
    os.write(disk, bytes(room))  # there is no room for a line
    recorder = BusRecorder(DirectBus(BenchEndpoint()), pipe)
    recorder.connect()
    for _ in range(4):  # one line of them the writer may have taken
        recorder.exchange(rows([]), image)
    assert recorder.problem == "the disk is slower than the bus"
    assert image[IMAGE_COUNT] > 0
    os.read(disk, room)
    recorder.finish()  # what was kept until then is on the disk
    written = os.read(disk, room).decode().splitlines()
    os.close(disk)
    assert written[0] == MAGIC
    assert 3 <= len(written) <= 4


def test_values_no_register_takes_are_recorded_as_they_were_asked(tmp_path: Path) -> None:
    odd: list[Access] = [(OP_WRITE, DAC, -5), (OP_WRITE, ENC_COUNT, 1 << 20)]
    with BusRecorder(DirectBus(BenchEndpoint()), tmp_path / "odd.txt") as recorder:
        recorder.connect()
        recorder.exchange(rows(odd), make_image())
    (exchange,) = load_recording(tmp_path / "odd.txt").exchanges
    assert [tuple(map(int, row)) for row in exchange.operations] == odd
    assert exchange.image is not None
    assert exchange.image[IMAGE_INPUTS:].max() < 1 << 16
    assert issubclass(LogError, QRobotError)


class ModulesBus(DirectBus):
    """A bus to a board with modules beside it, which are not there: outputs go nowhere."""

    def connect(self) -> BoardFacts:
        return dataclasses.replace(super().connect(), outputs=True)

    def exchange(self, operations: Operations, image: Words) -> None:
        super().exchange(for_the_transport(operations), image)


class ReferencesBus(DirectBus):
    """A bus to drives that close their own loop."""

    def connect(self) -> BoardFacts:
        return dataclasses.replace(super().connect(), references=True)


def test_references_are_recorded_as_such_and_with_them_that_the_board_takes_them(tmp_path: Path) -> None:
    path, done = tmp_path / "here.txt", rows([(OP_REFERENCE, 5, 0xFFFF8000), (OP_WRITE, DAC, 1)])
    with BusRecorder(ReferencesBus(BenchEndpoint()), path) as recorder:
        facts = recorder.connect()
        recorder.exchange(done, make_image())
    recording = load_recording(path)
    assert recording.accesses() == {"reference 6": 1, "DAC 1": 1}
    replay = Replay(recording)
    assert replay.connect() == facts
    replay.exchange(done, make_image())
    assert replay.finished


def test_outputs_are_recorded_and_played_onto_a_board_without_modules_they_are_left_out(tmp_path: Path) -> None:
    path, done = tmp_path / "here.txt", rows([(OP_OUTPUTS, 0, 5), (OP_WRITE, DAC, 1)])
    with BusRecorder(ModulesBus(BenchEndpoint()), path) as recorder:
        facts = recorder.connect()
        recorder.exchange(done, make_image())
    recording = load_recording(path)
    assert recording.accesses() == {"outputs": 1, "DAC 1": 1}
    replay = Replay(recording)
    assert replay.connect() == facts
    replay.exchange(done, make_image())
    end = BenchEndpoint()
    replay_onto(recording, DirectBus(end))
    assert end.applied == [(OP_WRITE, DAC, 1)]
