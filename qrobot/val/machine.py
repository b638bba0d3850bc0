"""The state that all programs share: variables, signals, timers, switches, frames, speeds, and the arm."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final, NamedTuple, TypeAlias

import numpy as np

from qrobot.arrays import Floats
from qrobot.errors import JointLimit, MotionError, ProgramError, TooFast, Unreachable
from qrobot.model.branch import Branch, branch_of
from qrobot.model.transform import inverse
from qrobot.val.arm import Destination, ValArm
from qrobot.val.number_ranges import FILES_OWN, TIMER
from qrobot.val.parser import parse_variable
from qrobot.val.signal_lines import SignalLines
from qrobot.val.source import SourceFile, constant_indices, stored_name
from qrobot.val.tree import NumberLiteral, ValProgram, VariableName
from qrobot.val.values import JointLocation, Transformation, ValValue, stored_location, stored_numbers
from qrobot.val.vocabulary import ANALOG_OUTPUTS, INPUTS, INTERNAL, OUTPUTS, SWITCHES
from qrobot.val.workspace import Workspace

DEFAULT_MONITOR_SPEED: Final = 50.0  # percent; V+'s, recalled
DEFAULT_HAND_TIME_S: Final = 0.5  # [A]
STRAIGHT_SHARE: Final = 0.9  # of the joints' limits at 100 %, for a straight line needs more where it is joined [A]
ROUNDED: Final = 0.99  # of a speed that is told to three digits, lest it be rounded up
_MULTIPLIER: Final = 6364136223846793005  # Knuth's 64-bit generator: RANDOM is the same in every run
_INCREMENT: Final = 1442695040888963407
_BITS: Final = 64

CellKey: TypeAlias = tuple[str, tuple[int, ...]]
Cells: TypeAlias = dict[CellKey, ValValue]
"""Values of variables, and of the elements of arrays, by name and indices."""


class NextMotion(NamedTuple):
    """Speed, configuration and hand that are asked of one motion to come.

    Attributes:
        speed: and whether it is in mm/s; None for that of the program.
        words: letters of the configuration; empty to keep it.
        hand: opened or closed as it begins; None to leave it.
    """

    speed: tuple[float, bool] | None
    words: str
    hand: bool | None


class Machine:
    """The controller under the interpreter.

    Args:
        arm: under control.
        say: is given each line that programs type.
        ask: gives the answer to a question of PROMPT.

    Attributes:
        lines: where outputs lead; None where that is not known, as off line: then every one is there.
        analog: volts that each analogue output was told last, which a stop may have ended since.
    """

    def __init__(self, arm: ValArm, say: Callable[[str], None], ask: Callable[[str], str]) -> None:
        self.arm = arm
        self.arm.override = DEFAULT_MONITOR_SPEED
        self.robot = arm.robot
        self.say = say
        self.ask = ask
        self.space = Workspace(arm.robot)
        self.programs: dict[str, ValProgram] = {}
        self.values: Cells = {}
        self.switches = {switch: switch in ("CP", "MESSAGES") for switch in SWITCHES}
        self.hand_time_s = DEFAULT_HAND_TIME_S
        self.collision_percent = FILES_OWN
        self.lines: SignalLines | None = None
        self.analog: dict[int, float] = {}
        self._internal: set[int] = set()
        self._timers: dict[float, float] = {}
        self._random = 1
        self.reset_manner()

    # ------------------------------------------------------------------------------------------- values and programs

    def load(self, source: SourceFile) -> None:
        """Take programs, locations and numbers of a file; those of the same name are replaced.

        Raises ProgramError, and takes nothing: a precision point is one of an arm with more or fewer joints.
        """
        places = {_key(name): stored_location(name, numbers, self.robot) for name, numbers in source.locations.items()}
        self.programs |= source.programs
        self.values |= places | {_key(name): number for name, number in source.numbers.items()}

    def source(self) -> SourceFile:
        """Everything that there is, for a file."""
        found = SourceFile(dict(self.programs))
        for (name, indices), value in sorted(self.values.items(), key=lambda item: item[0]):
            key = stored_name(VariableName(name, tuple(NumberLiteral(float(index)) for index in indices)))
            if isinstance(value, float):
                found.numbers[key] = value
            else:
                found.locations[key] = stored_numbers(value, self.robot)
        return found

    # --------------------------------------------------------------------------------------- what expressions ask for

    def frame(self, name: str) -> Floats:
        """See `Surroundings`."""
        match name:
            case "here":
                return self.space.tool_at(self.arm.q)
            case "dest":
                return self.destination_pose()
            case "tool":
                return self.space.tool
            case "base":
                return self.space.base
            case _:
                return np.eye(4)

    def signal_is_on(self, number: int) -> bool:
        """See `Surroundings`."""
        if number in OUTPUTS:
            return bool(self.arm.outputs >> (number - OUTPUTS.start) & 1)
        if number in INPUTS:
            return bool(self.arm.inputs >> (number - INPUTS.start) & 1)
        if number in INTERNAL:
            return number in self._internal
        raise ProgramError(no_signal(number))

    def set_signal(self, number: int) -> None:
        """Switch a signal on, or off for a negative number. Raises ProgramError: an input, without a line, or none."""
        if abs(number) in OUTPUTS:
            if self.lines is not None and (refusal := self.lines.refusal(abs(number))):
                raise ProgramError(refusal)
            self.arm.signal(number)
        elif abs(number) in INTERNAL:
            self._internal = self._internal - {abs(number)} | ({number} if number > 0 else set())
        elif abs(number) in INPUTS:
            raise ProgramError(f"signal {abs(number)} is an input: it cannot be switched")
        else:
            raise ProgramError(no_signal(number))

    def set_analog(self, output: int, volts: float) -> None:
        """Let an analogue output show `volts`. Raises ProgramError: no such output; MotionError: not so many volts."""
        if output not in ANALOG_OUTPUTS:
            raise ProgramError(no_analog_output(output))
        self.arm.analog(output, volts)
        self.analog[output] = volts

    def tell_collisions(self, percent: float, comply: bool) -> None:
        """Have the arm tell collisions at a share of the robot file's thresholds, and give way after one, or not.

        Raises MotionError: it does not; nothing has changed then.
        """
        thresholds = None if percent == FILES_OWN else percent / 100.0 * self.robot.guard.unexplained_torque_or_default
        self.arm.collision("comply" if comply else "stop", thresholds)
        self.collision_percent, self.switches["COMPLY"] = percent, comply

    def reset_signals(self) -> None:
        """Switch all outputs off."""
        self.arm.signal(*(-number for number in OUTPUTS))

    def number_function(self, name: str, arguments: Sequence[float]) -> float:
        """See `Surroundings`."""
        if name == "TIMER":
            return self.arm.time_s - self._timers.get(TIMER.check(arguments[0]), 0.0)
        if name == "SPEED":
            return self.arm.override if arguments[:1] == [1.0] else self.speed
        self._random = (self._random * _MULTIPLIER + _INCREMENT) % (1 << _BITS)
        return (self._random >> 11) / float(1 << 53)

    def set_timer(self, number: float, seconds: float) -> None:
        """Let a timer stand at `seconds` now. Raises ProgramError: no such timer."""
        self._timers[TIMER.check(number)] = self.arm.time_s - seconds

    def pose_of(self, location: Transformation | JointLocation) -> Floats:
        """See `Surroundings`."""
        return self.space.pose_of(location)

    def reaches(self, location: Transformation | JointLocation) -> bool:
        """See `Surroundings`."""
        return self.space.reaches(location)

    # ------------------------------------------------------------------------------------------------------- motions

    def reset_manner(self) -> None:
        """Restore the manner in which a program begins: full speed, no configuration asked for, where the arm is."""
        self.speed, self.in_mm_s = 100.0, False
        self.forget_next_motion()
        self.forget_destination()

    def forget_next_motion(self) -> None:
        """Forget what was asked of the next motion, by a program that has been given up, and by what is typed."""
        self.ask_nothing_of_next()
        self._aside: NextMotion | None = None

    def ask_nothing_of_next(self) -> None:
        """Let nothing be asked of the next motion: no speed, configuration or hand of its own."""
        self.next_speed: tuple[float, bool] | None = None
        self.words = ""
        self.hand_at_next: bool | None = None

    def set_aside(self) -> None:
        """Steps are typed while a program is paused: what it asked of its next motion stays for that; see `take_up`.

        Motions that are typed have the same speed and configuration, when no others are typed before; the hand waits.
        """
        if self._aside is None:
            self._aside, self.hand_at_next = self.asked_of_next, None

    @property
    def asked_of_next(self) -> NextMotion:
        """Speed, configuration and hand that have been asked of the next motion."""
        return NextMotion(self.next_speed, self.words, self.hand_at_next)

    def behind_reaction(self, asked: NextMotion) -> None:
        """A reaction has ended: what its program had `asked` counts again, and else what the reaction asked."""
        self.next_speed = asked.speed or self.next_speed
        self.words = asked.words or self.words
        self.hand_at_next = self.hand_at_next if asked.hand is None else asked.hand

    def take_up(self) -> None:
        """The program goes on, as it asked, or as was typed last for its next motion."""
        if self._aside is not None:
            self.hand_at_next = self._aside.hand if self.hand_at_next is None else self.hand_at_next
            self._aside = None

    def forget_destination(self) -> None:
        """The arm has been stopped: motions begin where it stands."""
        self._dest: Floats | None = None
        self._branch: Branch | None = None

    def destination_pose(self) -> Floats:
        """Pose in the world that the tool is going to, or has. Shape (4, 4)."""
        return self.space.tool_at(self.arm.setpoint) if self._dest is None else self._dest

    def go(
        self, name: str, location: Transformation | JointLocation, straight: bool, per_cent: float | None = None
    ) -> None:
        """Queue a motion with its own speed or that which was asked for, and the configuration.

        A straight line to a precision point goes to its pose, and does not change the configuration.
        Raises MotionError, ProgramError; what was asked for then stays for the next one.
        """
        asked = self.next_speed or (self.speed, self.in_mm_s)
        speed, in_mm_s = asked if per_cent is None else (per_cent, False)
        pose = self.pose_of(location)
        q = location.q if isinstance(location, JointLocation) else None
        before = self._branch_before()
        letters = self._letters(before, straight, q)
        fastest = STRAIGHT_SHARE if straight else 1.0
        share = fastest * min(1.0 if in_mm_s else speed / 100.0, 1.0)
        mm_s = speed if in_mm_s else None
        q = None if straight else q
        robot_pose = self.space.robot_pose(pose) if q is None else None
        destination = Destination(name, robot_pose, self.space.T_last_tool, q, straight, share, mm_s, letters)
        if not self.switches["DRY.RUN"]:
            self._move(destination)
        self._dest = pose
        self._branch = branch_of(letters, before) if q is None else self.space.branch(q)
        self.next_speed, self.words = (None, "") if self._aside is None else self._aside[:2]

    def go_again(self, destination: Destination) -> None:
        """Queue a motion that was interrupted; the next one begins where it leads. Raises MotionError."""
        before = self._branch_before()
        self.arm.move(destination)
        if destination.q is not None:
            self._dest, self._branch = self.space.tool_at(destination.q), self.space.branch(destination.q)
        if destination.T_robot_tool is not None:
            last = destination.T_robot_tool @ inverse(destination.T_last_tool)  # the tool may be another one by now
            self._dest = self.space.base @ last @ self.space.T_last_tool
            self._branch = branch_of(destination.letters, before)

    def _move(self, destination: Destination) -> None:
        """Queue a motion. Raises MotionError, with the speed or the configuration that would get there."""
        try:
            self.arm.move(destination)
        except TooFast as error:
            if not error.share:
                raise
            raise MotionError(f"{error.reason}; {_slower(destination, error.share)} or less gets there") from error
        except (JointLimit, Unreachable) as error:
            goal = destination.T_robot_tool
            branch = branch_of(destination.letters, self._branch_before())
            words = "" if goal is None else self.space.other_words(goal, self.arm.setpoint, branch)
            if not words:
                raise
            raise MotionError(f"{error}; {words} before a MOVE gets there") from error

    def _branch_before(self) -> Branch:
        """The configuration in which the next motion begins."""
        return self.space.branch(self.arm.setpoint) if self._branch is None else self._branch

    def _letters(self, before: Branch, straight: bool, q: Floats | None) -> str:
        """The configuration to ask for, of a motion to joint positions `q` (n,) or to a pose; empty to keep `before`.

        Raises ProgramError: it would change in a straight line.
        """
        asked = branch_of(self.words, before)
        if straight and (asked != before or (q is not None and self.space.branch(q) != before)):
            raise ProgramError("the configuration cannot change in a straight line; MOVE first")
        return asked.letters if self.words and not straight else ""


def _slower(destination: Destination, share: float) -> str:
    """The SPEED that is `share` of a motion's."""
    if destination.speed_mm_s is not None:
        return f"SPEED {ROUNDED * share * destination.speed_mm_s:.3g} MMPS"
    fastest = STRAIGHT_SHARE if destination.straight else 1.0
    return f"SPEED {ROUNDED * share * 100.0 * destination.share / fastest:.3g}"


def no_signal(number: int) -> str:
    """Words for a signal that there is not."""
    kinds = (("outputs", OUTPUTS), ("inputs", INPUTS), ("internal ones", INTERNAL))
    told = ", ".join(f"{name} {numbers.start} to {numbers.stop - 1}" for name, numbers in kinds)
    return f"there is no signal {abs(number)}; there are {told}"


def no_analog_output(number: float) -> str:
    """Words for an analogue output that there is not."""
    return f"there is no analogue output {number:g}; there are {ANALOG_OUTPUTS.start} to {ANALOG_OUTPUTS.stop - 1}"


def _key(name: str) -> CellKey:
    variable = parse_variable(name)
    return variable.name, constant_indices(variable)
