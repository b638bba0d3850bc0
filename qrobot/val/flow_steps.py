"""Steps that lead to other steps: structures, calls, the ends of programs, reactions and programs beside."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Final

from qrobot.errors import ProgramError
from qrobot.val import tree
from qrobot.val.evaluate import is_true, number_of, signal_holds, whole_number_of
from qrobot.val.motion_steps import wait_for_arrival
from qrobot.val.number_ranges import check_cycles
from qrobot.val.task import ValTask, Waits, Watch

if TYPE_CHECKING:
    from qrobot.val.interpreter import Interpreter

HIGHEST_PRIORITY: Final = 127  # V+'s (recalled)


def _goto(_run: Interpreter, task: ValTask, action: tree.Goto) -> None:
    if action.condition is None or is_true(action.condition, task):
        task.frame_now.pc = task.frame_now.jumps.labels[action.label]


def _block(_run: Interpreter, task: ValTask, action: tree.Block) -> None:
    frame = task.frame_now
    at = frame.pc - 1
    match action.word:
        case "IF" | "WHILE" if action.condition is not None:
            if not is_true(action.condition, task):
                frame.pc = frame.jumps.to[at]
        case "UNTIL" if action.condition is not None:
            if not is_true(action.condition, task):
                frame.pc = frame.jumps.to[at]
        case "CASE" if action.condition is not None:
            frame.pc = _chosen(task, at, number_of(action.condition, task))
        case "ELSE" | "ANY":
            frame.pc = frame.jumps.to[at]
        case "END" if at in frame.jumps.to:
            frame.pc = frame.again = frame.jumps.to[at]


def _chosen(task: ValTask, at: int, value: float) -> int:
    """The step behind the VALUE that has this number, or ANY; else behind the END."""
    frame = task.frame_now
    for part in frame.jumps.cases[at]:
        action = frame.program.lines[part].action
        if not isinstance(action, tree.CaseValues) or value in action.values:
            return part + 1
    return frame.jumps.to[at]


def _value(_run: Interpreter, task: ValTask, _action: tree.CaseValues) -> None:
    task.frame_now.pc = task.frame_now.jumps.to[task.frame_now.pc - 1]


def _for(_run: Interpreter, task: ValTask, action: tree.ForLoop) -> None:
    frame = task.frame_now
    at = frame.pc - 1
    again = frame.again == at
    if not again or at not in frame.loops:  # else GOTO, or the step of EXECUTE, has led into it
        frame.loops[at] = _last_and_step(task, action)
    last, step = frame.loops[at]
    value = number_of(action.variable, task) + step if again else number_of(action.first, task)
    task.store(action.variable, value)
    frame.again = -1
    if (value - last) * step > 0.0:
        del frame.loops[at]
        frame.pc = frame.jumps.to[at]


def _last_and_step(task: ValTask, action: tree.ForLoop) -> tuple[float, float]:
    step = 1.0 if action.step is None else number_of(action.step, task)
    if step == 0.0:
        raise ProgramError("FOR: a STEP of 0 never ends")
    return number_of(action.last, task), step


def _call(_run: Interpreter, task: ValTask, action: tree.ProgramCall) -> None:
    task.call(action.program, action.arguments)


def _return(run: Interpreter, task: ValTask) -> Waits | None:
    return run.end_of_program(task)


def _pause(run: Interpreter, task: ValTask) -> Waits:
    if task.moves:
        yield from wait_for_arrival(run, task)
    run.pause(f"PAUSE in program {task.at[0]}", halt=not task.moves)  # the one that moves stands between two steps


def _stop(run: Interpreter, task: ValTask) -> Waits:
    return run.end_of_cycle(task)


def _halt(run: Interpreter, task: ValTask) -> Waits:
    task.cycles = 1
    return run.end_of_cycle(task)


def _react(run: Interpreter, task: ValTask, action: tree.Reaction) -> None:
    if action.program not in run.machine.programs:
        raise ProgramError(f"there is no program {action.program}", column=action.column)
    if action.signal is None:
        task.on_error = action.program
        return
    number = whole_number_of(action.signal, task)
    signal_holds(number, task)  # there is such a signal
    priority = 1 if action.priority is None else _priority(action.priority, task, "REACT", 1)
    task.watch(number, Watch(action.program, priority, action.word == "REACTI"))


def _ignore(_run: Interpreter, task: ValTask, number: tree.Expression) -> None:
    task.ignore(whole_number_of(number, task))


def _lock(_run: Interpreter, task: ValTask, priority: tree.Expression) -> None:
    task.priority = _priority(priority, task, "LOCK", 0)


def _priority(expression: tree.Expression, task: ValTask, word: str, least: int) -> int:
    priority = whole_number_of(expression, task)
    if not least <= priority <= HIGHEST_PRIORITY:
        raise ProgramError(f"{word}: expected a priority from {least} to {HIGHEST_PRIORITY}, not {priority}")
    return priority


def _pcexecute(run: Interpreter, task: ValTask, action: tree.ProcessStart) -> None:
    cycles = 1 if action.cycles is None else check_cycles(whole_number_of(action.cycles, task))
    run.start_beside(action.program, cycles)


WORDS: Final[dict[str, Callable[..., Waits | None]]] = {
    "IGNORE": _ignore,
    "LOCK": _lock,
    "RETURN": _return,
    "PAUSE": _pause,
    "STOP": _stop,
    "HALT": _halt,
}
ACTIONS: Final[dict[type, Callable[..., Waits | None]]] = {
    tree.Goto: _goto,
    tree.Block: _block,
    tree.ForLoop: _for,
    tree.CaseValues: _value,
    tree.ProgramCall: _call,
    tree.Reaction: _react,
    tree.ProcessStart: _pcexecute,
}
