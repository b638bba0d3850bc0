"""`qrobot arcl`: what is in the streams of ARCL programs, as text and as tables."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import App, Parameter

from qrobot.cli.console import note
from qrobot.cli.option_types import OutputArrays, OutputFilm, Range
from qrobot.errors import LogError
from qrobot.printable import printable

if TYPE_CHECKING:
    from qrobot.arcl.stream import Stream
    from qrobot.arcl.stream.tables import TrajectoryTable

HELP = """
Look at the streams that ARCL programs leave behind.

`qrobot run --offline PROGRAM` writes one for each robot that the program opens. Of a stream that is cut or damaged
each command gives what is whole, says where that ends, and exits with status 1.
"""

Orientation = Literal["rpy", "euler", "oat", "rotvec", "quat", "matrix"]

app = App(name="arcl", help=HELP, help_format="plaintext", group_commands="Commands")


@app.command
def unstream(file: Path) -> None:
    """Print a stream, a line for each record: degrees, millimetres, seconds.

    Parameters
    ----------
    file
        The stream.
    """
    from qrobot.arcl.stream import stream_lines

    with _whole(file) as stream:
        for line in stream_lines(stream):
            print(printable(line))


@app.command
def jtraj(file: Path, *, output: OutputArrays | None = None, measured: bool = False) -> None:
    """Joint setpoints as a table: seconds and degrees (mm on a sliding joint).

    Parameters
    ----------
    file
        The stream.
    output
        File to write: .csv, .parquet, .npy, .npz or .mat (MATLAB); default the terminal.
    measured
        Measured joint positions instead of setpoints.
    """
    from qrobot.arcl.stream import joint_table

    with _whole(file) as stream:
        _give(joint_table(stream, measured), output)


@app.command
def ctraj(
    file: Path,
    *,
    output: OutputArrays | None = None,
    orientation: Annotated[Orientation, Parameter(name="--as")] = "rpy",
) -> None:
    """Cartesian setpoints as a table: seconds, T6 in millimetres, and its orientation.

    Parameters
    ----------
    file
        The stream.
    output
        File to write: .csv, .parquet, .npy, .npz or .mat (MATLAB); default the terminal.
    orientation
        Roll, pitch and yaw; Euler angles; VAL's O, A and T; rotation vector (all degrees); quaternion; or n, o and a.
    """
    from qrobot.arcl.stream import cartesian_table

    with _whole(file) as stream:
        _give(cartesian_table(stream, orientation), output)


@app.command
def torques(file: Path, *, robot: str | None = None, output: OutputArrays | None = None) -> None:
    """Joint torques of the rigid body that follows the setpoints: seconds and newton-metres (newtons).

    Gravity, inertia and rotors count, friction does not.

    Parameters
    ----------
    file
        The stream.
    robot
        Robot file, or name of a packaged robot; default the stream's.
    output
        File to write: .csv, .parquet, .npy, .npz or .mat (MATLAB); default the terminal.
    """
    from qrobot.arcl.stream.torques import torque_table
    from qrobot.config import load_robot

    with _whole(file) as stream:
        _give(torque_table(stream, load_robot(robot or stream.start.robot)), output)


@app.command
def animate(
    file: Path,
    *,
    output: OutputFilm | None = None,
    robot: str | None = None,
    speed: Annotated[float, Parameter(validator=Range(0.01, 1000.0))] = 1.0,
    frames: Annotated[int, Parameter(name="--fps", validator=Range(1, 60))] = 12,
    width: Annotated[int, Parameter(validator=Range(240, 3840, "pixels"))] = 480,
) -> None:
    """Make a film of a stream: the arm in three dimensions and the way of its tool. No screen is needed.

    Parameters
    ----------
    file
        The stream.
    output
        The film, `.gif`, or `.mp4` where ffmpeg is installed; beside the stream if left out.
    robot
        Robot file, or name of a packaged robot; default the stream's.
    speed
        Seconds of the stream in one second of the film.
    frames
        Pictures a second.
    width
        Of the film, in pixels; it is as high.
    """
    from qrobot.cli.stream_film import write_stream_film
    from qrobot.config import load_robot
    from qrobot.log.animation import Film

    target = output or file.parent / f"{file.stem}.gif"
    with _whole(file) as stream:
        film = Film(speed=speed, frames_hz=frames, width=width)
        write_stream_film(stream, load_robot(robot or stream.start.robot), target, film)
        note(f"the film is {target}")


@contextmanager
def _whole(file: Path) -> Iterator[Stream]:
    """The stream. Raises LogError behind the block, when what is whole is out, if the stream is cut or damaged."""
    from qrobot.arcl.stream import read_stream

    stream = read_stream(file)
    yield stream
    if stream.damage:
        raise LogError(f"{file}: {stream.damage}")


def _give(table: TrajectoryTable, output: Path | None) -> None:
    from qrobot.arcl.stream.tables import table_text, write_table

    if output is None:
        print(table_text(table), end="")
        return
    write_table(table, output)
    note(f"{len(table['t_s'])} rows are in {output}")
