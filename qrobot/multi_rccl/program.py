"""The calls of Multi-RCCL, with the manipulator as their first argument (Lloyd, Parker and McClain 1987, section 3)."""

from __future__ import annotations

from collections.abc import Callable
from contextvars import ContextVar
from dataclasses import replace
from typing import Any, Concatenate, Final, ParamSpec, TypeVar

from qrobot.config import robot_path
from qrobot.errors import ConfigError, LinkError, MotionError
from qrobot.motion import Trsf
from qrobot.multi_rccl.manip import Manip
from qrobot.multi_rccl.object_frame import ObjectFrame
from qrobot.multi_rccl.positions import goal_for
from qrobot.multi_rccl.robot_manip import RobotManip
from qrobot.rccl.arguments import require_function
from qrobot.rccl.channel import Channel
from qrobot.rccl.database import DataBase
from qrobot.rccl.event import Event
from qrobot.rccl.parameters import MotionParameters
from qrobot.rccl.position import Position
from qrobot.rccl.task_group import TaskGroup
from qrobot.rccl.teach_transform import Prompt, Say
from qrobot.rccl.teach_transform import teach as teach_arm
from qrobot.rccl.transforms import Transform
from qrobot.rci.arguments import numbers
from qrobot.rci.environment import environment
from qrobot.rci.link import Link
from qrobot.rci.robot_data import KnownRobot
from qrobot.rci.tcp import bridge_address
from qrobot.wire import Hello

OBJECT_FRAME: Final = "OBJECT_FRAME"
DEFAULT_ROBOT: Final = "puma560"


class ManipProgram:
    """Manipulators of one program, which share one count of samples."""

    def __init__(self) -> None:
        self.group = TaskGroup()
        self.manips: list[Manip] = []
        self._waiting = False

    def open(self, name: str, robot: str = "", bridge: str = "") -> Manip:
        """See `rccl_open`."""
        _check_opening(self, name, robot, bridge)
        if name.startswith(OBJECT_FRAME):
            manip: Manip = ObjectFrame(name, self.group)
        else:
            manip = _robot(self, KnownRobot(name, robot or _file_of(name), bridge))
        self.manips.append(manip)
        return manip

    @property
    def over(self) -> bool:
        """True once all arms that it had were let go of."""
        arms = [manip for manip in self.manips if isinstance(manip, RobotManip) and manip.begun]
        return arms != [] and self.robots == []

    @property
    def robots(self) -> list[RobotManip]:
        """Its arms under control."""
        return [manip for manip in self.manips if isinstance(manip, RobotManip) and manip.on]

    def _check(self) -> None:
        """Raise what has ended control of an arm, and once, MotionError, that one could not stay with its goal."""
        for manip in self.manips:
            manip.check()
        if lost := self.group.take_lost():
            raise MotionError(lost)

    def look(self, happened: Callable[[], bool], what: str) -> bool:
        """Whether it has happened. Raises what has ended control of an arm, and MotionError when nothing can happen."""
        self._check()
        if happened():
            return True
        if what and not any(manip.eventful for manip in self.manips):
            self.robots[0].channel.expect(what)
        return False

    def wait(self, happened: Callable[[], bool], what: str = "") -> None:
        """Let time pass until something has happened. Raises what `look` does, and LinkError without an arm."""
        self._check()
        if not self.robots:
            raise LinkError(
                "no arm is under control; call rccl_control first: time passes for object frames only beside an arm"
            )
        if self._waiting:
            raise MotionError("a function of wait_as must not wait: let it look, and wait behind it")
        self._waiting = True
        try:
            self.robots[0].channel.waitas(lambda: self.look(happened, what))
        finally:
            self._waiting = False


_program: ContextVar[ManipProgram | None] = ContextVar("multi_rccl_program", default=None)


def this_program() -> ManipProgram:
    """The program that calls; begun anew when all its manipulators were let go of."""
    program = _program.get()
    if program is None or program.over:
        program = ManipProgram()
        _program.set(program)
    return program


def rccl_open(name: str, robot: str = "", bridge: str = "") -> Manip:
    """A manipulator, with a trajectory generator of its own.

    Args:
        name: of the arm, in messages and for whoever gives links by name; "OBJECT_FRAME" makes an object's frame, and
            whatever begins with that another one.
        robot: its file, or the name of a packaged one; default the one that `name` names, else puma560.
        bridge: "host:port" of its bridge; default where the program's is.

    Raises:
        ConfigError: no such robot, or that is no address.
        MotionError: there is a manipulator of that name, or at that bridge; or that is no name.
    """
    return this_program().open(name, robot, bridge)


def _check_opening(program: ManipProgram, name: object, robot: object, bridge: object) -> None:
    for what, given in (("name", name), ("robot", robot), ("bridge", bridge)):
        if not isinstance(given, str) or (what == "name" and not given):
            raise MotionError(f"rccl_open: a {what} is a word, not {given!r}")
    for manip in program.manips:
        if manip.name == name:
            raise MotionError(f"rccl_open: {name} is open already")
        if bridge and isinstance(manip, RobotManip) and manip.bridge == bridge:
            raise MotionError(f"rccl_open: {manip.name} is at {bridge} already")
    if str(name).startswith(OBJECT_FRAME) and (robot or bridge):
        raise MotionError(f"rccl_open: {name} is an object frame, which has neither robot nor bridge")
    if not str(name).startswith(OBJECT_FRAME) and str(name).upper().startswith(OBJECT_FRAME):
        raise MotionError(f"rccl_open: an object frame's name begins with {OBJECT_FRAME}, in capitals")
    bridge_address(str(bridge))


def _robot(program: ManipProgram, known: KnownRobot) -> RobotManip:
    robot_path(known.file)
    surroundings = environment()

    def link(hello: Hello) -> Link:
        return surroundings.links(known, replace(hello, in_step=True))

    return RobotManip(known, link, program.group)


def _file_of(name: str) -> str:
    try:
        robot_path(name)
    except ConfigError:
        return DEFAULT_ROBOT
    return name


def _manip(call: str, given: object) -> Manip:
    if not isinstance(given, Manip):
        raise MotionError(f"{call}: a manipulator is needed, from rccl_open, not {given!r}")
    return given


def _arm(call: str, given: object) -> RobotManip:
    manip = _manip(call, given)
    if not isinstance(manip, RobotManip):
        raise MotionError(f"{call}: {manip.name} is an object frame; an arm is needed")
    return manip


def rccl_control(manip: Manip, *, clear_fault: bool = False, period_ms: float | None = None) -> None:
    """Turn a trajectory generator on: an arm is connected, gets power and stands; a frame is at the origin.

    Args:
        manip: from `rccl_open`.
        clear_fault: clear a latched fault of the arm first.
        period_ms: sample period, 1 to 100 ms, the same for all of a program; default the bridge's, 28 ms.

    Raises:
        LinkError, ServoFault, MotionError: as `control` of RCCL; or it is under control already.
    """
    _manip("rccl_control", manip).control(clear_fault, period_ms)


def rccl_release(manip: Manip, power_off: bool = False) -> None:
    """Let go of a manipulator: an arm comes to rest, and before it what it holds together with others."""
    chosen = _manip("rccl_release", manip)
    if isinstance(chosen, RobotManip):
        chosen.release(power_off)
    elif isinstance(chosen, ObjectFrame):
        chosen.release()


def move(manip: Manip, position: Position) -> None:
    """Queue a motion and return at once; motions that follow each other go through their positions.

    At the last one the manipulator stays where it was then; after `tracking_mode` it stays with a goal that moves.

    Raises:
        JointLimit, Unreachable, Singular: the position, or a straight way there, is not for this arm.
        MotionError: it cannot be done in that time, or is solved for another manipulator; or too many motions wait.
    """
    _manip("move", manip).move(position)


def stop(manip: Manip, position: Position | None = None, ms: float = 0.0) -> None:
    """Queue a stop and return at once: at `position`, or where the motions before it end, for at least `ms`.

    Raises what `move` raises.
    """
    (ms,) = numbers("stop", ms)
    if ms < 0.0:
        raise MotionError(f"stop({ms:g}): a stop takes no negative time")
    _manip("stop", manip).stop_at(position, ms)


def cancel(manip: Manip, ms: float = 0.0) -> None:
    """Forget all motions and come to rest, in at least `ms` where `Channel.stop` does; ours, not historical."""
    (ms,) = numbers("cancel", ms)
    _manip("cancel", manip).cancel(ms)


def maintain(manip: Manip, position: Position) -> None:
    """Be at `position` at once, and stay with it until something else is asked.

    Raises:
        MotionError: an arm is not there; move there first. Or a frame still moves.
    """
    _manip("maintain", manip).maintain(position)


def tracking_mode(manip: Manip) -> None:
    """Let the manipulator stay with the goal of its next motion, until another is asked for."""
    _manip("tracking_mode", manip).track()


def wait_for(event: Event) -> None:
    """Wait until `event` is signalled, and use up one signal.

    Raises:
        ServoFault, LinkError: control of one of the arms was lost; the others come to rest.
        MotionError: on virtual time, where nobody else could signal: no motion is left that would.
    """
    if not isinstance(event, Event):
        raise MotionError(f"wait_for: an event is needed, as the `completed` of a manipulator, not {event!r}")
    this_program().wait(event.take, event.name)


def wait_as(predicate: Callable[[], object]) -> None:
    """Wait until `predicate`, called at every sample, is true. Raises what `wait_for` raises."""
    require_function("wait_as", predicate)
    this_program().wait(lambda: bool(predicate()))


def grasp(manip: RobotManip) -> None:
    """Close the hand, now."""
    _arm("grasp", manip).channel.CLOSE()


def open_hand(manip: RobotManip) -> None:
    """Open the hand, now."""
    _arm("open_hand", manip).channel.OPEN()


P = ParamSpec("P")
R = TypeVar("R")


def update(manip: Manip, trsf: Trsf, position: Position) -> None:
    """Give `trsf`, when the arm's next motion ends, the value that makes the equation of `position` true there.

    Raises:
        MotionError: see `rccl.update`; or the position is solved for another manipulator.
    """
    arm = _arm("update", manip)
    arm.channel.update(trsf, goal_for("update", position, arm.trans, arm.name))


def teach(manip: Manip, trsf: Transform, position: Position, database: DataBase | None = None) -> int:
    """Let a person show a transform with one of the arms, in the terminal; see `teach_transform.teach`."""
    return teach_by(manip, trsf, position, database, input, print)


def teach_by(
    manip: Manip, trsf: Transform, position: Position, database: DataBase | None, ask: Prompt, say: Say
) -> int:
    """The same in a terminal of another process."""
    arm = _arm("teach", manip)
    return teach_arm(arm.channel, trsf, goal_for("teach", position, arm.trans, arm.name), database, ask, say)


def _parameter(call: Callable[Concatenate[Any, P], R]) -> Callable[Concatenate[Manip, P], R]:
    """A call of RCCL for the motions of one manipulator."""

    def of_manip(manip: Manip, /, *args: P.args, **kwargs: P.kwargs) -> R:
        name = call.__name__
        chosen = _manip(name, manip) if hasattr(MotionParameters, name) else _arm(name, manip)
        result: R = getattr(chosen.parameters, name)(*args, **kwargs)
        return result

    of_manip.__name__, of_manip.__doc__ = call.__name__, call.__doc__
    return of_manip


setmode = _parameter(MotionParameters.setmode)
setvel = _parameter(MotionParameters.setvel)
setjvel = _parameter(MotionParameters.setjvel)
setconf = _parameter(MotionParameters.setconf)
setime = _parameter(MotionParameters.setime)
evalfn = _parameter(MotionParameters.evalfn)
distance = _parameter(MotionParameters.distance)
limit = _parameter(MotionParameters.limit)
comply = _parameter(MotionParameters.comply)
lock = _parameter(MotionParameters.lock)
pose = _parameter(Channel.pose)
jposition = _parameter(Channel.jposition)
collision = _parameter(Channel.collision)
setload = _parameter(Channel.setload)
override = _parameter(Channel.override)
pause = _parameter(Channel.pause)
retract = _parameter(Channel.retract)
keep_path = _parameter(Channel.keep_path)
resume = _parameter(Channel.resume)


def kept(manip: RobotManip) -> str:
    """Reason for which an arm stands off a path that is kept, until somebody confirms that it may go back; or empty."""
    return _arm("kept", manip).channel.kept
