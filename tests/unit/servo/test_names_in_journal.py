"""Names of a program's numbers, and a law that came back: from the servo's main thread into the log, when it was so."""

from __future__ import annotations

import threading
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest

from qrobot.errors import LinkError, LinkTimeout, QRobotError
from qrobot.log.events import log_events
from qrobot.log.read import Log, read_log
from qrobot.log.record import write_log
from qrobot.servo.laws.law import Law, Setting
from qrobot.servo.laws.law_swap import NOT_NOW, SwapState, fall_back
from qrobot.servo.laws.shipped import find_law
from qrobot.servo.memory.law_history import JournalReader
from qrobot.servo.memory.mailbox import ServoMailbox
from qrobot.servo.memory.servo_memory import journal_base
from qrobot.servo.operator import law_changes
from qrobot.servo.operator.law_changes import LawChanges
from qrobot.servo.operator.messages import ChangeGains, ChangeLaw
from tests.support.log_samples import make_header
from tests.support.puma import ROBOT
from tests.support.servo_bench import ServoBench


@dataclass
class Servo:
    """A servo on the bench, as far as `LawChanges` touches it."""

    bench: ServoBench = field(default_factory=lambda: ServoBench(law=find_law("qrobot", ROBOT)).tick(5))
    law: Law = field(default_factory=lambda: find_law("qrobot", ROBOT))
    law_name: str = "qrobot"
    said: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.robot, self.settings, self.mailbox = ROBOT, self.bench.settings, self.bench.mailbox
        self.swap: SwapState = self.bench.state.swap
        self.changes = LawChanges(cast(Any, self))

    def say(self, message: str) -> None:
        self.said.append(message)

    def name(self, *names: str) -> int:
        """Name numbers, as the bridge does; the tick from which the log has them."""
        self.mailbox.name_signals(names)
        self.changes.note_fallback()
        tick = self.mailbox.snapshot().tick
        self.bench.tick(10)
        return tick

    def logged(self, folder: Path) -> Log:
        journal = JournalReader(self.mailbox.words, journal_base(ROBOT.n), ROBOT.n)
        write_log(folder / "run.mcap", self.bench.rows(), make_header(), laws=journal.read())
        return read_log(folder / "run.mcap")


@pytest.fixture
def servo(monkeypatch: pytest.MonkeyPatch) -> Servo:
    servo = Servo()
    monkeypatch.setattr(law_changes, "await_loop", lambda _: servo.bench.tick(1))
    return servo


@pytest.mark.parametrize(
    ("namings", "names"),
    [
        ([("force",), ()], ("force",)),
        ([("force",), (), ("force",), ()], ("force",)),
        ([("depth",), ("depth", "parts"), ()], ("depth", "parts")),
        ([("force",), (), ("height",)], ()),
        ([("depth",), ("depth", "parts"), ("force", "parts")], ()),
        ([], ()),
    ],
)
def test_a_log_has_the_names_on_which_its_programs_agree_also_once_they_have_gone(
    servo: Servo, tmp_path: Path, namings: list[tuple[str, ...]], names: tuple[str, ...]
) -> None:
    ticks = [servo.name(*each) for each in namings]
    log = servo.logged(tmp_path)
    assert log.program_signal_names == names
    for tick, each in zip(ticks, namings, strict=True):
        entry = log.maybe_law_at(tick)
        assert entry is not None
        assert (entry.tick, entry.program_signals.split()) == (tick, list(each))
        assert entry.t_ns == log.rows["t_ns"][log.rows["tick"] == tick][0]
    assert [event for event in log_events(log) if event.kind in ("law", "gains")] == []


def test_names_are_noted_once_and_those_of_a_swap_with_it(servo: Servo, tmp_path: Path) -> None:
    servo.name("force")
    servo.changes.note_fallback()
    servo.name("force")
    assert len(servo.logged(tmp_path).laws) == 2
    servo.mailbox.name_signals(("height",))
    servo.changes.change_gains(ChangeGains(kv=tuple(servo.robot.control.kv)))
    servo.changes.note_fallback()
    log = servo.logged(tmp_path)
    assert [entry.program_signals for entry in log.laws] == ["", "force", "height", "height"]
    assert [event.text for event in log_events(log) if event.kind == "law"] == ["law qrobot anew"]


def stands_still(_condition: object) -> None:
    raise LinkTimeout("the servo's loop does not run")


def test_a_law_that_a_standing_loop_takes_when_it_goes_on_is_told_as_that(
    servo: Servo, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(law_changes, "await_loop", stands_still)
    with pytest.raises(LinkTimeout, match="does not run; should it go on, it takes law pd"):
        servo.changes.change_law(ChangeLaw(name="pd"), threading.Event())
    for _ in range(2):  # what the loop may be reading is not written over
        with pytest.raises(LinkTimeout, match=r"does not run$"):
            servo.changes.change_gains(ChangeGains(kv=tuple(servo.robot.control.kv)))
    assert servo.law_name == "qrobot"
    servo.bench.tick(10)
    servo.changes.note_fallback()
    assert servo.said == ["taken late, for the loop did not run: law pd"]
    assert servo.law_name == "pd"
    log = servo.logged(tmp_path)
    assert [event.text for event in log_events(log) if event.kind == "law"] == ["law qrobot -> pd"]


def test_gains_that_a_standing_loop_takes_late_are_those_that_later_changes_begin_with(
    servo: Servo, monkeypatch: pytest.MonkeyPatch
) -> None:
    kv = tuple(1.25 * each for each in servo.robot.control.kv)
    with monkeypatch.context() as patch:
        patch.setattr(law_changes, "await_loop", stands_still)
        with pytest.raises(LinkTimeout):
            servo.changes.change_gains(ChangeGains(kv=kv))
    servo.changes.change_gains(ChangeGains(kp=tuple(servo.robot.control.kp)))
    np.testing.assert_array_equal(servo.swap.gains[1], kv)
    assert servo.said[0] == "taken late, for the loop did not run: other gains of law qrobot"


def test_a_law_that_failed_is_told_for_the_cycles_it_was_in_force(servo: Servo, tmp_path: Path) -> None:
    servo.changes._swap(find_law("pd", ROBOT), "pd", servo.bench.state.swap.gains.copy())
    failing = servo.mailbox.snapshot().tick
    servo.bench.tick(10)
    fall_back(servo.swap)
    servo.changes.note_fallback()
    back = servo.mailbox.snapshot().tick
    servo.bench.tick(10)
    log = servo.logged(tmp_path)
    laws = [log.maybe_law_at(tick) for tick in (failing - 2, failing, back - 1, back)]
    assert [law.law for law in laws if law is not None] == ["qrobot", "pd", "pd", "qrobot"]
    assert [event.text for event in log_events(log) if event.kind == "law"] == ["law qrobot -> pd", "law pd -> qrobot"]
    assert servo.said[-1] == "law qrobot is in force again: the one after it has failed"


def test_gains_after_a_clear_are_those_of_the_law_that_is_back_also_where_nobody_has_noticed_yet(servo: Servo) -> None:
    servo.changes._swap(find_law("pd", ROBOT), "pd", servo.bench.state.swap.gains.copy())
    fall_back(servo.swap)
    servo.changes.change_gains(ChangeGains(kv=tuple(servo.robot.control.kv)))
    assert (servo.law_name, servo.swap.law_at) == ("qrobot", find_law("qrobot", ROBOT).address)


def test_settings_of_a_soft_law_that_failed_are_not_given_to_the_law_that_is_back(
    servo: Servo, monkeypatch: pytest.MonkeyPatch
) -> None:
    back, body = servo.law, find_law("pd", ROBOT).body
    soft = Law(body, (Setting("softness", 1.0, 0.0, 2.0, "", "how soft"),), compliant=True)
    monkeypatch.setattr(law_changes, "tried_law", lambda _name, _robot, chosen, *_: soft.with_settings(chosen))
    servo.changes._swap(soft, "soft", servo.bench.state.swap.gains.copy())
    fall_back(servo.swap)
    servo.changes.change_law(ChangeLaw(name="soft", settings={"softness": 2.0}), threading.Event())
    assert "law qrobot is in force again: the one after it has failed" in servo.said
    assert (servo.law_name, servo.swap.law_at, servo.swap.settings[0]) == ("soft", soft.address, 2.0)
    fall_back(servo.swap)
    assert (servo.swap.law_at, list(servo.swap.settings)) == (back.address, list(back.values))


def test_a_law_is_not_told_as_one_that_is_back_while_it_is_being_taken(
    servo: Servo, monkeypatch: pytest.MonkeyPatch
) -> None:
    def look_beside_the_swap(_done: object) -> None:
        servo.bench.tick(1)
        servo.changes.note_fallback()

    monkeypatch.setattr(law_changes, "await_loop", look_beside_the_swap)
    monkeypatch.setattr(law_changes, "tried_law", lambda *_: find_law("pd", ROBOT))
    servo.changes.change_law(ChangeLaw(name="pd"), threading.Event())
    assert servo.law_name == "pd"
    assert not [line for line in servo.said if "in force again" in line]


def test_a_servo_keeps_a_law_once_however_often_its_gains_and_its_settings_are_changed(servo: Servo) -> None:
    """The process whose memory is locked must not be the one that runs out."""
    kv = np.array(servo.robot.control.kv)
    for share in np.linspace(0.9, 1.0, 20):
        servo.changes.change_gains(ChangeGains(kv=tuple(share * kv)))
    assert len(servo.changes._kept) == 1
    setting = Setting("softness", 1.0, 0.0, 2.0, "", "how soft")
    servo.law = Law(servo.law.body, (setting,), compliant=True)
    for softness in np.linspace(1.0, 2.0, 20):
        servo.changes.change_law(ChangeLaw(name="qrobot", settings={"softness": softness}), threading.Event())
    (kept, _name), *others = servo.changes._kept.values()
    assert (kept, others) == (servo.law, [])
    assert kept.chosen == {"softness": 2.0}


def test_a_change_that_was_refused_is_not_what_is_kept_of_a_law(servo: Servo, monkeypatch: pytest.MonkeyPatch) -> None:
    before = servo.law
    again = Law(before.body, before.settings, before.values, before.signals)
    monkeypatch.setattr(law_changes, "maybe_swap_result", lambda _: NOT_NOW)
    with pytest.raises(QRobotError, match="not in mode"):
        servo.changes._swap(again, "again", servo.bench.state.swap.gains.copy())
    assert servo.changes._kept == {before.address: (before, "qrobot")}


def test_names_that_cannot_be_dated_are_noted_at_the_next_look(
    servo: Servo, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def unreadable(_mailbox: ServoMailbox) -> None:
        raise LinkError("the servo's state cannot be read")

    servo.mailbox.name_signals(("force",))
    with monkeypatch.context() as patch:
        patch.setattr(ServoMailbox, "snapshot", unreadable)
        servo.changes.note_fallback()
    servo.changes.note_fallback()
    servo.bench.tick(10)
    assert servo.logged(tmp_path).program_signal_names == ("force",)


def test_settings_that_meet_another_law_in_the_loop_are_not_taken(
    servo: Servo, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The law failed, and its fault was cleared, after it was looked at."""
    soft = Law(find_law("pd", ROBOT).body, (Setting("softness", 1.0, 0.0, 2.0, "", "how soft"),), compliant=True)
    servo.changes._swap(soft, "soft", servo.bench.state.swap.gains.copy())
    before = servo.swap.last_settings.copy()
    monkeypatch.setattr(law_changes, "await_loop", lambda _: (fall_back(servo.swap), servo.bench.tick(1)))
    with pytest.raises(QRobotError, match="law soft has failed meanwhile: its settings have not been taken"):
        servo.changes.change_law(ChangeLaw(name="soft", settings={"softness": 2.0}), threading.Event())
    np.testing.assert_array_equal(servo.swap.settings, before)


def test_the_first_law_that_is_in_force_again_is_told_with_the_settings_it_was_left_with(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    own = Law(find_law("pd", ROBOT).body, (Setting("share", 1.0, 0.0, 2.0, "", "of something"),))
    servo = Servo(ServoBench(law=own).tick(5), own, "own")
    monkeypatch.setattr(law_changes, "await_loop", lambda _: servo.bench.tick(1))
    gains = servo.bench.state.swap.gains.copy()
    servo.changes._swap(find_law("qrobot", ROBOT), "qrobot", gains)
    servo.changes._swap(own.with_settings({"share": 2.0}), "own", gains)
    for name, chosen in (("qrobot", {}), ("own", {"share": 1.0})):
        fall_back(servo.swap)
        servo.changes.note_fallback()
        assert (servo.law_name, servo.law.chosen) == (name, chosen)
