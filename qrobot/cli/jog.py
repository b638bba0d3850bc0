"""`qrobot jog`: an arm that moves while a key of the terminal is held."""

from __future__ import annotations

import os
import select
import sys
import termios
import tty
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Final

from qrobot.cli.arms import DEFAULT_DEPLOYMENT, choose_arm, inside_fences
from qrobot.cli.console import out
from qrobot.errors import ConfigError
from qrobot.realtime.signals import ends_as_ctrl_c

if TYPE_CHECKING:
    from qrobot.config.deployment import DeployedArm
    from qrobot.rccl.transforms import Transform
    from qrobot.rci import LinkFactory

PERIOD_MS: Final = 28.0  # the servo must hear of the key every 70 ms
MOST_CHARACTERS: Final = 256


@ends_as_ctrl_c()
def jog(
    *,
    offline: bool = False,
    stick: str | None = None,
    frame: str | None = None,
    deployment: str = DEFAULT_DEPLOYMENT,
    arm: str | None = None,
) -> None:
    """Move one joint, or along or about one axis, as long as a key is held.

    A terminal tells no release of a key: the arm moves from the first repeat of the key on, and is braked 0.12 s after
    the last one came. When this program or its link hangs the servo stops the arm. This is no safety function: keep the
    emergency stop at hand.

      1 2 ...  joint                  b t n  axes of base, last link, frame
      x y z    along an axis          . ,    HOLD to move one way, the other
      u v w    about it               f s    faster, slower
      q        quit

    With `--stick` a gamepad or a SpaceMouse moves it: hold the left shoulder button, or the first button, and draw a
    stick, the further the faster. The other of these buttons changes the axes; Ctrl-C quits.

    Parameters
    ----------
    stick
        Device of Linux input, such as /dev/input/event5; needs python-evdev.
    frame
        FILE:NAME of a taught transform, such as parts.db:TABLE; the key n chooses its axes.
    offline
        On an ideal arm inside this process, on virtual time.
    deployment
        Deployment file, or the name of a packaged one: tells where the bridge is.
    arm
        Which arm of the file; may be left out when there is only one.
    """
    from qrobot.cli.arm_links import link_of
    from qrobot.rccl.connect import open_channel
    from qrobot.rccl.hold_to_run import KEYS, HeldJog

    if stick is not None and frame is not None:
        raise ConfigError("--frame does not go with --stick: a stick has no key n to choose its axes; leave one out")
    chosen = choose_arm(deployment, arm)
    factory = link_of(chosen, offline)
    if stick is not None:
        _jog_by_stick(Path(stick), chosen, factory)
        return
    named = None if frame is None else _named_frame(frame)
    keys_of = single_keys("jog")
    with keys_of as keys, inside_fences(chosen), open_channel(factory, chosen.robot, PERIOD_MS) as channel:
        out.print(KEYS, markup=False)
        HeldJog(channel, keys.read, lambda line: out.print(line, markup=False, soft_wrap=True), frame=named).run()


def _named_frame(told: str) -> Transform:
    """The transform FILE:NAME. Raises ConfigError: there is none."""
    from qrobot.rccl.database import DataBase

    file, colon, name = told.rpartition(":")
    if not (file and colon and name):
        raise ConfigError(f"--frame {told}: say file and name, as in parts.db:TABLE")
    return DataBase(Path(file)).get(name)


def _jog_by_stick(path: Path, chosen: DeployedArm, factory: LinkFactory) -> None:
    from qrobot.cli.stick_device import open_stick
    from qrobot.rccl.connect import open_channel
    from qrobot.rccl.held_stick import StickJog

    device = open_stick(path)
    tell = lambda line: out.print(line, markup=False, soft_wrap=True)  # noqa: E731
    with inside_fences(chosen), open_channel(factory, chosen.robot, PERIOD_MS) as channel:
        StickJog(channel, device.layout, device.read, tell).run()


class TerminalKeys:
    """Characters of a terminal, as they are typed. The end of the input reads as q."""

    def __init__(self, fd: int) -> None:
        self._fd = fd

    def read(self) -> str:
        """Keys typed since the last call; never waits."""
        if not select.select([self._fd], [], [], 0)[0]:
            return ""
        return os.read(self._fd, MOST_CHARACTERS).decode("ascii", "replace") or "q"


@contextmanager
def single_keys(command: str) -> Iterator[TerminalKeys]:
    """Read the terminal key by key inside; Ctrl-C works as ever. Raises ConfigError when there is no terminal."""
    if not sys.stdin.isatty():
        raise ConfigError(f"qrobot {command} needs a terminal, whose keys repeat while they are held; try qrobot teach")
    fd = sys.stdin.fileno()
    before = termios.tcgetattr(fd)
    tty.setcbreak(fd)
    try:
        yield TerminalKeys(fd)
    finally:
        termios.tcsetattr(fd, termios.TCSADRAIN, before)
