"""Mistakes of a program that can be seen before anything moves.

Structures and labels, programs that are called and are not there, constant locations that the arm cannot reach, and
signals that there are not; names without a value, locations in place of numbers, numbers that a step does not take, and
process control programs that would move the arm. Of an arm with
fences also constant locations that are too near to one; where the lines of an arm are known, signals that have none.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import islice

import numpy as np

from qrobot.arrays import Floats
from qrobot.config import Robot
from qrobot.errors import ProgramError, QRobotError
from qrobot.fences.fence_set import FenceSet
from qrobot.model.transform import transform
from qrobot.units import M_PER_MM
from qrobot.val import tree
from qrobot.val.beside import beside_programs
from qrobot.val.evaluate import KindError, location_of, number_of
from qrobot.val.fenced_place import fence_refusal
from qrobot.val.machine import no_analog_output, no_signal
from qrobot.val.number_ranges import check_numbers
from qrobot.val.signal_lines import SignalLines
from qrobot.val.signatures import expressions_in, parts_of, wanted_kinds, wanted_within
from qrobot.val.source import SourceFile, read_source
from qrobot.val.structure import jumps_of
from qrobot.val.values import JointLocation, Transformation, ValValue, check_joint_count, stored_location
from qrobot.val.vocabulary import (
    ANALOG_OUTPUTS,
    INPUTS,
    INTERNAL,
    LOCATION_VALUES,
    MOVING,
    NUMBER_VALUES,
    OUTPUTS,
    moves_nothing,
    taken,
)
from qrobot.val.workspace import Workspace

_MOTIONS = ("MOVE", "MOVES", "APPRO", "APPROS")
_SWITCHING = ("SIGNAL", "RUNSIG")


@dataclass(frozen=True)
class ProgramMistake:
    """A mistake that was found.

    Attributes:
        program: empty for none.
        line, column: from 1; 0 for none.
        what: in words.
    """

    program: str
    line: int
    column: int
    what: str


def check_text(
    text: str, robot: Robot, fences: FenceSet | None = None, lines: SignalLines | None = None
) -> list[ProgramMistake]:
    """All mistakes of a file's text, for this arm inside its fences, in the order of lines.

    Without `lines` every signal of the language has one, as off line.
    """
    source, errors = read_source(text)
    found = [ProgramMistake("", error.line, error.column, error.what) for error in errors]
    found += [ProgramMistake("", 0, 0, refusal) for refusal in _strange_locations(source, robot)]
    for program in source.programs.values():
        mistakes = [*jumps_of(program)[1], *_Checker(source, robot, not errors, fences, lines).look_at(program)]
        found += [ProgramMistake(program.name, error.line, error.column, error.what) for error in mistakes]
    return sorted(found, key=lambda mistake: (mistake.line, mistake.column))


def _strange_locations(source: SourceFile, robot: Robot) -> Iterator[str]:
    """Reasons against stored locations that are none of this arm."""
    for name, numbers in source.locations.items():
        try:
            stored_location(name, numbers, robot)
        except ProgramError as error:
            yield error.what


class _VariesError(ProgramError):
    """Only a run can tell the value."""


class _Checker:
    """Looks at programs; the `Surroundings` of expressions that are constant.

    Args:
        source: the file.
        robot: the arm.
        readable: no line of the file was refused; only then is it known which names have a value.
        fences: of the arm, None for none.
        lines: of the arm's signals, None for all of the language.
    """

    def __init__(
        self, source: SourceFile, robot: Robot, readable: bool, fences: FenceSet | None, lines: SignalLines | None
    ) -> None:
        self.robot = robot
        self._fences = fences
        self._lines = lines
        self._told: set[float] = set()  # signals: each is looked at once for its line
        self._readable = readable
        self._source = source
        self._space = Workspace(robot)
        actions = [line.action for program in source.programs.values() for line in program.lines]
        self._changed = {name for action in actions for name in _names_given(action)}
        self._kinds = self._kinds_of_names(actions)
        self._known = self._names_with_a_value()
        self._beside = beside_programs(source)
        self._frames_move = any(isinstance(a, tree.Instruction) and a.word in ("TOOL", "BASE") for a in actions)

    def look_at(self, program: tree.ValProgram) -> Iterator[ProgramError]:
        """Mistakes of one program."""
        self._changed |= set(program.parameters)
        for line in program.lines:
            if line.action is not None:
                for error in (*self._moves(program, line.action), *self._mistakes_of(line.action)):
                    yield ProgramError(error.what, line.line, max(error.column, line.column))

    def _names_with_a_value(self) -> set[str]:
        """Names that have a value somewhere; of an array the name alone."""
        stored = {name.partition("[")[0] for name in (*self._source.locations, *self._source.numbers)}
        parameters = {name for program in self._source.programs.values() for name in program.parameters}
        return stored | parameters | self._changed | {*LOCATION_VALUES, *NUMBER_VALUES}

    def _kinds_of_names(self, actions: Sequence[tree.StepAction | None]) -> dict[str, set[str]]:
        """The kinds of value that names may have, an array those of its elements; "either" is not known."""
        kinds: dict[str, set[str]] = defaultdict(set)
        for stored, kind in ((self._source.locations, "location"), (self._source.numbers, "number")):
            for name in stored:
                kinds[name.partition("[")[0]].add(kind)
        for program in self._source.programs.values():
            for name in program.parameters:
                kinds[name].add("either")
        for name, kind in (given for action in actions for given in _kinds_given(action)):
            kinds[name].add(kind)
        return kinds

    def _mistakes_of(self, action: tree.StepAction) -> Iterator[ProgramError]:
        looks = self._words, self._calls, self._signals, self._analog, self._joints, self._places, self._values
        found = [error for look in looks for error in look(action)]
        yield from found or self._expressions(action)

    def _words(self, action: tree.StepAction) -> Iterator[ProgramError]:
        if not isinstance(action, tree.ProgramCall):  # a program is handed the value of PI
            yield from (ProgramError(refusal, column=1) for name in _names_given(action) if (refusal := taken(name)))

    def _moves(self, program: tree.ValProgram, action: tree.StepAction) -> Iterator[ProgramError]:
        if program.name in self._beside and isinstance(action, tree.Instruction) and action.word in MOVING:
            yield ProgramError(moves_nothing(action.word), column=1)

    def _values(self, action: tree.StepAction) -> Iterator[ProgramError]:
        """The first use of each name that nothing gives a value."""
        if not self._readable:
            return
        for expression in expressions_in(action):
            for part in parts_of(expression):
                if isinstance(part, tree.VariableName) and part.name not in self._known:
                    self._known.add(part.name)
                    what = f"{part.name} has no value: no program gives it one, and the file holds none"
                    yield ProgramError(what, column=part.column)

    def _joints(self, action: tree.StepAction) -> Iterator[ProgramError]:
        """Precision points of another arm."""
        for part in (part for expression in expressions_in(action) for part in parts_of(expression)):
            if isinstance(part, tree.FunctionCall) and part.name == "#PPOINT":
                try:
                    check_joint_count(part.name, len(part.arguments), self.robot)
                except ProgramError as error:
                    yield ProgramError(error.what, column=part.column)

    def _expressions(self, action: tree.StepAction) -> Iterator[ProgramError]:
        """Values of the wrong kind, and literal ones that cannot be computed or are none that the step takes.

        One that comes out of a variable may stand behind an IF that looks at it.
        """
        for expression, kind in wanted_kinds(action):
            try:
                (location_of if kind == "location" else number_of)(expression, self)
            except KindError as error:
                yield error
            except _VariesError:
                yield from islice(self._strange_kinds(expression, kind), 1)
            except ProgramError as error:
                if _is_literal(expression):
                    yield error
        try:
            check_numbers(action, self.robot.n, lambda each: self._constant(each) if _is_literal(each) else None)
        except ProgramError as error:
            yield ProgramError(error.what, column=error.column or 1)

    def _strange_kinds(self, expression: tree.Expression, kind: str) -> Iterator[ProgramError]:
        """Names that vary, and are never of the kind that is wanted in an expression of this kind."""
        for part, wanted in ((expression, kind), *wanted_within(expression)):
            variable = part.variable if isinstance(part, tree.GroupedVariable) else part
            if self._readable and isinstance(variable, tree.VariableName):
                kinds = self._kinds.get(variable.name, set())
                if len(kinds) == 1 and not kinds & {wanted, "either"}:
                    yield KindError(f"expected a {wanted}, not a {next(iter(kinds))}", column=variable.column)

    def _calls(self, action: tree.StepAction) -> Iterator[ProgramError]:
        if not isinstance(action, tree.ProgramCall | tree.Reaction | tree.ProcessStart):
            return
        called = self._source.programs.get(action.program)
        if called is None:
            yield ProgramError(f"there is no program {action.program}", column=action.column)
        elif isinstance(action, tree.ProgramCall) and len(action.arguments) > len(called.parameters):
            most = len(called.parameters)
            yield ProgramError(
                f"program {called.name} has {most} parameters, not {len(action.arguments)}", column=action.column
            )

    def _signals(self, action: tree.StepAction) -> Iterator[ProgramError]:
        for expression, switched in _signal_numbers(action):
            number = self._constant(expression)
            if number is not None and (refusal := self._signal_refusal(abs(number), switched)):
                yield ProgramError(refusal, column=1)

    def _signal_refusal(self, number: float, switched: bool) -> str:
        """Reason against the use of a signal; "" for none."""
        if number != int(number):
            return f"a signal is a whole number, not {number:g}"
        if not any(number in numbers for numbers in (OUTPUTS, INPUTS, INTERNAL)):
            return no_signal(int(number))
        if switched and number in INPUTS:
            return f"signal {number:g} is an input: it cannot be switched"
        if self._lines is None or number in self._told:
            return ""
        self._told.add(number)
        return self._lines.refusal(int(number))

    def _analog(self, action: tree.StepAction) -> Iterator[ProgramError]:
        if not isinstance(action, tree.NumberedAssignment) or action.word != "DAC":
            return
        number, volts = self._constant(action.number), self._constant(action.value)
        if number is None:
            return
        if number not in ANALOG_OUTPUTS:
            yield ProgramError(no_analog_output(number), column=1)
        elif self._lines is not None and (refusal := self._lines.analog_refusal(int(number), volts)):
            yield ProgramError(refusal, column=1)

    def _constant(self, expression: tree.Expression) -> float | None:
        """The value of a number that is constant; None where only a run can tell."""
        try:
            return number_of(expression, self)
        except QRobotError:
            return None

    def _places(self, action: tree.StepAction) -> Iterator[ProgramError]:
        if not isinstance(action, tree.Instruction) or action.word not in _MOTIONS or action.arguments[0] is None:
            return
        where = action.arguments[0]
        try:
            location = location_of(where, self)
            places = [location, *self._approached(action, location)]
        except QRobotError:
            return  # it is not constant
        if self._frames_move and isinstance(location, Transformation):
            return
        column = getattr(where, "column", 0) or 1
        if not all(self._space.reaches(place) for place in places):
            yield ProgramError(f"{action.word}: the arm does not reach this place", column=column)
        elif refusal := self._refusal(places, action.word):
            yield ProgramError(refusal, column=column)

    def _refusal(self, places: Sequence[Transformation | JointLocation], word: str) -> str:
        """Reason of the fences against the first place that is too near to one; "" for none."""
        fences = self._fences
        refusals = (fence_refusal(fences, self._space, place, word) for place in places) if fences else iter(())
        return next(filter(None, refusals), "")

    def _approached(
        self, action: tree.Instruction, location: Transformation | JointLocation
    ) -> Iterator[Transformation]:
        if len(action.arguments) > 1 and action.arguments[1] is not None:
            back = np.array([0.0, 0.0, -M_PER_MM * number_of(action.arguments[1], self)])
            yield Transformation(self._space.pose_of(location) @ transform(translation=back))

    # ------------------------------------------------------------------------------------------------ `Surroundings`

    def value(self, name: str, indices: tuple[int, ...]) -> ValValue | None:
        """A stored location or number that no program changes. Raises ProgramError for others."""
        if name in self._changed:
            raise _VariesError(f"{name} is not constant")
        key = name + (f"[{', '.join(map(str, indices))}]" if indices else "")
        if (numbers := self._source.locations.get(key)) is not None:
            return stored_location(name, numbers, self.robot)
        if key not in self._source.numbers:
            raise _VariesError(f"the file has no {key}")
        return self._source.numbers[key]

    def frame(self, name: str) -> Floats:
        """NULL alone is constant. Raises ProgramError for the others."""
        if name != "null":
            raise _VariesError(f"{name.upper()} is not constant")
        return np.eye(4)

    def signal_is_on(self, _number: int) -> bool:
        """Raise ProgramError: no signal is constant."""
        raise _VariesError("signals are not constant")

    def number_function(self, name: str, _arguments: Sequence[float]) -> float:
        """Raise ProgramError: timers, speeds and random numbers are not constant."""
        raise _VariesError(f"{name} is not constant")

    def pose_of(self, location: Transformation | JointLocation) -> Floats:
        """See `Surroundings`."""
        return self._space.pose_of(location)

    def reaches(self, location: Transformation | JointLocation) -> bool:
        """See `Surroundings`."""
        return self._space.reaches(location)


def _is_literal(expression: tree.Expression) -> bool:
    """No variable is in it."""
    return not any(isinstance(part, tree.VariableName) for part in parts_of(expression))


def _names_given(action: tree.StepAction | None) -> Iterator[str]:
    """Variables that an action may change."""
    yield from (name for name, _ in _kinds_given(action))


def _kinds_given(action: tree.StepAction | None) -> Iterator[tuple[str, str]]:
    """Variables that an action may change, and the kind of the value; those given to a program may be changed there."""
    match action:
        case tree.Assignment(target=target, location=location):
            yield target.name, "location" if location else "number"
        case tree.PromptFor(target=target) | tree.ForLoop(variable=target):
            yield target.name, "number"
        case tree.Decomposition(target=name):
            yield name, "number"
        case tree.Instruction(word="HERE", arguments=arguments) | tree.ProgramCall(arguments=arguments):
            kind = "location" if isinstance(action, tree.Instruction) else "either"
            yield from ((argument.name, kind) for argument in arguments if isinstance(argument, tree.VariableName))


def _signal_numbers(action: tree.StepAction) -> Iterator[tuple[tree.Expression, bool]]:
    """Expressions that name signals, and whether the action switches them."""
    match action:
        case tree.Instruction(word="SIGNAL" | "RUNSIG" | "IGNORE" as word, arguments=arguments):
            yield from ((argument, word in _SWITCHING) for argument in arguments if argument is not None)
        case tree.Reaction(signal=signal) if signal is not None:
            yield signal, False
    for expression in expressions_in(action):
        for part in parts_of(expression):
            if isinstance(part, tree.FunctionCall) and part.name == "SIG":
                yield from ((argument, False) for argument in part.arguments if argument is not None)
