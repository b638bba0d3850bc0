"""Calls of compiled code by a bench: records go over as blocks, which Python hands over far faster."""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from qrobot.hwif.board_memory import publish_image
from qrobot.hwif.image import IMAGE_ENC_COUNT
from qrobot.hwif.lanes import take_operation
from qrobot.model.transmission import joint_to_counts
from qrobot.realtime.flat_record import block_of
from qrobot.realtime.jit import jit_disabled, lean_kernel
from qrobot.realtime.structure import WORD_BYTES, view_words
from qrobot.servo.process.loop import one_cycle

SHARED_KINDS = ("row", "frame")  # records that are copied into shared memory as they are
FIRST_COUNTER = IMAGE_ENC_COUNT
WORD_MASK = 0xFFFF


@lean_kernel
def cycle_of_blocks(params: Any, state: Any, mail: Any, ring: Any, board: Any, now_ns: int) -> None:
    """`one_cycle` for a call from Python, where records come as blocks, thirty times as fast."""
    one_cycle(params[0], state[0], mail[0], ring, board[0], now_ns, 0)


@lean_kernel
def publish_arm(params: Any, board: Any, q: Any, slip: Any, counts: Any, image: Any) -> None:
    """Publish an image of the encoders of an arm at `q`, off by `slip`; `counts` is room. Shapes (n,), (n,), (n,)."""
    joint_to_counts(q, params[0].transmission, counts)
    for i in range(counts.size):
        image[FIRST_COUNTER + i] = (counts[i] + slip[i]) & WORD_MASK
    publish_image(board[0], image)


@lean_kernel
def take_lanes(board: Any, operations: Any, taken: Any) -> None:
    """Take all that was posted to the lanes of a block; how many of each. Shapes (lanes, k, OP_FIELDS), (lanes,)."""
    for lane in range(taken.size):
        taken[lane] = 0
        while taken[lane] < operations.shape[1] and take_operation(board[0], lane, operations[lane, taken[lane]]):
            taken[lane] += 1


def callable_block(record: Any) -> Any:
    """A block for `cycle_of_blocks`."""
    return [record] if jit_disabled() else block_of(record)


def word_of(record: Any, name: str) -> NDArray[np.int64]:
    """A number of a record as an array of one, in the same memory: read and written in a twentieth of the time."""
    kind, at, *_ = record.dtype.fields[name]
    assert kind == np.int64
    return view_words(record)[at // WORD_BYTES : at // WORD_BYTES + 1]


def in_python(record: Any) -> Any:
    """The record itself; without the JIT its fields in a namespace, for Python finds those of a record slowly."""
    return views_of(record) if jit_disabled() else record


def views_of(record: Any) -> SimpleNamespace:
    """The fields of a record by name: its arrays themselves, and its numbers as they are."""
    fields = {name: getattr(record, name) for name in record.dtype.names}
    return SimpleNamespace(
        **{
            name: views_of(field) if isinstance(field, np.record) and name not in SHARED_KINDS else field
            for name, field in fields.items()
        }
    )


@dataclass(frozen=True)
class ModeOfFields:
    """The mode of a state whose fields are in a namespace, read as that of one in words is."""

    fields: Any

    def __getitem__(self, _: int) -> int:
        return int(self.fields.mode)


def mode_of(state: Any) -> NDArray[np.int64] | ModeOfFields:
    """Where a state tells its mode, as an array of one."""
    return ModeOfFields(state) if jit_disabled() else word_of(state, "mode")
