"""Power-up anywhere: two hundred random poses, boards of both revisions, arms that are not quite their model."""

from __future__ import annotations

from collections.abc import Iterable

import pytest

from qrobot.faultcodes import FaultCode
from qrobot.rig.table_maker import make_table
from qrobot.servo.calibration.table import CalibrationTable
from qrobot.sim_board.board import BoardOptions
from qrobot.sim_board.emulator import Emulator
from qrobot.sim_board.mismatch import PlantMismatch
from tests.support.calibrating import PUMA, TABLE, CalibratingRig, random_pose

TWELVE_BITS, EIGHT_BITS = range(130), range(130, 200)
CHUNK = 26  # poses a test
LAST_JOINT = PUMA.n - 1


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


def refusals(seeds: Iterable[int], revision: str, table: CalibrationTable) -> dict[int, tuple[FaultCode, int]]:
    """Seeds of the poses that were refused, and why."""
    outcomes = {seed: calibrated_from(seed, revision, table) for seed in seeds}
    return {seed: why for seed, why in outcomes.items() if why is not None}


def only_beyond_the_track(refused: dict[int, tuple[FaultCode, int]]) -> bool:
    """Whether joint 6 was the reason everywhere, and stood where its potentiometer's track is about to end."""
    reach = PUMA.limits.q_max[LAST_JOINT] * 0.5
    last = all(joint == LAST_JOINT for _, joint in refused.values())
    return last and all(abs(random_pose(seed)[LAST_JOINT]) > reach for seed in refused)


@pytest.mark.slow
@pytest.mark.parametrize("first", TWELVE_BITS[::CHUNK])
def test_on_a_twelve_bit_converter_every_pose_comes_out_exact_but_beyond_the_track_of_joint_6(first: int) -> None:
    refused = refusals(TWELVE_BITS[first : first + CHUNK], "F", TABLE)
    assert only_beyond_the_track(refused)
    assert len(refused) < CHUNK // 2


@pytest.mark.slow
def test_on_an_eight_bit_converter_too_only_poses_beyond_the_track_are_refused() -> None:
    table = make_table(Emulator(PUMA, physics="rigid", options=BoardOptions(revision_f=False)))
    refused = refusals(EIGHT_BITS, "E", table)
    assert only_beyond_the_track(refused)
    assert len(refused) < len(EIGHT_BITS) // 2


def test_the_packaged_table_is_the_one_the_emulator_makes() -> None:
    made = make_table(Emulator(PUMA, physics="rigid"))
    assert [pots.tolist() for pots in made.pots] == [pots.tolist() for pots in TABLE.pots]
    assert [counts.tolist() for counts in made.counts] == [counts.tolist() for counts in TABLE.counts]
