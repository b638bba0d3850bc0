"""`qrobot guide`: an arm that is led by hand while a key of the terminal is held, and a recording of where it went."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from qrobot.cli.arms import DEFAULT_DEPLOYMENT, choose_arm
from qrobot.cli.console import note, out
from qrobot.cli.jog import single_keys
from qrobot.cli.option_types import OutputFile, SmoothOption

if TYPE_CHECKING:
    from collections.abc import Sequence

    from qrobot.config import Robot
    from qrobot.rccl.setpoints import Setpoints


def guide(
    record: OutputFile | None = None,
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
    on, until 0.12 s after the last one came. This is no safety function: keep the emergency stop at hand.

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
    from qrobot.rccl.database import DataBase
    from qrobot.rccl.guiding import GuidedArm
    from qrobot.rccl.led_by_key import KEYS, LedByKey

    chosen = choose_arm(deployment, arm)
    say = lambda line: out.print(line, markup=False, soft_wrap=True)  # noqa: E731
    with single_keys("guide") as keys, GuidedArm(link_of(chosen), chosen.robot) as led:
        out.print(KEYS, markup=False)
        LedByKey(led, keys.read, say, None if places is None else DataBase(places)).run()
    if record is not None:
        _write(record, led.recordings, led.robot, smooth)


def _write(path: Path, parts: Sequence[Setpoints], robot: Robot, smooth_mm: float | None) -> None:
    from qrobot.rccl.recordings import joined, smoothed
    from qrobot.rccl.setpoint_tables import write_setpoint_table
    from qrobot.units import M_PER_MM

    if not parts:
        note("the arm was not led: nothing is written")
        return
    motion = joined(parts, robot)
    if smooth_mm is not None:
        motion = smoothed(motion, robot, smooth_mm * M_PER_MM)
    write_setpoint_table(path, motion)
    note(f"wrote {path}: {motion.t[-1]:.1f} s")
