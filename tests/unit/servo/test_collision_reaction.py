"""Collisions that are told sooner, and an arm that gives way to what it has met."""

from __future__ import annotations

import numpy as np
import pytest

from qrobot.config import load_robot
from qrobot.faultcodes import FaultCode
from qrobot.hwif.board_memory import PANEL_MICRO
from qrobot.modecodes import Mode
from qrobot.servo.event import report_fault
from qrobot.servo.operator.motion_requests import REACTIONS
from qrobot.servo.stages.collision_stop import COMPLY_NS, SOFT
from tests.support.dead_encoder import reference
from tests.support.pressing import tip_down
from tests.support.servo_bench import ServoBench, moving
from tests.support.tables import contact_force
from tests.system.test_table_collisions import PLACES, TOP, CollidingArm

ROBOT = load_robot("puma560")
USUAL = ROBOT.guard.unexplained_torque_or_default
SLOWLY = 0.03  # m/s


def meet_the_table(thresholds: tuple[float, ...], reaction: str) -> tuple[CollidingArm, list[FaultCode], float]:
    """The arm comes down on a table; itself, the codes told and the largest force on the way, N."""
    x, y, _ = PLACES["down"]
    one = CollidingArm(x, y, 0.01)
    one.rig.mailbox.request_collision(thresholds, REACTIONS.index(reaction))
    forces = []

    def path(t: float) -> np.ndarray:
        forces.append(float(np.abs(contact_force(one.rig.emulator)).max()))
        return tip_down(x, y, TOP + 0.01 - reference(SLOWLY, t), one.scene) - one.start

    return one, one.follow(path, 0.11 / SLOWLY), max(forces)


def test_a_lower_threshold_tells_a_collision_with_less_force() -> None:
    late, codes, most = meet_the_table((), "stop")
    soon, sooner_codes, less = meet_the_table(tuple((0.35 * USUAL).tolist()), "stop")
    assert codes == sooner_codes == [FaultCode.COLLISION]
    assert less < 0.6 * most
    assert late.mode is soon.mode is Mode.HOLDING


@pytest.mark.parametrize("reaction", REACTIONS)
def test_an_arm_that_complies_can_be_pushed_away_for_a_while_and_is_held_then(reaction: str) -> None:
    one, codes, _ = meet_the_table(tuple((0.35 * USUAL).tolist()), reaction)
    rig = one.rig
    assert codes == [FaultCode.COLLISION]
    complies = reaction == "comply"
    assert one.mode is (Mode.STOPPING if complies else Mode.HOLDING)
    met, push = rig.emulator.q.copy(), 40.0
    rig.board.panel.push[1] = -round(push * PANEL_MICRO)  # up, off the table, harder than the threshold
    rig.run_for(0.8)
    moved = met[1] - rig.emulator.q[1]
    free = (push - 1.3 * ROBOT.friction[ROBOT.control.friction_preset].coulomb_neg[1]) / (SOFT * ROBOT.control.kp[1])
    assert moved > 0.5 * free if complies else moved < 0.02
    if complies:
        rig.board.panel.push[1] = 0
        rig.run_for(COMPLY_NS * 1e-9)
        held = rig.emulator.q.copy()
        rig.board.panel.push[1] = -round(0.5 * push * PANEL_MICRO)
        rig.run_for(0.3)
        assert np.abs(rig.emulator.q - held).max() < 0.01
    assert one.mode is Mode.HOLDING
    assert not (rig.rows()["mode"] == Mode.FAULT).any()


def test_an_arm_that_gets_power_after_a_fault_has_ended_its_stop_gives_way_to_nothing() -> None:
    bench, joint = ServoBench(), 0
    bench.mailbox.request_collision((), REACTIONS.index("comply"))
    moving(bench, joint=joint, seconds=0.15)
    report_fault(bench.state, int(FaultCode.COLLISION), joint)
    bench.tick(2)
    assert bench.mode is Mode.STOPPING
    bench.before.clear()
    bench.estop_ok = False
    bench.tick(2)
    assert bench.mode is Mode.FAULT
    bench.estop_ok = True
    bench.mailbox.request_power(False)
    bench.mailbox.request_clear()
    bench.until(lambda: bench.mode is Mode.OFF)
    bench.hold()
    bench.follows = False
    bench.before.append(lambda _now: bench.q.__setitem__(joint, bench.q[joint] + 1e-3))
    bench.until(lambda: bench.mode is Mode.FAULT, 0.2)
    assert bench.fault is FaultCode.FOLLOWING
    assert abs(bench.q - bench.state.q_ref)[joint] < 1.1 * ROBOT.guard.following_error[joint]
