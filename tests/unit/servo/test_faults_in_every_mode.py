"""Which watch is on in which mode: what goes wrong brings its code in every mode in which the motors carry torque."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from qrobot.faultcodes import FaultCode
from qrobot.modecodes import Mode
from qrobot.servo.modes import TORQUE_ON
from tests.support.calibrating import PUMA, CalibratingRig
from tests.support.servo_bench import ServoBench, moving

LEAVES_RAD_S = 1.0  # below every limit of speed
Mishap = Callable[[ServoBench], object]


def in_mode(mode: Mode) -> ServoBench:
    """A bench in this mode, whose joint 2 stands next to the end of its range."""
    bench = ServoBench(guarded=True, calibrated=mode is not Mode.UNCALIBRATED)
    bench.q[1] = bench.robot.limits.q_max[1] - 2e-3
    if mode in (Mode.TRACKING, Mode.STOPPING):
        moving(bench, seconds=0.5)
    else:
        bench.hold().tick(20)
    if mode is Mode.STOPPING:
        bench.mailbox.request_stop()
        bench.until(lambda: bench.mode is mode)
    assert bench.mode is mode
    return bench


def becomes(name: str, value: object) -> Mishap:
    return lambda bench: setattr(bench, name, value)


def measures(joint: int, share: float) -> Mishap:
    """A speed of so much of a joint's limit is measured in each cycle."""

    def measure(bench: ServoBench) -> None:
        speed = share * bench.robot.limits.v_max[joint]
        bench.before.append(lambda _now: bench.state.v.__setitem__(joint, speed))

    return measure


def leaves(joint: int, by: float) -> Mishap:
    """A joint leaves its place by so much, rad; the others are where they are to be."""

    def leave(bench: ServoBench) -> None:
        bench.follows = False
        goal = bench.q[joint] + by
        most = LEAVES_RAD_S * bench.settings.period_ns * 1e-9

        def go(_now: int) -> None:
            place = bench.q[joint] + np.clip(goal - bench.q[joint], -most, most)
            bench.q = np.array(bench.state.q_ref)
            bench.q[joint] = place

        bench.before.append(go)

    return leave


F = FaultCode
CALIBRATED = TORQUE_ON - {Mode.UNCALIBRATED, Mode.CALIBRATING}  # the others know no range
WATCHES: list[tuple[Mishap, FaultCode, frozenset[Mode]]] = [
    (becomes("frozen", True), F.BOARD_GONE, TORQUE_ON),
    (becomes("estop_ok", False), F.ESTOP, TORQUE_ON),
    (becomes("panel", False), F.POWER_LOST, TORQUE_ON),
    (becomes("beating", False), F.GUARD_LOST, TORQUE_ON),
    (becomes("slip", {2: 200}), F.ENC_JUMP, TORQUE_ON),
    (measures(3, 2.2), F.RUNAWAY, TORQUE_ON),
    (measures(3, -2.2), F.RUNAWAY, TORQUE_ON),
    (measures(0, 1.55), F.VEL_LIMIT, TORQUE_ON),
    (measures(5, -1.55), F.VEL_LIMIT, TORQUE_ON),
    (leaves(2, 0.5), F.FOLLOWING, TORQUE_ON),
    (leaves(5, -0.5), F.FOLLOWING, TORQUE_ON),
    (leaves(1, 0.03), F.JOINT_LIMIT, CALIBRATED),
]


@pytest.mark.parametrize("mode", sorted(TORQUE_ON - {Mode.CALIBRATING}), ids=lambda mode: mode.name)
@pytest.mark.parametrize(("mishap", "code", "modes"), WATCHES)
def test_what_goes_wrong_cuts_the_power_in_every_mode_under_torque(
    mishap: Mishap, code: FaultCode, modes: frozenset[Mode], mode: Mode
) -> None:
    bench = in_mode(mode)
    mishap(bench)
    bench.run(0.4)
    if mode in modes:
        assert (bench.fault, bench.safe) == (code, True)
        assert set(bench.rows()["mode"][-400:]) <= {mode, Mode.STOPPING, Mode.FAULT}
    else:
        assert (bench.mode, bench.event) == (mode, F.NONE)


# ------------------------------------------------------------------------------------------- while power is waited for


@pytest.mark.parametrize(
    ("mishap", "code"),
    [(becomes("estop_ok", False), F.ESTOP), (becomes("beating", False), F.GUARD_LOST),
     (becomes("frozen", True), F.BOARD_GONE)],
)  # fmt: skip
def test_what_goes_wrong_while_power_is_waited_for_takes_the_request_back(mishap: Mishap, code: FaultCode) -> None:
    bench = ServoBench(guarded=True).wait_for_power()
    assert (bench.mode, bench.powered) == (Mode.POWERING, True)
    mishap(bench)
    bench.run(0.05)
    assert (bench.mode, bench.fault, bench.safe) == (Mode.FAULT, code, True)
    bench.estop_ok = bench.beating = bench.panel = True  # the button is pressed after all
    bench.frozen = False
    bench.run(0.5)
    assert (bench.mode, bench.safe) == (Mode.FAULT, True)


# ---------------------------------------------------------------------------------------------- while it is calibrated


@pytest.mark.parametrize("way", [-1, 1])
def test_an_arm_that_is_calibrated_is_watched_as_well(way: int) -> None:
    guard, limits = PUMA.guard, PUMA.limits
    fast, astray = CalibratingRig().calibrating(), CalibratingRig().calibrating()
    fast.state.v[3] = way * 2.2 * limits.v_max[3]
    astray.state.q_ref[4] += way * 1.01 * guard.following_error[4]
    for rig, code in ((fast, F.RUNAWAY), (astray, F.FOLLOWING)):
        assert rig.mode is Mode.CALIBRATING
        rig.ticks(1)
        assert (rig.mode, rig.event) == (Mode.FAULT, (code, 3 if rig is fast else 4))


BEGINNINGS = {Mode.UNCALIBRATED: CalibratingRig.powered, Mode.CALIBRATING: CalibratingRig.calibrating}


@pytest.mark.parametrize("line", ["dac:2 full", "dac:5 full -1", "estop pressed", "power drop"])
@pytest.mark.parametrize("mode", BEGINNINGS, ids=lambda mode: mode.name)
def test_what_breaks_before_an_arm_is_calibrated_and_meanwhile_costs_its_power(mode: Mode, line: str) -> None:
    rig = BEGINNINGS[mode](CalibratingRig())
    assert rig.mode is mode
    rig.emulator.faults.add(line)
    rig.run_for(0.3)
    assert rig.mode is Mode.FAULT
    assert not rig.emulator.powered
