"""A program that runs: its calls, where each of them is, what it waits for, and its reactions to signals."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Final, NamedTuple, TypeAlias

from qrobot.arrays import Floats
from qrobot.config import Robot
from qrobot.errors import ProgramError
from qrobot.val import tree
from qrobot.val.evaluate import Surroundings, evaluate, indices_of
from qrobot.val.machine import CellKey, Cells, Machine, NextMotion
from qrobot.val.structure import jumps_of
from qrobot.val.values import JointLocation, Transformation, ValValue
from qrobot.val.vocabulary import taken

DEEPEST_CALL: Final = 100  # [A]
ValueSlot: TypeAlias = tuple[Cells, CellKey]
"""Where the value of a variable is kept: among which others, and by which key."""
Until: TypeAlias = Callable[[], bool]
Waits: TypeAlias = Iterator[Until]
"""What an instruction waits for, one after the other."""


class StepUnderWay(NamedTuple):
    """A step that waits: see the attributes of `ValTask`."""

    doing: Waits | None
    until: Until | None
    at: tuple[str, int, int]
    last: tuple[CallFrame, int] | None


@dataclass
class CallFrame:
    """One call of a program.

    Attributes:
        program: which one.
        pc: the step to come, from 0.
        bindings: the variables that its parameters stand for; those that only this call has end with it.
        loops: last value and step of each FOR under way, by its step.
        again: the FOR that its END has just led back to.
        interrupted: the caller's step that goes on afterwards, None for none.
        priority_before: of the task that a reaction has interrupted; None for a call.
        asked_before: of the next motion, by the program that a reaction has interrupted; None for a call.
    """

    program: tree.ValProgram
    pc: int = 0
    bindings: dict[str, ValueSlot] = field(default_factory=dict)
    loops: dict[int, tuple[float, float]] = field(default_factory=dict)
    interrupted: StepUnderWay | None = None
    again: int = -1
    priority_before: int | None = None
    asked_before: NextMotion | None = None

    def __post_init__(self) -> None:
        self.jumps, errors = jumps_of(self.program)
        if errors:
            raise ProgramError(f"program {self.program.name}, {errors[0]}")


@dataclass(frozen=True)
class Watch:
    """A reaction that waits for its signal.

    Attributes:
        program: called when it comes.
        priority: of that call.
        at_once: the arm is stopped first (REACTI).
    """

    program: str
    priority: int
    at_once: bool


class ValTask:
    """One program under way, with all that it calls. An expression is evaluated in it: see `Surroundings`.

    Args:
        machine: shared by all.
        program: its name.
        moves: it may move the arm; process control programs may not.
        cycles: how often it is run; negative for ever.
        step: to begin at, from 0.

    Attributes:
        frames: calls, the innermost last; empty when it is over.
        at: program, line and column of the step under way, or that was begun last.
        last: its call, and its number there.
        doing, until: what the step waits for.
        watches: reactions by signal number, negative for one that goes off.
        seen: whether each of these signals was there when it was looked at last.
        pending: those that have come, and whose reaction is still to be called.
        on_error: program that REACTE has named; empty for none.
        priority: no reaction of this priority or below interrupts it.
    """

    def __init__(self, machine: Machine, program: str, moves: bool = True, cycles: int = 1, step: int = 0) -> None:
        self.machine = machine
        self.name = program
        self.moves = moves
        self.cycles = cycles
        self.frames: list[CallFrame] = []
        self.at: tuple[str, int, int] = (program, 0, 0)
        self.last: tuple[CallFrame, int] | None = None
        self.doing: Waits | None = None
        self.until: Until | None = None
        self.watches: dict[int, Watch] = {}
        self.seen: dict[int, bool] = {}
        self.pending: set[int] = set()
        self.on_error = ""
        self.priority = 0
        self._run_signal = 0
        self.call(program, ())
        if not 0 <= step <= len(self.frames[0].program.lines):
            raise ProgramError(f"program {program} has steps 1 to {len(self.frames[0].program.lines)}")
        self.frames[0].pc = step

    @property
    def over(self) -> bool:
        """Whether the task has nothing left to do."""
        return not self.frames and self.doing is None

    @property
    def frame_now(self) -> CallFrame:
        """The innermost call."""
        return self.frames[-1]

    def set_run_signal(self, number: int) -> None:
        """RUNSIG: on while the program runs; 0 for none. Raises as `Machine.set_signal`: then it is the one before."""
        if number:
            self.machine.set_signal(number)
        if self._run_signal != number:
            self.show_running(False)
        self._run_signal = number

    def show_running(self, on: bool) -> None:
        """Switch the signal that RUNSIG has named, when the program begins to run, and when it does no more."""
        if self._run_signal:
            self.machine.set_signal(self._run_signal if on else -self._run_signal)

    # ----------------------------------------------------------------------------------------------------- reactions

    def watch(self, number: int, watch: Watch) -> None:
        """Have a signal call a program when it comes, at once if it is there; what was pending of it is forgotten."""
        self.ignore(number)
        self.watches[number], self.seen[number] = watch, False

    def ignore(self, number: int) -> None:
        """End a reaction."""
        self.watches.pop(number, None)
        self.pending.discard(number)

    # ------------------------------------------------------------------------------------------------------- calling

    def call(self, name: str, arguments: Sequence[tree.Expression | None]) -> None:
        """Begin a program. Raises ProgramError: there is none, too many arguments, or calls too deep."""
        program = self.machine.programs.get(name)
        if program is None:
            raise ProgramError(f"there is no program {name}")
        if len(arguments) > len(program.parameters):
            raise ProgramError(f"program {name} has {len(program.parameters)} parameters, not {len(arguments)}")
        if len(self.frames) >= DEEPEST_CALL:
            raise ProgramError(f"calls are {DEEPEST_CALL} deep: program {name} calls itself without end")
        own: Cells = {}
        bindings = {}
        given = [*arguments, *[None] * (len(program.parameters) - len(arguments))]
        for parameter, argument in zip(program.parameters, given, strict=True):
            bindings[parameter] = self._bound(parameter, argument, own)
        self.frames.append(CallFrame(program, bindings=bindings))

    def interrupt(self, name: str, priority: int) -> None:
        """Call a program between steps, or in the middle of one that waits; the task has `priority` until its end."""
        self.call(name, ())
        self.frames[-1].priority_before, self.priority = self.priority, priority
        if self.doing is not None:
            self.frames[-1].interrupted = StepUnderWay(self.doing, self.until, self.at, self.last)
        self.doing = self.until = None

    def keep_next_motion(self) -> None:
        """Keep what has been asked of the next motion for the program that a reaction has just interrupted."""
        self.frame_now.asked_before = self.machine.asked_of_next
        self.machine.ask_nothing_of_next()

    def return_(self) -> None:
        """End the innermost call."""
        frame, self.doing, self.until = self.frames.pop(), None, None
        if frame.interrupted is not None:
            self.doing, self.until, self.at, self.last = frame.interrupted
        if frame.priority_before is not None:
            self.priority = frame.priority_before
        if frame.asked_before is not None:
            self.machine.behind_reaction(frame.asked_before)
        if not self.frames:
            self.priority = 0

    def _bound(self, parameter: str, argument: tree.Expression | None, own: Cells) -> ValueSlot:
        """The variable that a parameter stands for: the caller's for a variable, else one of the call's `own`."""
        if isinstance(argument, tree.VariableName) and not taken(argument.name):
            return self._slot(argument.name, indices_of(argument, self))
        if argument is not None:
            own[parameter, ()] = evaluate(argument, self.around)
        return own, (parameter, ())

    # ------------------------------------------------------------------------------------------------------ variables

    @property
    def around(self) -> Surroundings:
        """This task, as what expressions are evaluated in."""
        return self

    @property
    def robot(self) -> Robot:
        """See `Surroundings`."""
        return self.machine.robot

    def store(self, variable: tree.VariableName, value: ValValue) -> None:
        """Give a variable a value. Raises ProgramError: it is a name of the language, or of the other kind."""
        cells, key = self._slot(variable.name, indices_of(variable, self))
        if refusal := taken(key[0]):
            raise ProgramError(refusal)
        if key[0].startswith("#") != isinstance(value, JointLocation):
            raise ProgramError("a precision point has a # in front, other locations and numbers have none")
        cells[key] = value

    def _slot(self, name: str, indices: tuple[int, ...]) -> ValueSlot:
        """The slot of a variable's value; parameters lead to the caller's."""
        bound = self.frames[-1].bindings.get(name) if self.frames else None
        if bound is None:
            return self.machine.values, (name, indices)
        cells, (stored, outer) = bound
        return cells, (stored, (*outer, *indices))

    def value(self, name: str, indices: tuple[int, ...]) -> ValValue | None:
        """See `Surroundings`."""
        cells, key = self._slot(name, indices)
        return cells.get(key)

    def frame(self, name: str) -> Floats:
        """See `Surroundings`."""
        return self.machine.frame(name)

    def signal_is_on(self, number: int) -> bool:
        """See `Surroundings`."""
        return self.machine.signal_is_on(number)

    def number_function(self, name: str, arguments: Sequence[float]) -> float:
        """See `Surroundings`."""
        return self.machine.number_function(name, arguments)

    def pose_of(self, location: Transformation | JointLocation) -> Floats:
        """See `Surroundings`."""
        return self.machine.pose_of(location)

    def reaches(self, location: Transformation | JointLocation) -> bool:
        """See `Surroundings`."""
        return self.machine.reaches(location)
