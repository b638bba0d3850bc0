"""Laws that turn bad only in the cycle, on the way, where no trial has seen them: the arm is made safe, and answers.

Both laws are tried, taken, and then wait for two thousand cycles and for motion before they show what they are.
"""

from __future__ import annotations

import os
import signal
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

from qrobot.errors import LinkError, QRobotError, ServoFault
from qrobot.faultcodes import FaultCode
from qrobot.hwif.registers import DAC, DAC_ZERO, DISCRETE, DISCRETE_POWER
from qrobot.modecodes import Mode
from qrobot.servo.operator.client import ServoClient
from tests.support.patience import STALL_MS, wait_until
from tests.support.processes import GUARDIAN_MS, RunningArm

pytestmark = pytest.mark.realtime

SAFE_NS = round((1.2 * GUARDIAN_MS + STALL_MS) * 1e6)  # the guardian's bound, and what a busy machine adds
BAD_FROM = 0.3  # rad/s of the waist, as in the laws
LAWS = """
from qrobot.servo.laws.law import law

@law
def hangs(q_ref, v_ref, a_ref, q, v, gravity, friction, sensors, gains, settings, memory, dt, tau):
    memory[0] += 1.0
    while 2000.0 < memory[0] < 1e9 and abs(v_ref[0]) > 0.3:
        memory[1] += 1.0
    for j in range(q.size):
        tau[j] = gains[0, j] * (q_ref[j] - q[j]) + gains[1, j] * (v_ref[j] - v[j]) + gravity[j]

@law
def dawdles(q_ref, v_ref, a_ref, q, v, gravity, friction, sensors, gains, settings, memory, dt, tau):
    memory[0] += 1.0
    if 2000.0 < memory[0] < 1e9 and abs(v_ref[0]) > 0.3:
        for k in range(500_000):
            memory[1] += 1.0 / (1.0 + memory[1])
    for j in range(q.size):
        tau[j] = gains[0, j] * (q_ref[j] - q[j]) + gains[1, j] * (v_ref[j] - v[j]) + gravity[j]
"""


@pytest.fixture
def laws(tmp_path: Path) -> Path:
    """A file with a law that hangs, and one that takes several periods."""
    path = tmp_path / "late.py"
    path.write_text(LAWS)
    return path


def fail_on_the_way(arm: RunningArm, law: str, told: str) -> None:
    """Put a law in force, begin a motion of the waist, and lose the arm; the program is `told` why."""
    with ServoClient(arm.name) as commander:
        commander.power_on()
        tick = commander.change_law(law).tick
        wait_until(lambda: commander.status().tick > tick + 2500, "cycles with the law")
    with pytest.raises((ServoFault, LinkError), match=told):
        go_to_the_end(arm)


def go_to_the_end(arm: RunningArm) -> None:
    """A leg in which the waist is faster than both laws bear."""
    with arm.control() as channel:
        channel.setjvel(1.05)
        channel.move(channel.pose("end"))
        channel.waitfor(channel.completed)


@pytest.mark.starves_others
def test_a_law_that_hangs_on_the_way_loses_torque_and_power_and_the_arm_still_answers(
    arm: RunningArm, laws: Path
) -> None:
    # With one processor the bridge does not run either, until the loop has lost its priority.
    fail_on_the_way(arm, f"{laws}:hangs", "the servo of .* does not run|the bridge at .* has fallen silent")
    wait_until(lambda: not arm.powered, "power off")
    last = arm.telemetry()[-1]
    assert abs(last["v_ref"][0]) > 0.9 * BAD_FROM  # it hung on the way: no cycle came after this one
    assert safe_ns(arm) - int(last["t_ns"]) < SAFE_NS
    with ServoClient(arm.name) as visitor:
        for ask in (visitor.stop, visitor.power_off, visitor.status):
            status = ask()
            assert (status.mode, status.fault, status.powered) == ("FAULT", FaultCode.GUARD_TRIP, False)
        with pytest.raises(QRobotError, match="does not run"):
            visitor.clear()
    servo = arm.running()["servo"]
    wait_until(lambda: not real_time_threads(servo), "the loop leaves the processor to others")
    os.kill(servo, signal.SIGTERM)
    wait_until(lambda: "servo" not in arm.running(), "the servo is left where it hangs")
    assert "is left where it hangs" in arm.said("servo")
    assert not arm.powered
    arm.processes.start("servo")
    with arm.swinging(0.3):
        assert arm.mode is Mode.TRACKING


def real_time_threads(process: int) -> list[int]:
    """Threads under SCHED_FIFO; there are none where that is not allowed."""
    found = []
    for thread in map(int, os.listdir(f"/proc/{process}/task")):
        with suppress(ProcessLookupError):  # it has ended meanwhile, as those that answer requests do
            if os.sched_getscheduler(thread) & ~os.SCHED_RESET_ON_FORK == os.SCHED_FIFO:
                found.append(thread)
    return found


def safe_ns(arm: RunningArm) -> int:
    """When power was off and all DACs had been set to zero torque for the last time, by the board's clock."""
    trace = arm.trace()
    off = trace[(trace[:, 2] == DISCRETE) & ((trace[:, 3] & DISCRETE_POWER) == 0)]
    driven = trace[(trace[:, 2] >= DAC) & (trace[:, 3] != DAC_ZERO)]
    began_ns = int(driven[-1, 0])
    return int(off[off[:, 0] >= began_ns][0, 0])


def test_a_law_that_takes_several_periods_is_replaced_and_the_arm_stopped_on_its_path(
    arm: RunningArm, laws: Path
) -> None:
    fail_on_the_way(arm, f"{laws}:dawdles", "LAW_SLOW")
    arm.wait_for(Mode.FAULT)
    rows = arm.telemetry()
    stop = rows[np.flatnonzero(rows["mode"] == Mode.STOPPING)]
    assert stop.size
    speeds = np.abs(stop["v_ref"]).max(axis=1)
    assert speeds.max() > BAD_FROM
    assert speeds[-1] < BAD_FROM / 6
    assert np.abs(stop["q_ref"] - stop["q"]).max() < 0.1
    assert np.abs(stop["v"][-1]).max() < 0.1
    with ServoClient(arm.name) as commander:
        assert commander.clear().mode == "OFF"
        wait_until(lambda: commander.status().law == "qrobot", "the law before it is in force again")
