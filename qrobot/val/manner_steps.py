"""Steps that say how later ones are done: speed, configuration, switches and parameters."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Final

from qrobot.val import number_ranges, tree
from qrobot.val.evaluate import number_of
from qrobot.val.task import ValTask, Waits

if TYPE_CHECKING:
    from qrobot.val.interpreter import Interpreter

_CONFIGURATIONS: Final = {"RIGHTY": "r", "LEFTY": "l", "ABOVE": "u", "BELOW": "d", "FLIP": "f", "NOFLIP": "n"}
_PAIRS: Final = {"r": "l", "l": "r", "u": "d", "d": "u", "f": "n", "n": "f"}


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
    numbers = number_ranges.SPEED_MMPS if action.in_mm_s else number_ranges.SPEED
    speed = numbers.check(number_of(action.value, task))
    run.machine.next_speed = (speed, action.in_mm_s)
    if action.always:
        run.machine.speed, run.machine.in_mm_s = speed, action.in_mm_s


def _parameter(run: Interpreter, task: ValTask, action: tree.ParameterSetting) -> None:
    value = number_ranges.PARAMETER_RANGES[action.name].check(number_of(action.value, task))
    match action.name:
        case "COLLISION":
            with run.may_wait(task):
                run.machine.tell_collisions(value, run.machine.switches["COMPLY"])
        case "RETRACT":
            run.machine.arm.retract(value)
        case "HAND.TIME":
            run.machine.hand_time_s = value


def _switch(run: Interpreter, task: ValTask, action: tree.SwitchSetting) -> None:
    if "COMPLY" in action.switches:
        with run.may_wait(task):
            run.machine.tell_collisions(run.machine.collision_percent, action.on)
    run.machine.switches |= dict.fromkeys(action.switches, action.on)


def _payload(run: Interpreter, task: ValTask, kg: tree.Expression, *centre: tree.Expression | None) -> None:
    """PAYLOAD: mass, and its centre in the frame of the flange, mm."""
    at = [0.0 if number is None else number_of(number, task) for number in centre]
    mass = number_of(kg, task)
    with run.may_wait(task):
        run.machine.arm.payload(mass, (*at, *[0.0] * (3 - len(at))))


WORDS: Final[dict[str, Callable[..., Waits | None]]] = {
    **{word: _configure(word) for word in _CONFIGURATIONS},
    "PAYLOAD": _payload,
    **dict.fromkeys(("COARSE", "FINE", "NULL", "NONULL"), _no_effect),
}
ACTIONS: Final[dict[type, Callable[..., Waits | None]]] = {
    tree.SpeedSetting: _set_speed,
    tree.ParameterSetting: _parameter,
    tree.SwitchSetting: _switch,
}
