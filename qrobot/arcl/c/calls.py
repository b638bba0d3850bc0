"""The calls of `<arcl.h>`, by name: from the arguments of C to `qrobot.arcl`, and back."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from math import inf
from typing import Any, Final, TypeAlias

import numpy as np

from qrobot import arcl
from qrobot.arcl.c.objects import ObjectTable
from qrobot.arcl.c.values import WordList
from qrobot.arcl.motion import Motion
from qrobot.arcl.positions import Pos
from qrobot.arcl.robot import ArclRobot
from qrobot.arcl.trans import Trans
from qrobot.c_transport.message import CallMessage, Op
from qrobot.errors import MotionError
from qrobot.motion import Trsf

_KINDS: Final = (arcl.CONST, arcl.VARB, arcl.HOLD, arcl.FNDEF)
_DIRECTIONS: Final = (arcl.IOD_IN, arcl.IOD_OUT)
_COLUMNS: Final = 10
CallValues: TypeAlias = Sequence[Any]
CHandler: TypeAlias = Callable[[ObjectTable, int, CallValues], "CallMessage | None"]


def _numbers(values: Iterable[float]) -> CallMessage:
    numbers = [float(value) for value in values]
    return CallMessage(Op.REPLY, len(numbers), numbers=numbers)


def _of(number: int, given: Sequence[float]) -> Any:
    """The structure of so many numbers: Quat, Diff or QuatVect."""
    if number == 4:
        return arcl.Quat(*given)
    if number == 6:
        return arcl.new_diff(*given)
    return arcl.QuatVect(arcl.Quat(*given[:4]), arcl.new_vector(*given[4:]))


def _structure(value: Any) -> Any:
    return _of(len(value), value) if isinstance(value, tuple) else value


def _flat(value: Any) -> list[float]:
    """The numbers of what a call gives."""
    if isinstance(value, arcl.Diff):
        return [*value.d, *value.r]
    if isinstance(value, arcl.Force):
        return [*value.f, *value.m]
    if isinstance(value, arcl.Quat):
        return [value.s, value.x, value.y, value.z]
    if isinstance(value, arcl.QuatVect):
        return [*_flat(value.q), *value.v]
    return [float(value)] if isinstance(value, int | float) else [float(number) for number in value]


def _gives_numbers(call: Callable[..., Any]) -> CHandler:
    def handler(_: ObjectTable, __: int, given: CallValues) -> CallMessage:
        value = call(*(_structure(one) for one in given))
        return _numbers([] if value is None else _flat(value))

    return handler


def _gives_trans(call: Callable[..., Trans]) -> CHandler:
    def handler(objects: ObjectTable, place: int, given: CallValues) -> None:
        objects.put_trans(place, call(*(_structure(one) for one in given)))

    return handler


def _gives_object(call: Callable[..., Any]) -> CHandler:
    def handler(objects: ObjectTable, place: int, given: CallValues) -> None:
        objects.put(place, call(*given))

    return handler


def _plain(call: Callable[..., Any]) -> CHandler:
    def handler(_: ObjectTable, __: int, given: CallValues) -> None:
        call(*given)

    return handler


# ------------------------------------------------------------------------------------------------ those of their own


def _arcl_open(objects: ObjectTable, place: int, given: CallValues) -> CallMessage:
    words = next((value for value in given if isinstance(value, WordList)), WordList())
    argv = [_Word(text, index) for index, text in enumerate(words)]
    rest: list[Any] = list(argv)
    robot = arcl.arcl_open(*(rest if isinstance(value, WordList) else value for value in given))
    objects.put(place, robot)
    kept = {word.place for word in rest}
    return CallMessage(Op.REPLY, numbers=[float(index in kept) for index in range(len(argv))], text=robot.name)


class _Word(str):
    """A word of the command line, and its place."""

    place: int

    def __new__(cls, text: str, place: int) -> _Word:
        word = super().__new__(cls, text)
        word.place = place
        return word


def _move(objects: ObjectTable, place: int, given: CallValues) -> CallMessage:
    rp, *rest = given
    if not isinstance(rp, ArclRobot):
        raise MotionError(f"move: a robot is needed, from arcl_open, not {rp!r}")
    motion = rp.move(*rest, announce=lambda motion: objects.put_motion(place, motion))
    return CallMessage(Op.REPLY, text=motion.name)


def _new_trans(objects: ObjectTable, place: int, given: CallValues) -> None:
    name, kind, *function = given if given[-1] != 0 or len(given) == 2 else given[:-1]
    kinds = _KINDS[kind - 1] if isinstance(kind, int) and 1 <= kind <= len(_KINDS) else kind
    if not isinstance(name, str) or not all(callable(one) for one in function):
        raise MotionError("new_trans: a name and a kind are needed, and with FNDEF a function")
    trans = arcl.new_trans(name, kinds, *function)
    objects.put_trans(place, trans, trans._function)


def _joint_pos(objects: ObjectTable, place: int, given: CallValues) -> None:
    rp, name, *rest = given
    at = next((index for index, value in enumerate(rest) if value is arcl.TL), len(rest))
    degs, tool = rest[:at], rest[at:]
    if isinstance(rp, ArclRobot) and len(degs) == rp.n + 1 and degs[-1] == 0:  # which closes the list
        degs.pop()
    if degs and isinstance(degs[0], tuple) and not any(degs[1:]):
        degs = list(degs[0])
    objects.put(place, arcl.joint_pos(rp, _name("joint_pos", name), degs, *tool))


def _robot_pos(objects: ObjectTable, place: int, given: CallValues) -> None:
    rp, name, *tool = given
    objects.put(place, arcl.robot_pos(rp, _name("robot_pos", name), *tool))


def _teach(objects: ObjectTable, place: int, given: CallValues) -> CallMessage:
    """`function` of the program is called with the transform at `place`, which has the value of T6 then."""
    rp, function = given
    shared = objects.put_trans(place, arcl.new_trans("T6", arcl.VARB))

    def learn(T6: Trans, rp: ArclRobot) -> Any:
        shared.value = T6.value
        return function(shared, rp)

    return _numbers([arcl.teach(rp, learn if callable(function) else function)])


def _name(call: str, given: Any) -> str:
    if not isinstance(given, str):
        raise MotionError(f"{call}: a name is needed behind the robot, not {given!r}")
    return given


def _new_iod(objects: ObjectTable, place: int, given: CallValues) -> None:
    rp, direction, first, count = given
    if direction not in (1, 2):
        raise MotionError(f"new_iod: IOD_IN or IOD_OUT is needed, not {direction!r}")
    if not isinstance(rp, ArclRobot):
        raise MotionError(f"new_iod: a robot is needed, from arcl_open, not {rp!r}")
    objects.put(place, arcl.new_iod(rp, _DIRECTIONS[direction - 1], first, count))


def _new_jacob(_: ObjectTable, __: int, given: CallValues) -> CallMessage:
    rp, pos = given
    if not isinstance(rp, ArclRobot) or not isinstance(pos, Pos) or not isinstance(pos.target, np.ndarray):
        raise MotionError("new_jacob: a robot is needed, and a position of joint_pos or robot_pos")
    matrix = rp.aki.jacobian(pos.target)
    if (n := matrix.shape[1]) > _COLUMNS:
        raise MotionError(f"new_jacob: {n} joints; at most {_COLUMNS} are possible in C")
    return _numbers([n, *matrix.ravel()])


def _force_from(_: ObjectTable, __: int, given: CallValues) -> CallMessage:
    trans, numbers = given
    return _numbers(_flat(arcl.force_from(_trans("force_from", trans), arcl.new_force(*numbers))))


def _diff_in(_: ObjectTable, __: int, given: CallValues) -> CallMessage:
    trans, numbers = given
    return _numbers(_flat(arcl.diff_in(_trans("diff_in", trans), arcl.new_diff(*numbers))))


def _trans(call: str, given: Any) -> Trsf:
    if not isinstance(given, Trsf):
        raise MotionError(f"{call}: a transform is needed, not {given!r}")
    return given


def _sym_lookup(objects: ObjectTable, place: int, given: CallValues) -> CallMessage:
    (name,) = given
    if (known := arcl.sym_lookup(name)) is None:
        return CallMessage(Op.REPLY, 0)
    if objects.place_of(known) < 0:  # out of a file
        known = arcl.sym_enter(objects.put_trans(place, known))
    return CallMessage(Op.REPLY, 1, [objects.place_of(known)])


def _free(objects: ObjectTable, place: int, _: CallValues) -> None:
    if isinstance(objects.at(place), ArclRobot):
        raise MotionError("arcl_free: a robot is let go by arcl_close")
    if isinstance(objects.at(place), Motion):
        raise MotionError("arcl_free: the memory of a motion stays ARCL's, which uses it again 256 motions later")
    objects.free(place)


def _kept(_: ObjectTable, __: int, given: CallValues) -> CallMessage:
    return CallMessage(Op.REPLY, text=arcl.arcl_kept(*given))


def _treal(_: ObjectTable, __: int, given: CallValues) -> CallMessage:
    return _numbers([arcl.ami_treal(*given)])


NULL_FROM: Final = {"arcl_errproc": 0, "arcl_setload": 2, "arcl_collision": 2}
"""Calls that take null pointers, from that argument on."""


def check_values(call: str, given: CallValues) -> None:
    """Raise MotionError: there are too few or too many, or one is a null pointer where there must be none."""
    if call in LISTS:
        least, most = LISTS[call]
        if not least <= len(given) <= most:
            raise MotionError(f"{call}: {len(given)} values; from {least} to {most:g} are possible")
    elif any(value is None for value in given[: NULL_FROM.get(call)]):
        raise MotionError(f"{call}: a null pointer was given")


WAITING: Final = frozenset(
    {"arcl_open", "arcl_close", "arcl_wait", "arcl_setload", "arcl_collision", "sem_pend", "teach"}
)
"""Calls that let samples pass, or take or release an arm: no function that is called at a sample may ask them."""
GIVING_WAY: Final = frozenset({"arcl_wait", "sem_pend"})
"""Those of them that may be broken off, and asked again, for the sake of another thread of the program."""
LISTS: Final = {
    "arcl_open": (0, inf),
    "move": (2, inf),
    "stop": (1, inf),
    "gripper": (2, 3),
    "new_trans": (2, 4),
    "makeposition": (0, inf),
    "joint_pos": (2, inf),
    "robot_pos": (2, 5),
    "arcl_wait": (1, 2),
    "ami_treal": (0, 1),
}
"""Calls with open lists: how many values they take, at least and at most."""
CALLS: Final[dict[str, CHandler]] = {
    "arcl_open": _arcl_open,
    "arcl_close": _plain(arcl.arcl_close),
    "arcl_skip": _plain(arcl.arcl_skip),
    "arcl_override": _plain(arcl.arcl_override),
    "arcl_keep_path": _plain(arcl.arcl_keep_path),
    "arcl_retract": _plain(arcl.arcl_retract),
    "arcl_kept": _kept,
    "arcl_setload": _plain(arcl.arcl_setload),
    "arcl_collision": _plain(arcl.arcl_collision),
    "arcl_pause": _plain(arcl.arcl_pause),
    "arcl_resume": _plain(arcl.arcl_resume),
    "arcl_wait": _plain(arcl.arcl_wait),
    "arcl_errproc": _plain(arcl.arcl_errproc),
    "arcl_free": _free,
    "ami_treal": _treal,
    "move": _move,
    "stop": _plain(arcl.stop),
    "gripper": _plain(arcl.gripper),
    "teach": _teach,
    "where": _gives_trans(arcl.where),
    "makeposition": _gives_object(arcl.makeposition),
    "joint_pos": _joint_pos,
    "robot_pos": _robot_pos,
    "new_trans": _new_trans,
    "new_trans_tr": _gives_trans(arcl.new_trans_tr),
    "new_trans_rotvec": _gives_trans(arcl.new_trans_rotvec),
    "new_trans_rpy": _gives_trans(arcl.new_trans_rpy),
    "new_trans_eul": _gives_trans(arcl.new_trans_eul),
    "new_trans_quatvect": _gives_trans(arcl.new_trans_quatvect),
    "new_trans_diff": _gives_trans(arcl.new_trans_diff),
    "trans_assign": _plain(arcl.trans_assign),
    "trans_mult": _plain(arcl.trans_mult),
    "trans_invert": _plain(arcl.trans_invert),
    "trans_rpy": _gives_numbers(arcl.trans_rpy),
    "new_vector": _gives_numbers(arcl.new_vector),
    "vect_dot": _gives_numbers(arcl.vect_dot),
    "vect_cross": _gives_numbers(arcl.vect_cross),
    "vect_unit": _gives_numbers(arcl.vect_unit),
    "new_quat": _gives_numbers(arcl.new_quat),
    "new_quat_rotvec": _gives_numbers(arcl.new_quat_rotvec),
    "quat_mult": _gives_numbers(arcl.quat_mult),
    "quat_invert": _gives_numbers(arcl.quat_invert),
    "quat_interp": _gives_numbers(arcl.quat_interp),
    "new_quatvect": _gives_numbers(arcl.QuatVect),
    "quatvect_of": _gives_numbers(arcl.quatvect_of),
    "new_diff": _gives_numbers(arcl.new_diff),
    "diff_of": _gives_numbers(arcl.diff_of),
    "diff_in": _diff_in,
    "new_force": _gives_numbers(arcl.new_force),
    "force_from": _force_from,
    "new_jacob": _new_jacob,
    "new_iod": _new_iod,
    "named_iod": _gives_object(arcl.named_iod),
    "iod_read": _gives_numbers(arcl.iod_read),
    "iod_value": _gives_numbers(arcl.iod_value),
    "iod_write": _plain(arcl.iod_write),
    "iod_set_value": _plain(arcl.iod_set_value),
    "new_sem": _gives_object(arcl.new_sem),
    "sem_take": _gives_numbers(arcl.sem_take),
    "sem_give": _gives_numbers(arcl.sem_give),
    "sem_clear": _gives_numbers(arcl.sem_clear),
    "sem_pend": _gives_numbers(arcl.sem_pend),
    "sym_enter": _plain(arcl.sym_enter),
    "sym_lookup": _sym_lookup,
    "sym_delete": _gives_numbers(arcl.sym_delete),
    "sym_dump": _gives_numbers(arcl.sym_dump),
    "sym_load": _gives_numbers(arcl.sym_load),
}
"""Every call that a message of a program asks for, by its name."""
