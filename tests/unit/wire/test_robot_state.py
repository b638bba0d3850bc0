"""The one table of the robot's state: each of its lines is in everything that carries the state."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from qrobot.faultcodes import NO_JOINT
from qrobot.rccl_bridge.mailbox_port import MailboxPort
from qrobot.realtime.structure import dtype_of, offset_of
from qrobot.servo.memory.mailbox import ServoMailbox
from qrobot.servo.memory.published_state import ROWS, ServoSnapshot, block_of_rows
from qrobot.servo.memory.servo_memory import local_servo_memory
from qrobot.servo.operator.messages import ServoStatus
from qrobot.servo.state import ServoState
from qrobot.wire import State
from qrobot.wire.codec import decode, encode
from qrobot.wire.document import field_table, state_members, state_reads
from qrobot.wire.layout import STATE, Field, Layout, state_fields
from qrobot.wire.packets import RobotState, Values
from qrobot.wire.robot_state import StateRow, StateTable, rows_of, told

N = 3
ROOT = Path(__file__).parents[3]
TRAVELLING = [row for row in rows_of(StateTable) if row.code]


def name_of(row: StateRow) -> str:
    return row.name


@pytest.mark.parametrize("row", ROWS, ids=name_of)
def test_each_line_is_copied_from_a_field_of_the_servos_state_to_its_memory_and_read_back(row: StateRow) -> None:
    source = row.source or row.name
    assert source in ServoState.__annotations__
    mailbox = ServoMailbox(local_servo_memory("sample", "", N, 1_000_000, 16))
    field = mailbox.memory.published.state[source]
    assert np.shape(field) == {1: (), "n": (N,)}.get(row.count, (row.count,))
    mailbox.memory.published.state[source] = 3
    np.testing.assert_array_equal(getattr(mailbox.snapshot(), row.name), np.full(np.shape(field), 3))


@pytest.mark.parametrize("row", TRAVELLING, ids=name_of)
def test_each_line_that_travels_reaches_a_client_and_the_documentation_and_programs_in_c(row: StateRow) -> None:
    words = local_servo_memory("sample", "", N, 1_000_000, 16)
    ServoMailbox(words).memory.published.state[row.source or row.name] = 2
    arrived = decode(encode(State(1, MailboxPort(words).read_state())))
    assert isinstance(arrived, State)
    assert np.all(np.array(getattr(arrived.robot, row.name)) == 2)
    assert f"| {row.name} | {row.unit} | {row.meaning} |" in field_table(STATE)
    header = (ROOT / "qrobot" / "wire" / "c" / "qrobot_wire.h").read_text()
    assert re.search(rf" {row.name}(\[\w+\])?; /\* .*{re.escape(row.meaning)}", header)
    assert re.search(rf"QROBOT_AT_STATE_{row.name.upper()}(\(n\))?, ", header)


@dataclass(frozen=True, slots=True, kw_only=True)
class WiderState(StateTable[Values]):
    """The table and one line more."""

    temperature: Values = told("d", "°C", "of the motors", "n", source="motor_temperature")
    doors: int = told("H", "bits", "safety doors that are open", default=0)


def test_a_new_line_is_in_every_derivation() -> None:
    rows = rows_of(WiderState)
    assert [row.name for row in rows][-2:] == ["temperature", "doors"]
    block = dtype_of(block_of_rows(rows), n=N)
    assert offset_of(block, "doors") == offset_of(block, "motor_temperature") + 8 * N
    fields = state_fields(rows)
    assert fields[:-2] == STATE.fields
    assert fields[-2:] == (
        Field("temperature", "d", "°C", "of the motors", "n"),
        Field("doors", "H", "bits", "safety doors that are open"),
    )
    page = field_table(Layout(STATE.kind, STATE.name, STATE.sender, STATE.meaning, fields))
    assert "| 200 + 32n | `double[n]` | temperature | °C | of the motors |" in page
    assert "    double temperature[QROBOT_MAX_JOINTS]; /* °C: of the motors */" in list(state_members(fields))
    assert "    state->doors = (uint32_t)qrw_get(frame + QROBOT_AT_STATE_DOORS(n), 2);" in list(state_reads(fields))


def test_numbers_stand_at_multiples_of_their_size_whatever_comes_before() -> None:
    @dataclass(frozen=True, slots=True, kw_only=True)
    class Crooked(StateTable[Values]):
        """A byte, and behind it what wants four and eight."""

        flag: int = told("B", "-", "a byte")
        wide: int = told("I", "-", "four")
        vector: Values = told("d", "-", "eight each", 2)

    at, places = 24, dict[str, int]()
    for field in state_fields(rows_of(Crooked)):
        if field.code != "x":
            assert at % field.size == 0, field.name
        places[field.name] = at
        at += field.size * field.length(N)
    assert places["wide"] - places["flag"] == 4
    assert places["vector"] - places["wide"] == 4


def test_snapshot_and_packet_have_the_fields_of_the_table_and_the_snapshot_three_more() -> None:
    assert [row.name for row in rows_of(RobotState)] == [row.name for row in rows_of(StateTable)]
    more = ["tick", "setpoint_seq", "pots_verdict"]
    assert [row.name for row in ROWS] == [*(row.name for row in rows_of(StateTable)), *more]


def test_the_operators_status_has_what_the_state_has_under_the_same_names() -> None:
    elsewhere = {"t_ns", "flags", "q_setpoint", "force", "sensors", "setpoint_seq", "pots_verdict"}  # flags by name
    assert {row.name for row in ROWS} - elsewhere <= set(ServoStatus.model_fields)


def test_flags_of_a_sample_are_told_one_by_one() -> None:
    sample: Any = SimpleNamespace(flags=0b11111)
    for name in ("powered", "calibrated", "estop_ok", "guarded", "at_rest"):
        read = getattr(StateTable, name).fget
        assert read(sample) is True
        assert read(SimpleNamespace(flags=0)) is False


def test_a_state_says_no_joint_unless_told_otherwise() -> None:
    still = (0.0,) * N
    robot = RobotState(t_ns=1, mode=0, q=still, v=still, tau=still, q_setpoint=still)
    assert (robot.event_joint, robot.force, robot.n) == (NO_JOINT, (0.0,) * 6, N)
    assert issubclass(ServoSnapshot, StateTable)
