"""Steps that move the arm, its hand and its frames: each waits for what it has to."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from qrobot.errors import ProgramError
from qrobot.model.transform import transform
from qrobot.units import M_PER_MM, RAD_PER_DEG
from qrobot.val import number_ranges, tree
from qrobot.val.evaluate import location_of, number_of, pose_of
from qrobot.val.printer import print_expression
from qrobot.val.task import ValTask, Waits
from qrobot.val.values import JointLocation, Transformation, joint_units, within_reason
from qrobot.val.workspace import aligned

if TYPE_CHECKING:
    from qrobot.val.interpreter import Interpreter


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


def _go(
    run: Interpreter,
    name: str,
    location: Transformation | JointLocation,
    straight: bool,
    per_cent: float | None = None,
) -> Waits:
    """Queue a motion, and wait until it begins: then the arm has passed the place before it."""
    machine, arm = run.machine, run.machine.arm
    machine.go(name, location, straight, per_cent)
    hand, given_up = machine.hand_at_next, run.rest.given_up
    machine.hand_at_next = None  # a reaction on the way there has none to take
    yield lambda: arm.waiting == 0
    if hand is not None and run.rest.given_up == given_up:
        arm.hand(hand)
    if not machine.switches["CP"]:
        yield lambda: arm.idle


def _drive(run: Interpreter, task: ValTask, *numbers: tree.Expression) -> Waits:
    joint, by, speed = (number_of(number, task) for number in numbers)
    machine = run.machine
    axis = int(number_ranges.joint(machine.robot.n).check(joint)) - 1
    yield from wait_for_arrival(run, task)
    q = machine.arm.setpoint  # not as measured: each DRIVE would move the other joints by the error of their servo
    q[axis] += by * joint_units(machine.robot)[axis]
    yield from _go(run, "DRIVE", JointLocation(q), False, number_ranges.SPEED.check(speed))


def _align(run: Interpreter, _task: ValTask) -> Waits:
    return _go(run, "ALIGN", Transformation(aligned(run.machine.destination_pose())), False)


def _ready(run: Interpreter, _task: ValTask) -> Waits:
    poses = run.machine.robot.poses
    if "ready" not in poses:
        raise ProgramError(f"{run.machine.robot.name} has no pose `ready`")
    return _go(run, "READY", JointLocation(poses["ready"]), False)


def _delay(run: Interpreter, task: ValTask, seconds: tree.Expression) -> Waits:
    length = number_ranges.DELAY.check(number_of(seconds, task))
    yield from wait_for_arrival(run, task)
    end = run.machine.arm.time_s + length
    yield lambda: run.machine.arm.time_s >= end


def wait_for_arrival(run: Interpreter, _task: ValTask) -> Waits:
    """BREAK: until every motion is done, and the arm stands."""
    yield lambda: run.machine.arm.idle


def _brake(run: Interpreter, _task: ValTask) -> Waits:
    run.rest.give_up_motions()
    yield lambda: run.machine.arm.idle


def _hand(opened: bool, now: bool) -> Callable[..., Waits]:
    def do(run: Interpreter, task: ValTask) -> Waits:
        if not now:
            run.machine.hand_at_next = opened
            return
        yield from wait_for_arrival(run, task)
        run.machine.arm.hand(opened)
        end = run.machine.arm.time_s + run.machine.hand_time_s
        yield lambda: run.machine.arm.time_s >= end

    return do


def _tool(run: Interpreter, task: ValTask, where: tree.Expression | None = None) -> Waits:
    tool = np.eye(4) if where is None else pose_of(where, task)
    yield from wait_for_arrival(run, task)
    run.machine.space.tool = tool
    run.machine.forget_destination()


def _base(run: Interpreter, task: ValTask, *numbers: tree.Expression | None) -> Waits:
    values = [0.0 if number is None else number_of(number, task) for number in numbers]
    dx, dy, dz, rotation = (*within_reason(values), *[0.0] * (4 - len(values)))
    yield from wait_for_arrival(run, task)
    run.machine.space.move_base(dx * M_PER_MM, dy * M_PER_MM, dz * M_PER_MM, rotation * RAD_PER_DEG)
    run.machine.forget_destination()


MOTIONS: Final = frozenset(("MOVE", "MOVES", "APPRO", "APPROS", "DEPART", "DEPARTS", "DRIVE", "ALIGN", "READY"))
WORDS: Final[dict[str, Callable[..., Waits | None]]] = {
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
    "BREAK": wait_for_arrival,
    "BRAKE": _brake,
    "OPEN": _hand(opened=True, now=False),
    "OPENI": _hand(opened=True, now=True),
    "CLOSE": _hand(opened=False, now=False),
    "CLOSEI": _hand(opened=False, now=True),
    "TOOL": _tool,
    "BASE": _base,
}
