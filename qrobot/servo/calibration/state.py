"""State of potentiometers and calibration from cycle to cycle."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import Any, Final

import numpy as np

from qrobot.servo.kernels.awaited import Awaited

MOST_INDEXES: Final = 14  # the vendor's number (TRC004 vendor driver v4.3, INDEX_NUM)
DEFAULT_INDEXES: Final = 5
FEWEST_INDEXES: Final = 3  # a single one is not enough: 75 units decide, waviness and noise make 40 [A]


class Stage(IntEnum):
    """Stages of a calibration."""

    IDLE = 0
    BACKING = 1  # makes room to move on in the positive direction
    SWEEPING = 2  # creeps forward from index pulse to index pulse
    SLOWING = 3  # has what it needs, comes to rest
    SETTLING = 4  # all joints are done: waits until no counter moves
    LOADING = 5  # counters were loaded, the image does not show it yet
    MARKING = 6  # the calibrated bit was set, STATUS does not show it yet


@dataclass(eq=False)
class CalibrationState:
    """One calibration. Vectors have shape (n,)."""

    index: Any  # int64[MOST_INDEXES] counts of the present joint's index pulses
    pot: Any  # float64[MOST_INDEXES] its potentiometer there
    shift: Any  # int64[n] what to add to the counts
    misfit: Any  # float64[n] mean distance from the table's rows, pot units
    margin: Any  # float64[n] how much further the second best place in the table is, pot units
    votes: Any  # int64[n] index pulses that agree
    words: Any  # int64[n] counters as loaded
    before: Any  # int64[n] counters before that
    latch: Awaited  # the first image whose index flag counts
    stage: int = 0
    joint_now: int = 0
    found: int = 0  # index pulses of this joint that count
    wanted: int = 0
    last_index: int = 0  # count of the newest index pulse, or of the place where the search began
    first: int = 0  # 1 until the first index pulse, which only tells where the turns begin
    attempts: int = 0  # of this joint
    rearm: int = 0  # 1: arm the index latch in this cycle
    samples: int = 0  # pot readings since the newest index pulse
    still: int = 0  # cycles in a row without a count
    waited: int = 0  # cycles in the present stage
    load: int = 0  # 1: post the new counts in this cycle
    moved: int = 0  # 1: a counter changed between the last look at the old ones and the first at the new ones
    residue: float = 0.0  # sum of pot - slope * counts of those readings
    begin: float = 0.0  # where this joint's sweep begins, and backing ends
    speed: float = 0.0


def make_calibration_state(n: int) -> CalibrationState:
    """No calibration under way."""
    return CalibrationState(
        np.zeros(MOST_INDEXES, np.int64),
        np.zeros(MOST_INDEXES), np.zeros(n, np.int64), np.zeros(n), np.zeros(n), np.zeros(n, np.int64),
        np.zeros(n, np.int64), np.zeros(n, np.int64), Awaited(),
    )  # fmt: skip


# values of `PotState.verdict`
UNJUDGED, PLAUSIBLE, IMPLAUSIBLE, SILENT = range(4)

# values of `PotState.proof`
REFUTED, UNPROVEN, PROVEN = -1, 0, 1


@dataclass(eq=False)
class PotState:
    """The potentiometers since the board was met, or since power was asked for."""

    total: Any  # float64[n] pot - slope * counts, summed over the readings
    readings: Any  # int64[n]
    average: Any  # float64[n] mean of pot - slope * counts while the joints are driven, see `servo.checks.dead_encoder`
    newest: Any  # float64[n] of the newest reading on its track
    followed: Any  # int64[n] readings on its track
    at_end: Any  # int64[n] 1: the newest reading was at an end of its track
    trusted: Any  # int64[n] 0: it made a step that no motor makes
    gone: Any  # int64[n] readings in a row a good way off `average`
    strayed: Any  # int64[n] readings in a row some way off `average`, to one side; negative below it
    stood: Any  # int64[n] readings in a row by which a joint that is driven, and shows no count, stands
    counts: Any  # int64[n] of the joint at the newest reading
    low: Any  # float64[n] least of the readings before power, where there is no table
    high: Any  # float64[n] greatest
    proof: Any  # int64[n] see `servo.checks.potentiometer_monitor`
    anchor: Any  # float64[n] reading that its motion is measured from
    anchor_counts: Any  # int64[n] of the joint then
    verdict: int = 0
    suspect: int = 0  # joint that IMPLAUSIBLE speaks of
    silences_before: int = 0  # their conversions given up until the reading began
    asked_at: int = 0  # tick of the newest cycle in which a request for power asked for them


def make_pot_state(n: int) -> PotState:
    """No reading yet."""

    def integers() -> Any:
        return np.zeros(n, np.int64)

    return PotState(
        np.zeros(n), integers(), average=np.zeros(n), newest=np.zeros(n),
        followed=integers(), at_end=integers(), trusted=integers(), gone=integers(), strayed=integers(),
        stood=integers(),
        counts=integers(),
        low=np.zeros(n), high=np.zeros(n), proof=integers(), anchor=np.zeros(n), anchor_counts=integers(),
    )  # fmt: skip
