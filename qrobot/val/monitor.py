"""The monitor: commands typed at the terminal, abbreviated down to uniqueness."""

from __future__ import annotations

import re
from collections.abc import Callable
from math import nan
from pathlib import Path
from typing import Final

from qrobot.errors import LinkError, ProgramError, QRobotError, ServoFault
from qrobot.printable import printable
from qrobot.rci.arguments import MOST_BACK_MM
from qrobot.val import tree
from qrobot.val.interpreter import Interpreter, RunState
from qrobot.val.number_ranges import LEAST_SPEED, check_cycles
from qrobot.val.parser import parse_variable
from qrobot.val.printer import print_number, print_program
from qrobot.val.source import constant_indices, load_source, store_source
from qrobot.val.values import JointLocation, numbers_of, stored_numbers
from qrobot.val.vocabulary import INPUTS, INTERNAL, OUTPUTS

HELP: Final[dict[str, str]] = {
    "EXECUTE": "p, cycles, step    run a program",
    "XSTEP": "p, cycles, step    run a program up to behind its first step; NEXT does the next one",
    "DO": "step    one step, as DO MOVE a",
    "NEXT": "one step of the paused program",
    "PROCEED": "go on, first with the interrupted motion",
    "RETRY": "go on with the step that failed",
    "ABORT": "give the program up",
    "HERE": "a    where the arm is becomes a, or #a",
    "POINT": "a = location    as SET",
    "TEACH": "a    as HERE",
    "WHERE": "where the arm is",
    "LISTP": "p    programs",
    "LISTL": "a, b    locations, or those of these names",
    "LISTR": "x, y    numbers, or those of these names",
    "DELETEP": "p    forget a program",
    "DELETEL": "a    forget a location",
    "DELETER": "x    forget a number",
    "LOAD": "file    programs and locations, in place of those of the same name; .v2 may be left out",
    "STORE": "file    all there is",
    "SPEED": "n    monitor speed, per cent",
    "RETRACT": "n    mm by which the arm goes back after a collision; 0 for not at all",
    "IO": "signals that are on, and analogue outputs as they were told last",
    "STATUS": "how far the program is",
    "CALIBRATE": "whether the arm is calibrated; `qrobot calibrate` does it",
    "QUIT": "leave the monitor",
}

_MOVING: Final = ("EXECUTE", "XSTEP", "DO", "NEXT", "PROCEED", "RETRY")
_COUNT: Final = re.compile("-?[0-9]{1,9}")
_WORD: Final = 40  # characters of a word that are shown again


class ValMonitor:
    """Obeys commands.

    Args:
        interpreter: of the arm.

    Attributes:
        over: nothing more is to be obeyed.
        stopped: during the newest command the arm was stopped, or a mistake did it: what was typed meanwhile may not
            let it go on.
        sure: asks somebody whether that is to be done, before a program that could be gone on with is given up; None
            where nobody can be asked: then it is told.
    """

    def __init__(self, interpreter: Interpreter) -> None:
        self.over = self.stopped = False
        self.sure: Callable[[str], bool] | None = None
        self._run = interpreter
        self._machine = interpreter.machine
        self._commands: dict[str, Callable[[str], str]] = {
            "EXECUTE": self._execute,
            "XSTEP": lambda rest: self._execute(rest, single=True),
            "DO": self._do,
            "NEXT": lambda _: self._proceed(single=True),
            "PROCEED": lambda _: self._proceed(),
            "RETRY": lambda _: self._told(self._run.retry()),
            "ABORT": self._abort,
            "HERE": lambda rest: self._do(f"HERE {rest}"),
            "POINT": lambda rest: self._do(f"SET {rest}"),
            "TEACH": lambda rest: self._do(f"HERE {rest}"),
            "WHERE": lambda _: self._where(),
            "LISTP": self._list_programs,
            "LISTL": self._list_locations,
            "LISTR": self._list_numbers,
            "DELETEP": self._delete_program,
            "DELETEL": lambda rest: self._delete(rest, number=False),
            "DELETER": lambda rest: self._delete(rest, number=True),
            "LOAD": self._load,
            "STORE": self._store,
            "SPEED": self._speed,
            "RETRACT": self._retract,
            "IO": lambda _: self._signals(),
            "STATUS": lambda _: " ".join(filter(None, [self._run.state.value, self._run.message])),
            "CALIBRATE": lambda _: (
                "the arm is calibrated, or it could not be under control; QUIT and `qrobot calibrate` do it"
            ),
            "QUIT": self._quit,
        }

    @property
    def names(self) -> list[str]:
        """Words that may be typed: commands, programs, locations and numbers."""
        there = self._machine.source()
        return [*HELP, *there.programs, *there.locations, *there.numbers]

    def obey(self, line: str) -> str:
        """Do what a line says, and give the answer. A mistake is answered, and ends nothing.

        Raises:
            LinkError, ServoFault: the arm is lost.
        """
        self.stopped, error = False, self._run.error
        word, rest = [*line.split(None, 1), "", ""][:2]
        if not word or word.startswith(";"):
            return ""
        try:
            return self._obey(word.upper(), rest.strip())
        except KeyboardInterrupt:
            return self._interrupted(self._run.error not in (None, error))
        except (LinkError, ServoFault):
            raise
        except QRobotError as error:
            return f"error: {error}"

    def _interrupted(self, failed: bool) -> str:
        """Words for a command that Ctrl-C has ended, in whose last turn a step may have failed as well."""
        goes_on = "; PROCEED goes on" if self._run.unfinished or self._machine.arm.off_path else ""
        failure = f"\n{self._told(self._run.state)}" if failed and self._run.state is RunState.FAILED else ""
        return f"interrupted: the arm stands{goes_on}{failure}"

    def _obey(self, word: str, rest: str) -> str:
        if word.startswith("?") or word == "HELP":
            return "\n".join(f"{name:9} {text}" for name, text in HELP.items())
        found = [name for name in self._commands if name.startswith(word)]
        if word in self._commands:
            found = [word]
        if len(found) > 1:
            raise ProgramError(f"{word} may be {', '.join(found)}", column=1)
        if not found:
            raise ProgramError(
                f"there is no command {printable(word[:_WORD])}; ? lists them, and DO does a step", column=1
            )
        try:
            return self._commands[found[0]](rest)
        finally:
            stopped = self._machine.arm.off_path or self._run.state is RunState.FAILED
            self.stopped = stopped and found[0] in _MOVING

    # ------------------------------------------------------------------------------------------------------- programs

    def _execute(self, rest: str, single: bool = False) -> str:
        name, *numbers = [part.strip() for part in rest.split(",")]
        numbers = [number or "1" for number in numbers]  # an argument that is left out keeps its comma
        if not name or not all(_COUNT.fullmatch(number) for number in numbers) or len(numbers) > 2:
            raise ProgramError(f"expected {'XSTEP' if single else 'EXECUTE'} program, cycles, step", column=1)
        cycles, step = (*map(int, numbers), *[1, 1][len(numbers) :])
        check_cycles(cycles)
        program, before = self._program(name).name, self._run.unfinished
        if before and self.sure is not None and not self.sure(f"{before} will be given up: are you sure (Y/N)? "):
            return "nothing has been done; PROCEED goes on"
        state = self._told(self._run.execute(program, cycles, step, single))
        return f"{before} is given up; {state}" if before else state

    def _told(self, state: RunState) -> str:
        return f"{state.value}{': ' + self._run.message if self._run.message else ''}"

    def _proceed(self, single: bool = False) -> str:
        if self._run.lead_back():
            return "the arm has gone back to its path"
        return self._told(self._run.proceed(single=single))

    def _do(self, text: str) -> str:
        self._run.do(text)
        return ""

    def _abort(self, _rest: str) -> str:
        self._run.rest.need_path()
        self._run.abort()
        return "aborted"

    def _quit(self, _rest: str) -> str:
        if self._machine.arm.off_path:
            self._run.abort()  # nobody is left who could lead the arm back
        self.over = True
        return ""

    # --------------------------------------------------------------------------------------------- places and numbers

    def _where(self) -> str:
        pose, joints = numbers_of(self._machine.frame("here")), JointLocation(self._machine.arm.q)
        degrees = stored_numbers(joints, self._machine.robot)
        names = "x {:.2f} y {:.2f} z {:.2f} o {:.2f} a {:.2f} t {:.2f}".format(*pose)
        return f"{names}\njoints {' '.join(f'{angle:.2f}' for angle in degrees)}"

    def _list_programs(self, rest: str) -> str:
        if not rest:
            return "\n".join(self._machine.programs)
        return print_program(self._program(rest)).rstrip()

    def _list_locations(self, rest: str) -> str:
        there = self._machine.source().locations
        names = _named("location", rest, list(there))
        return "\n".join(f"{name} {' '.join(f'{number:.3f}' for number in there[name])}" for name in names)

    def _list_numbers(self, rest: str) -> str:
        there = self._machine.source().numbers
        return "\n".join(f"{name} {print_number(there[name])}" for name in _named("number", rest, list(there)))

    def _program(self, name: str) -> tree.ValProgram:
        if name.lower() not in self._machine.programs:
            raise ProgramError(f"there is no program {printable(name)}")
        return self._machine.programs[name.lower()]

    def _delete_program(self, rest: str) -> str:
        name = self._program(rest).name
        if self._run.state in (RunState.PAUSED, RunState.FAILED):
            raise ProgramError("a program is to be continued; ABORT first")
        del self._machine.programs[name]
        return ""

    def _delete(self, rest: str, number: bool) -> str:
        variable = parse_variable(rest)
        key = (variable.name, constant_indices(variable))
        if isinstance(self._machine.values.get(key), float) != number or key not in self._machine.values:
            raise ProgramError(f"there is no {'number' if number else 'location'} {printable(rest)}")
        del self._machine.values[key]
        return ""

    # ------------------------------------------------------------------------------------------------ files, settings

    def _load(self, rest: str) -> str:
        if not rest:
            raise ProgramError("expected LOAD file")
        source = load_source(_with_suffix(Path(rest)))
        changed = {name for name, each in source.programs.items() if self._machine.programs.get(name) != each}
        self._machine.load(source)
        told = f"{len(source.programs)} programs, {len(source.locations)} locations, {len(source.numbers)} numbers"
        if self._run.unfinished and (begun := sorted(changed & self._begun())):
            told += f"; what was begun of {', '.join(begun)} goes on as it was, the new text counts when it begins anew"
        return told

    def _begun(self) -> set[str]:
        """Names of the programs that are in the midst of something."""
        tasks = [task for task in (self._run.task, *self._run.beside) if task is not None]
        return {frame.program.name for task in tasks for frame in task.frames}

    def _store(self, rest: str) -> str:
        if not rest:
            raise ProgramError("expected STORE file")
        store_source(_with_suffix(Path(rest)), self._machine.source())
        return ""

    def _speed(self, rest: str) -> str:
        self._machine.arm.override = _number("SPEED", rest, LEAST_SPEED, 100.0)
        return ""

    def _retract(self, rest: str) -> str:
        self._machine.arm.retract(_number("RETRACT", rest, 0.0, MOST_BACK_MM))
        return ""

    def _signals(self) -> str:
        lines = []
        for name, numbers in (("outputs", OUTPUTS), ("inputs", INPUTS), ("internal", INTERNAL)):
            on = [str(number) for number in numbers if self._machine.signal_is_on(number)]
            lines.append(f"{name:9}{' '.join(on) or 'none'}")
        told = [f"{number} {volts:g} V" for number, volts in sorted(self._machine.analog.items())]
        lines.append(f"analogue {', '.join(told) or 'none'}")
        return "\n".join(lines)


def _number(command: str, rest: str, least: float, most: float) -> float:
    """The number behind a command. Raises ProgramError: there is none from `least` to `most`."""
    try:
        number = float(rest)
    except ValueError:
        number = nan
    if not least <= number <= most:
        raise ProgramError(f"expected {command} and a number from {least:g} to {most:g}")
    return number


def _with_suffix(path: Path) -> Path:
    """The path of a file of programs, with .v2 when its name has no suffix, and no file is called as it stands."""
    return path if path.suffix or path.exists() else path.with_suffix(".v2")


def _named(kind: str, wanted: str, there: list[str]) -> list[str]:
    """Names of `there` that are `wanted`, by names with commas between: x is x and all of x[]; nothing is all of them.

    Raises ProgramError: there is none of a name.
    """
    found = []
    for name in filter(None, (part.strip().lower() for part in wanted.split(","))):
        here = [each for each in there if name in (each, each.partition("[")[0])]
        if not here:
            raise ProgramError(f"there is no {kind} {printable(name)}")
        found += here
    return found if wanted else there
