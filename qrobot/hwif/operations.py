"""Register operations: what a controller asks of a board, as rows that are applied strictly in order."""

from __future__ import annotations

from typing import Any, Final

from qrobot.realtime.jit import lean_kernel

OP_READ: Final = 0
OP_WRITE: Final = 1
OP_REFERENCE: Final = 2  # where a motor is to be, for drives that close their own loop; boards count it as illegal
OP_OUTPUTS: Final = 3  # outputs of the arm, for modules beside the board and the emulated panel; others ignore it
OP_ANALOG: Final = 4  # an analogue output, from 0, in microvolts, for modules and panel likewise
ALL_ANALOG: Final = 8  # in place of the number of an output: every one of them goes to its off value
MASK_32: Final = 0xFFFFFFFF
SIGN_32: Final = 1 << 31
OP_FIELDS: Final = 3  # kind, offset, value
REFERENCE_PER_COUNT: Final = 1 << 16  # the value of a reference is a counter with a fraction; its offset is the joint


@lean_kernel
def put_write(operations: Any, n: int, offset: int, value: int) -> int:
    """Append a register write to a list of operations of length `n`; returns its new length."""
    operations[n, 0], operations[n, 1], operations[n, 2] = OP_WRITE, offset, value
    return n + 1


@lean_kernel
def put_read(operations: Any, n: int, offset: int) -> int:
    """Append a read whose side effect is wanted to a list of operations of length `n`; returns its new length."""
    operations[n, 0], operations[n, 1], operations[n, 2] = OP_READ, offset, 0
    return n + 1


@lean_kernel
def put_reference(operations: Any, n: int, joint: int, value: int) -> int:
    """Append where the motor of a joint is to be, in counts x REFERENCE_PER_COUNT; returns the list's new length."""
    operations[n, 0], operations[n, 1], operations[n, 2] = OP_REFERENCE, joint, value
    return n + 1


@lean_kernel
def put_outputs(operations: Any, n: int, outputs: int) -> int:
    """Append the outputs of the arm, output 1 in bit 0, to a list of operations; returns its new length."""
    operations[n, 0], operations[n, 1], operations[n, 2] = OP_OUTPUTS, 0, outputs
    return n + 1


@lean_kernel
def put_analog(operations: Any, n: int, output: int, microvolts: int) -> int:
    """Append an analogue output, from 0 or `ALL_ANALOG`, to a list of operations; returns its new length."""
    operations[n, 0], operations[n, 1], operations[n, 2] = OP_ANALOG, output, microvolts
    return n + 1


@lean_kernel
def signed_microvolts(value: int) -> int:
    """Microvolts of an operation that has been cut to 32 bits on its way."""
    return ((value ^ SIGN_32) & MASK_32) - SIGN_32
