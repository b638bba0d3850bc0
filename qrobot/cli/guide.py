"""`qrobot guide`: an arm that is led by hand while a key of the terminal is held, and a recording of where it went."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from qrobot.cli.arms import DEFAULT_DEPLOYMENT, choose_arm
from qrobot.cli.console import complain, note, out
from qrobot.cli.jog import single_keys
from qrobot.cli.option_types import OutputFile, OutputTable, SmoothOption
from qrobot.errors import MotionError, QRobotError, error_text

if TYPE_CHECKING:
    from qrobot.rccl.database import DataBase
    from qrobot.rccl.guiding import GuidedArm


def guide(
    record: OutputTable | None = None,
    *,
    places: OutputFile | None = None,
    smooth: SmoothOption | None = None,
    deployment: str = DEFAULT_DEPLOYMENT,
    arm: str | None = None,
) -> None:
    """Lead the arm by hand while a key is held; what it did may be recorded, and played again.

    While the key is held the arm carries its own weight and most of its friction, is damped, slower than 250 mm/s at
    the tool, and stays within its range. When the key is let go it stops, and stays; when this program or its link
    hangs the servo stops it. A terminal tells no release of a key: the arm gives way from the first repeat of the key
    on, until 0.12 s after the last one came. This is no safety function: keep the emergency stop at hand. The recording
    is written whatever ends the command: q, Ctrl-C, a closed terminal, or an arm that is lost.

      g  HOLD to lead the arm      w  keep this place      q  quit

      qrobot guide lesson.csv --smooth 3
      qrobot replay lesson.csv --approach

    Parameters
    ----------
    record
        Write where the arm went to this file, `.csv` or `.parquet`: all that was led, joined, without what was between.
    places
        Data base of `qrobot teach` into which `w` puts the places, as P1, P2 and so on.
    smooth
        Smooth the recording, by at most so many mm at the flange and beside it.
    deployment
        Deployment file, or the name of a packaged one: tells where the bridge is.
    arm
        Which arm of the file; may be left out when there is only one.
    """
    from qrobot.cli.arm_links import link_of
    from qrobot.rccl.guiding import GuidedArm
    from qrobot.rccl.led_by_key import KEYS, LedByKey
    from qrobot.rig.interrupts import interrupted_by_signals

    chosen, kept = choose_arm(deployment, arm), None if places is None else _checked(places)
    say = lambda line: out.print(line, markup=False, soft_wrap=True)  # noqa: E731
    with interrupted_by_signals(), single_keys("guide") as keys:
        led = GuidedArm(link_of(chosen), chosen.robot)
        with _recorded(led, record, smooth):
            out.print(KEYS, markup=False)
            LedByKey(led, keys.read, say, kept).run()


def _checked(places: Path) -> DataBase:
    """The data base, in which places can be put. Raises ConfigError: better now than when the arm is in place."""
    from qrobot.rccl.database import DataBase

    kept = DataBase(places)
    kept.check()
    return kept


@contextmanager
def _recorded(led: GuidedArm, record: Path | None, smooth_mm: float | None) -> Iterator[None]:
    """Say goodbye to the arm at the end, and write what it was led through, whatever ends it."""
    try:
        with led:
            yield
    except BaseException:
        try:
            _write(led, record, smooth_mm)
        except (QRobotError, OSError) as error:
            complain(error_text(error))
        raise
    _write(led, record, smooth_mm)


def _write(led: GuidedArm, path: Path | None, smooth_mm: float | None) -> None:
    """Write the recording as it was led, and then a smoothed one in its place. Raises MotionError: there is none."""
    from qrobot.rccl.recordings import joined, smoothed
    from qrobot.rccl.setpoint_tables import write_setpoint_table
    from qrobot.units import M_PER_MM

    if path is None:
        return
    if not led.recordings:
        note("the arm was not led: nothing is written")
        return
    motion = joined(led.recordings, led.robot)
    path.parent.mkdir(parents=True, exist_ok=True)
    write_setpoint_table(path, motion)
    if smooth_mm is not None:
        try:
            motion = smoothed(motion, led.robot, smooth_mm * M_PER_MM)
        except MotionError as error:
            again = f"`qrobot replay {path} --smooth MM --save-as FILE`"
            raise MotionError(f"{error}; {path} has it as it was led, and {again} smooths that") from error
        write_setpoint_table(path, motion)
    note(f"wrote {path}: {motion.t[-1]:.1f} s")
