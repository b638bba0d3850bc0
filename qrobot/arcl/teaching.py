"""One `teach`: what the operator's ENTER brings to a function of the program (Corke & Kirkham, section 2.9)."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from qrobot.arcl.errors import answer_of
from qrobot.arcl.events import CallbackAnswer
from qrobot.arcl.trans import new_trans_value
from qrobot.arrays import Floats
from qrobot.config import Robot
from qrobot.rci.link import LinkFactory
from qrobot.rci.machine_choice import TeachPendant

if TYPE_CHECKING:
    from qrobot.arcl.robot import ArclRobot


class Teaching:
    """Keeps what goes wrong until the program has its arm again.

    Args:
        rp: the robot that is taught.
        function: of the program, called with T6 and the robot.
    """

    def __init__(self, rp: ArclRobot, function: Callable[..., object]) -> None:
        self._rp, self._function = rp, function
        self._presses = 0
        self._error: BaseException | None = None

    def give(self, pendant: TeachPendant, links: LinkFactory, robot: Robot) -> None:
        """Let a person move the arm until he has done, or something goes wrong."""
        try:
            pendant(links, robot, self._learn)
        except BaseException as error:
            self._error = error

    def end(self) -> int:
        """The number of presses of ENTER. Raises what went wrong."""
        if self._error is not None:
            raise self._error
        return self._presses

    def _learn(self, q: Floats) -> bool:
        """Tell the function where the arm is, joint positions of the robot file (n,); true when it wants no more."""
        self._presses += 1
        aki = self._rp.aki
        T6 = new_trans_value(f"T{self._presses}", aki.forward(q - aki.zero))
        return answer_of(self._function(T6, self._rp)) is CallbackAnswer.MOVE_STOP
