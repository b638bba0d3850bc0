"""The transports to a board side by side: none changes anything, and the page that says so shows what is measured."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import numpy as np
import pytest

from qrobot.config import load_robot
from qrobot.rig.lockstep import LockstepRig
from qrobot.servo.memory.setpoint_queue import POSITION_SETPOINT
from qrobot.servo.settings import ServoSettings
from qrobot.sim_board.emulator import Emulator
from tests.support.transport_comparison import TRANSPORTS, TransportRun, run_over

DOCS = Path(__file__).parents[2] / "docs"
sys.path.insert(0, str(DOCS))

from transports import PAGE, measure  # type: ignore[import-not-found]  # noqa: E402

ROBOT = load_robot("puma560")
RATE_HZ = 500.0
FRAME_NS, FRAMES = 28_000_000, 6
PUSH = np.array([0.002, 0.002, -0.002, 0.001, 0.001, 0.002])  # rad a frame, more in every frame


def fly(rig: LockstepRig) -> None:
    """Power on, once the potentiometers are heard, however long that takes, and get under way."""
    rig.run_for(1.0)
    rig.mailbox.request_power(True)
    rig.run_for(0.3)
    q = ROBOT.poses["park"].copy()
    for frame in range(FRAMES):
        q += PUSH * frame
        rig.mailbox.push_setpoint(1, frame, rig.now_ns, FRAME_NS, [POSITION_SETPOINT] * ROBOT.n, q.tolist())
        rig.run_for(FRAME_NS * 1e-9)


def over(transport: str, rate_hz: float = RATE_HZ) -> TransportRun:
    return run_over(transport, ROBOT, ServoSettings(rate_hz=rate_hz), Emulator(ROBOT, physics="rigid"), fly)


@pytest.fixture(scope="module")
def direct() -> TransportRun:
    return over("direct")


@pytest.mark.parametrize("transport", list(TRANSPORTS)[1:])
def test_a_transport_changes_no_setpoint_no_torque_word_and_no_position(transport: str, direct: TransportRun) -> None:
    seen = over(transport)
    assert (seen.fault, seen.digest) == (0, direct.digest)
    np.testing.assert_array_equal(seen.error, direct.error)


def test_another_rate_is_another_motion(direct: TransportRun) -> None:
    assert over("direct", 1000.0).digest != direct.digest


def test_the_errors_on_the_page_are_those_measured_and_hardly_depend_on_the_rate() -> None:
    part = re.search(r"<!-- measured: transports -->\n(.*?)<!-- end -->", PAGE.read_text(), re.DOTALL)
    assert part is not None
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in part[1].strip().splitlines()[2:]]
    errors = {int(rate): [float(cell) for cell in cells[:6]] for rate, *cells in rows}
    np.testing.assert_allclose(measure("direct", 1000).error * 1e3, errors[1000], atol=0.08, rtol=0.02)
    worst = [max(cells) for cells in errors.values()]
    assert sorted(errors) == [125, 250, 500, 1000, 2000, 4000]
    assert max(worst) < 1.1 * min(worst)
