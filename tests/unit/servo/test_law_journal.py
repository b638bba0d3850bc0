"""Which law was in force: from the servo's journal through the recorder into the log, and out again as events."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader

from qrobot.cli.console import run_app
from qrobot.cli.main import make_app
from qrobot.faultcodes import FaultCode
from qrobot.log import law_message
from qrobot.log.compare import compare_logs
from qrobot.log.events import LogEvent, log_events
from qrobot.log.plot import MAX_MARKS, torques_figure
from qrobot.log.read import Log, read_log
from qrobot.log.record import LogRecorder, write_log
from qrobot.log.writer import LogWriter
from qrobot.modecodes import Mode
from qrobot.servo.memory.law_history import (
    ENTRIES,
    LAW_BYTES,
    SETTINGS_BYTES,
    JournalReader,
    LawInForce,
    journal_words,
    write_entry,
)
from qrobot.servo.memory.settings_text import settings_text
from tests.support.log_samples import PERIOD_NS, START_NS, Ring, make_header, make_rows

BASE = 16


def entry(tick: int, law: str = "qrobot", kp: float = 100.0, n: int = 6, settings: str = "") -> LawInForce:
    t_ns = START_NS + tick * PERIOD_NS if tick else 0
    return LawInForce(t_ns, tick, law, settings, (kp,) * n, (10.0,) * n, (1.5,) * n)


def memory(n: int = 6) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
    return np.zeros(BASE + journal_words(n), dtype=np.int64)


def logged(tmp_path: Path, *laws: LawInForce, first: int = 100, n_rows: int = 400) -> Log:
    write_log(tmp_path / "run.mcap", make_rows(n_rows, first=first), make_header(), laws=laws)
    return read_log(tmp_path / "run.mcap")


def told(log: Log) -> list[tuple[int, str]]:
    return [(event.tick, event.text) for event in log_events(log)]


@pytest.mark.parametrize("n", [1, 6, 32])
def test_entries_come_out_of_the_journal_once_and_as_they_went_in(n: int) -> None:
    words, entries = memory(n), [entry(0, "qrobot", n=n), entry(5, "é" * (LAW_BYTES // 2), 0.1, n, "softness=1")]
    reader = JournalReader(words, BASE, n)
    write_entry(words, BASE, entries[0])
    assert list(reader.read()) == entries[:1]
    write_entry(words, BASE, entries[1])
    assert list(reader.read()) == entries[1:]
    assert list(reader.read()) == []
    assert list(JournalReader(words, BASE, n).read()) == entries


def test_of_a_journal_that_ran_over_the_newest_entries_are_left() -> None:
    words = memory()
    slow = JournalReader(words, BASE, 6)
    for tick in range(ENTRIES + 9):
        write_entry(words, BASE, entry(tick))
    for reader in (slow, JournalReader(words, BASE, 6)):
        assert [law.tick for law in reader.read()] == list(range(10, ENTRIES + 9))


@pytest.mark.parametrize("law", ["pd", "qrobot+a", "lab/ä.py:soft", ""])
@pytest.mark.parametrize("n", [1, 9])
@pytest.mark.parametrize("settings", ["", "frequency=8 damping=1"])
def test_a_message_comes_back_bit_for_bit(law: str, n: int, settings: str) -> None:
    sent = entry(7, law, 1 / 3, n, settings)
    assert law_message.from_bytes(law_message.to_bytes(sent), n) == sent


def test_a_message_ends_with_strings_as_cdr_wants_them() -> None:
    message = law_message.to_bytes(entry(7, "pd", settings="a=1"))
    assert len(message) == 4 + 8 * (2 + 3 * 6) + (4 + 3) + 1 + (4 + 4) + (4 + 1) + 3 + (4 + 1)
    assert message[-29:-8] == b"\x03\0\0\0pd\0" + b"\0" + b"\x04\0\0\0a=1\0" + b"\x01\0\0\0\0"
    assert message[-8:] == b"\0\0\0" + b"\x01\0\0\0\0"


def test_settings_are_told_in_one_line_that_fits() -> None:
    assert settings_text({"frequency": 8.0, "damping": 0.7}) == "frequency=8 damping=0.7"
    assert settings_text({}) == ""
    assert len(settings_text({"é" * 400: 1.0, "b": 2.0}).encode()) <= SETTINGS_BYTES


def test_another_setting_of_the_same_law_is_an_event(tmp_path: Path) -> None:
    log = logged(tmp_path, entry(0), entry(200, "soft", settings="a=1"), entry(300, "soft", settings="a=2"))
    assert told(log) == [(200, "law qrobot -> soft (a=1)"), (300, "law soft (a=1) -> soft (a=2)")]


def test_the_recorder_writes_the_laws_down_and_a_log_never_begins_before_its_rows(tmp_path: Path) -> None:
    words, ring = memory(), Ring()
    recorder = LogRecorder(
        ring.reader(), LogWriter(tmp_path / "run.mcap", make_header()), JournalReader(words, BASE, 6)
    )
    write_entry(words, BASE, entry(0))
    recorder.poll(0)  # no row yet: nothing that could be said of it
    ring.append(make_rows(50, first=10))
    write_entry(words, BASE, entry(20, "pd"))
    recorder.poll(1)
    write_entry(words, BASE, entry(40, "pd", 50.0))
    recorder.close()
    assert read_log(tmp_path / "run.mcap").laws == (entry(0), entry(20, "pd"), entry(40, "pd", 50.0))
    with (tmp_path / "run.mcap").open("rb") as file:
        times = [message.log_time for _, _, message in make_reader(file).iter_messages(topics=["/servo/law"])]
    assert times == [START_NS + tick * PERIOD_NS for tick in (10, 20, 40)]


def test_a_change_of_law_and_one_of_gains_are_events_at_the_cycle_they_came(tmp_path: Path) -> None:
    log = logged(tmp_path, entry(0), entry(200, "pd"), entry(300, "pd", 50.0), entry(400, "pd", 50.0))
    gains = " ".join(["100"] * 6) + " -> " + " ".join(["50"] * 6)
    assert told(log) == [(200, "law qrobot -> pd"), (300, f"Kp {gains}"), (400, "law pd anew")]
    assert [event.line.split(":")[0] for event in log_events(log)] == ["0.025 s", "0.050 s", "0.075 s"]
    assert log.law_names == ("qrobot", "pd")


def test_what_a_log_begun_late_calls_its_law_is_the_one_of_its_first_row(tmp_path: Path) -> None:
    log = logged(tmp_path, entry(0), entry(50, "pd"), entry(90, "qrobot+a"), entry(200, "pd"))
    assert log.header.law == "qrobot+a"  # the header of this one told nothing
    assert log.laws == (entry(90, "qrobot+a"), entry(200, "pd"))
    assert told(log) == [(200, "law qrobot+a -> pd")]
    for tick, law in ((100, "qrobot+a"), (199, "qrobot+a"), (200, "pd"), (10_000, "pd")):
        found = log.maybe_law_at(tick)
        assert found is not None
        assert found.law == law


def test_a_log_without_a_journal_still_has_the_law_of_its_header(tmp_path: Path) -> None:
    write_log(tmp_path / "old.mcap", make_rows(5), replace(make_header(), law="pd"))
    log = read_log(tmp_path / "old.mcap")
    assert (log.law_names, log.laws, log.maybe_law_at(3)) == (("pd",), (), None)


def test_modes_and_faults_are_events_in_the_order_of_cause_and_effect() -> None:
    log = Log(Path("run.mcap"), make_header(), make_rows(100), laws=(entry(0), entry(60, "pd")))
    log.rows["mode"][60:] = Mode.STOPPING
    log.rows["mode"][80:] = Mode.HOLDING
    log.rows["fault"][60:70], log.rows["event_joint"][60:70] = FaultCode.FOLLOWING, 2
    log.rows["fault"][90:] = 9999
    events = log_events(log)
    assert [(event.tick, event.kind, event.short) for event in events] == [
        (60, "law", "pd"),
        (60, "fault", "FOLLOWING"),
        (60, "mode", "STOPPING"),
        (80, "mode", "HOLDING"),
        (90, "fault", "fault 9999"),
    ]
    assert events[1].text.startswith("joint 3: FOLLOWING: ")
    assert events[4].text.startswith("fault 9999")
    assert events[2].line == "0.015 s: TRACKING -> STOPPING"


def test_a_log_without_rows_has_no_events() -> None:
    assert log_events(Log(Path("run.mcap"), make_header(), make_rows(0), laws=(entry(0), entry(60, "pd")))) == []


def test_figures_mark_laws_and_faults_by_name_and_of_very_many_the_first() -> None:
    log = Log(Path("run.mcap"), make_header(), make_rows(1000), laws=(entry(0), entry(400, "pd")))
    log.rows["fault"][700:] = FaultCode.FOLLOWING
    texts = [text.get_text() for text in torques_figure(log).axes[0].texts]
    assert {"pd", "FOLLOWING"} <= set(texts)
    log.rows["fault"][::2] = FaultCode.FOLLOWING
    texts = [text.get_text() for text in torques_figure(log).axes[0].texts]
    assert texts.count("FOLLOWING") == MAX_MARKS


def test_a_comparison_names_laws_that_changed_and_gains_that_differ(tmp_path: Path) -> None:
    one = Log(Path("a"), make_header(), make_rows(100), laws=(entry(0),))
    other = replace(one, laws=(entry(0, kp=50.0), entry(60, "pd", 50.0)))
    one, other = (replace(log, header=replace(log.header, law="qrobot")) for log in (one, other))
    differences = {d.what: (d.a, d.b) for d in compare_logs(one, other).differences}
    assert differences == {"law": ("qrobot", "qrobot, then pd"), "Kp": ((100.0,) * 6, (50.0,) * 6)}


@pytest.mark.parametrize("json_wanted", [False, True])
def test_the_command_lists_events_and_info_shows_the_first(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], json_wanted: bool
) -> None:
    logged(tmp_path, *(entry(100 + 10 * k, ("qrobot", "pd")[k % 2]) for k in range(26)))
    flags = ["--json"] if json_wanted else []
    assert run_app(make_app(), ["log", "events", str(tmp_path / "run.mcap"), *flags]) == 0
    printed = capsys.readouterr().out
    lines = [event["line"] for event in json.loads(printed)] if json_wanted else printed.splitlines()
    assert len(lines) == 25
    assert lines[0] == "0.003 s: law qrobot -> pd"
    assert run_app(make_app(), ["log", "info", str(tmp_path / "run.mcap"), *flags]) == 0
    printed = capsys.readouterr().out
    if json_wanted:
        assert len(json.loads(printed)["events"]) == 25
    else:
        assert "and 5 more: qrobot log events" in " ".join(printed.split())


def test_an_event_for_scripts_has_its_line_too() -> None:
    event = LogEvent(12.3456, 7, "law", "pd", "law qrobot -> pd")
    assert event.to_dict() == {
        "t_s": 12.3456, "tick": 7, "kind": "law", "short": "pd", "text": "law qrobot -> pd",
        "line": "12.346 s: law qrobot -> pd",
    }  # fmt: skip
