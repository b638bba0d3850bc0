"""Dispatcher of the calls of a C program: from each message to `qrobot.rccl`."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, TypeAlias

import numpy as np

from qrobot.c_transport.memory import ProgramMemory
from qrobot.c_transport.message import CallMessage, Op
from qrobot.c_transport.program_link import ProgramLink
from qrobot.errors import MotionError, letting_go
from qrobot.model.transmission import transmission_params
from qrobot.rccl import program
from qrobot.rccl.c.call_row import OBJECT_CALLS, CallReply, CallRow, on_objects
from qrobot.rccl.c.object_registry import ObjectRegistry, UnknownError
from qrobot.rccl.c.recorded_transforms import RecordedTransforms
from qrobot.rccl.c.shared import SharedPosition
from qrobot.rccl.c.undone import terminated, undone
from qrobot.rccl.c.variables import Variables
from qrobot.rccl.channel import Channel
from qrobot.rccl.jog import STEPPING_HELP, Stepper
from qrobot.rccl.position import there
from qrobot.rccl.teach_transform import teach
from qrobot.rci.listening import giving_way

OBJECTS: Final = 9  # variables and structures, whose places stand first
FIELDS: Final = 4  # of structures, whose places stand behind them


class Dispatcher:
    """Serves one program, which has a world of transforms and positions, and an arm.

    Args:
        memory: shared with the program.
        places: of its global variables, and of the fields in its structures; the order is that of shared.c.
        link: to the program.
        robot: that its arm is, a packaged one's name or a file.

    Attributes:
        objects: its transforms and positions.
    """

    def __init__(self, memory: ProgramMemory, places: list[int], link: ProgramLink, robot: str) -> None:
        *variables, last_link, park, present = places[:OBJECTS]
        fields = places[OBJECTS : OBJECTS + FIELDS]
        self._link, self._robot, self._park = link, robot, park
        self._variables = Variables(memory, variables, last_link + fields[0])
        self.objects = ObjectRegistry(memory, fields, (last_link, self._variables.t6), self._evaluate, link.signal)
        self.objects.put(present, "there", there().target, ours=True)
        self.recorded = RecordedTransforms(self.objects, link.say)
        self._functions: tuple[int, ...] = ()
        self._arm: Channel | None = None
        self._leaving = False
        self._dropped = 0  # motions, because of `terminate`

    @property
    def arm(self) -> Channel:
        """The arm of the program, which takes it at its first call that needs one."""
        if self._arm is None:
            self._arm = self._take_arm()
        return self._arm

    def _take_arm(self) -> Channel:
        arm = program.control(self._robot)
        self.objects.put(self._park, "park", arm.pose("park").target, ours=True)
        self._variables.show(arm)
        self._variables.begin_outputs(arm)
        arm.each_sample(self._each_sample)
        return arm

    def answer(self, message: CallMessage, background: bool = False) -> CallMessage:
        """Do what is asked, in a function that is called at a sample if `background`.

        Raises QRobotError when that cannot be.
        """
        op = Op(message.op)
        call = CALLS[op]
        if background and call.waits:
            raise MotionError("a function that is called at a sample must not wait, nor take or release the arm")
        if not background:
            self._look_at_flags()
        try:
            answer = call.handler(self, message)
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
                self._link.call(Op.CALL_FUNCTION, function)
            self._variables.take_command(arm)
            self._variables.take_outputs(arm)
        if self._variables.terminate:
            self._dropped += arm.unserved
            arm.stop()
        else:
            self._skip(arm)

    def _look_at_flags(self) -> None:
        """Obey what the program has assigned since the latest sample."""
        if self._arm is None:
            return
        if self._variables.terminate:
            with letting_go(self.let_go):
                left = self._dropped + self._arm.unserved
            raise terminated(left)
        self._skip(self._arm)

    def _skip(self, arm: Channel) -> None:
        """End the motion that the program wants to be ended."""
        if not arm.released and (code := self._nextmove()):
            arm.nextmove(code)

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
        self._link.call(op, place)

    # ------------------------------------------------------------------------------------------- control, release

    def control(self, message: CallMessage) -> CallReply:
        """Take the arm; functions to be called at every sample may come along."""
        self._functions = tuple(function for function in message.refs[:2] if function)
        if self._arm is None:
            self._arm = self._take_arm()
        return None

    def release(self, message: CallMessage) -> CallReply:
        """Let go of it; when `n`, after all motions are done. The answer says how many were left."""
        with letting_go(self.let_go):
            if message.n and self._arm is not None:
                self._arm.finish()
                if self._variables.terminate:
                    raise terminated(self._dropped)
            left = 0 if self._arm is None else self._arm.unserved
        return CallMessage(Op.REPLY, text=undone(left))

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
        self.objects.put(message.refs[0], message.text, target)
        return None

    def _named(self, place: int) -> SharedPosition:
        if place == self._park and self._arm is None:
            self._arm = self._take_arm()  # where its park pose is, the robot knows
        return self.objects.position(place)

    def move(self, message: CallMessage) -> CallReply:
        """Queue a motion."""
        arm = self.arm
        arm.move(self._named(message.refs[0]))
        return None

    def keep_path(self, message: CallMessage) -> CallReply:
        """Keep the path in a stop of the servo when `n` is not 0, with a way back of so many mm and degrees at most."""
        self.arm.keep_path(bool(message.n), message.numbers[0], message.numbers[1])
        return None

    def collision(self, message: CallMessage) -> CallReply:
        """Choose what follows a collision, with a way back, mm, and thresholds of `n` joints, 0 for the file's."""
        mm, *thresholds = message.numbers[: message.n + 1]
        self.arm.collision(message.text, thresholds if message.n else None, mm)
        return None

    def analog(self, message: CallMessage) -> CallReply:
        """Let an analogue output show so many volts."""
        output, volts = message.numbers[:2]
        self.arm.analog(int(output), volts)
        return None

    def setload(self, message: CallMessage) -> CallReply:
        """Tell what the hand holds: mass, centre, inertia."""
        self.arm.setload(message.numbers[0], message.numbers[1:4], message.numbers[4:10])
        return None

    def kept(self, _: CallMessage) -> CallReply:
        """Reason for which the arm stands off its path."""
        return CallMessage(Op.REPLY, text=self.arm.kept)

    def evalfn(self, message: CallMessage) -> CallReply:
        """A function during the next motion. What it returns is no code: of old it returned nothing."""
        function, arm = message.refs[0], self.arm

        def monitor() -> int:
            self._skip(arm)  # what others have said before is for the younger motion, this may be the older
            self._call(Op.CALL_FUNCTION, function)
            return self._nextmove()

        arm.evalfn(monitor)
        return None

    def update(self, message: CallMessage) -> CallReply:
        """Measure a transform when the next motion ends."""
        self.arm.update(self.objects.transform(message.refs[0]), self._named(message.refs[1]))
        return None

    def hand(self, message: CallMessage) -> CallReply:
        """Open or close it."""
        arm, take_outputs = self.arm, self._variables.take_outputs
        take_outputs(arm)  # a hand that was assigned before counts before
        (arm.OPEN if message.text == "open" else arm.CLOSE)()
        take_outputs(arm)
        return None

    def next_sample(self, message: CallMessage) -> CallReply:
        """Wait for it, or give way to another thread; `text` names the event of ours that the program waits for."""
        arm = self.arm
        if message.text:
            arm.expect(message.text)
        begin = arm.how.t_ns
        with giving_way(self._link.others_wait):
            arm.waitas(lambda: arm.how.t_ns != begin)
        if arm.kept:  # the functions of samples, before which the state is shown else, wait as well
            self._variables.show(arm)
        return None

    # ---------------------------------------------------------------------------------------------------- people

    def teach(self, message: CallMessage) -> CallReply:
        """A person shows a transform; the answer is YES or NO."""
        trans, position = self.objects.transform(message.refs[0]), self._named(message.refs[1])
        return CallMessage(
            Op.REPLY, teach(self.arm, trans, position, self.recorded.database, self._link.ask, self._link.say)
        )

    def stepmode(self, _: CallMessage) -> CallReply:
        """A person moves the arm, until `q`."""
        stepper, say = Stepper(self.arm), self._link.say
        say(f"{STEPPING_HELP}\nq                  go on with the program")
        try:
            while (line := self._link.ask("? ").strip()) != "q":
                say(stepper.obey(line))
        except EOFError:
            pass
        return None

    # --------------------------------------------------------------------------------------- encoders, converter

    def adcopen(self, message: CallMessage) -> CallReply:
        """Choose the reading of `how.adcr`: a component of the wrist sensor."""
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


ArmCallRow: TypeAlias = CallRow[Dispatcher]


def _plain(call: Callable[[Channel], None]) -> ArmCallRow:
    """A call of the arm with nothing else."""
    return CallRow(lambda dispatcher, _: call(dispatcher.arm))


def _number(call: Callable[[Channel, float], None], waits: bool = False) -> ArmCallRow:
    """A call of the arm with one number."""
    return CallRow(lambda dispatcher, message: call(dispatcher.arm, message.numbers[0]), waits)


def _two_numbers(call: Callable[[Channel, float, float], None]) -> ArmCallRow:
    """A call of the arm with two numbers."""
    return CallRow(lambda dispatcher, message: call(dispatcher.arm, message.numbers[0], message.numbers[1]))


def _word(call: Callable[[Channel, str], None]) -> ArmCallRow:
    """A call of the arm with a text."""
    return CallRow(lambda dispatcher, message: call(dispatcher.arm, message.text))


def _directions(call: Callable[..., None]) -> ArmCallRow:
    """A call of the arm with names of directions, and a number for each."""
    return CallRow(lambda dispatcher, message: call(dispatcher.arm, message.text, *message.numbers[: message.n]))


CALLS: Final[dict[Op, ArmCallRow]] = {
    # the arm: what the method of `Channel` does, with the arguments of the message
    Op.STOP: _number(Channel.stop),
    Op.SAMPLE_PERIOD: _number(Channel.sample, waits=True),
    Op.OVERRIDE: _number(Channel.override),
    Op.RETRACT: _number(Channel.retract),
    Op.PAUSE: _plain(Channel.pause),
    Op.RESUME: _plain(Channel.resume),
    Op.SETVEL: _two_numbers(Channel.setvel),
    Op.SETIME: _two_numbers(Channel.setime),
    Op.SETMODE: _word(Channel.setmode),
    Op.SETCONF: _word(Channel.setconf),
    Op.LOCK: _word(Channel.lock),
    Op.DISTANCE: _directions(Channel.distance),
    Op.LIMIT: _directions(Channel.limit),
    Op.COMPLY: _directions(Channel.comply),
    # the arm, with transforms, positions or functions of the program
    Op.CONTROL: CallRow(Dispatcher.control, waits=True),
    Op.RELEASE: CallRow(Dispatcher.release, waits=True),
    Op.NEXT_SAMPLE: CallRow(Dispatcher.next_sample, waits=True),
    Op.JPOSITION: CallRow(Dispatcher.jposition),
    Op.MOVE: CallRow(Dispatcher.move),
    Op.EVALFN: CallRow(Dispatcher.evalfn),
    Op.KEEP_PATH: CallRow(Dispatcher.keep_path),
    Op.KEPT: CallRow(Dispatcher.kept),
    Op.ANALOG: CallRow(Dispatcher.analog, waits=True),
    Op.COLLISION: CallRow(Dispatcher.collision, waits=True),
    Op.SETLOAD: CallRow(Dispatcher.setload, waits=True),
    Op.UPDATE: CallRow(Dispatcher.update),
    Op.HAND: CallRow(Dispatcher.hand),
    Op.ADCOPEN: CallRow(Dispatcher.adcopen),
    Op.ENCTOANG: CallRow(Dispatcher.enctoang),
    Op.ANGTOENC: CallRow(Dispatcher.angtoenc),
    # people, and what they have taught
    Op.TEACH: CallRow(Dispatcher.teach, waits=True),
    Op.STEPMODE: CallRow(Dispatcher.stepmode, waits=True),
    # transforms and positions
    **OBJECT_CALLS,
    Op.MAKEPOSITION: on_objects(ObjectRegistry.makeposition),
}
"""Every call that a message of a program asks for."""
