"""A manipulator of a C program, as the program sees it."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from typing import Final

import numpy as np

from qrobot.c_transport.assigned_code import AssignedCode
from qrobot.c_transport.memory import ProgramMemory, SharedPose
from qrobot.config.outputs import ALL_OUTPUTS
from qrobot.errors import MotionError
from qrobot.multi_rccl.manip import Manip
from qrobot.multi_rccl.robot_manip import RobotManip
from qrobot.wire.vocabulary import MAX_JOINTS

STATE: Final = np.dtype(
    [
        *((name, np.int32) for name in ("n", "mode", "flags")),
        *((name, np.uint32) for name in ("inputs", "outputs")),
        *((name, np.int32) for name in ("completed", "nbrequest", "nextmove")),
    ]
)
"""The integers of `struct manip` of rccl.h, from `n` on; `nextmove` is the last."""
INT: Final = 4  # bytes
NUMBERS_OF_TRANS: Final = 12
FORCES: Final = 6


class SharedManip:
    """Fields of `struct manip`, and the manipulator whose they are.

    Args:
        memory: shared with the program.
        place: of the structure.
        fields: where its integers, the numbers of its transform, its joints and its forces begin.
        manip: the manipulator.

    Attributes:
        manip: as given.
    """

    def __init__(self, memory: ProgramMemory, place: int, fields: Sequence[int], manip: Manip) -> None:
        integers, trans, joints, force = (place + field for field in fields)
        self.manip = manip
        self._state = memory.record(integers, STATE)[0]
        self._nextmove = AssignedCode(memory.ints(integers + STATE.itemsize - INT))
        self._pose = SharedPose(memory.reals(trans, NUMBERS_OF_TRANS))
        self._joints, self._force = memory.reals(joints, MAX_JOINTS), memory.doubles(force, FORCES)
        self._showing = threading.Lock()  # the threads of all arms show all manipulators

    def show(self) -> None:
        """Show the program its newest state."""
        manip = self.manip
        with self._showing:
            self._pose.value = manip.trans.value
            self._state["completed"] = int(manip.completed.count > 0)
            self._state["nbrequest"] = manip.waiting
            if isinstance(manip, RobotManip) and manip.on:
                self._show_arm(manip)

    def _show_arm(self, arm: RobotManip) -> None:
        how, state, joints = arm.channel.how, self._state, arm.j6
        state["n"], state["mode"], state["flags"], state["inputs"] = len(joints), how.mode, how.flags, how.inputs
        self._joints[: len(joints)] = joints
        self._force[:] = how.force

    def begin_outputs(self, arm: RobotManip) -> None:
        """The outputs that the arm was taken with, beside those that the program has set already."""
        self._state["outputs"] |= arm.channel.chg.outputs

    def take_outputs(self, arm: RobotManip) -> None:
        """Take what the program wants of the outputs: it may say so anywhere, and set all bits of an int."""
        arm.channel.chg.outputs = int(self._state["outputs"]) & ALL_OUTPUTS

    def take_nextmove(self) -> int:
        """Take what the program has put into `nextmove`, which is 0 then.

        Raises MotionError: the code is negative.
        """
        code = self._nextmove.take()
        if code < 0:
            raise MotionError(f"nextmove = {code}: the code must be positive, or it could not be told from our own")
        return code
