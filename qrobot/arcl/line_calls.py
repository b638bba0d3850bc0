"""Calls of a robot about what it does beside its motions: gripper, lines, analogue channels, load, collisions."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from contextlib import AbstractContextManager
from math import inf, nan
from typing import Final

from qrobot.arcl.events import Grip
from qrobot.arcl.machine import MachineSample, RobotMachine
from qrobot.arcl.machine.digital import check_analog, set_bits
from qrobot.arrays import Floats
from qrobot.config import Robot
from qrobot.config.signals import N_BOARD_INPUTS, NamedSignal, no_output
from qrobot.errors import ConfigError, MotionError
from qrobot.rci.arguments import as_float, collision_of, payload_of, shown
from qrobot.rci.machine_choice import MachineChoice, choice_for
from qrobot.units import S_PER_MS

ANSWERED: Final = 4  # samples after which the newest one shows what was switched, or that it was not to be [A]


class LineCalls(ABC):
    """See above; `ArclRobot` is one.

    Attributes:
        name: of the arm.
        bridge: its address, where the program has named it by that; else empty.
        ami: the way to it.
    """

    name: str
    bridge: str
    ami: RobotMachine
    _robot: Robot

    def __init__(self) -> None:
        self._analog: dict[int, float] = {}
        self._switched: dict[int, tuple[int, float]] = {}  # of a line: its bit, and the time in ms

    @abstractmethod
    def _lock(self) -> AbstractContextManager[object]:
        """Held while motions are touched."""

    @property
    @abstractmethod
    def _seen(self) -> MachineSample:
        """The newest sample."""

    def gripper(self, command: int, value: float | None = None) -> None:
        """Command the gripper, now. Raises MotionError: no such command or value, or not for this gripper."""
        if isinstance(command, bool) or command not in set(Grip):
            raise MotionError(f"gripper: {command!r} is none of {', '.join(one.name for one in Grip)}")
        mm = _grip_value(Grip(command), value)
        with self._lock():
            self.ami.grip(command, mm)

    def write_outputs(self, first: int, count: int, value: int) -> None:
        """Switch `count` outputs from line `first` on to the bits of `value`. Raises MotionError: no such."""
        with self._lock():
            self.ami.write_outputs(first, count, value)
            now = 0.0 if self.ami.sample is None else self.ami.sample.t_ms
            self._switched |= {first + bit: (value >> bit & 1, now) for bit in range(count)}

    def write_analog(self, output: int, volts: float) -> None:
        """Let an analogue output of the deployment file, from 1, show `volts`, now.

        Raises MotionError: there is no such output, it does not show so much, or one before was refused.
        """
        check_analog(f"output {output} of {self.name}", volts, self._choice.analog_ranges.get(output))
        with self._lock():
            self.ami.write_analog(output, volts)
            self._analog[output] = float(volts)

    def analog_written(self, output: int) -> float:
        """Volts that this program has told an analogue output last; NaN before it has."""
        return self._analog.get(output, nan)

    def setload(self, kg: float, centre: Sequence[float] | None = None, inertia: Sequence[float] | None = None) -> None:
        """Tell the arm what its hand holds, and wait half a second until it reckons with that; it may be moving.

        A load stays when the program ends: `setload(0)` takes it away.

        Args:
            kg: mass.
            centre: of mass in the frame of the flange, mm; None for its origin. Shape (3,).
            inertia: about the centre along the axes of the flange, kg m^2: xx yy zz xy xz yz; None for a point.

        Raises:
            MotionError: the arm cannot carry it, or that is no load; nothing has changed then.
        """
        point = (0.0,) * 6
        with self._lock():
            load = payload_of(
                "setload", kg, point[:3] if centre is None else centre, point if inertia is None else inertia
            )
        self.ami.tell(load)

    def collision(self, reaction: str = "stop", thresholds: Sequence[float] | None = None) -> None:
        """Choose what follows a collision, and have collisions told sooner than the robot file does.

        Waits some samples.

        Args:
            reaction: "stop", the arm is held where it got to, or "comply", it is soft for two seconds before.
            thresholds: torque that nobody commanded, N m (N); None for the robot file's, which none may exceed. What
                accelerations may hide comes on top. They count until the program lets go of the arm. Shape (n,).

        Raises:
            MotionError: no such reaction, or thresholds that the arm does not take; nothing has changed then.
        """
        with self._lock():
            collision = collision_of("collision", self._robot, reaction, thresholds)
        self.ami.tell(collision)

    @property
    def lines(self) -> tuple[int, int]:
        """Inputs and outputs as they were at the newest sample, line 1 in bit 0.

        An output that was switched a moment ago is as it was switched: the sample cannot show it yet.
        """
        seen, outputs = self._seen, self._seen.outputs
        since = seen.t_ms - ANSWERED * self.ami.period_s / S_PER_MS
        for line, (bit, switched) in list(self._switched.items()):
            if switched >= since:
                outputs = set_bits(outputs, line, 1, bit)
        return seen.inputs, outputs

    @property
    def sensors(self) -> Floats:
        """Volts at the channels of the converter at the newest sample, NaN where not known. Shape (8,)."""
        return self._seen.sensors

    def check_wired(self, numbers: range, output: bool) -> None:
        """Raise MotionError for lines, from 1, to which nothing leads by the deployment file of the arm.

        Without one, as of a program that `qrobot run` has not started, nobody knows.
        """
        outputs = self._choice.outputs
        if outputs is None:
            return
        there = outputs if output else range(1, N_BOARD_INPUTS + 1)
        missing = [number for number in numbers if number not in there]
        if not missing:
            return
        if output:
            raise MotionError(f"new_iod: {no_output(f'output {missing[0]} of {self.name}', there)}")
        raise MotionError(
            f"new_iod: no line leads to input line {missing[0]} of {self.name}; there are lines 1 to {N_BOARD_INPUTS}, "
            "of the board, and modules stand for those"
        )

    def signal(self, name: str) -> NamedSignal:
        """The signal of that name in the deployment file. Raises ConfigError: there is none; tells which there are."""
        known = {each.name: each for each in self._choice.signals}
        if name in known:
            return known[name]
        if not known:
            raise ConfigError(
                f"{self.name} has no signal {name!r}, nor any other: name them by [[arm.signals]] of the deployment "
                "file, and start the program with `qrobot run` for this arm"
            )
        raise ConfigError(f"{self.name} has no signal {name!r}; it has {', '.join(sorted(known))}")

    @property
    def _choice(self) -> MachineChoice:
        """The choice of whoever started the program, as far as it is about this arm."""
        return choice_for(self.name, self.bridge)


def _grip_value(command: Grip, value: object) -> float:
    """Millimetres of a command that has some; 0 for the others, behind which nothing or a final 0 stands."""
    if command not in (Grip.GRIP_CLOSE_BY, Grip.GRIP_OPEN_BY):
        if value is None or (isinstance(value, int | float) and value == 0):
            return 0.0
        raise MotionError(f"gripper: {command.name} takes no value, not {shown(value)}")
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0.0 <= as_float(value) < inf:
        raise MotionError(f"gripper: {command.name} needs millimetres from 0 on, not {shown(value)}")
    return float(value)
