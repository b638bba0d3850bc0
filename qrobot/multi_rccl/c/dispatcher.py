"""Dispatcher of the calls of a C program of Multi-RCCL: from each message to `qrobot.multi_rccl`."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from functools import partial
from typing import Any, Final, TypeAlias

from qrobot.c_transport.memory import ProgramMemory
from qrobot.c_transport.message import REFS, CallMessage, Op
from qrobot.c_transport.program_link import ProgramLink
from qrobot.errors import MotionError, QRobotError, letting_go, raise_first
from qrobot.motion import TransformKind
from qrobot.multi_rccl import program as calls
from qrobot.multi_rccl.c.shared_manip import SharedManip
from qrobot.multi_rccl.manip import Manip
from qrobot.multi_rccl.positions import TRANS, make_position
from qrobot.multi_rccl.program import ManipProgram
from qrobot.multi_rccl.robot_manip import RobotManip
from qrobot.rccl.c.call_row import OBJECT_CALLS, CallReply, CallRow
from qrobot.rccl.c.dispatcher import FIELDS, OBJECTS
from qrobot.rccl.c.object_registry import ObjectRegistry, UnknownError
from qrobot.rccl.c.recorded_transforms import RecordedTransforms
from qrobot.rccl.c.shared import SharedTransform
from qrobot.rccl.c.undone import terminated, undone
from qrobot.rccl.position import Position, Separator, there
from qrobot.rci.bad_end import stop_all
from qrobot.rci.listening import giving_way

MANIP: Final = REFS - 1  # reference to the manipulator of a call
TERMINATE: Final = 3  # among the places of variables
TRANS_WORD: Final = -4  # as EQ and TL go along


class ManipDispatcher:
    """Serves one program, which has a world of transforms and positions, and manipulators.

    Args:
        memory: shared with the program.
        places: of its global variables, and of the fields in its structures; the order is that of shared.c.
        link: to the program.
    """

    def __init__(self, memory: ProgramMemory, places: Sequence[int], link: ProgramLink) -> None:
        *variables, last_link, _park, present = places[:OBJECTS]
        fields = places[OBJECTS : OBJECTS + FIELDS]
        self._memory, self._link = memory, link
        self._terminate = memory.ints(variables[TERMINATE])
        t6 = SharedTransform("T6", TransformKind.UNKNOWN, memory.reals(last_link + fields[0], 12))
        self.objects = ObjectRegistry(memory, fields, (last_link, t6), self._evaluate, link.signal)
        self.objects.put(present, "there", there().target, ours=True)
        self.objects.lend(TRANS_WORD, TRANS)
        self.recorded = RecordedTransforms(self.objects, link.say)
        self._program = ManipProgram()
        self._manips: dict[int, SharedManip] = {}
        self._dropped = 0  # motions of arms, because of `terminate`

    def answer(self, message: CallMessage, background: bool = False) -> CallMessage:
        """Do what is asked, in a function that is called at a sample if `background`.

        Raises QRobotError when that cannot be.
        """
        op = Op(message.op)
        if (call := CALLS.get(op)) is None:
            raise MotionError(f"{op.name.lower()}: {OTHER_RELEASE}")
        if background and call.waits:
            raise MotionError("a function that is called at a sample must not wait, nor take or release an arm")
        if not background and self._terminate[0]:
            with letting_go(self.let_go):
                left = self._dropped + self._unserved()
            raise terminated(left)
        if not background:
            _skip(list(self._manips.values()))
        try:
            answer = call.handler(self, message)
        except UnknownError as error:
            raise MotionError(_in_c(f"{op.name.lower()}: {error}")) from error
        except MotionError as error:
            raise MotionError(_in_c(str(error))) from error
        self._show()
        return answer or CallMessage(Op.REPLY)

    def let_go(self) -> None:
        """Bring all arms to rest together, and release them. Raises, at the end, what ended control of one before."""
        program, self._program = self._program, ManipProgram()
        with letting_go(partial(_release_all, program)):
            stop_all()

    # -------------------------------------------------------------------------------------------- at every sample

    def _each_sample(self, shared: SharedManip, arm: RobotManip) -> None:
        """An arm comes to a sample: the program sees it, and what it has changed goes out."""
        if not arm.on:  # samples pass while it is let go of
            return
        self._show()
        shared.take_outputs(arm)
        if self._terminate[0]:
            self._dropped += arm.channel.unserved
            arm.cancel(0.0)
        _skip([shared, *(each for each in list(self._manips.values()) if not isinstance(each.manip, RobotManip))])

    def _show(self) -> None:
        for shared in list(self._manips.values()):
            with suppress(QRobotError):  # an arm that is let go of meanwhile keeps what was shown
                shared.show()

    def _evaluate(self, place: int) -> None:
        self._call(Op.CALL_TRANSFORM, place)

    def _call(self, op: Op, place: int) -> None:
        """Call a function of the program, which sees the newest state."""
        self._show()
        self._link.call(op, place)

    # ----------------------------------------------------------------------------------------------- manipulators

    def open(self, message: CallMessage) -> CallReply:
        """A manipulator at refs[0], whose transform is at refs[5]; the text has its name, robot and bridge."""
        place, *fields, trans = message.refs[:6]
        if self._program.over:
            self._program = ManipProgram()
        manip = self._program.open(*message.text.split("\n"))
        self._manips[place] = SharedManip(self._memory, place, fields, manip)
        self.objects.lend(trans, manip.trans)
        return None

    def _shared(self, message: CallMessage) -> SharedManip:
        place = message.refs[MANIP]
        if not place:
            raise MotionError(f"{Op(message.op).name.lower()}: {OTHER_RELEASE}")
        if place not in self._manips:
            raise UnknownError("this is no manipulator of rccl_open")
        return self._manips[place]

    def manip(self, message: CallMessage) -> Manip:
        """The manipulator of a call. Raises UnknownError, and MotionError for calls of the other release."""
        return self._shared(message).manip

    def control(self, message: CallMessage) -> CallReply:
        """Turn a generator on, with a sample period of numbers[0] ms if that is not 0."""
        shared = self._shared(message)
        manip = shared.manip
        calls.rccl_control(manip, period_ms=message.numbers[0] or None)
        if isinstance(manip, RobotManip):
            shared.begin_outputs(manip)
            manip.channel.each_sample(partial(self._each_sample, shared, manip))
        return None

    def release(self, message: CallMessage) -> CallReply:
        """Let go of a manipulator; or of all, when `n` after all motions are done: the program ends."""
        if message.refs[MANIP]:
            calls.rccl_release(self.manip(message))
            return None
        arms = [arm.channel for arm in self._program.robots]
        with letting_go(self.let_go):
            for channel in arms if message.n else ():
                channel.finish()
            if message.n and self._terminate[0]:
                raise terminated(self._dropped)
            left = self._unserved()
        return CallMessage(Op.REPLY, text=undone(left))

    def _unserved(self) -> int:
        return sum(arm.channel.unserved for arm in self._program.robots)

    # -------------------------------------------------------------------------------------------------- positions

    def make_position(self, message: CallMessage) -> CallReply:
        """The position at refs[0], of the n terms from refs[2] on; solved for refs[1] if that is not 0."""
        terms = [self.objects.term(place) for place in message.refs[2 : 2 + message.n]]
        unknown = self.objects.term(message.refs[1]) if message.refs[1] else None
        if isinstance(unknown, Separator):
            raise MotionError("makePositionFor: the unknown is a transform, not EQ or TL")
        return self._put(message, make_position(*terms, unknown=unknown))

    def jposition(self, message: CallMessage) -> CallReply:
        """The position at refs[0], of n joints."""
        joints = message.numbers[: message.n]
        return self._put(message, calls.jposition(self.manip(message), message.text, joints))

    def pose(self, message: CallMessage) -> CallReply:
        """The position at refs[0], which the robot's file names."""
        return self._put(message, calls.pose(self.manip(message), message.text))

    def _put(self, message: CallMessage, position: Position) -> CallMessage:
        self.objects.put(message.refs[0], position.name, position.target)
        return CallMessage(Op.REPLY, text=position.name)

    # ---------------------------------------------------------------------------------------------------- motions

    def stop(self, message: CallMessage) -> CallReply:
        """Queue a stop of numbers[0] ms, at the position at refs[0] if `n`."""
        position = self.objects.position(message.refs[0]) if message.n else None
        calls.stop(self.manip(message), position, message.numbers[0])
        return None

    def evalfn(self, message: CallMessage) -> CallReply:
        """A function during the next motion. What it returns is no code: of old it returned nothing."""
        function, shared = message.refs[0], self._shared(message)

        def monitor() -> int:
            _skip([shared])  # what others have said before is for the younger motion, this may be the older
            self._call(Op.CALL_FUNCTION, function)
            return shared.take_nextmove()

        calls.evalfn(shared.manip, monitor)
        return None

    def hand(self, message: CallMessage) -> CallReply:
        """Open or close it."""
        (calls.open_hand if message.text == "open" else calls.grasp)(_arm(self, message))
        return None

    def collision(self, message: CallMessage) -> CallReply:
        """Choose what follows a collision, with a way back, mm, and thresholds of `n` joints, 0 for the file's."""
        mm, *thresholds = message.numbers[: message.n + 1]
        calls.collision(self.manip(message), message.text, thresholds if message.n else None, mm)
        return None

    def setload(self, message: CallMessage) -> CallReply:
        """Tell what the hand holds: mass, centre, inertia."""
        calls.setload(self.manip(message), message.numbers[0], message.numbers[1:4], message.numbers[4:10])
        return None

    def update(self, message: CallMessage) -> CallReply:
        """Measure the transform at refs[0] when the next motion ends, by the position at refs[1]."""
        trans, position = self.objects.transform(message.refs[0]), self.objects.position(message.refs[1])
        calls.update(self.manip(message), trans, position)
        return None

    def teach(self, message: CallMessage) -> CallReply:
        """A person shows the transform at refs[0] with an arm, by the position at refs[1]; the answer is YES or NO."""
        trans, position = self.objects.transform(message.refs[0]), self.objects.position(message.refs[1])
        data_base, link = self.recorded.database, self._link
        return CallMessage(
            Op.REPLY, calls.teach_by(_arm(self, message), trans, position, data_base, link.ask, link.say)
        )

    def keep_path(self, message: CallMessage) -> CallReply:
        """Keep the path in a stop of the servo when `n` is not 0, with a way back of so many mm and degrees at most."""
        calls.keep_path(self.manip(message), bool(message.n), message.numbers[0], message.numbers[1])
        return None

    def kept(self, message: CallMessage) -> CallReply:
        """Reason for which the arm stands off its path."""
        return CallMessage(Op.REPLY, text=calls.kept(_arm(self, message)))

    def next_sample(self, message: CallMessage) -> CallReply:
        """Wait for it, or give way to another thread; `text` names the event of ours that the program waits for."""
        group = self._program.group
        begin = group.tick
        with giving_way(self._link.others_wait):
            self._program.wait(lambda: group.tick != begin, message.text)
        return None


def _arm(dispatcher: ManipDispatcher, message: CallMessage) -> Any:
    """The manipulator of a call; whether it is an arm, the call finds out."""
    return dispatcher.manip(message)


def _release_all(program: ManipProgram) -> None:
    """Release all manipulators of a program, frames last. Raises, at the end, the first error."""
    failed: list[BaseException] = []
    for manip in sorted(program.manips, key=lambda manip: not isinstance(manip, RobotManip)):
        try:
            calls.rccl_release(manip)
        except BaseException as error:
            failed.append(error)
    raise_first(failed, ours_too=True)


def _skip(manips: Iterable[SharedManip]) -> None:
    """End the motions that the program wants to be ended."""
    for each in manips:
        on = not isinstance(each.manip, RobotManip) or each.manip.on
        if on and (code := each.take_nextmove()):
            each.manip.skip(code)


def _in_c(text: str) -> str:
    """A message with the names that calls have in C."""
    for name, in_c in NAMES_IN_C.items():
        text = text.replace(name, in_c)
    return text


NAMES_IN_C: Final = {"make_position": "makePosition", "tracking_mode": "trackingMode"}
OTHER_RELEASE: Final = (
    "this is a call of RCCL 1.0 in a program of Multi-RCCL: compile all files of a program for one release "
    "(`qrobot cc --release`)"
)
ManipCallRow: TypeAlias = CallRow[ManipDispatcher]


def _plain(call: Callable[..., None]) -> ManipCallRow:
    """A call of a manipulator with nothing else."""
    return CallRow(lambda dispatcher, message: call(dispatcher.manip(message)))


def _to(call: Callable[..., None]) -> ManipCallRow:
    """A call of a manipulator with a position."""
    return CallRow(lambda dispatcher, message: call(
        dispatcher.manip(message), dispatcher.objects.position(message.refs[0])
    ))  # fmt: skip


def _numbers(call: Callable[..., None], count: int) -> ManipCallRow:
    """A call of a manipulator with so many numbers."""
    return CallRow(lambda dispatcher, message: call(dispatcher.manip(message), *message.numbers[:count]))


def _word(call: Callable[..., None]) -> ManipCallRow:
    """A call of a manipulator with a text."""
    return CallRow(lambda dispatcher, message: call(dispatcher.manip(message), message.text))


def _directions(call: Callable[..., None]) -> ManipCallRow:
    """A call of a manipulator with names of directions, and a number for each."""
    return CallRow(lambda dispatcher, message: call(
        dispatcher.manip(message), message.text, *message.numbers[: message.n]
    ))  # fmt: skip


CALLS: Final[dict[Op, ManipCallRow]] = {
    # manipulators
    Op.MANIP_OPEN: CallRow(ManipDispatcher.open, waits=True),
    Op.CONTROL: CallRow(ManipDispatcher.control, waits=True),
    Op.RELEASE: CallRow(ManipDispatcher.release, waits=True),
    Op.NEXT_SAMPLE: CallRow(ManipDispatcher.next_sample, waits=True),
    Op.MOVE: _to(calls.move),
    Op.STOP: CallRow(ManipDispatcher.stop),
    Op.MAINTAIN: _to(calls.maintain),
    Op.TRACKING_MODE: _plain(calls.tracking_mode),
    Op.CANCEL: _numbers(calls.cancel, 1),
    Op.SETVEL: _numbers(calls.setvel, 2),
    Op.SETIME: _numbers(calls.setime, 2),
    Op.SETMODE: _word(calls.setmode),
    Op.SETCONF: _word(calls.setconf),
    Op.LOCK: _word(calls.lock),
    Op.DISTANCE: _directions(calls.distance),
    Op.LIMIT: _directions(calls.limit),
    Op.COMPLY: _directions(calls.comply),
    Op.EVALFN: CallRow(ManipDispatcher.evalfn),
    Op.HAND: CallRow(ManipDispatcher.hand),
    Op.OVERRIDE: _numbers(calls.override, 1),
    Op.PAUSE: _plain(calls.pause),
    Op.RETRACT: _numbers(calls.retract, 1),
    Op.COLLISION: CallRow(ManipDispatcher.collision, waits=True),
    Op.SETLOAD: CallRow(ManipDispatcher.setload, waits=True),
    Op.UPDATE: CallRow(ManipDispatcher.update),
    Op.TEACH: CallRow(ManipDispatcher.teach, waits=True),
    Op.KEEP_PATH: CallRow(ManipDispatcher.keep_path),
    Op.KEPT: CallRow(ManipDispatcher.kept),
    Op.RESUME: _plain(calls.resume),
    # transforms and positions
    Op.MAKE_POSITION: CallRow(ManipDispatcher.make_position),
    Op.JPOSITION: CallRow(ManipDispatcher.jposition),
    Op.POSE: CallRow(ManipDispatcher.pose),
    **OBJECT_CALLS,
}
"""Every call that a message of a program asks for."""
