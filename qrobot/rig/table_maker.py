"""Make a calibration table on the emulator: somebody leads the unpowered arm through its range, joint by joint.

The arm is put from place to place, quasi-statically; the board sees the shafts turn, and what is recorded comes
through its registers alone, with the servo's own sampling. Each motor goes from the lowest to the highest position it
has inside the joints' range, in the positive direction of its joint; coupled joints go along, so that the table has
every row the arm can come to.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from qrobot.arrays import Floats, Words
from qrobot.errors import ConfigError
from qrobot.hwif.board_memory import BoardMemory, Lane, fetch_image, local_board_memory
from qrobot.hwif.image import (
    IMAGE_COUNT,
    IMAGE_ENC_COUNT,
    IMAGE_ENC_INDEX,
    IMAGE_STATUS,
    IMAGE_T_NS,
    make_image,
)
from qrobot.hwif.lanes import post_operations
from qrobot.hwif.operations import OP_FIELDS, put_write
from qrobot.hwif.registers import DISCRETE, DISCRETE_ADC, INDEX_BIT_0, N_ADCS
from qrobot.model.transmission import signed_word
from qrobot.realtime.flat_record import record_of
from qrobot.realtime.jit import lean_kernel
from qrobot.servo.calibration.potentiometers import pot_units
from qrobot.servo.calibration.table import FEWEST_ROWS, CalibrationTable
from qrobot.servo.kernels.converter import IMAGES_TO_ANSWER, collect_sample, make_adc_state, start_sample
from qrobot.sim_board.board import accept_operations, publish_sample
from qrobot.sim_board.emulator import Emulator, EmulatorBundle, turn_shafts

PLACES_PER_TURN: Final = 64  # half as many readings
PATIENCE: Final = 8

TableProgress = Callable[[int, float], None]


@lean_kernel
def lead_to(bundle: EmulatorBundle, memory: BoardMemory, q: Floats, t_ns: int) -> None:
    """Put the unpowered arm at `q` (n,) and let the board see it at `t_ns`."""
    accept_operations(bundle.board, memory, t_ns)
    for j in range(q.size):
        bundle.plant.q[j] = q[j]
    turn_shafts(bundle)
    publish_sample(bundle.board, memory, bundle.shaft, t_ns)


@dataclass
class _Recorder:
    """The controller's side: one joint's index latch, its potentiometer, and the rows so far."""

    emulator: Emulator
    memory: BoardMemory
    image: Words = field(default_factory=make_image)
    ops: Words = field(default_factory=lambda: np.zeros((8, OP_FIELDS), np.int64))
    volts: Floats = field(default_factory=lambda: np.zeros(N_ADCS))
    t_ns: int = 0

    def record(self, joint: int, places: Floats, progress: TableProgress) -> tuple[list[int], list[int]]:
        """Rows (pots, counts) met while the arm is led through `places` (m, n)."""
        transmission = self.emulator.robot.transmission
        slope = transmission.pots_per_rev[joint] / transmission.counts_per_rev[joint]
        channel, adc = int(transmission.pot_channels[joint]), record_of(make_adc_state())
        pots, counts, residues = [], [], []
        bit, valid_at = INDEX_BIT_0 << joint, -1
        for number, q in enumerate(places):
            self._step(q)
            raw = int(self.image[IMAGE_ENC_COUNT + joint])
            count = int(signed_word(raw)) - int(transmission.count_offset[joint])
            revision, taken_ns = self.memory.facts.revision, self.image[IMAGE_T_NS]
            if collect_sample(adc, self.volts, self.image, taken_ns, revision, PATIENCE) == channel:
                residues.append(pot_units(self.volts[channel]) - slope * count)
            n_ops, seen = 0, self.image[IMAGE_STATUS] & bit == 0
            if valid_at >= 0 and seen and self.image[IMAGE_COUNT] >= valid_at:
                latched = int(self.image[IMAGE_ENC_INDEX + joint])
                index = count + int(signed_word(latched - raw))
                counts.append(index)
                pots.append(round(float(np.mean(residues)) + slope * index))
                residues, valid_at = [], -1
                progress(joint, number / len(places))
            if valid_at < 0:
                n_ops = put_write(self.ops, n_ops, DISCRETE, DISCRETE_ADC)
                n_ops = put_write(self.ops, n_ops, DISCRETE, DISCRETE_ADC | bit)
                valid_at = int(self.image[IMAGE_COUNT]) + IMAGES_TO_ANSWER
            word, wanted = DISCRETE_ADC | bit, 1 << channel
            n_ops = start_sample(adc, self.ops, n_ops, word, wanted, self.image[IMAGE_COUNT], revision)
            post_operations(self.memory, int(Lane.SERVO), self.ops, n_ops)
        return pots, counts

    def _step(self, q: Floats) -> None:
        self.t_ns += self.emulator.bundle.period_ns
        lead_to(self.emulator.bundle, self.memory, q, self.t_ns)
        fetch_image(self.memory, self.image)


def _ignore(_joint: int, _share: float) -> None:
    """Take no notice of the progress."""


def make_table(emulator: Emulator, progress: TableProgress = _ignore) -> CalibrationTable:
    """Lead the emulated arm through its range and record its table; the arm is where it was, and off, afterwards.

    Args:
        emulator: a board that is calibrated, with potentiometers, and that nobody else uses.
        progress: called with joint and share of its range at each index pulse.

    Raises:
        ConfigError: the board's counters are not calibrated, or a joint has too short a range for a table.
    """
    if not emulator.calibrated:
        raise ConfigError("a table needs a board that is calibrated: start the emulator with `calibrated = true`")
    memory = local_board_memory()
    emulator.connect(memory)
    recorder = _Recorder(emulator, memory)
    start = emulator.q
    columns = [recorder.record(joint, _places(emulator, joint), progress) for joint in range(emulator.robot.n)]
    emulator.plant.place(start)
    rows = [_usable(joint, np.array(column, dtype=np.int64)) for joint, column in enumerate(columns)]
    table = CalibrationTable(tuple(pots for pots, _ in rows), tuple(counts for _, counts in rows))
    table.check_against(emulator.robot, "the new table")
    return table


def _usable(joint: int, columns: NDArray[np.int64]) -> NDArray[np.int64]:
    """The rows of columns (2, rows) that tell one turn from the next: an 8-bit converter ends at 0 and 5 V.

    Without the first row: its turn is not whole, and the potentiometer's backlash has not been taken up.

    Raises:
        ConfigError: they are too few for a table.
    """
    steps = np.abs(np.diff(columns[0]))
    moving = np.flatnonzero(steps > 0.5 * np.median(steps[steps > 0])) if steps.any() else np.zeros(0, np.int64)
    rows = columns[:, max(1, moving[0]) : moving[-1] + 2] if moving.size else columns[:, :0]
    if rows.shape[1] < FEWEST_ROWS:
        raise ConfigError(
            f"joint {joint + 1} meets {columns.shape[1]} index pulses in its range, {rows.shape[1]} of them at "
            f"readings that differ: a table needs {FEWEST_ROWS}"
        )
    return rows


def _places(emulator: Emulator, joint: int) -> Floats:
    """Joint positions (m, n) from the lowest to the highest position of a motor inside the joints' range."""
    limits, row = emulator.robot.limits, emulator.robot.transmission.coupling[joint]
    low = np.where(row >= 0.0, limits.q_min, limits.q_max)
    high = np.where(row >= 0.0, limits.q_max, limits.q_min)
    still = row == 0.0
    low[still] = high[still] = emulator.robot.poses["ready"][still]
    turns = row @ (high - low) * emulator.robot.transmission.gear[joint] / (2.0 * np.pi)
    way: Floats = low + np.linspace(0.0, 1.0, round(turns * PLACES_PER_TURN))[:, None] * (high - low)
    return way
