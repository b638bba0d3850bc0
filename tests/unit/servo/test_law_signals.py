"""Numbers that a law tells: in every row, by name in the log, and in its tables."""

from __future__ import annotations

import threading
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from qrobot.config import load_robot
from qrobot.errors import ConfigError
from qrobot.log import law_message
from qrobot.log.export import table_columns
from qrobot.log.plot import figures_of
from qrobot.log.read import read_log
from qrobot.log.record import write_log
from qrobot.log.summary import sensed
from qrobot.servo.laws.law import KP, KV, SIGNALS_AT, Law, Setting, law
from qrobot.servo.laws.shipped import find_law
from qrobot.servo.laws.trial_process import tried_law
from qrobot.servo.memory.law_history import JournalReader, LawInForce, journal_words, write_entry
from qrobot.wire.vocabulary import LONGEST_SIGNAL, N_SIGNALS
from tests.support.log_samples import make_header, make_rows
from tests.support.servo_bench import ServoBench

LAW = LawInForce(0, 0, "told", "", (1.0,) * 6, (2.0,) * 6, (3.0,) * 6, "power count")


@law(settings=(Setting("step", 1.0, 0.0, 9.0, "-", "of the count"),), signals=("count", "pull"))
def counting(q_ref, v_ref, q, v, gains, gravity, friction, settings, memory, tau):
    """PD that counts its cycles and tells the torque of joint 2."""
    for j in range(tau.size):
        tau[j] = gains[KP, j] * (q_ref[j] - q[j]) + gains[KV, j] * (v_ref[j] - v[j]) + gravity[j] + friction[j]
    memory[SIGNALS_AT] += settings[0]
    memory[SIGNALS_AT + 1] = tau[1]


def test_what_a_law_leaves_at_the_end_of_its_memory_is_in_every_row() -> None:
    bench = ServoBench(law=counting.with_settings({"step": 2.0})).hold()
    bench.run(0.05)
    signals = bench.rows()["signals"][-40:]
    np.testing.assert_array_equal(np.diff(signals[:, 0]), 2.0)
    np.testing.assert_array_equal(signals[:, 1], bench.rows()["tau"][-40:, 1])
    assert not signals[:, 2:].any()


def test_chosen_settings_leave_the_names_as_they_are() -> None:
    assert counting.with_settings({"step": 2.0}).signals == ("count", "pull")
    assert find_law("force", load_robot("puma560"), {"force": 5.0}).signals == ("pressed", "advance", "correction")


def test_a_law_in_a_file_brings_its_names_along(tmp_path: Path) -> None:
    page = (Path(__file__).parents[3] / "docs/how-to/write-a-control-law.md").read_text()
    code = page.split("<!-- file: my_signals.py -->\n```python\n")[1].split("```")[0]
    (tmp_path / "my_signals.py").write_text(code)
    taken = tried_law(f"{tmp_path}/my_signals.py:metered", load_robot("puma560"), {}, 1_000_000, threading.Event())
    assert taken.signals == ("power",)


@pytest.mark.parametrize(
    "names",
    [
        ("a", "a"), ("two words",), ("",), ("a" * (LONGEST_SIGNAL + 1),), ("größe",), ("a;b",),
        tuple(f"s{k}" for k in range(N_SIGNALS + 1)),
    ],
)  # fmt: skip
def test_names_that_no_table_could_have_are_refused(names: tuple[str, ...]) -> None:
    with pytest.raises(ConfigError, match="signal"):
        Law(counting.body, signals=names)


def test_the_longest_names_fit_into_the_journal() -> None:
    words = np.zeros(16 + journal_words(6), dtype=np.int64)
    reader = JournalReader(words, 16, 6)
    longest = replace(LAW, signals=" ".join(str(k) * LONGEST_SIGNAL for k in range(N_SIGNALS)))
    write_entry(words, 16, longest)
    assert list(reader.read()) == [longest]


def test_names_go_with_the_log_into_tables_figures_and_facts(tmp_path: Path) -> None:
    rows = make_rows(50)
    rows["signals"][:, 0], rows["signals"][:, 1] = np.arange(50), -1.5
    write_log(tmp_path / "run.mcap", rows, make_header(), laws=[LAW])
    log = read_log(tmp_path / "run.mcap")
    assert log.signal_names == ("power", "count")
    columns = table_columns(log)
    np.testing.assert_array_equal(columns["signals_power"], np.arange(50.0))
    assert [name for name in columns if name.startswith("signals_")][2:] == [f"signals_{k}" for k in range(3, 9)]
    assert "signals" in figures_of(log)
    assert sensed(log)[-2:] == ["power 0 to 49", "count -1.5 to -1.5"]


def test_laws_that_name_them_differently_leave_numbers(tmp_path: Path) -> None:
    other = replace(LAW, tick=20, t_ns=1, signals="")
    write_log(tmp_path / "run.mcap", make_rows(50), make_header(), laws=[LAW, other])
    log = read_log(tmp_path / "run.mcap")
    assert log.signal_names == ()
    assert "signals_1" in table_columns(log)


def test_a_law_of_a_log_of_before_has_no_signals() -> None:
    entry = replace(LAW, law="pd1", signals="")
    message = law_message.to_bytes(entry)
    before = message[:-8]  # three bytes of padding, the length of the names, and their closing zero
    assert law_message.from_bytes(before, 6) == law_message.from_bytes(message, 6) == entry
