"""The film of a run of a program, drawn when it has ended: from its log, or of what it heard of its arm each sample."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from qrobot.arrays import Floats
from qrobot.cli.arms import robot_of_arm
from qrobot.cli.console import complain, err, note
from qrobot.config.deployment import DeployedArm
from qrobot.errors import LogError
from qrobot.fences.told_fences import told_fences
from qrobot.rci import Link, LinkFactory
from qrobot.rci.forwarding_link import ForwardingLink
from qrobot.units import NS_PER_S
from qrobot.wire import Command, State

if TYPE_CHECKING:
    from qrobot.log.animation import Progress

NOTHING: Final = (
    "no film: the program has heard of no arm by a bridge; `qrobot arcl animate` makes one of a stream of ARCL"
)


class Heard:
    """Samples that a program has heard of one arm: time, joints and setpoints."""

    def __init__(self) -> None:
        self._rows: list[tuple[int, tuple[float, ...], tuple[float, ...]]] = []

    def hear(self, state: State) -> None:
        """Another sample; one of a clock that began anew ends what was heard before."""
        robot = state.robot
        if self._rows and robot.t_ns < self._rows[-1][0]:
            self._rows.clear()
        self._rows.append((robot.t_ns, robot.q, robot.q_setpoint))

    def table(self, n: int) -> tuple[Floats, Floats, Floats]:
        """Times since the first sample, s (rows,); joints, and setpoints, rad or m (rows, n)."""
        t_ns = np.array([row[0] for row in self._rows], dtype=np.int64)
        q, setpoints = (np.array([row[k] for row in self._rows]).reshape(-1, n) for k in (1, 2))
        return (t_ns - t_ns[:1]) / NS_PER_S, q, setpoints

    def links(self, factory: LinkFactory) -> LinkFactory:
        """The same ways to an arm, heard."""
        return lambda hello: HeardLink(factory(hello), self)


class HeardLink(ForwardingLink):
    """A `Link` that keeps what is heard of the arm."""

    def __init__(self, link: Link, heard: Heard) -> None:
        super().__init__(link)
        self._heard = heard

    def exchange(self, command: Command | None) -> State:
        """See `Link.exchange`."""
        state = super().exchange(command)
        self._heard.hear(state)
        return state


@contextmanager
def filmed(make: Callable[[], None]) -> Iterator[None]:
    """Block behind which `make` makes a film, whatever ends it: `sys.exit` and Ctrl-C, too.

    Where the block fails its own error is raised, and what there is to say of the film is told.

    Raises:
        LogError: there is no film of a program that ended well.
    """
    try:
        yield
    except BaseException as error:
        try:
            make()
        except LogError as refused:
            if isinstance(error, SystemExit) and not error.code:
                raise
            complain(str(refused))
        raise
    make()


@contextmanager
def drawing_bar() -> Iterator[Progress]:
    """Show how far a film has been drawn, where there is a terminal."""
    from rich.progress import Progress as Bars

    with Bars(console=err, disable=not err.is_terminal) as bars:
        bar = bars.add_task("drawing", total=None)
        yield lambda done, of: bars.update(bar, completed=done, total=of)


def film_log(log: Path, film: Path) -> None:
    """Make the film of a log. Raises LogError."""
    from qrobot.log.animation import Film, write_animation
    from qrobot.log.read import read_log

    with drawing_bar() as progress:
        found = read_log(log)
        length_s = float(found.time_s[-1]) if found.rows.size else 0.0
        write_animation(found, film, Film.of_all(length_s), progress)
    note(f"the film is {film}")


def film_heard(heard: Heard, program: str, arm: DeployedArm, path: Path) -> None:
    """Make the film of what a program has heard of its arm. Raises LogError: of nothing, or it cannot be written."""
    from qrobot.cli.motion_stage import MotionStage
    from qrobot.log.animation import Film, write_film

    robot = robot_of_arm(arm)
    times, q, setpoints = heard.table(robot.n)
    if not times.size:
        raise LogError(NOTHING)
    told = told_fences(arm, robot)
    film = Film.of_all(float(times[-1]))
    rows: NDArray[np.intp] = film.rows(times, program)
    fences = () if told is None else told.fences
    make = lambda: MotionStage(f"{program}   {robot.name}", robot, times, q, rows, setpoints, fences)  # noqa: E731
    with drawing_bar() as progress:
        write_film(path, film, rows, make, progress)
    note(f"the film is {path}")
