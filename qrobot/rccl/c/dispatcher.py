"""What each call of a C program does: from its message to `qrobot.rccl`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, TypeAlias

import numpy as np

from qrobot.errors import ConfigError, MotionError
from qrobot.model.transmission import transmission_params
from qrobot.rccl import program
from qrobot.rccl.c.message import CallMessage, Op
from qrobot.rccl.c.object_registry import UnknownError, World
from qrobot.rccl.c.shared import ProgramMemory, SharedPosition
from qrobot.rccl.c.variables import Variables
from qrobot.rccl.channel import YES, Channel
from qrobot.rccl.database import DataBase
from qrobot.rccl.jog import STEPPING_HELP, Stepper
from qrobot.rccl.position import there
from qrobot.rccl.teach_transform import teach

FIELDS: Final = 4  # of structures, whose places stand last among the places
CallReply: TypeAlias = "CallMessage | None"


@dataclass(frozen=True)
class ProgramLink:
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


class Dispatcher:
    """Serves one program, which has a world of transforms and positions, and an arm.

    Args:
        memory: shared with the program.
        places: of its global variables, and of the fields in its structures; the order is that of shared.c.
        talk: to the program.
        robot: that its arm is, a packaged one's name or a file.

    Attributes:
        world: its transforms and positions.
    """

    def __init__(self, memory: ProgramMemory, places: list[int], talk: ProgramLink, robot: str) -> None:
        *variables, last_link, park, present = places[:-FIELDS]
        fields = places[-FIELDS:]
        self._talk, self._robot, self._park = talk, robot, park
        self._variables = Variables(memory, variables, last_link + fields[0])
        self.world = World(memory, fields, (last_link, self._variables.t6), self._evaluate, talk.signal)
        self.world.put(present, "there", there().target, ours=True)
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
        self.world.put(self._park, "park", arm.pose("park").target, ours=True)
        self._variables.show(arm)
        self._variables.begin_outputs(arm)
        arm.each_sample(self._each_sample)
        return arm

    def answer(self, message: CallMessage, background: bool = False) -> CallMessage:
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
        return answer or CallMessage(Op.REPLY)

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

    def _evaluate(self, place: int) -> None:
        self._call(Op.CALL_TRANSFORM, place)

    def _call(self, op: Op, place: int) -> None:
        """Call a function of the program, which sees the newest state."""
        if self._arm is not None:
            self._variables.show(self._arm)
        self._talk.call(op, place)

    # ------------------------------------------------------------------------------------------- control, release

    def control(self, message: CallMessage) -> CallReply:
        """Take the arm; functions to be called at every sample may come along."""
        self._functions = tuple(function for function in message.refs[:2] if function)
        if self._arm is None:
            self._arm = self._take_arm()
        return None

    def release(self, message: CallMessage) -> CallReply:
        """Let go of it; when `n`, after all motions are done. The answer says how many were left."""
        try:
            if message.n and self._arm is not None:
                self._arm.finish(self._talk.listen)
            left = 0 if self._arm is None else self._arm.unserved
        finally:
            self.let_go()
        return CallMessage(Op.REPLY, text=f"{left} motion{'s were' if left > 1 else ' was'} not done" if left else "")

    def let_go(self) -> None:
        """Bring the arm to rest and release it, if there is one. Raises what ended control of it before."""
        if self._arm is not None:
            self._variables.take_outputs(self._arm)
        self._leaving = True
        try:
            program.release()
        finally:
            self._arm, self._leaving = None, False

    # ---------------------------------------------------------------------------------------------------- motions

    def jposition(self, message: CallMessage) -> CallReply:
        """The position at refs[0], of n joints."""
        target = self.arm.jposition(message.text, message.numbers[: message.n]).target
        self.world.put(message.refs[0], message.text, target)
        return None

    def _named(self, place: int) -> SharedPosition:
        if place == self._park and self._arm is None:
            self._arm = self._take_arm()  # where its park pose is, the robot knows
        return self.world.position(place)

    def move(self, message: CallMessage) -> CallReply:
        """Queue a motion."""
        arm = self.arm
        arm.move(self._named(message.refs[0]))
        return None

    def evalfn(self, message: CallMessage) -> CallReply:
        """A function during the next motion. What it returns is no code: of old it returned nothing."""
        function = message.refs[0]

        def monitor() -> int:
            self._call(Op.CALL_FUNCTION, function)
            return self._nextmove()

        self.arm.evalfn(monitor)
        return None

    def setconf(self, message: CallMessage) -> CallReply:
        """Configuration of the following motions."""
        self.arm.setconf(message.text)
        return None

    def update(self, message: CallMessage) -> CallReply:
        """Measure a transform when the next motion ends."""
        self.arm.update(self.world.transform(message.refs[0]), self._named(message.refs[1]))
        return None

    def hand(self, message: CallMessage) -> CallReply:
        """Open or close it."""
        arm, take_outputs = self.arm, self._variables.take_outputs
        take_outputs(arm)  # a hand that was assigned before counts before
        (arm.OPEN if message.text == "open" else arm.CLOSE)()
        take_outputs(arm)
        return None

    def next_sample(self, message: CallMessage) -> CallReply:
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

    def teach(self, message: CallMessage) -> CallReply:
        """A person shows a transform; the answer is YES or NO."""
        trans, position = self.world.transform(message.refs[0]), self._named(message.refs[1])
        return CallMessage(Op.REPLY, teach(self.arm, trans, position, self._database, self._talk.ask, self._talk.say))

    def stepmode(self, _: CallMessage) -> CallReply:
        """A person moves the arm, until `q`."""
        stepper, say = Stepper(self.arm), self._talk.say
        say(f"{STEPPING_HELP}\nq                  go on with the program")
        try:
            while (line := self._talk.ask("? ").strip()) != "q":
                say(stepper.obey(line))
        except EOFError:
            pass
        return None

    def makedb(self, message: CallMessage) -> CallReply:
        """Use the data base in a file."""
        self._database = DataBase(message.text)
        return None

    @property
    def _base(self) -> DataBase:
        if self._database is None:
            raise ConfigError("no data base: name its file with makedb first")
        return self._database

    def getr(self, message: CallMessage) -> CallReply:
        """Read a transform by its name; the answer is YES or NO."""
        return CallMessage(Op.REPLY, int(self._base.read(self.world.transform(message.refs[0]))))

    def saver(self, message: CallMessage) -> CallReply:
        """Record a transform under its name."""
        self._base.record(self.world.transform(message.refs[0]))
        return CallMessage(Op.REPLY, YES)

    def dumpdb(self, _: CallMessage) -> CallReply:
        """Show what is recorded."""
        for name in self._base.names():
            x, y, z = self._base.get(name).p
            self._talk.say(f"{name:<14} {x:10.3f} {y:10.3f} {z:10.3f}")
        return None

    # --------------------------------------------------------------------------------------- encoders, converter

    def adcopen(self, message: CallMessage) -> CallReply:
        """Which reading `how.adcr` shows: a component of the wrist sensor."""
        channel = int(message.numbers[0])
        if not 0 <= channel < 6:
            raise MotionError(f"adcopen({channel}): the channels are 0 to 5: fx fy fz mx my mz of the wrist sensor")
        self._variables.adc_channel = channel
        return None

    def enctoang(self, message: CallMessage) -> CallReply:
        """Joint angles, rad, of encoder counts."""
        p, n = transmission_params(self.arm.robot), self.arm.robot.n
        q = p.q_offset + p.joint_per_count @ (np.array(message.numbers[:n]) - p.count_offset)
        return CallMessage(Op.REPLY, n, numbers=q.tolist())

    def angtoenc(self, message: CallMessage) -> CallReply:
        """Encoder counts of joint angles, rad."""
        p, n = transmission_params(self.arm.robot), self.arm.robot.n
        counts = np.rint(p.count_per_joint @ (np.array(message.numbers[:n]) - p.q_offset)) + p.count_offset
        return CallMessage(Op.REPLY, n, numbers=counts.tolist())


def _in_the_world(call: Callable[[World, CallMessage], CallReply]) -> Callable[[Dispatcher, CallMessage], CallReply]:
    """A call that needs no arm."""
    return lambda desk, message: call(desk.world, message)


def _setmode(desk: Dispatcher, message: CallMessage) -> CallReply:
    desk.arm.setmode(message.text)
    return None


def _with_numbers(call: Callable[[Channel, float, float], None]) -> Callable[[Dispatcher, CallMessage], CallReply]:
    """A call of the arm with two numbers."""

    def answer(desk: Dispatcher, message: CallMessage) -> CallReply:
        call(desk.arm, message.numbers[0], message.numbers[1])
        return None

    return answer


def _with_directions(call: Callable[[Channel], Callable[..., None]]) -> Callable[[Dispatcher, CallMessage], CallReply]:
    """A call of the arm with names of directions, and a number for each."""

    def answer(desk: Dispatcher, message: CallMessage) -> CallReply:
        call(desk.arm)(message.text, *message.numbers[: message.n])
        return None

    return answer


_WAITING: Final = {Op.CONTROL, Op.RELEASE, Op.SAMPLE_PERIOD, Op.NEXT_SAMPLE, Op.TEACH, Op.STEPMODE}
_CALLS: Final[dict[Op, Callable[[Dispatcher, CallMessage], CallReply]]] = {
    Op.CONTROL: Dispatcher.control,
    Op.RELEASE: Dispatcher.release,
    Op.NEWTRANS: _in_the_world(World.newtrans),
    Op.FREETRANS: _in_the_world(World.freetrans),
    Op.MAKEPOSITION: _in_the_world(World.makeposition),
    Op.JPOSITION: Dispatcher.jposition,
    Op.FREEPOS: _in_the_world(World.freepos),
    Op.MAKE: _in_the_world(World.make),
    Op.TRMULT: _in_the_world(World.trmult),
    Op.INVERT: _in_the_world(World.invert),
    Op.MOVE: Dispatcher.move,
    Op.STOP: _with_numbers(lambda arm, ms, _: arm.stop(ms)),
    Op.SETVEL: _with_numbers(Channel.setvel),
    Op.SETMODE: _setmode,
    Op.SETCONF: Dispatcher.setconf,
    Op.SAMPLE_PERIOD: _with_numbers(lambda arm, ms, _: arm.sample(ms)),
    Op.SETIME: _with_numbers(Channel.setime),
    Op.EVALFN: Dispatcher.evalfn,
    Op.DISTANCE: _with_directions(lambda arm: arm.distance),
    Op.LIMIT: _with_directions(lambda arm: arm.limit),
    Op.COMPLY: _with_directions(lambda arm: arm.comply),
    Op.LOCK: _with_directions(lambda arm: arm.lock),
    Op.UPDATE: Dispatcher.update,
    Op.HAND: Dispatcher.hand,
    Op.NEXT_SAMPLE: Dispatcher.next_sample,
    Op.TEACH: Dispatcher.teach,
    Op.STEPMODE: Dispatcher.stepmode,
    Op.MAKEDB: Dispatcher.makedb,
    Op.GETR: Dispatcher.getr,
    Op.SAVER: Dispatcher.saver,
    Op.DUMPDB: Dispatcher.dumpdb,
    Op.ADCOPEN: Dispatcher.adcopen,
    Op.ENCTOANG: Dispatcher.enctoang,
    Op.ANGTOENC: Dispatcher.angtoenc,
}
