"""The calls and variables of RCCL for the arm that the program controls; with several arms use their `Channel`s."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from functools import wraps
from inspect import signature
from typing import Any, Concatenate, Final, ParamSpec, TypeVar

from qrobot.errors import LinkError
from qrobot.motion import Blend
from qrobot.rccl.arm_session import ArmSession, ended_well
from qrobot.rccl.channel import Channel
from qrobot.rccl.connect import open_channel
from qrobot.rccl.database import DataBase
from qrobot.rccl.position import Position
from qrobot.rccl.teach_transform import teach as teach_arm
from qrobot.rccl.trace import Trace
from qrobot.rccl.transforms import Transform
from qrobot.rci import Link, LinkFactory, TcpLink, bridge_address
from qrobot.rci.descriptor import HOST
from qrobot.wire import Hello

VARIABLES: Final[dict[str, Callable[[Channel], Any]]] = {
    "completed": lambda arm: arm.completed,
    "nbrequest": lambda arm: arm.nbrequest,
    "how": lambda arm: arm.how,
    "chg": lambda arm: arm.chg,
    "kept": lambda arm: arm.kept,
    "park": lambda arm: arm.pose("park"),
    "there": lambda arm: arm.there,
    "joints": lambda arm: arm.joints,
    "time": lambda arm: arm.time,
    "exerted": lambda arm: arm.exerted,
    "overruns": lambda arm: arm.overruns,
}
"""RCCL's global variables, and properties of ours beside them, of one arm."""


def _tcp_link(hello: Hello) -> Link:
    return TcpLink(hello, bridge_address())


_factory: ContextVar[LinkFactory] = ContextVar("link_factory", default=_tcp_link)
_traces: ContextVar[list[Trace] | None] = ContextVar("traces", default=None)
_arm: Channel | None = None


@contextmanager
def use(factory: LinkFactory, traces: list[Trace] | None = None) -> Iterator[None]:
    """Programs run in this context reach their robot by the links that `factory` makes.

    For each time they take control of an arm, a trace of what they do with it is added to `traces`. Programs of
    Multi-RCCL and RCI take their links from `rci.use`: here they would reach the arms that run.
    """
    token, traces_token = _factory.set(factory), _traces.set(traces)
    try:
        yield
    finally:
        _factory.reset(token)
        _traces.reset(traces_token)


def traces_wanted() -> list[Trace] | None:
    """The list to which traces of arms are added, None where nobody wants any."""
    return _traces.get()


@contextmanager
def ending() -> Iterator[None]:
    """A program runs in this block: when it ends well its motions are done first, else its arms stop; all are released.

    Raises what a motion ends with that cannot be done.
    """
    try:
        yield
    except BaseException as error:
        ArmSession.end_all(ended_well(error))
        raise
    ArmSession.end_all(well=True)


def control(
    robot: str = "puma560",
    *,
    period_ms: float | None = None,
    clear_fault: bool = False,
    blend: Blend = Blend.QUARTIC,
    processor: str = HOST,
) -> Channel:
    """Take control of a robot: connect, ask for power, stream setpoints from where it stands.

    Args:
        robot: name of a packaged robot, or path of a robot file.
        period_ms: sample period, 1 to 100 ms; default the bridge's (28 ms).
        clear_fault: clear a latched fault first. Power-up after a fault never happens unasked.
        blend: polynomial of the transitions.
        processor: where the trajectory generator runs: "host", a thread of this program; "aux", a process of its own
            that shares the program's transforms; "cpu0", "cpu1" ..., the same, kept on that processor of this machine.
            In a process it answers the robot whatever holds this program's interpreter, and calls no function of the
            program: `each_sample`, `evalfn` and transforms with functions are refused. On virtual time it is always a
            part of the program, and they are refused all the same.

    Raises:
        ConfigError: no such robot, or no such processor.
        LinkBusy: somebody else commands it, or has that processor.
        LinkError: no bridge, another robot, or no answer (`LinkTimeout`, `LinkLost`).
        ServoFault: the servo is in a fault, or power does not come.
        MotionError: the arm is not calibrated, or no such period.
    """
    global _arm  # noqa: PLW0603 (the papers' calls name no arm)
    _arm = open_channel(_factory.get(), robot, period_ms, clear_fault, blend, _traces.get(), processor=processor)
    return _arm


def release(power_off: bool = False) -> None:
    """Let go of the arm; see `Channel.release`. Does nothing when there is none."""
    global _arm
    channel, _arm = _arm, None
    if channel is not None:
        channel.release(power_off)


def arm() -> Channel:
    """The arm under control. Raises LinkError when there is none."""
    if _arm is None:
        raise LinkError("no arm is under control; call control() first")
    return _arm


P = ParamSpec("P")
R = TypeVar("R")


def _of_the_arm(call: Callable[Concatenate[Channel, P], R]) -> Callable[P, R]:
    """A call of the arm under control: what the method of `Channel` does, with its arguments and its docstring."""

    @wraps(call)
    def of_the_arm(*args: P.args, **kwargs: P.kwargs) -> R:
        return call(arm(), *args, **kwargs)

    _, *arguments = signature(call).parameters.values()  # all but `self`
    of_the_arm.__dict__["__signature__"] = signature(call).replace(parameters=arguments)
    return of_the_arm


finish = _of_the_arm(Channel.finish)
jposition = _of_the_arm(Channel.jposition)
pose = _of_the_arm(Channel.pose)
setmode = _of_the_arm(Channel.setmode)
setvel = _of_the_arm(Channel.setvel)
setjvel = _of_the_arm(Channel.setjvel)
setconf = _of_the_arm(Channel.setconf)
sample = _of_the_arm(Channel.sample)
setime = _of_the_arm(Channel.setime)
evalfn = _of_the_arm(Channel.evalfn)
distance = _of_the_arm(Channel.distance)
each_sample = _of_the_arm(Channel.each_sample)
limit = _of_the_arm(Channel.limit)
comply = _of_the_arm(Channel.comply)
lock = _of_the_arm(Channel.lock)
update = _of_the_arm(Channel.update)
move = _of_the_arm(Channel.move)
stop = _of_the_arm(Channel.stop)
override = _of_the_arm(Channel.override)
pause = _of_the_arm(Channel.pause)
resume = _of_the_arm(Channel.resume)
keep_path = _of_the_arm(Channel.keep_path)
retract = _of_the_arm(Channel.retract)
collision = _of_the_arm(Channel.collision)
nextmove = _of_the_arm(Channel.nextmove)
waitfor = _of_the_arm(Channel.waitfor)
waitas = _of_the_arm(Channel.waitas)
OPEN = _of_the_arm(Channel.OPEN)
CLOSE = _of_the_arm(Channel.CLOSE)
signal = _of_the_arm(Channel.signal)
analog = _of_the_arm(Channel.analog)
log_signal = _of_the_arm(Channel.log_signal)
setload = _of_the_arm(Channel.setload)


def teach(trsf: Transform, position: Position, database: DataBase | None = None) -> int:
    """Let a person show a transform, in the terminal; see `teach_transform.teach`."""
    return teach_arm(arm(), trsf, position, database)
