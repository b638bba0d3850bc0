"""Faults as people write them down."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from qrobot.errors import ConfigError
from qrobot.sim_board.faults import COMPONENTS, KINDS, Fault, FaultKind, FaultPlan, kind_of


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("encoder:2 stuck @1.5s +0.5s", Fault("encoder", "stuck", 2, 1.5, 0.5)),
        ("dac:1 gain 0.8", Fault("dac", "gain", 1, value=0.8)),
        ("estop pressed @2s +100ms", Fault("estop", "pressed", None, 2.0, 0.1)),
        ("  board   off 0x0000 ", Fault("board", "off", value=0.0)),
        ("arm:3 pushed -30 +20ms @.5s", Fault("arm", "pushed", 3, 0.5, 0.02, -30.0)),
    ],
)
def test_a_line_says_what_breaks_how_when_and_how_much(line: str, expected: Fault) -> None:
    assert Fault.parse(line) == expected


@st.composite
def any_fault(draw: st.DrawFn) -> Fault:
    row: FaultKind = draw(st.sampled_from(KINDS))
    value = None
    if row.default is not None:
        value = draw(st.none() | st.integers(int(row.low), int(row.high)).map(float))
        value = None if value is not None and not row.low <= value <= row.high else value
    thousandths = st.integers(1, 100_000).map(lambda ms: ms / 1000)
    return Fault(
        row.component,
        row.name,
        draw(st.integers(1, 6)) if row.per_joint else None,
        draw(st.just(0.0) | thousandths),
        None if row.once else draw(st.none() | thousandths),
        value,
    )


@given(any_fault())
def test_every_fault_can_be_written_down_and_read_back(fault: Fault) -> None:
    assert Fault.parse(str(fault)) == fault


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("encoder", 'say what breaks and how, as in "encoder:2 stuck'),
        ("encodr:2 stuck", "nothing called 'encodr' can break (did you mean 'encoder'?)"),
        ("encoder:2 stuk", "encoder has no fault 'stuk' (did you mean 'stuck'?), only stuck, jump"),
        ("brake:2 garbage", "brake has no fault 'garbage', only stuck, slips, slow"),
        ("encoder stuck", "encoder stuck: which joint? Write encoder:1 to encoder:6"),
        ("encoder:7 stuck", "which joint?"),
        ("encoder:x stuck", "after the colon stands the number of a joint"),
        ("board:1 off", "befalls no single joint"),
        ("encoder:1 stuck @soon", "'@soon' is no value, no start"),
        ("encoder:1 stuck @3", "'@3' is no value, no start"),
        ("encoder:1 stuck 5", "takes no value, not 5"),
        ("encoder:1 jump +1s", "happens at an instant"),
        ("dac:1 gain 3", "3 times is out of range -1 to 1"),
        ("dac:1 gain nan", "out of range"),
        ("estop pressed +0s", "cannot last 0.0 s"),
    ],
)
def test_what_makes_no_sense_is_refused_with_the_reason(line: str, words: str) -> None:
    with pytest.raises(ConfigError) as refused:
        Fault.parse(line)
    assert words in str(refused.value)


def test_a_fault_cannot_begin_in_the_past() -> None:
    with pytest.raises(ConfigError, match=r"cannot begin at -1\.0 s"):
        Fault("estop", "pressed", start_s=-1.0)


def test_kinds_have_numbers_and_names_of_their_own_and_a_default_in_range() -> None:
    assert len({kind.number for kind in KINDS}) == len({(kind.component, kind.name) for kind in KINDS}) == len(KINDS)
    assert {COMPONENTS.index(kind.component) for kind in KINDS} == set(range(len(COMPONENTS)))
    for kind in KINDS:
        assert kind_of(kind.number) is kind
        assert kind.default is None or kind.low <= kind.default <= kind.high


def test_a_plan_is_a_file_of_lines_and_a_seed(tmp_path: Path) -> None:
    path = tmp_path / "plan.toml"
    path.write_text('seed = 7\nfaults = ["encoder:2 stuck @1s", "estop pressed @2s"]\n')
    assert FaultPlan.load(path) == FaultPlan.parse(["encoder:2 stuck @1s", "estop pressed @2s"], seed=7)


def test_a_mistake_in_a_file_is_told_with_its_place(tmp_path: Path) -> None:
    path = tmp_path / "plan.toml"
    path.write_text('fauls = ["encoder:2 stuck"]\n')
    with pytest.raises(ConfigError, match=r"plan\.toml.*(.|\n)*fauls: unknown key; did you mean 'faults'"):
        FaultPlan.load(path)


@pytest.mark.parametrize(
    "line",
    [
        "estop pressed @99999999999s",
        "estop pressed +2000000000s",
        "estop pressed +99999999999s",
        f"dac:1 offset 0x{'f' * 300}",
    ],
)
def test_times_and_values_that_no_board_can_count_are_refused(line: str) -> None:
    with pytest.raises(ConfigError):
        Fault.parse(line)
