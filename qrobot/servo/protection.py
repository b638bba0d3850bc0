"""Protections of the arm, in the order in which a cycle has them.

    inputs -> check_inputs -> requests -> reference -> check_reference -> law and check of its torque -> outputs

Each check reports a fault code (`servo.event`); the worst of them is acted upon at two places, before the law is called
and after its torque was checked (`servo.stages.mode_machine.apply_faults`). What a code does to the arm is its stop
category (`servo.stop_categories`). The guardian stands beside the cycle, a process of its own
(`servo.process.guardian`).

| looked at              | by                                             | in                                    |
|------------------------|------------------------------------------------|---------------------------------------|
| the time of the cycle  | `watch_timing`, called where time is taken     | `checks.timing_checks`                |
| the board's clock      | `follow_clock`, called where images are read   | `checks.board_clock`                  |
| image, estop, guardian | `watch_surroundings`                           | `stages.mode_machine`                 |
| encoders, speed, range | `watch_arm`                                    | `checks.limit_checks`, `lost_counts`  |
| fences                 | `watch_fences`                                 | `fences.gate`                         |
| other arms             | `watch_neighbours`                             | `neighbour`                           |
| motors, load, contact  | `watch_motors`                                 | `checks.motor_fault_diagnosis`        |
| encoders that stand    | `watch_motors`                                 | `checks.encoder_monitor`              |
| brakes                 | `watch_brakes`                                 | `checks.fault_monitors`               |
| remote modules         | `watch_modules`                                | `checks.fault_monitors`               |
| setpoints              | `take_frame`, each when it becomes a reference | `stages.setpoint_stream`              |
| following error        | `watch_following`                              | `checks.limit_checks`                 |
| the key, hold to run   | `watch_key`                                    | `checks.hold_to_run`                  |
| speed of the tool      | `watch_tool`                                   | `checks.reduced_speed`                |
| torque of the law      | `drive`                                        | `checks.limit_checks`, `laws`         |
"""

from __future__ import annotations

from typing import Any

from qrobot.realtime.jit import lean_kernel, part_kernel
from qrobot.servo.checks.fault_monitors import watch_brakes, watch_modules, watch_motors
from qrobot.servo.checks.fence_watch import watch_fences
from qrobot.servo.checks.hold_to_run import watch_key
from qrobot.servo.checks.neighbour_watch import watch_neighbours
from qrobot.servo.checks.reduced_speed import watch_tool
from qrobot.servo.parameters import ServoParameters
from qrobot.servo.stages.inputs import watch_arm, watch_following
from qrobot.servo.stages.mode_machine import watch_surroundings
from qrobot.servo.state import ServoState


@part_kernel
def check_inputs(params: ServoParameters, state: ServoState, mail: Any, now_ns: int) -> None:
    """Judge what the board says, and what the arm did under the torque of the cycles before."""
    watch_surroundings(params, state, mail, now_ns)
    watch_arm(params, state)
    watch_fences(params, state)
    watch_neighbours(params, state)
    watch_motors(params, state)
    watch_brakes(params, state, now_ns)
    watch_modules(state)


@lean_kernel
def check_reference(params: ServoParameters, state: ServoState, mail: Any) -> None:
    """Judge where the arm is about to be led, how far it is from there, and whether somebody still wants it to go."""
    watch_following(params, state)
    watch_key(params, state, mail)
    watch_tool(params, state)
