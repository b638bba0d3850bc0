"""The global variables of RCCL in a C program: what the engine shows there, and what it finds."""

from __future__ import annotations

import math
import threading
from collections.abc import Sequence
from typing import Final

import numpy as np

from qrobot.c_transport.assigned_code import AssignedCode
from qrobot.c_transport.memory import ProgramMemory
from qrobot.config.outputs import ALL_OUTPUTS
from qrobot.model.arm import Arm
from qrobot.motion import TransformKind
from qrobot.rccl.c.shared import CHG, HOW, SharedTransform
from qrobot.rccl.channel import Channel

MILLI: Final = 1e3
ADC_NONE: Final = -(1 << 31)  # of rccl.h
LARGEST_READING: Final = 2e6  # N or N m that fit into an int of thousandths


def reading(value: float) -> int:
    """Reading of `how.adcr` for a force or torque in N or N m: thousandths, ADC_NONE for NaN."""
    if math.isnan(value):
        return ADC_NONE
    return round(MILLI * min(max(value, -LARGEST_READING), LARGEST_READING))


class Variables:
    """The variables of one program.

    Args:
        memory: where they are.
        places: of nextmove, completed, nbrequest, terminate, how, chg.
        t6: place of the fields of T6.

    Attributes:
        t6: where the last link was measured.
        adc_channel: which component of the wrist sensor `how.adcr` shows.
    """

    def __init__(self, memory: ProgramMemory, places: Sequence[int], t6: int) -> None:
        *flags, how, chg = places
        nextmove, self._completed, self._nbrequest, self._terminate = map(memory.ints, flags)
        self._nextmove = AssignedCode(nextmove)
        self._how, self._chg = memory.record(how, HOW)[0], memory.record(chg, CHG)[0]
        self.t6 = SharedTransform("T6", TransformKind.UNKNOWN, memory.reals(t6, 12))
        self.adc_channel = 0
        self._shown_ns = -1
        self._arm: Arm | None = None
        self._hand = 0  # of the program and of the command when they were compared last
        self._comparing = threading.Lock()

    def show(self, channel: Channel) -> None:
        """The state of the arm, once for each sample."""
        how = channel.how
        if how.t_ns == self._shown_ns:
            return
        self._shown_ns = how.t_ns
        n = channel.robot.n
        shown = self._how
        shown["n"], shown["mode"], shown["flags"] = n, how.mode, how.flags
        shown["inputs"], shown["hand"], shown["outputs"] = how.inputs, how.hand, how.outputs
        shown["time"] = channel.time
        for name in ("q", "v", "tau", "q_setpoint"):
            shown[name][:n] = getattr(how, name)
        shown["force"], shown["adcr"] = how.force, reading(how.force[self.adc_channel])
        if self._arm is None or self._arm.robot is not channel.robot:
            self._arm = Arm(channel.robot)
        self.t6.set(self._arm.forward(np.array(how.q)))

    def show_queue(self, channel: Channel | None) -> None:
        """Show the motions that wait; none when no arm is under control."""
        self._completed[0] = 1 if channel is None else int(channel.completed.count > 0)
        self._nbrequest[0] = 0 if channel is None else channel.nbrequest

    def show_command(self, channel: Channel) -> None:
        """Show the joints of the next command to functions that change it."""
        chg, shown, n = channel.chg, self._chg, channel.robot.n
        shown["modes"][:n], shown["setpoints"][:n] = chg.modes, chg.setpoints

    def take_command(self, channel: Channel) -> None:
        """Take the joints as these functions have left them."""
        chg, shown, n = channel.chg, self._chg, channel.robot.n
        chg.modes, chg.setpoints = tuple(shown["modes"][:n].tolist()), tuple(shown["setpoints"][:n].tolist())

    def begin_outputs(self, channel: Channel) -> None:
        """The outputs that the arm was taken with, beside those that the program has set already; and its hand."""
        self._chg["outputs"] |= channel.chg.outputs
        if int(self._chg["hand"]) == self._hand:  # it has said nothing of it
            self._chg["hand"] = channel.chg.hand
        self._hand = channel.chg.hand

    def take_outputs(self, channel: Channel) -> None:
        """Take what the program wants of outputs and hand: it may say so anywhere. Of the hand OPEN and CLOSE do
        too."""
        channel.chg.outputs = int(self._chg["outputs"]) & ALL_OUTPUTS  # a C program may set all bits of an int
        with self._comparing:
            asked = int(self._chg["hand"])
            if asked != self._hand:
                channel.chg.hand = asked
            elif asked != channel.chg.hand:
                self._chg["hand"] = channel.chg.hand
            self._hand = channel.chg.hand

    def take_nextmove(self) -> int:
        """Take what the program has put into `nextmove`, which is 0 then."""
        return self._nextmove.take()

    @property
    def terminate(self) -> bool:
        """The program wants to end."""
        return bool(self._terminate[0])
