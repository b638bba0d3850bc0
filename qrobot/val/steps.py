"""The effect of each action of a line. One that takes time is a generator of what it waits for."""

from __future__ import annotations

from collections.abc import Callable
from math import isfinite
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from qrobot.errors import ProgramError
from qrobot.model.transform import transform
from qrobot.units import M_PER_MM, RAD_PER_DEG
from qrobot.val import tree
from qrobot.val.evaluate import is_true, location_of, number_of, pose_of, signal_holds, whole_number_of
from qrobot.val.printer import print_expression
from qrobot.val.task import ValTask, Waits, Watch
from qrobot.val.values import JointLocation, Transformation, joint_units, numbers_of
from qrobot.val.vocabulary import MOVING, moves_nothing
from qrobot.val.workspace import aligned

if TYPE_CHECKING:
    from qrobot.val.interpreter import Interpreter

_CONFIGURATIONS: Final = {"RIGHTY": "r", "LEFTY": "l", "ABOVE": "u", "BELOW": "d", "FLIP": "f", "NOFLIP": "n"}
_PAIRS: Final = {"r": "l", "l": "r", "u": "d", "d": "u", "f": "n", "n": "f"}


def do_step(run: Interpreter, task: ValTask, action: tree.StepAction) -> Waits | None:
    """Begin an action; what it waits for, None for nothing. Raises ProgramError, MotionError."""
    if isinstance(action, tree.Instruction):
        if action.word in MOVING and not task.moves:
            raise ProgramError(moves_nothing(action.word))
        return _INSTRUCTIONS[action.word](run, task, *action.arguments)
    return _ACTIONS[type(action)](run, task, action)


# ------------------------------------------------------------------------------------------------------------- motions


def _move(straight: bool, approach: bool = False) -> Callable[..., Waits]:
    def do(run: Interpreter, task: ValTask, where: tree.Expression, back: tree.Expression | None = None) -> Waits:
        location = location_of(where, task)
        if approach and back is not None:
            location = Transformation(_behind(run.machine.pose_of(location), number_of(back, task)))
        return _go(run, print_expression(where), location, straight)

    return do


def _depart(straight: bool) -> Callable[..., Waits]:
    def do(run: Interpreter, task: ValTask, back: tree.Expression) -> Waits:
        away = Transformation(_behind(run.machine.destination_pose(), number_of(back, task)))
        return _go(run, "DEPART", away, straight)

    return do


def _behind(T: Any, mm: float) -> Any:
    """The pose `mm` back along its own z axis."""
    return T @ transform(translation=np.array([0.0, 0.0, -M_PER_MM * mm]))


def _go(run: Interpreter, name: str, location: Transformation | JointLocation, straight: bool) -> Waits:
    """Queue a motion, and wait until it begins: then the arm has passed the place before it."""
    machine, arm = run.machine, run.machine.arm
    machine.go(name, location, straight)
    yield lambda: arm.waiting == 0
    if (hand := machine.hand_at_next) is not None:
        machine.hand_at_next = None
        arm.hand(hand)
    if not machine.switches["CP"]:
        yield lambda: arm.idle


def _drive(run: Interpreter, task: ValTask, *numbers: tree.Expression) -> Waits:
    joint, by, speed = (number_of(number, task) for number in numbers)
    machine = run.machine
    if joint != int(joint) or not 1 <= joint <= machine.robot.n:
        raise ProgramError(f"DRIVE: joints are 1 to {machine.robot.n}, not {joint:g}")
    yield from _break(run, task)
    q = machine.arm.q
    q[int(joint) - 1] += by * joint_units(machine.robot)[int(joint) - 1]
    machine.next_speed = (_speed(speed), False)
    yield from _go(run, "DRIVE", JointLocation(q), False)


def _align(run: Interpreter, _task: ValTask) -> Waits:
    return _go(run, "ALIGN", Transformation(aligned(run.machine.destination_pose())), False)


def _ready(run: Interpreter, _task: ValTask) -> Waits:
    poses = run.machine.robot.poses
    if "ready" not in poses:
        raise ProgramError(f"{run.machine.robot.name} has no pose `ready`")
    return _go(run, "READY", JointLocation(poses["ready"]), False)


def _delay(run: Interpreter, task: ValTask, seconds: tree.Expression) -> Waits:
    length = number_of(seconds, task)
    yield from _break(run, task)
    end = run.machine.arm.time_s + length
    yield lambda: run.machine.arm.time_s >= end


def _break(run: Interpreter, _task: ValTask) -> Waits:
    yield lambda: run.machine.arm.idle


def _brake(run: Interpreter, _task: ValTask) -> Waits:
    run.stop_arm()
    yield lambda: run.machine.arm.idle
    run.machine.arm.unfinished()


def _hand(opened: bool, now: bool) -> Callable[..., Waits]:
    def do(run: Interpreter, task: ValTask) -> Waits:
        if not now:
            run.machine.hand_at_next = opened
            return
        yield from _break(run, task)
        run.machine.arm.hand(opened)
        end = run.machine.arm.time_s + run.machine.hand_time_s
        yield lambda: run.machine.arm.time_s >= end

    return do


def _tool(run: Interpreter, task: ValTask, where: tree.Expression | None = None) -> Waits:
    tool = np.eye(4) if where is None else pose_of(where, task)
    yield from _break(run, task)
    run.machine.space.tool = tool
    run.machine.forget_destination()


def _base(run: Interpreter, task: ValTask, *numbers: tree.Expression | None) -> Waits:
    values = [0.0 if number is None else number_of(number, task) for number in numbers]
    dx, dy, dz, rotation = (*values, *[0.0] * (4 - len(values)))
    yield from _break(run, task)
    run.machine.space.move_base(dx * M_PER_MM, dy * M_PER_MM, dz * M_PER_MM, rotation * RAD_PER_DEG)
    run.machine.forget_destination()


# -------------------------------------------------------------------------------------------------------------- manner


def _configure(word: str) -> Callable[..., None]:
    letter = _CONFIGURATIONS[word]

    def do(run: Interpreter, _task: ValTask) -> None:
        run.machine.words = run.machine.words.replace(_PAIRS[letter], "").replace(letter, "") + letter

    return do


def _no_effect(_run: Interpreter, task: ValTask, *numbers: tree.Expression) -> None:
    """COARSE, FINE, NULL, NONULL: motions end exactly in any case."""
    for number in numbers:
        number_of(number, task)


def _set_speed(run: Interpreter, task: ValTask, action: tree.SpeedSetting) -> None:
    speed = _speed(number_of(action.value, task))
    run.machine.next_speed = (speed, action.in_mm_s)
    if action.always:
        run.machine.speed, run.machine.in_mm_s = speed, action.in_mm_s


def _speed(value: float) -> float:
    if not 0.0 < value <= 1000.0:
        raise ProgramError(f"SPEED: a number above 0 and up to 1000 is needed, not {value:g}")
    return value


def _parameter(run: Interpreter, task: ValTask, action: tree.ParameterSetting) -> None:
    seconds = number_of(action.value, task)
    if not 0.0 <= seconds <= 60.0:
        raise ProgramError(f"HAND.TIME is 0 to 60 s, not {seconds:g}")
    run.machine.hand_time_s = seconds


def _switch(run: Interpreter, _task: ValTask, action: tree.SwitchSetting) -> None:
    run.machine.switches |= dict.fromkeys(action.switches, action.on)


# ----------------------------------------------------------------------------------------------------- values, signals


def _assign(run: Interpreter, task: ValTask, action: tree.Assignment) -> None:
    if not action.location:
        run.machine.store(task.key_of(action.target), number_of(action.value, task))
        return
    value = location_of(action.value, task)
    if action.target.name.startswith("#") and action.value == tree.VariableName("here"):
        value = JointLocation(run.machine.arm.q)
    run.machine.store(task.key_of(action.target), value)


def _here(run: Interpreter, task: ValTask, target: tree.VariableName) -> None:
    _assign(run, task, tree.Assignment(target, tree.VariableName("here"), location=True))


def _decompose(run: Interpreter, task: ValTask, action: tree.Decomposition) -> None:
    location = location_of(action.location, task)
    numbers = location.q / joint_units(task.robot) if isinstance(location, JointLocation) else numbers_of(location.T)
    for index, number in enumerate(numbers):
        target = tree.VariableName(action.target, (tree.NumberLiteral(float(index)),))
        run.machine.store(task.key_of(target), float(number))


def _timer(run: Interpreter, task: ValTask, action: tree.NumberedAssignment) -> None:
    run.machine.set_timer(number_of(action.number, task), number_of(action.value, task))


def _signal(run: Interpreter, task: ValTask, *numbers: tree.Expression) -> None:
    for number in [whole_number_of(number, task) for number in numbers]:
        run.machine.set_signal(number)


def _reset(run: Interpreter, _task: ValTask) -> None:
    run.machine.reset_signals()


def _runsig(run: Interpreter, task: ValTask, number: tree.Expression | None = None) -> None:
    run.set_run_signal(0 if number is None else whole_number_of(number, task))


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
        run.machine.say(text)


def _count(form: str, letter: str) -> int:
    return min(int(form[1:] or 1), 80) if form.startswith(letter) else 0


def _written(value: float, form: str) -> str:
    if form.startswith("I"):
        return f"{value:{min(int(form[1:] or 0), 80) or ''}.0f}"
    if form.startswith("F"):
        width, _, digits = form[1:].partition(".")
        return f"{value:{min(int(width or 0), 80) or ''}.{min(int(digits), 15)}f}"
    return f"{value:.6g}"


def _prompt(run: Interpreter, task: ValTask, action: tree.PromptFor) -> None:
    answer = run.machine.ask(action.text).strip()
    try:
        number = float(answer or 0.0)
    except ValueError:
        raise ProgramError(f"PROMPT: expected a number, not {answer[:40]!r}") from None
    if not isfinite(number):
        raise ProgramError("PROMPT: expected a finite number")
    run.machine.store(task.key_of(action.target), number)


# ---------------------------------------------------------------------------------------------------------------- flow


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


def _for(run: Interpreter, task: ValTask, action: tree.ForLoop) -> None:
    frame = task.frame_now
    at, key = frame.pc - 1, task.key_of(action.variable)
    again, frame.again = frame.again == at, -1
    if not again:
        value = number_of(action.first, task)
        step = 1.0 if action.step is None else number_of(action.step, task)
        if step == 0.0:
            raise ProgramError("FOR: a STEP of 0 never ends")
        frame.loops[at] = number_of(action.last, task), step
    else:
        value = number_of(action.variable, task) + frame.loops[at][1]
    last, step = frame.loops[at]
    run.machine.store(key, value)
    if (value - last) * step > 0.0:
        del frame.loops[at]
        frame.pc = frame.jumps.to[at]


def _call(_run: Interpreter, task: ValTask, action: tree.ProgramCall) -> None:
    task.call(action.program, action.arguments)


def _return(run: Interpreter, task: ValTask) -> None:
    run.end_of_program(task)


def _pause(run: Interpreter, task: ValTask) -> Waits:
    if task.moves:
        yield from _break(run, task)
    run.pause(f"PAUSE in program {task.at[0]}")


def _stop(run: Interpreter, task: ValTask) -> None:
    run.end_of_cycle(task)


def _halt(run: Interpreter, task: ValTask) -> None:
    task.cycles = 1
    run.end_of_cycle(task)


def _react(run: Interpreter, task: ValTask, action: tree.Reaction) -> None:
    if action.program not in run.machine.programs:
        raise ProgramError(f"there is no program {action.program}", column=action.column)
    if action.signal is None:
        task.on_error = action.program
        return
    number = whole_number_of(action.signal, task)
    signal_holds(number, task)  # there is such a signal
    priority = 1 if action.priority is None else whole_number_of(action.priority, task)
    task.watches[number] = Watch(action.program, priority, action.word == "REACTI")
    task.seen[number] = False


def _ignore(_run: Interpreter, task: ValTask, number: tree.Expression) -> None:
    task.watches.pop(whole_number_of(number, task), None)


def _lock(_run: Interpreter, task: ValTask, priority: tree.Expression) -> None:
    task.frame_now.priority = whole_number_of(priority, task)


def _pcexecute(run: Interpreter, task: ValTask, action: tree.ProcessStart) -> None:
    run.start_beside(action.program, 1 if action.cycles is None else whole_number_of(action.cycles, task))


_INSTRUCTIONS: Final[dict[str, Callable[..., Waits | None]]] = {
    "MOVE": _move(straight=False),
    "MOVES": _move(straight=True),
    "APPRO": _move(straight=False, approach=True),
    "APPROS": _move(straight=True, approach=True),
    "DEPART": _depart(straight=False),
    "DEPARTS": _depart(straight=True),
    "DRIVE": _drive,
    "ALIGN": _align,
    "READY": _ready,
    "DELAY": _delay,
    "BREAK": _break,
    "BRAKE": _brake,
    "OPEN": _hand(opened=True, now=False),
    "OPENI": _hand(opened=True, now=True),
    "CLOSE": _hand(opened=False, now=False),
    "CLOSEI": _hand(opened=False, now=True),
    "HERE": _here,
    "TOOL": _tool,
    "BASE": _base,
    "WAIT": _wait,
    "IGNORE": _ignore,
    "LOCK": _lock,
    "SIGNAL": _signal,
    "RESET": _reset,
    "RUNSIG": _runsig,
    "RETURN": _return,
    "PAUSE": _pause,
    "STOP": _stop,
    "HALT": _halt,
    **{word: _configure(word) for word in _CONFIGURATIONS},
    **dict.fromkeys(("COARSE", "FINE", "NULL", "NONULL"), _no_effect),
}
_ACTIONS: Final[dict[type, Callable[..., Waits | None]]] = {
    tree.SpeedSetting: _set_speed,
    tree.Assignment: _assign,
    tree.NumberedAssignment: _timer,
    tree.ParameterSetting: _parameter,
    tree.SwitchSetting: _switch,
    tree.Decomposition: _decompose,
    tree.Goto: _goto,
    tree.Block: _block,
    tree.ForLoop: _for,
    tree.CaseValues: _value,
    tree.ProgramCall: _call,
    tree.Reaction: _react,
    tree.ProcessStart: _pcexecute,
    tree.TypeOut: _type_out,
    tree.PromptFor: _prompt,
}
