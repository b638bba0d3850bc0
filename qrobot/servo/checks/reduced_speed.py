"""Reduced speed (T1 of ISO 10218-1): the tool of an arm never moves faster than the deployment allows.

A setpoint that asks for more is not played (`servo.stages.setpoint_stream`), and the arm is stopped on its path: the
path is a program's, sampled at its own pace, and to follow it more slowly would only leave the setpoints behind. Beside
that the speed of the reference is judged in each cycle, and that of the measured motion, which a joint that is pushed
or driven by torque makes as well.
"""

from __future__ import annotations

from typing import Final

from qrobot.faultcodes import NO_JOINT
from qrobot.modecodes import Mode
from qrobot.realtime.jit import lean_kernel
from qrobot.servo.checks.tip_speed import check_tip_speed, tip_speed
from qrobot.servo.event import report_fault
from qrobot.servo.modes import gives_torque
from qrobot.servo.parameters import ServoParameters
from qrobot.servo.state import ServoState

UNCALIBRATED: Final = int(Mode.UNCALIBRATED)
CALIBRATING: Final = int(Mode.CALIBRATING)
REFERENCE_FACTOR: Final = 1.05  # [A] of the limit: between setpoints that keep it the path may be a little faster
MEASURED_FACTOR: Final = 1.2  # [A] of the limit: noise of the estimator, and a lag that is made up


@lean_kernel
def watch_tool(params: ServoParameters, state: ServoState) -> None:
    """Raise what the speed of the tool calls for, where reduced speed is in force and the arm knows where it is."""
    mode = state.mode
    if params.tool_speed <= 0.0 or not gives_torque(mode) or mode in (UNCALIBRATED, CALIBRATING):
        return
    chain, tip = params.dynamics.chain, (params.tip[0], params.tip[1], params.tip[2])
    asked = tip_speed(state.q_ref, state.v_ref, chain, tip)
    most = REFERENCE_FACTOR * params.tool_speed
    report_fault(state, check_tip_speed(asked, most), NO_JOINT, asked, most)
    most = MEASURED_FACTOR * params.tool_speed
    measured = tip_speed(state.q, state.v, chain, tip)
    report_fault(state, check_tip_speed(measured, most), NO_JOINT, measured, most)
