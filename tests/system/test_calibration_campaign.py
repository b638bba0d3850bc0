"""Power-up anywhere: random poses, boards of both revisions, arms that are not quite their model.

Of the two hundred poses of `python -m tests.campaigns calibration`: two and one of each combination of what is drawn.
"""

from __future__ import annotations

import pytest

from qrobot.rig.table_maker import make_table
from qrobot.sim_board.emulator import Emulator
from tests.campaigns.calibration import EIGHT_BITS, TWELVE_BITS, eight_bit_table, only_beyond_the_track, refusals
from tests.support.calibrating import PUMA, TABLE

POSES = 12  # one of each combination


@pytest.mark.thorough
def test_on_a_twelve_bit_converter_every_pose_comes_out_exact_but_beyond_the_track_of_joint_6() -> None:
    refused = refusals(TWELVE_BITS[: 2 * POSES], "F", TABLE)
    assert only_beyond_the_track(refused)
    assert len(refused) < POSES


@pytest.mark.thorough
def test_on_an_eight_bit_converter_too_only_poses_beyond_the_track_are_refused() -> None:
    refused = refusals(EIGHT_BITS[:POSES], "E", eight_bit_table())
    assert only_beyond_the_track(refused)
    assert len(refused) < POSES // 2


def test_the_packaged_table_is_the_one_the_emulator_makes() -> None:
    made = make_table(Emulator(PUMA, physics="rigid"))
    assert [pots.tolist() for pots in made.pots] == [pots.tolist() for pots in TABLE.pots]
    assert [counts.tolist() for counts in made.counts] == [counts.tolist() for counts in TABLE.counts]
