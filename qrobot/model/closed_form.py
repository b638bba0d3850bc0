"""Inverse kinematics in closed form: the arms that have one, and the kernels that give it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, NamedTuple

from qrobot.model.puma import puma_branch, puma_inverse, puma_inverse_all
from qrobot.model.stanford import stanford_branch, stanford_inverse, stanford_inverse_all


class ClosedForm(NamedTuple):
    """Kernels of one family of arms; see `model.puma` for their arguments."""

    inverse: Callable[..., int]
    inverse_all: Callable[..., None]
    branch: Callable[..., int]


CLOSED_FORMS: Final[dict[str, ClosedForm]] = {
    "puma": ClosedForm(puma_inverse, puma_inverse_all, puma_branch),
    "stanford": ClosedForm(stanford_inverse, stanford_inverse_all, stanford_branch),
}
"""By the `family` of the robot file."""
