"""The teach pendant of a terminal, for programs that lend their arm to one: the keys of `qrobot jog`, and ENTER."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from qrobot.arrays import Floats
from qrobot.cli.console import out
from qrobot.cli.jog import PERIOD_MS, single_keys
from qrobot.config import Robot
from qrobot.rci import LinkFactory
from qrobot.units import MM_PER_M, RAD_PER_DEG

KEY_LINES = """\
ENTER       take where the arm is
q           go on with the program"""


def terminal_pendant(links: LinkFactory, robot: Robot, learn: Callable[[Floats], bool]) -> None:
    """See `TeachPendant`."""
    with single_keys("run") as keys:
        teach_by_keys(links, robot, learn, keys.read, lambda line: out.print(line, markup=False, soft_wrap=True))


def teach_by_keys(
    links: LinkFactory,
    robot: Robot,
    learn: Callable[[Floats], bool],
    read_keys: Callable[[], str],
    tell: Callable[[str], None],
) -> None:
    """Let keys move the arm until `q`; see `HeldJog` for `read_keys` and `tell`, `TeachPendant` for the others."""
    from qrobot.rccl.connect import open_channel
    from qrobot.rccl.hold_to_run import MOVING_KEYS, HeldJog

    per_unit = np.where(robot.prismatic, 1.0 / MM_PER_M, RAD_PER_DEG)
    with open_channel(links, robot, PERIOD_MS) as channel:
        tell(f"{MOVING_KEYS}\n{KEY_LINES}")

        def press() -> bool:
            return learn(channel.joints * per_unit)

        HeldJog(channel, read_keys, tell, {"\n": press, "\r": press}).run()
