"""The state that the servo publishes: a block of its memory under a seqlock, made from the table of the robot's state.

The cycle copies each field from the field of its own state that the table names as its source (`copy_fields`), readers
get a `ServoSnapshot`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any, Final

import numpy as np

from qrobot.arrays import Floats, Words
from qrobot.realtime.flat_record import copy_fields, words_of
from qrobot.realtime.jit import lean_kernel
from qrobot.realtime.seqlock import begin_write, end_write, seqlock_read
from qrobot.realtime.structure import dtype_of, floats, number, part, word
from qrobot.wire.robot_state import StateRow, StateTable, rows_of, told
from qrobot.wire.vocabulary import RobotFlag

# bits of `flags`
FLAG_POWERED: Final = int(RobotFlag.POWERED)
FLAG_CALIBRATED: Final = int(RobotFlag.CALIBRATED)
FLAG_ESTOP_OK: Final = int(RobotFlag.ESTOP_OK)
FLAG_GUARDED: Final = int(RobotFlag.GUARDED)
FLAG_AT_REST: Final = int(RobotFlag.AT_REST)
FLAG_HALTED: Final = int(RobotFlag.HALTED)
FLAG_PAUSED: Final = int(RobotFlag.PAUSED)
FLAG_NO_TORQUES: Final = int(RobotFlag.NO_TORQUES)


@dataclass(frozen=True, slots=True, kw_only=True)
class ServoSnapshot(StateTable[Floats]):
    """The robot's state at one tick as servo memory has it: beside what travels, where the servo is."""

    tick: int = told("", "-", "cycles since the servo started")
    setpoint_seq: int = told("", "-", "number of the setpoint being played")
    pots_verdict: int = told("", "-", "on the counters, see `servo.calibration.state`; PLAUSIBLE without a table")


ROWS: Final = rows_of(ServoSnapshot)
_NAMES: Final = tuple(row.name for row in ROWS)


def block_of_rows(rows: tuple[StateRow, ...]) -> type:
    """The block that holds these fields: an integer an int64, all else float64, each under the name of its source."""
    return type(
        "StateBlock",
        (),
        {row.source or row.name: _field(row) for row in rows},
    )


def _field(row: StateRow) -> Any:
    if row.count != 1:
        return floats(row.count)
    return number() if row.code == "d" else word()


STATE_BLOCK: Final = block_of_rows(ROWS)


class PublishedBlock:
    """The newest state, under a seqlock."""

    sequence: int = word()
    state: Any = part(STATE_BLOCK, own_line=True)


@cache
def state_dtype(n: int) -> np.dtype[Any]:
    """The type of the state of `n` joints."""
    return dtype_of(STATE_BLOCK, n=n)


@lean_kernel
def publish_state(mail: Any, state: Any) -> None:
    """Servo: publish each field of the block from the field of `state` that has its name."""
    begin_write(mail.published)
    copy_fields(state, mail.published.state)
    end_write(mail.published)


@lean_kernel
def read_state(mail: Any, out: Words) -> bool:
    """Reader, from Python: copy the newest whole state into `out`, words; False when none could be had.

    `mail` is a block of one servo memory.
    """
    published = mail[0].published
    return seqlock_read(published, words_of(published.state), out)


def snapshot_of(words: Words, n: int) -> ServoSnapshot:
    """The state of `n` joints whose block these words are; its arrays are views of them."""
    told = words.view(state_dtype(n)).item()  # all at once: one field after the other takes Python ten times as long
    return ServoSnapshot(**dict(zip(_NAMES, told, strict=True)))
