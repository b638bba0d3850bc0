"""The calls and variables of RCCL for the arm that the program controls; with several arms use their `Channel`s."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any, Final

from qrobot.errors import LinkError
from qrobot.motion import Blend, Trsf
from qrobot.rccl.arm_session import Hold, ended_well
from qrobot.rccl.channel import YES, Channel
from qrobot.rccl.connect import open_channel
from qrobot.rccl.database import DataBase
from qrobot.rccl.event import Event
from qrobot.rccl.position import Position
from qrobot.rccl.teach_transform import teach as teach_arm
from qrobot.rccl.trace import Trace
from qrobot.rccl.transforms import Transform
from qrobot.rci import Link, LinkFactory, TcpLink, bridge_address
from qrobot.wire import Hello

VARIABLES: Final[dict[str, Callable[[Channel], Any]]] = {
    "completed": lambda arm: arm.completed,
    "nbrequest": lambda arm: arm.nbrequest,
    "how": lambda arm: arm.how,
    "chg": lambda arm: arm.chg,
    "park": lambda arm: arm.pose("park"),
    "there": lambda arm: arm.there,
}
"""RCCL's global variables, of one arm."""


def _tcp_link(hello: Hello) -> Link:
    return TcpLink(hello, bridge_address())


_factory: ContextVar[LinkFactory] = ContextVar("link_factory", default=_tcp_link)
_traces: ContextVar[list[Trace] | None] = ContextVar("traces", default=None)
_arm: Channel | None = None


@contextmanager
def use(factory: LinkFactory, traces: list[Trace] | None = None) -> Iterator[None]:
    """Programs run in this context reach their robot by the links that `factory` makes.

    For each time they take control of an arm, a trace of what they do with it is added to `traces`.
    """
    token, traces_token = _factory.set(factory), _traces.set(traces)
    try:
        yield
    finally:
        _factory.reset(token)
        _traces.reset(traces_token)


@contextmanager
def ending() -> Iterator[None]:
    """A program runs in this block: when it ends well its motions are done first, else its arms stop; all are released.

    Raises what a motion ends with that cannot be done.
    """
    try:
        yield
    except BaseException as error:
        Hold.end_all(ended_well(error))
        raise
    Hold.end_all(well=True)


def control(
    robot: str = "puma560",
    *,
    period_ms: float | None = None,
    clear_fault: bool = False,
    blend: Blend = Blend.QUARTIC,
) -> Channel:
    """Take control of a robot: connect, ask for power, stream setpoints from where it stands.

    Args:
        robot: name of a packaged robot, or path of a robot file.
        period_ms: sample period, 1 to 100 ms; default the bridge's (28 ms).
        clear_fault: clear a latched fault first. Power-up after a fault never happens unasked.
        blend: polynomial of the transitions.

    Raises:
        ConfigError: no such robot.
        LinkBusy: somebody else commands it.
        LinkError: no bridge, another robot, or no answer (`LinkTimeout`, `LinkLost`).
        ServoFault: the servo is in a fault, or power does not come.
        MotionError: the arm is not calibrated, or no such period.
    """
    global _arm  # noqa: PLW0603 (the papers' calls name no arm)
    _arm = open_channel(_factory.get(), robot, period_ms, clear_fault, blend, _traces.get())
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


def jposition(name: str, degs: Sequence[float]) -> Position:
    """A position given by its joints; see `Channel.jposition`."""
    return arm().jposition(name, degs)


def pose(name: str) -> Position:
    """A pose of the robot's file; see `Channel.pose`."""
    return arm().pose(name)


def setmode(mode: str, turn: str = "axis") -> None:
    """Joint or Cartesian mode of the following motions; see `Channel.setmode`."""
    arm().setmode(mode, turn)


def setvel(tv: float, rv: float) -> None:
    """Speed of the controlled frame, mm/s and degrees/s; see `Channel.setvel`."""
    arm().setvel(tv, rv)


def setconf(letters: str) -> None:
    """Configuration of the following motions; see `Channel.setconf`."""
    arm().setconf(letters)


def sample(ms: float) -> None:
    """Sample period of the following motions, ms; see `Channel.sample`."""
    arm().sample(ms)


def evalfn(function: Callable[[], object]) -> None:
    """A function called at each sample of the next motion; see `Channel.evalfn`."""
    arm().evalfn(function)


def distance(spec: str, *values: float) -> None:
    """Modify the goal of the next motion; see `Channel.distance`."""
    arm().distance(spec, *values)


def comply(dirs: str, *values: float) -> None:
    """Give way along directions, exerting forces, until they are locked; see `Channel.comply`."""
    arm().comply(dirs, *values)


def lock(dirs: str) -> None:
    """Hold position again along directions; see `Channel.lock`."""
    arm().lock(dirs)


def limit(spec: str, *values: float) -> None:
    """Forces and displacements that end the next motion; see `Channel.limit`."""
    arm().limit(spec, *values)


def update(trsf: Trsf, position: Position) -> None:
    """Measure a transform when the next motion ends or is interrupted; see `Channel.update`."""
    arm().update(trsf, position)


def teach(trsf: Transform, position: Position, database: DataBase | None = None) -> int:
    """Let a person show a transform, in the terminal; see `lesson.teach`."""
    return teach_arm(arm(), trsf, position, database)


def setime(ta: float, ts: float) -> None:
    """Times of the next motion alone, ms; see `Channel.setime`."""
    arm().setime(ta, ts)


def setjvel(speed: float | None = None, *, share: float | None = None) -> None:
    """Speed of the following motions; see `Channel.setjvel`."""
    arm().setjvel(speed, share=share)


def move(position: Position) -> None:
    """Queue a motion; see `Channel.move`."""
    arm().move(position)


def stop(ms: float = 0.0) -> None:
    """Forget all motions and come to rest; see `Channel.stop`."""
    arm().stop(ms)


def nextmove(code: int = YES) -> None:
    """Interrupt the present motion; see `Channel.nextmove`."""
    arm().nextmove(code)


def waitfor(event: Event) -> None:
    """Wait until an event is signalled; see `Channel.waitfor`."""
    arm().waitfor(event)


def waitas(predicate: Callable[[], object]) -> None:
    """Wait until a predicate is true; see `Channel.waitas`."""
    arm().waitas(predicate)


def OPEN() -> None:  # noqa: N802 (RCCL's name)
    """Open the hand, now."""
    arm().OPEN()


def CLOSE() -> None:  # noqa: N802 (RCCL's name)
    """Close the hand, now."""
    arm().CLOSE()


def signal(*lines: int) -> None:
    """Switch binary outputs, now; see `Channel.signal`."""
    arm().signal(*lines)
