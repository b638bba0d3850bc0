"""Calibrations from random poses: boards of both revisions, arms that are not quite their model."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

from qrobot.faultcodes import FaultCode
from qrobot.rig.table_maker import make_table
from qrobot.servo.calibration.table import CalibrationTable
from qrobot.sim_board.board import BoardOptions
from qrobot.sim_board.emulator import Emulator
from qrobot.sim_board.mismatch import PlantMismatch
from tests.support.calibrating import PUMA, TABLE, CalibratingRig, random_pose

# Poses by revision of the board; twelve in a row are every combination of relatching, backlash and mismatch.
TWELVE_BITS: Final = range(130)
EIGHT_BITS: Final = range(130, 200)
LAST_JOINT: Final = PUMA.n - 1

Refusals = dict[int, tuple[FaultCode, int]]


def calibrated_from(seed: int, revision: str, table: CalibrationTable) -> tuple[FaultCode, int] | None:
    """None when the counters came out exact, else why and on which joint it was refused."""
    wrong_plant = PlantMismatch.mismatched(PUMA.n) if seed % 4 == 3 else None
    emulator = Emulator(
        PUMA, physics="rigid", start=random_pose(seed), calibrated=False, seed=seed, mismatch=wrong_plant,
        options=BoardOptions(revision_f=revision == "F", relatch=seed % 2 == 0),
    )  # fmt: skip
    emulator.bundle.board.analog["backlash"] = 0.3 * (seed % 3 == 1)
    rig = CalibratingRig(emulator=emulator, table=table)
    why = rig.outcome()
    return None if why is None else (why, rig.event[1])


def refusals(seeds: Iterable[int], revision: str, table: CalibrationTable) -> Refusals:
    """Seeds of the poses that were refused, and why."""
    outcomes = {seed: calibrated_from(seed, revision, table) for seed in seeds}
    return {seed: why for seed, why in outcomes.items() if why is not None}


def eight_bit_table() -> CalibrationTable:
    """As a board of revision E makes it."""
    return make_table(Emulator(PUMA, physics="rigid", options=BoardOptions(revision_f=False)))


def only_beyond_the_track(refused: Refusals) -> bool:
    """Whether joint 6 was the reason everywhere, and stood where its potentiometer's track is about to end."""
    reach = PUMA.limits.q_max[LAST_JOINT] * 0.5
    last = all(joint == LAST_JOINT for _, joint in refused.values())
    return last and all(abs(random_pose(seed)[LAST_JOINT]) > reach for seed in refused)


def campaign() -> int:
    """Run it and print what was refused; the number of boards on which a pose was refused for another reason."""
    wrong = 0
    for revision, seeds, table in (("F", TWELVE_BITS, TABLE), ("E", EIGHT_BITS, eight_bit_table())):
        refused = refusals(seeds, revision, table)
        wrong += not only_beyond_the_track(refused)
        print(f"revision {revision}: {len(refused)} of {len(seeds)} refused: {refused}", flush=True)
    return wrong
