"""A board on the bench: shafts turned by hand, virtual time, register reads and writes by offset."""

from __future__ import annotations

import numpy as np

from qrobot.arrays import Words
from qrobot.hwif.board_memory import Lane, fetch_image, local_board_memory
from qrobot.hwif.image import input_at, make_image
from qrobot.hwif.lanes import post_operations
from qrobot.hwif.operations import OP_READ, OP_WRITE
from qrobot.hwif.registers import N_ENCODERS, STATUS
from qrobot.realtime.flat_record import record_of
from qrobot.realtime.jit import jit_disabled
from qrobot.sim_board.analog import make_analog
from qrobot.sim_board.board import BoardOptions, accept_operations, make_board, publish_sample
from qrobot.sim_board.encoder import make_encoders

PERIOD_NS = 250_000
COUNTS_PER_REV = np.array([1000, 800, 1000, 1000, 1000, 500])
PHASE = np.array([70, 429, 332, 760, 778, 95])
POT_ZERO = np.array([8532.0, 8530.0, 8384.0, 8668.0, 8269.0, 5318.0])
POT_SLOPE = -150.1


def post(memory: Words, *operations: tuple[int, int, int], lane: int = Lane.SERVO) -> None:
    """Post operations (kind, offset, value) to a lane."""
    rows = np.array(operations, np.int64).reshape(-1, 3)
    assert post_operations(memory, lane, rows, len(rows))


def read_word(memory: Words, offset: int) -> int:
    """An input word of the newest image."""
    image = make_image()
    assert fetch_image(memory, image)
    return int(image[input_at(offset)])


class Bench:
    """A board without a robot. `shaft` is where the encoders stand, counts; `tick` lets the board see it."""

    def __init__(
        self,
        n_pots: int = 6,
        noise: float = 0.0,
        wave: float = 0.0,
        backlash: float = 0.0,
        seed: int = 1,
        **options: object,
    ) -> None:
        analog = make_analog(POT_ZERO[:n_pots], POT_SLOPE, seed, noise, wave, backlash)
        encoders = make_encoders(COUNTS_PER_REV, PHASE)
        board = make_board(encoders, analog, BoardOptions(**options))  # type: ignore[arg-type]
        # a record, as of an emulator, whose kernels then do here too; plain Python finds its fields slowly
        self.board = board if jit_disabled() else record_of(board)
        self.memory = local_board_memory()
        self.shaft = np.zeros(N_ENCODERS)
        self.t_ns = 1_000_000_000
        self.tick()

    def tick(self, times: int = 1) -> None:
        """So many periods: what was posted takes effect, then the shafts are sampled."""
        for _ in range(times):
            accept_operations(self.board, self.memory, self.t_ns)
            self.t_ns += PERIOD_NS
            publish_sample(self.board, self.memory, self.shaft, self.t_ns)

    def write(self, *pairs: tuple[int, int], lane: int = Lane.SERVO) -> None:
        """Write (offset, value) pairs in order, within one tick."""
        post(self.memory, *((OP_WRITE, offset, value) for offset, value in pairs), lane=lane)
        self.tick()

    def touch(self, offset: int) -> None:
        """Read a register for its side effect."""
        post(self.memory, (OP_READ, offset, 0))
        self.tick()

    def turn(self, channel: int, *positions: float) -> None:
        """Move one shaft through positions, one sample each."""
        for position in positions:
            self.shaft[channel] = position
            self.tick()

    def read(self, offset: int) -> int:
        """An input word."""
        return read_word(self.memory, offset)

    @property
    def status(self) -> int:
        """The STATUS word."""
        return self.read(STATUS)
