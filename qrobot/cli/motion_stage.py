"""An arm in a film: where it was, where its setpoints wanted it, and the way of its tool."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from qrobot.arrays import Floats
from qrobot.config import Robot
from qrobot.config.fences import Fence
from qrobot.log.animation import GHOST_COLOUR, GHOST_FROM_M, WAY_COLOUR
from qrobot.log.arm_drawing import SolidArm, put_faces, set_up_space, solid_faces
from qrobot.log.fence_drawing import draw_fences, near_points

_SIZE_IN: Final = (4.8, 4.8)


class MotionStage:
    """One square figure whose arm moves.

    Args:
        head: what stands above it.
        robot: the arm.
        times: s. Shape (rows,).
        q: where the arm was. Shape (rows, n).
        rows: those that will be shown.
        setpoints: where it was wanted, (rows, n); None for not drawn.
        fences: that stand round it.

    Attributes:
        figure: the figure.
        way: of the tool's tip, m, in the base; a place for each picture so far.
    """

    def __init__(
        self, head: str, robot: Robot, times: Floats, q: Floats, rows: NDArray[np.intp],
        setpoints: Floats | None = None, fences: Sequence[Fence] = (),
    ) -> None:  # fmt: skip
        self._head, self._arm, self._times = head, SolidArm(robot), times
        self._q, self._setpoints = q, q if setpoints is None else setpoints
        self.figure = Figure(figsize=_SIZE_IN)
        space: Any = self.figure.add_axes((-0.1, -0.12, 1.2, 1.18), projection="3d")
        self._body, self._shadow = solid_faces(space, 1.0), solid_faces(space, 0.22)
        self._line = space.plot([], [], [], color=WAY_COLOUR, linewidth=1.2)[0]
        self.way: list[Floats] = []
        places = [self._arm.tip(each) for each in q[rows[:: max(1, rows.size // 50)]]]
        set_up_space(space, self._arm, np.vstack([*places, *near_points(fences)]))
        draw_fences(space, fences)
        self._caption = self.figure.text(0.03, 0.94, "", fontsize=10, fontweight="bold", parse_math=False)

    def show(self, row: int) -> None:
        """Move everything to one row."""
        place, wanted = (self._arm.tip(each[row]) for each in (self._q, self._setpoints))
        put_faces(self._body, *self._arm.faces(self._q[row]))
        apart = float(np.linalg.norm(place - wanted)) > GHOST_FROM_M
        faces, colours = self._arm.faces(self._setpoints[row], GHOST_COLOUR)
        put_faces(self._shadow, faces if apart else faces[:0], colours if apart else colours[:0])
        self.way.append(place)
        self._line.set_data_3d(*np.array(self.way).T)
        self._caption.set_text(f"{self._head}   {self._times[row]:.2f} s")
