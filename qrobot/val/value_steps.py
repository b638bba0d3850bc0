"""Steps that give values: to variables, timers and signals; and those that ask and tell them at the terminal."""

from __future__ import annotations

from collections.abc import Callable
from math import isfinite
from typing import TYPE_CHECKING, Final

from qrobot.errors import ProgramError
from qrobot.val import tree
from qrobot.val.evaluate import is_true, location_of, number_of, whole_number_of
from qrobot.val.task import ValTask, Waits
from qrobot.val.values import JointLocation, joint_units, numbers_of

if TYPE_CHECKING:
    from qrobot.val.interpreter import Interpreter


def _assign(run: Interpreter, task: ValTask, action: tree.Assignment) -> None:
    if not action.location:
        task.store(action.target, number_of(action.value, task))
        return
    value = location_of(action.value, task)
    if action.target.name.startswith("#") and action.value == tree.VariableName("here"):
        value = JointLocation(run.machine.arm.q)
    task.store(action.target, value)


def _here(run: Interpreter, task: ValTask, target: tree.VariableName) -> None:
    _assign(run, task, tree.Assignment(target, tree.VariableName("here"), location=True))


def _decompose(_run: Interpreter, task: ValTask, action: tree.Decomposition) -> None:
    location = location_of(action.location, task)
    numbers = location.q / joint_units(task.robot) if isinstance(location, JointLocation) else numbers_of(location.T)
    for index, number in enumerate(numbers):
        target = tree.VariableName(action.target, (tree.NumberLiteral(float(index)),))
        task.store(target, float(number))


def _set_numbered(run: Interpreter, task: ValTask, action: tree.NumberedAssignment) -> None:
    value = number_of(action.value, task)
    if action.word == "DAC":
        run.machine.set_analog(whole_number_of(action.number, task), value)
    else:
        run.machine.set_timer(number_of(action.number, task), value)


def _signal(run: Interpreter, task: ValTask, *numbers: tree.Expression) -> None:
    for number in [whole_number_of(number, task) for number in numbers]:
        run.machine.set_signal(number)


def _reset(run: Interpreter, _task: ValTask) -> None:
    run.machine.reset_signals()


def _runsig(_run: Interpreter, task: ValTask, number: tree.Expression | None = None) -> None:
    task.set_run_signal(0 if number is None else whole_number_of(number, task))


def _wait(_run: Interpreter, task: ValTask, condition: tree.Expression) -> Waits:
    yield lambda: is_true(condition, task)


def _type_out(run: Interpreter, task: ValTask, action: tree.TypeOut) -> None:
    text, form = "", ""
    for item in action.items:
        if isinstance(item, tree.TextLiteral):
            text += item.value
        elif isinstance(item, tree.OutputFormat):
            form = item.code
            text += "\n" * _count(form, "C") + " " * _count(form, "X")
        else:
            text += _written(number_of(item, task), form)
    if run.machine.switches["MESSAGES"]:
        with run.may_wait(task):
            run.machine.say(text)


def _count(form: str, letter: str) -> int:
    return min(int(form[1:] or 1), 80) if form.startswith(letter) else 0


def _written(value: float, form: str) -> str:
    if form.startswith("I"):
        return f"{value:{min(int(form[1:] or 0), 80) or ''}.0f}"
    if form.startswith("F"):
        width, _, digits = form[1:].partition(".")
        return f"{value:{min(int(width or 0), 80) or ''}.{min(int(digits), 15)}f}"
    return f" {value:.6g}"  # V+'s default begins with a blank (recalled)


def _prompt(run: Interpreter, task: ValTask, action: tree.PromptFor) -> Waits:
    yield lambda: run.machine.arm.idle  # no signal is looked for while somebody is asked
    with run.may_wait(task):
        answer = run.machine.ask(action.text).strip()
    try:
        number = float(answer or 0.0)
    except ValueError:
        raise ProgramError(f"PROMPT: expected a number, not {answer[:40]!r}") from None
    if not isfinite(number):
        raise ProgramError("PROMPT: expected a finite number")
    task.store(action.target, number)


WORDS: Final[dict[str, Callable[..., Waits | None]]] = {
    "HERE": _here,
    "WAIT": _wait,
    "SIGNAL": _signal,
    "RESET": _reset,
    "RUNSIG": _runsig,
}
ACTIONS: Final[dict[type, Callable[..., Waits | None]]] = {
    tree.Assignment: _assign,
    tree.NumberedAssignment: _set_numbered,
    tree.Decomposition: _decompose,
    tree.TypeOut: _type_out,
    tree.PromptFor: _prompt,
}
