"""Control of an emulated arm that may still be falling: an arm without power moves the joints that have no brakes."""

from __future__ import annotations

from functools import partial
from typing import Final

from qrobot import rccl
from qrobot.errors import ServoFault
from qrobot.faultcodes import FaultCode
from qrobot.rig.lockstep import LockstepRig, link_factory

FALL_S: Final = 10.0  # [A] of 12 Stanford arms drawn at random the slowest wrist took 7 s


def control_at_rest(rig: LockstepRig, robot_file: str, period_us: int) -> rccl.Channel:
    """A channel to an arm in lock-step. One that the servo will not power as it moves is given time to come to rest.

    An emulated arm begins at a pose, at rest; with little friction its wrist falls from there, as the real one would.

    Args:
        rig: the arm and its servo, which wait for nobody. robot_file, period_us: of the program.

    Raises:
        ServoFault: the servo does not power it for another reason, or it still moves.
    """
    with rccl.use(partial(link_factory, rig, period_us)):
        try:
            return rccl.control(robot_file)
        except ServoFault as fault:
            if fault.code != FaultCode.MOVING_AT_START:
                raise
            rig.run_for(FALL_S)
            return rccl.control(robot_file)
