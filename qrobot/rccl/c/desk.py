"""What each call of a C program does: from its message to `qrobot.rccl`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, TypeAlias

import numpy as np

from qrobot.errors import ConfigError, MotionError
from qrobot.model.transform import inverse
from qrobot.model.transmission import transmission_params
from qrobot.motion import Kind, Trsf
from qrobot.motion.limits import Floats
from qrobot.rccl import program, transforms
from qrobot.rccl.c.message import Message, Op
from qrobot.rccl.c.shared import SharedEvent, SharedMemory, SharedPosition, SharedTransform, numbers_of, value_of
from qrobot.rccl.c.variables import Variables
from qrobot.rccl.channel import YES, Channel
from qrobot.rccl.database import DataBase
from qrobot.rccl.lesson import teach
from qrobot.rccl.position import EQ, TL, Target, Word, makeposition, there
from qrobot.rccl.stepping import STEPPING_HELP, Stepper
from qrobot.rccl.transforms import Transform, t6, timed

_KINDS: Final = (Kind.FUNCTION, Kind.CONST, Kind.VARB, Kind.HOLD)  # numbered by newtrans
_WORDS: Final = {-2: EQ, -3: TL}
_MAKERS: Final[dict[str, Callable[..., Transform]]] = {
    "trsl": lambda px, py, pz: transforms.gentr_trsl("", px, py, pz),
    "rot": lambda px, py, pz, vx, vy, vz, a: transforms.gentr_rot("", px, py, pz, (vx, vy, vz), a),
    "eul": lambda *numbers: transforms.gentr_eul("", *numbers),
    "rpy": lambda *numbers: transforms.gentr_rpy("", *numbers),
    "pao": lambda *numbers: transforms.gentr_pao("", numbers[0:3], numbers[3:6], numbers[6:9]),
}

Answer: TypeAlias = "Message | None"


@dataclass(frozen=True)
class Talk:
    """How the engine reaches the program.

    Attributes:
        call: have a function of the program called: the `Op`, and which.
        signal: have the program count an event.
        ask: put a question to the person at its terminal; EOFError when nobody answers.
        say: print lines there.
        listen: raises LinkLost when the program has gone.
    """

    call: Callable[[Op, int], None]
    signal: Callable[[int], None]
    ask: Callable[[str], str]
    say: Callable[[str], None]
    listen: Callable[[], None]


class UnknownError(MotionError):
    """What a call was given is nothing that we know."""


class Desk:
    """Knows the transforms and positions of one program, and its arm.

    Args:
        memory: shared with the program.
        places: of its global variables, and of the fields in its structures; the order is that of shared.c.
        talk: to the program.
        robot: that its arm is, a packaged one's name or a file.
    """

    def __init__(self, memory: SharedMemory, places: list[int], talk: Talk, robot: str) -> None:
        *variables, last_link, park, present, self._axes, self._code, self._scal, self._end = places
        self._memory, self._talk, self._robot = memory, talk, robot
        self._variables = Variables(memory, variables, last_link + self._axes)
        self._transforms: dict[int, SharedTransform] = {last_link: self._variables.t6}
        self._positions: dict[int, SharedPosition] = {present: self._position(present, "there", there().target)}
        self._park = park
        self._database: DataBase | None = None
        self._functions: tuple[int, ...] = ()
        self._arm: Channel | None = None
        self._leaving = False

    @property
    def arm(self) -> Channel:
        """The arm of the program, which takes it at its first call that needs one."""
        if self._arm is None:
            self._arm = self._take_arm()
        return self._arm

    def _take_arm(self) -> Channel:
        arm = program.control(self._robot)
        self._positions[self._park] = self._position(self._park, "park", arm.pose("park").target)
        self._variables.show(arm)
        self._variables.begin_outputs(arm)
        arm.each_sample(self._each_sample)
        return arm

    def answer(self, message: Message, background: bool = False) -> Message:
        """Do what is asked, in a function that is called at a sample if `background`.

        Raises QRobotError when that cannot be.
        """
        op = Op(message.op)
        if background and op in _WAITING:
            raise MotionError("a function that is called at a sample must not wait, nor take or release the arm")
        if not background:
            self._look_at_flags()
        try:
            answer = _CALLS[op](self, message)
        except UnknownError as error:
            raise MotionError(f"{op.name.lower()}: {error}") from error
        self._variables.show_queue(self._arm)
        return answer or Message(Op.REPLY)

    # -------------------------------------------------------------------------------------------- at every sample

    def _each_sample(self) -> None:
        """Functions given to `control` see the newest state, and their changes go out."""
        arm = self._arm
        if arm is None or self._leaving:  # samples pass while it is taken and while it is released
            return
        self._variables.show(arm)
        self._variables.show_queue(arm)
        self._variables.take_outputs(arm)
        if self._functions:
            self._variables.show_command(arm)
            for function in self._functions:
                self._talk.call(Op.CALL_FUNCTION, function)
            self._variables.take_command(arm)
            self._variables.take_outputs(arm)
        if self._variables.terminate:
            arm.stop()
        elif code := self._nextmove():
            arm.nextmove(code)

    def _look_at_flags(self) -> None:
        """What the program has assigned since the latest sample counts now."""
        if self._arm is None:
            return
        if self._variables.terminate:
            self.let_go()
            raise MotionError("the program has set `terminate`")
        if code := self._nextmove():
            self._arm.nextmove(code)

    def _nextmove(self) -> int:
        code = self._variables.take_nextmove()
        if code < 0:
            raise MotionError(f"nextmove = {code}: the code must be positive, or it could not be told from our own")
        return code

    def _call(self, op: Op, place: int) -> None:
        """Call a function of the program, which sees the newest state."""
        if self._arm is not None:
            self._variables.show(self._arm)
        self._talk.call(op, place)

    # ------------------------------------------------------------------------------------------- control, release

    def control(self, message: Message) -> Answer:
        """Take the arm; functions to be called at every sample may come along."""
        self._functions = tuple(function for function in message.refs[:2] if function)
        if self._arm is None:
            self._arm = self._take_arm()
        return None

    def release(self, _: Message) -> Answer:
        """Let go of it."""
        self.let_go()
        return None

    def let_go(self) -> None:
        """Bring the arm to rest and release it, if there is one. Raises what ended control of it before."""
        if self._arm is not None:
            self._variables.take_outputs(self._arm)
        self._leaving = True
        try:
            program.release()
        finally:
            self._arm, self._leaving = None, False

    # ------------------------------------------------------------------------------------------------- transforms

    def newtrans(self, message: Message) -> Answer:
        """A new one, at refs[0], of kind n."""
        place = message.refs[0]
        kind = _KINDS[message.n]
        function = None if kind is not Kind.FUNCTION else timed(lambda _: self._call(Op.CALL_TRANSFORM, place))
        fields = self._memory.reals(place + self._axes, 12)
        self._transforms[place] = SharedTransform(message.text, kind, fields, function)
        return None

    def freetrans(self, message: Message) -> Answer:
        """Its memory will be used again."""
        self._transform(message.refs[0]).part()
        del self._transforms[message.refs[0]]
        return None

    def make(self, message: Message) -> Answer:
        """Another value for a transform, made by the constructor `text`."""
        return self._give(message.refs[0], _MAKERS[message.text](*message.numbers[: message.n]).value)

    def trmult(self, message: Message) -> Answer:
        """A product."""
        return self._give(message.refs[2], self._operand(message, 0) @ self._operand(message, 1))

    def invert(self, message: Message) -> Answer:
        """An inverse."""
        return self._give(message.refs[2], inverse(self._operand(message, 0)))

    def _operand(self, message: Message, i: int) -> Floats:
        known = self._transforms.get(message.refs[i])
        return value_of(np.array(message.numbers[12 * i : 12 * i + 12])) if known is None else known.value

    def _give(self, place: int, value: Floats) -> Message:
        if place in self._transforms:
            self._transforms[place].set(value)
        return Message(Op.REPLY, numbers=numbers_of(value).tolist())

    def _transform(self, place: int) -> SharedTransform:
        if place not in self._transforms:
            raise UnknownError("this is no transform of newtrans or the gentr_ functions, or it was freed")
        return self._transforms[place]

    # -------------------------------------------------------------------------------------------------- positions

    def makeposition(self, message: Message) -> Answer:
        """The position at refs[0], of the n terms behind it."""
        terms = [self._term(place) for place in message.refs[1 : 1 + message.n]]
        place = message.refs[0]
        self._positions[place] = self._position(place, message.text, makeposition(message.text, *terms).target)
        return None

    def _term(self, place: int) -> Trsf | Word:
        if place in _WORDS:
            return _WORDS[place]
        trsf = self._transform(place)
        return t6 if trsf is self._variables.t6 else trsf

    def jposition(self, message: Message) -> Answer:
        """The position at refs[0], of n joints."""
        place, degs = message.refs[0], message.numbers[: message.n]
        self._positions[place] = self._position(place, message.text, self.arm.jposition(message.text, degs).target)
        return None

    def freepos(self, message: Message) -> Answer:
        """Its memory will be used again."""
        self._named(message.refs[0]).part()
        del self._positions[message.refs[0]]
        return None

    def _position(self, place: int, name: str, target: Target) -> SharedPosition:
        code = self._memory.ints(place + self._code)
        scal = self._memory.reals(place + self._scal, 1)
        at = place + self._end
        end = SharedEvent(f"{name}.end", self._memory.ints(at), lambda: self._talk.signal(at))
        return SharedPosition(name, target, code, scal, end)

    def _named(self, place: int) -> SharedPosition:
        if place == self._park and self._arm is None:
            self._arm = self._take_arm()  # where its park pose is, the robot knows
        if place not in self._positions:
            raise UnknownError("this is no position of makeposition or jposition, or it was freed")
        return self._positions[place]

    # ---------------------------------------------------------------------------------------------------- motions

    def move(self, message: Message) -> Answer:
        """Queue a motion."""
        arm = self.arm
        arm.move(self._named(message.refs[0]))
        return None

    def evalfn(self, message: Message) -> Answer:
        """A function during the next motion. What it returns is no code: of old it returned nothing."""
        function = message.refs[0]

        def monitor() -> int:
            self._call(Op.CALL_FUNCTION, function)
            return self._nextmove()

        self.arm.evalfn(monitor)
        return None

    def setconf(self, message: Message) -> Answer:
        """Configuration of the following motions."""
        self.arm.setconf(message.text)
        return None

    def update(self, message: Message) -> Answer:
        """Measure a transform when the next motion ends."""
        self.arm.update(self._transform(message.refs[0]), self._named(message.refs[1]))
        return None

    def hand(self, message: Message) -> Answer:
        """Open or close it."""
        arm, take_outputs = self.arm, self._variables.take_outputs
        take_outputs(arm)  # a hand that was assigned before counts before
        (arm.OPEN if message.text == "open" else arm.CLOSE)()
        take_outputs(arm)
        return None

    def next_sample(self, message: Message) -> Answer:
        """Wait for it; `text` names the event of ours that the program waits for."""
        arm, listen = self.arm, self._talk.listen
        if message.text:
            arm.expect(message.text)
        begin = arm.how.t_ns

        def passed() -> bool:
            listen()
            return arm.how.t_ns != begin

        arm.waitas(passed)
        return None

    # ------------------------------------------------------------------------------------------ people, data base

    def teach(self, message: Message) -> Answer:
        """A person shows a transform; the answer is YES or NO."""
        trans, position = self._transform(message.refs[0]), self._named(message.refs[1])
        return Message(Op.REPLY, teach(self.arm, trans, position, self._database, self._talk.ask, self._talk.say))

    def stepmode(self, _: Message) -> Answer:
        """A person moves the arm, until `q`."""
        stepper, say = Stepper(self.arm), self._talk.say
        say(f"{STEPPING_HELP}\nq                  go on with the program")
        try:
            while (line := self._talk.ask("? ").strip()) != "q":
                say(stepper.obey(line))
        except EOFError:
            pass
        return None

    def makedb(self, message: Message) -> Answer:
        """Use the data base in a file."""
        self._database = DataBase(message.text)
        return None

    @property
    def _base(self) -> DataBase:
        if self._database is None:
            raise ConfigError("no data base: name its file with makedb first")
        return self._database

    def getr(self, message: Message) -> Answer:
        """Read a transform by its name; the answer is YES or NO."""
        return Message(Op.REPLY, int(self._base.read(self._transform(message.refs[0]))))

    def saver(self, message: Message) -> Answer:
        """Record a transform under its name."""
        self._base.record(self._transform(message.refs[0]))
        return Message(Op.REPLY, YES)

    def dumpdb(self, _: Message) -> Answer:
        """Show what is recorded."""
        for name in self._base.names():
            x, y, z = self._base.get(name).p
            self._talk.say(f"{name:<14} {x:10.3f} {y:10.3f} {z:10.3f}")
        return None

    # --------------------------------------------------------------------------------------- encoders, converter

    def adcopen(self, message: Message) -> Answer:
        """Which reading `how.adcr` shows: a component of the wrist sensor."""
        channel = int(message.numbers[0])
        if not 0 <= channel < 6:
            raise MotionError(f"adcopen({channel}): the channels are 0 to 5: fx fy fz mx my mz of the wrist sensor")
        self._variables.adc_channel = channel
        return None

    def enctoang(self, message: Message) -> Answer:
        """Joint angles, rad, of encoder counts."""
        p, n = transmission_params(self.arm.robot), self.arm.robot.n
        q = p.q_offset + p.joint_per_count @ (np.array(message.numbers[:n]) - p.count_offset)
        return Message(Op.REPLY, n, numbers=q.tolist())

    def angtoenc(self, message: Message) -> Answer:
        """Encoder counts of joint angles, rad."""
        p, n = transmission_params(self.arm.robot), self.arm.robot.n
        counts = np.rint(p.count_per_joint @ (np.array(message.numbers[:n]) - p.q_offset)) + p.count_offset
        return Message(Op.REPLY, n, numbers=counts.tolist())


def _setmode(desk: Desk, message: Message) -> Answer:
    desk.arm.setmode(message.text)
    return None


def _with_numbers(call: Callable[[Channel, float, float], None]) -> Callable[[Desk, Message], Answer]:
    """A call of the arm with two numbers."""

    def answer(desk: Desk, message: Message) -> Answer:
        call(desk.arm, message.numbers[0], message.numbers[1])
        return None

    return answer


def _with_directions(call: Callable[[Channel], Callable[..., None]]) -> Callable[[Desk, Message], Answer]:
    """A call of the arm with names of directions, and a number for each."""

    def answer(desk: Desk, message: Message) -> Answer:
        call(desk.arm)(message.text, *message.numbers[: message.n])
        return None

    return answer


_WAITING: Final = {Op.CONTROL, Op.RELEASE, Op.SAMPLE_PERIOD, Op.NEXT_SAMPLE, Op.TEACH, Op.STEPMODE}
_CALLS: Final[dict[Op, Callable[[Desk, Message], Answer]]] = {
    Op.CONTROL: Desk.control,
    Op.RELEASE: Desk.release,
    Op.NEWTRANS: Desk.newtrans,
    Op.FREETRANS: Desk.freetrans,
    Op.MAKEPOSITION: Desk.makeposition,
    Op.JPOSITION: Desk.jposition,
    Op.FREEPOS: Desk.freepos,
    Op.MAKE: Desk.make,
    Op.TRMULT: Desk.trmult,
    Op.INVERT: Desk.invert,
    Op.MOVE: Desk.move,
    Op.STOP: _with_numbers(lambda arm, ms, _: arm.stop(ms)),
    Op.SETVEL: _with_numbers(Channel.setvel),
    Op.SETMODE: _setmode,
    Op.SETCONF: Desk.setconf,
    Op.SAMPLE_PERIOD: _with_numbers(lambda arm, ms, _: arm.sample(ms)),
    Op.SETIME: _with_numbers(Channel.setime),
    Op.EVALFN: Desk.evalfn,
    Op.DISTANCE: _with_directions(lambda arm: arm.distance),
    Op.LIMIT: _with_directions(lambda arm: arm.limit),
    Op.COMPLY: _with_directions(lambda arm: arm.comply),
    Op.LOCK: _with_directions(lambda arm: arm.lock),
    Op.UPDATE: Desk.update,
    Op.HAND: Desk.hand,
    Op.NEXT_SAMPLE: Desk.next_sample,
    Op.TEACH: Desk.teach,
    Op.STEPMODE: Desk.stepmode,
    Op.MAKEDB: Desk.makedb,
    Op.GETR: Desk.getr,
    Op.SAVER: Desk.saver,
    Op.DUMPDB: Desk.dumpdb,
    Op.ADCOPEN: Desk.adcopen,
    Op.ENCTOANG: Desk.enctoang,
    Op.ANGTOENC: Desk.angtoenc,
}
