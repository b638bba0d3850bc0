"""A drive's position of 32 bits begins anew on the way of a joint: counts and targets go on as the shaft turns."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from qrobot.cli.servo_settings import check_drives
from qrobot.config import load_robot
from qrobot.config.deployment import load_deployment
from qrobot.config.drives import DrivesTransport
from qrobot.config.robot import counter_ends
from qrobot.errors import ConfigError
from qrobot.hwif.canbus.drives import DrivesBus
from qrobot.hwif.canbus.setpoints import DriveFeedback, PositionSetpoints
from qrobot.hwif.image import IMAGE_ENC_COUNT, make_image
from qrobot.hwif.operations import OP_REFERENCE, REFERENCE_PER_COUNT

COUNTS_PER_TURN = 1000
ENABLED = 0x27  # status word of a drive in operation
BITS = range(17, 25)


def transport(increments: float, counts_at_zero: int = 0) -> DrivesTransport:
    return DrivesTransport(
        mode="position", nodes=(1,), increments_per_count=(increments,), counts_at_zero=(counts_at_zero,), absolute=True
    )


def shown(position: int) -> int:
    """What 32 bits with a sign show of a position."""
    return (position + (1 << 31)) % (1 << 32) - (1 << 31)


def way(bits: int, way_up: int) -> list[int]:
    """Positions over some turns past the end, in steps that no sampling misses."""
    step = (1 << bits) // 5
    return [way_up * ((1 << 31) + k * step) for k in range(-20, 21)]


@pytest.mark.parametrize("bits", BITS)
@pytest.mark.parametrize("way_up", [1, -1])
def test_counts_go_on_by_what_the_shaft_has_turned(bits: int, way_up: int) -> None:
    increments = (1 << bits) / COUNTS_PER_TURN
    bus, image = DrivesBus(transport(increments), clock=lambda: 0), make_image()
    positions, counts = way(bits, way_up), []
    for position in positions:
        bus._drives[0].hear(ENABLED, shown(position))
        bus._fill(image, 0)
        counts.append(int(image[IMAGE_ENC_COUNT]))
    steps = (np.diff(counts) + 0x8000) % 0x10000 - 0x8000
    assert np.abs(steps - np.diff(positions) / increments).max() <= 1.0


@pytest.mark.parametrize("bits", BITS)
@pytest.mark.parametrize("way_up", [1, -1])
def test_a_target_stays_as_near_to_the_position_as_the_reference_is(bits: int, way_up: int) -> None:
    increments = (1 << bits) / COUNTS_PER_TURN
    setpoints, drive = PositionSetpoints(transport(increments)), DriveFeedback(0)
    for position in way(bits, way_up):
        drive.hear(0, shown(position))
        assert setpoints.value(0, drive, False) == shown(position)  # not in operation: it is told where it is
        drive.hear(ENABLED, shown(position))
        reference = round((position / increments + 3.0) * REFERENCE_PER_COUNT)  # three counts ahead
        setpoints.take(OP_REFERENCE, 0, reference & 0xFFFFFFFF)
        ahead = shown(setpoints.value(0, drive, True) - position)
        assert ahead == pytest.approx(3.0 * increments, abs=increments)


DEPLOYMENT = """
[[arm]]
name = "left"
robot = "puma560"
bridge = {{ port = 5600 }}
servo = {{ board_timeout_ms = 10 }}
[arm.board]
kind = "drives"
[arm.board.drives]
mode = "position"
absolute = {absolute}
nodes = [1, 2, 3, 4, 5, 6]
increments_per_count = [8388.608, 8388.608, 8388.608, -8388.608, 8388.608, 8388.608]
counts_at_zero = [{first}, 0, 0, 0, 0, 0]
"""


@pytest.mark.parametrize("end", [0, 1])
def test_a_joint_over_whose_range_an_absolute_position_begins_anew_is_refused(tmp_path: Path, end: int) -> None:
    robot, holds = load_robot("puma560"), int(2**31 / 8388.608)
    limit = float(counter_ends(robot.limits, robot.guard, robot.transmission)[1 - end][0])
    sign = (-1, 1)[end]
    for inside, fits in ((2, True), (-2, False)):
        first = round(limit + sign * (holds - inside))
        file = tmp_path / "cell.toml"
        file.write_text(DEPLOYMENT.format(absolute="true", first=first))
        (arm,) = load_deployment(str(file)).arm
        if fits:
            check_drives(arm)
            continue
        with pytest.raises(ConfigError, match=re.escape("counts_at_zero of left: the position of joint 1's drive")):
            check_drives(arm)
